//! The error of a calibration on views it did not see: k-fold cross-validation of the rectification.

use nalgebra::Vector2;

use super::BoardView;
use crate::camera::{AlignedFrame, StereoCalibration};
use crate::error::{Error, Result};

/// Which views one fit leaves out: every `step`-th from `first` of those that both cameras saw.
struct Fold {
    first: usize,
    step: usize,
}

impl Fold {
    /// (views to fit, views left out); views of one camera, which have no rows to compare, are always fitted.
    fn split(&self, views: &[BoardView]) -> (Vec<BoardView>, Vec<BoardView>) {
        let mut pairs = 0;
        views.iter().cloned().partition(|view| {
            let place = pairs;
            let is_pair = view.common().next().is_some();
            pairs += usize::from(is_pair);
            !is_pair || place % self.step != self.first
        })
    }
}

/// Fits all views, and parts of them to measure the rest: the result carries its held-out epipolar error.
pub(super) fn fit_and_test(
    views: &[BoardView],
    folds: usize,
    fit: impl Fn(&[BoardView]) -> Result<StereoCalibration>,
) -> Result<StereoCalibration> {
    let mut calibration = fit(views)?;
    let pairs = views.iter().filter(|view| view.common().next().is_some()).count();
    calibration.epipolar_error_px = mean_error_px(pairs, folds, |fold| {
        let (train, test) = fold.split(views);
        epipolar_error_px(&fit(&train)?, &test)
    });
    Ok(calibration)
}

/// Mean |vertical disparity| over all left-out corners of all folds, pixels.
///
/// `evaluate` fits without a fold's views and returns (sum of errors, corners) over them. NaN if there are fewer
/// than three views, no folds are wanted, or a part of the views is too little to fit from.
fn mean_error_px(views: usize, folds: usize, evaluate: impl Fn(&Fold) -> Result<(f64, usize)>) -> f64 {
    const MIN_VIEWS: usize = 3;
    const MIN_VIEWS_PER_FOLD: usize = 4;
    if folds == 0 || views < MIN_VIEWS {
        return f64::NAN;
    }
    let step = if views < MIN_VIEWS_PER_FOLD * folds { views } else { folds.max(2) };
    let total = (0..step).try_fold((0.0, 0), |(sum, corners), first| {
        evaluate(&Fold { first, step }).map(|(s, c)| (sum + s, corners + c))
    });
    total.map_or(f64::NAN, |(sum, corners)| sum / corners as f64)
}

/// (Sum of |vertical disparity| after rectification, number of corners) over views, pixels.
fn epipolar_error_px(calibration: &StereoCalibration, views: &[BoardView]) -> Result<(f64, usize)> {
    let frame = AlignedFrame::of(&calibration.right_from_left)?;
    let focal_px = AlignedFrame::common_focal_px(&calibration.left, &calibration.right);
    let (mut sum, mut corners) = (0.0, 0);
    for view in views {
        for (left, right) in view.common() {
            let ideal = calibration
                .left
                .normalised_from_pixel(Vector2::from(*left))
                .zip(calibration.right.normalised_from_pixel(Vector2::from(*right)));
            let Some((left, right)) = ideal else {
                let reason = "the distortion has no inverse at a corner of a held-out view";
                return Err(Error::degenerate("held-out error", reason));
            };
            sum += focal_px * (frame.align_left(left).y - frame.align_right(right).y).abs();
            corners += 1;
        }
    }
    Ok((sum, corners))
}
