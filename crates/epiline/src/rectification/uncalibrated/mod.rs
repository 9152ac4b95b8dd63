//! Alignment without calibration: quasi-Euclidean rectification from the pair's own matches.
//!
//! Each camera is turned, and as much of the lenses as is unknown is estimated, so that matched points come to lie on
//! one row (after Fusiello & Irsara, "Quasi-Euclidean epipolar rectification of uncalibrated images", 2011, with lens
//! distortion and priors). What the matches cannot carry is said in words, never aligned in silence.

mod consensus;
mod rig;
mod solver;
mod trust;
mod view;

use nalgebra::{Matrix3, Vector2};

use self::rig::{Lenses, Match, Rig, Unknowns};
use self::view::View;
use super::alignment::{AlignmentMeter, AlignmentOptions, PointMatch};
use crate::camera::CameraModel;
use crate::error::Result;
use crate::image::{Image, ImageRef};

/// Fewest candidates from which a first rig is sought.
const MIN_CANDIDATES: usize = 16;
/// Best first rigs from which every later fit starts, beside the last fit.
const KEPT_STARTS: usize = 2;
/// Times that matches are sought anew in the images aligned so far.
const ROUNDS: usize = 2;
/// Rows up and down that are looked at then, pixels.
const OFFSETS_PX: [usize; ROUNDS] = [8, 4];

/// Features no farther apart than this, in x and y, are one, pixels.
const SAME_FEATURE_PX: f64 = 3.0;

/// A pair aligned by its own content.
#[derive(Debug, Clone, PartialEq)]
pub struct PairAlignment {
    /// Aligned images: left, right. The photographs themselves if nothing could be estimated.
    pub images: [Image<u8>; 2],
    /// Where they have a source (255) and where not (0).
    pub valid: [Image<u8>; 2],
    /// Map pixels of the photographs, freed of lens distortion, to pixels of the aligned images.
    pub homographies: [Matrix3<f64>; 2],
    /// The lenses: those given, or the estimate.
    pub cameras: Option<[CameraModel; 2]>,
    /// Rotate directions of each camera into the aligned frame.
    pub aligned_from_camera: [Matrix3<f64>; 2],
    /// Median vertical disparity of matches that the fit did not see (halves fitted in turn), pixels; NaN if none.
    pub epipolar_error_px: f64,
    /// Vertical error that nine tenths of the view stay below by the fit's own account (one sigma), pixels.
    pub sigma_px: f64,
    /// The matches that the fit rests on, pixels of the photographs: left, right.
    pub matches: Vec<[[f64; 2]; 2]>,
    /// Why the alignment must not be trusted; empty if it can be.
    pub reasons: Vec<String>,
}

impl PairAlignment {
    /// Whether nothing speaks against the alignment.
    pub fn is_trusted(&self) -> bool {
        self.reasons.is_empty()
    }

    fn refused(images: [ImageRef<'_, u8>; 2], cameras: Option<[CameraModel; 2]>, reason: String) -> Self {
        let copy =
            |image: ImageRef<'_, u8>| Image::from_fn(image.width(), image.height(), |x, y| image.at(x, y));
        Self {
            images: images.map(copy),
            valid: images.map(|i| Image::from_fn(i.width(), i.height(), |_, _| 255)),
            homographies: [Matrix3::identity(); 2],
            cameras,
            aligned_from_camera: [Matrix3::identity(); 2],
            epipolar_error_px: f64::NAN,
            sigma_px: f64::NAN,
            matches: Vec::new(),
            reasons: vec![reason],
        }
    }
}

/// Aligns a pair of photographs of one size.
///
/// `candidates` are matches of distinct features, (x, y) in the left and the right photograph, pixels; many may be
/// wrong. They give a first alignment; precise matches are then sought in the images it aligns. `lenses` are the
/// cameras if they are known, with images of this size.
///
/// # Errors
///
/// [`Error::SizeMismatch`](crate::Error::SizeMismatch) for images of different sizes, or lenses of another size;
/// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a lens that cannot exist. Matches that do not carry an
/// alignment are no error: see [`PairAlignment::reasons`].
pub fn align_pair(
    left: ImageRef<'_, u8>,
    right: ImageRef<'_, u8>,
    candidates: &[[[f64; 2]; 2]],
    lenses: Option<[CameraModel; 2]>,
) -> Result<PairAlignment> {
    left.require_same_size("left image", &right, "right image")?;
    let size = [left.width(), left.height()];
    for camera in lenses.iter().flatten() {
        camera.validate()?;
        if [camera.width, camera.height] != size {
            return Err(crate::Error::SizeMismatch {
                first: "left image",
                first_width: size[0],
                first_height: size[1],
                second: "the lens's image",
                second_width: camera.width,
                second_height: camera.height,
            });
        }
    }
    let model = lenses.map_or(Lenses::Unknown { width: size[0], height: size[1] }, Lenses::Known);
    let candidates: Vec<Match> = candidates
        .iter()
        .filter(|points| points.as_flattened().iter().all(|v| v.is_finite()))
        .map(|points| points.map(Vector2::from))
        .collect();
    let refused = |reason| Ok(PairAlignment::refused([left, right], lenses, reason));
    if candidates.len() < MIN_CANDIDATES {
        return refused(format!(
            "too few matches: {} features found in both images (at least {MIN_CANDIDATES} needed)",
            candidates.len()
        ));
    }
    let tolerance_px = consensus::TOLERANCE_PX * (size[0].max(size[1]) as f64 / 640.0).max(1.0);
    let proposals = consensus::propose(&model, &candidates, tolerance_px);
    let starts: Vec<Unknowns> = proposals.iter().map(|proposal| proposal.unknowns).collect();
    let mut fit = solver::fit_best(&model, &candidates, &starts, 1.5 * tolerance_px);
    let starts = &starts[..starts.len().min(KEPT_STARTS)];
    let agreeing: Vec<Match> = within(&model.rig(&fit.unknowns), &candidates, tolerance_px);
    if agreeing.len() < MIN_CANDIDATES || 3 * agreeing.len() < candidates.len() {
        return refused(format!(
            "only {} of {} matched features agree with one pair of cameras",
            agreeing.len(),
            candidates.len()
        ));
    }
    let mut matches = agreeing.clone();
    for offset_px in OFFSETS_PX {
        let found = rematch([left, right], &model.rig(&fit.unknowns), &matches, &agreeing, offset_px)?;
        if found.len() < trust::MIN_MATCHES {
            break;
        }
        let starts: Vec<Unknowns> = starts.iter().copied().chain([fit.unknowns]).collect();
        fit = solver::fit_best(&model, &found, &starts, 0.5 * offset_px as f64);
        matches = found;
    }
    let halves = [0, 1].map(|half| every_other(&matches, half));
    let starts: Vec<Unknowns> = starts.iter().copied().chain([fit.unknowns]).collect();
    let fits = halves.each_ref().map(|half| solver::fit_best(&model, half, &starts, tolerance_px).unknowns);
    let mut held_out: Vec<f64> = [(0, 1), (1, 0)]
        .into_iter()
        .flat_map(|(seen, unseen)| verticals(model.rig(&fits[seen]), &halves[unseen]))
        .map(f64::abs)
        .collect();
    let epipolar_error_px = median(&mut held_out);
    let evidence = trust::Evidence {
        lenses: &model,
        fit: &fit,
        halves: fits.each_ref(),
        matches: &matches,
        held_out_px: epipolar_error_px,
    };
    let verdict = trust::judge(&evidence);
    let rig = model.rig(&fit.unknowns);
    let kept = within(&rig, &matches, fit.cutoff_px);
    let smallest_px = disparities(&rig, &kept).first().copied().unwrap_or(0.0);
    let view = View::with_least_disparity(&rig, size, smallest_px.min(0.0), 0.0);
    let [[left, left_valid], [right, right_valid]] = [view.render(0, left)?, view.render(1, right)?];
    Ok(PairAlignment {
        images: [left, right],
        valid: [left_valid, right_valid],
        homographies: [view.homography(0), view.homography(1)],
        cameras: Some(rig.cameras.map(|view| *view.camera())),
        aligned_from_camera: rig.turns.map(|turn| turn.rotation),
        epipolar_error_px,
        sigma_px: verdict.sigma_px,
        matches: kept.iter().map(|points| points.map(Into::into)).collect(),
        reasons: verdict.reasons,
    })
}

/// Precise matches of corners in the images as aligned so far, and of the features given, as pixels of the
/// photographs. `known` are matches that tell which disparities to look at.
fn rematch(
    photographs: [ImageRef<'_, u8>; 2],
    rig: &Rig,
    known: &[Match],
    features: &[Match],
    offset_px: usize,
) -> Result<Vec<Match>> {
    let size = [photographs[0].width(), photographs[0].height()];
    let disparities = disparities(rig, known);
    let at = |share: f64| disparities[(share * (disparities.len() - 1) as f64) as usize];
    let (near, far) = (at(0.97), at(0.03));
    let slack = 16.0 + 0.25 * (near - far);
    let view = View::with_least_disparity(rig, size, far - slack, 0.0);
    let options = AlignmentOptions {
        num_disparities: ((near - far + 2.0 * slack) as usize).clamp(1, 4096.min(size[0])),
        max_offset_px: offset_px,
    };
    let [[left, left_valid], [right, right_valid]] =
        [view.render(0, photographs[0])?, view.render(1, photographs[1])?];
    let mut meter = AlignmentMeter::thorough(options)?;
    let aligned = [left.view(), right.view()];
    let valid = [left_valid.view(), right_valid.view()];
    let mut found = meter.measure(aligned[0], aligned[1], Some(valid[0]), Some(valid[1]))?.matches.clone();
    for feature in features {
        let Some(start) = view.in_aligned(feature) else { continue };
        let is_same = |m: &PointMatch| (0..2).all(|i| (m.left_px[i] - start[0][i]).abs() < SAME_FEATURE_PX);
        if !found.iter().any(is_same) {
            found.extend(meter.locate_near(aligned, valid, start));
        }
    }
    Ok(found.iter().filter_map(|m| view.in_photographs([m.left_px, m.right_px])).collect())
}

/// Disparities of matches in pixels, infinity at 0, in ascending order.
fn disparities(rig: &Rig, matches: &[Match]) -> Vec<f64> {
    let aligned = matches.iter().filter_map(|m| rig.align(m));
    let mut disparities: Vec<f64> = aligned.map(|[l, r]| rig.focal_px * (l.x - r.x)).collect();
    disparities.sort_by(f64::total_cmp);
    disparities
}

fn verticals(rig: Rig, matches: &[Match]) -> impl Iterator<Item = f64> {
    matches.iter().filter_map(move |points| rig.vertical_px(points))
}

fn within(rig: &Rig, matches: &[Match], tolerance_px: f64) -> Vec<Match> {
    let agrees = |points: &&Match| rig.vertical_px(points).is_some_and(|r| r.abs() < tolerance_px);
    matches.iter().filter(agrees).copied().collect()
}

fn every_other(matches: &[Match], first: usize) -> Vec<Match> {
    matches.iter().skip(first).step_by(2).copied().collect()
}

/// Median of numbers, NaN if there are none; reorders them.
fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    super::alignment::median(values)
}
