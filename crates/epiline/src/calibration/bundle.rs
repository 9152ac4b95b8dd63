//! The calibration of a pair by bundle adjustment, from corners to [`StereoCalibration`].

use nalgebra::{SVector, Vector2};

use super::freedom::Plan;
use super::lens::{PixelCamera, pack, unpack};
use super::options::{BundleOptions, LensModel};
use super::solver::{Bundle, Estimate, Huber, View};
use super::start::{self, CameraStart, SeenView};
use super::{BoardView, CAMERAS, fisheye_start, held_out, homography, input, rig};
use crate::camera::{
    Brown, CameraModel, KannalaBrandt, LensFormula, Pose, Rational, StereoCalibration, ThinPrism,
};
use crate::error::{Error, Result};

/// With one view neither camera's principal point is determined.
const MIN_VIEWS: usize = 2;

/// Calibrates a pair of cameras from views of a flat board.
///
/// Minimises the reprojection error of all corners of both cameras over both cameras' intrinsics, the pose between
/// them and every board pose together. `image_size` is (width, height) of both cameras, pixels.
///
/// # Errors
///
/// [`InvalidParameter`](crate::Error::InvalidParameter) or [`NotEnoughData`](crate::Error::NotEnoughData) for lists
/// that do not belong together; [`Degenerate`](crate::Error::Degenerate) if the views do not determine the rig, the
/// fit does not converge, the cameras are swapped, or the rig that comes out cannot exist.
pub fn calibrate(
    views: &[BoardView],
    image_size: (usize, usize),
    options: &BundleOptions,
) -> Result<StereoCalibration> {
    input::check(views, image_size, MIN_VIEWS)?;
    input::check_loss(options.loss)?;
    let plan = Plan::of(options)?;
    let problem = |part: &[BoardView]| match options.lens {
        LensModel::Brown4 | LensModel::Brown5 => fit::<Brown, 5, 9>(part, image_size, options, &plan),
        LensModel::Rational => fit::<Rational, 8, 12>(part, image_size, options, &plan),
        LensModel::ThinPrism => fit::<ThinPrism, 12, 16>(part, image_size, options, &plan),
        LensModel::Fisheye => fit::<KannalaBrandt, 4, 8>(part, image_size, options, &plan),
    };
    held_out::fit_and_test(views, options.held_out_folds, problem)
}

/// [`calibrate`] with the simplest lens whose held-out epipolar error is next to the smallest of all models.
///
/// More coefficients always lower the error of the views they were fitted to; that of views left out falls only if
/// the lens asks for them. `options.lens` has no say.
///
/// # Errors
///
/// As [`calibrate`], if no model can be fitted: the reason of the simplest.
pub fn calibrate_choosing_lens(
    views: &[BoardView],
    image_size: (usize, usize),
    options: &BundleOptions,
) -> Result<StereoCalibration> {
    /// Held-out errors of 13 views scatter by about so much from one split to another.
    const NEXT_TO: f64 = 1.05;
    let held_out_folds = options.held_out_folds.max(2);
    let fits: Vec<Result<StereoCalibration>> = LensModel::ALL
        .iter()
        .map(|(_, lens)| {
            calibrate(views, image_size, &BundleOptions { lens: *lens, held_out_folds, ..options.clone() })
        })
        .collect();
    let error_px = |fit: &Result<StereoCalibration>| fit.as_ref().map_or(f64::NAN, |c| c.epipolar_error_px);
    // `min` passes over what is not known.
    let least = fits.iter().map(error_px).fold(f64::NAN, f64::min);
    let chosen = fits.iter().position(|fit| error_px(fit) <= NEXT_TO * least);
    let chosen = chosen.or_else(|| fits.iter().position(Result::is_ok)).unwrap_or(0);
    fits.into_iter().nth(chosen).expect("there are models")
}

fn fit<F: LensFormula<N>, const N: usize, const K: usize>(
    views: &[BoardView],
    image_size: (usize, usize),
    options: &BundleOptions,
    plan: &Plan,
) -> Result<StereoCalibration> {
    let camera = |side| refined_camera::<F, N, K>(side, views, image_size, options, plan);
    let (mut left, mut right) = (camera(0)?, camera(1)?);
    plan.unite([left.intrinsics.as_mut_slice(), right.intrinsics.as_mut_slice()]);
    let right_from_left = match &options.constraints.initial {
        Some(initial) => initial.right_from_left,
        None => start::right_from_left(&left.camera_from_board, &right.camera_from_board)?,
    };
    let estimate = Estimate {
        left_from_board: start::left_from_board(
            &left.camera_from_board,
            &right.camera_from_board,
            &right_from_left,
        ),
        right_from_left,
        intrinsics: [left.intrinsics, right.intrinsics],
        board_warp_m: Vector2::zeros(),
    };
    let fit = rig::fit(&PixelCamera::<F, N>::NEW, views, estimate, &plan.joint(), options.loss)?;
    let [left, right] = fit.estimate.intrinsics.map(|i| unpack(&i, &blank(options.lens, image_size)));
    let covariance = fit.covariance.clone();
    rig::finish(fit, left, right, covariance)
}

/// A camera whose lens bends nothing; its focal length is still to be found.
fn blank(lens: LensModel, image_size: (usize, usize)) -> CameraModel {
    CameraModel {
        focal_px: [1.0; 2],
        center_px: homography::image_center(image_size),
        lens: lens.lens(),
        width: image_size.0,
        height: image_size.1,
    }
}

/// One camera's intrinsics and poses, good enough to start the joint fit from.
struct RefinedCamera<const K: usize> {
    intrinsics: SVector<f64, K>,
    /// `None` where the camera saw too little of the board.
    camera_from_board: Vec<Option<Pose>>,
}

/// Closed form, then least squares of this camera alone.
fn refined_camera<F: LensFormula<N>, const N: usize, const K: usize>(
    side: usize,
    views: &[BoardView],
    image_size: (usize, usize),
    options: &BundleOptions,
    plan: &Plan,
) -> Result<RefinedCamera<K>> {
    /// The joint fit moves on from here: digits beyond this are not worth an iteration.
    const TOLERANCE: f64 = 1e-3;
    let seen = start::seen_by(side, views);
    if seen.len() < MIN_VIEWS {
        let what = ["board views of the left camera", "board views of the right camera"][side];
        return Err(Error::NotEnoughData { what, actual: seen.len(), needed: MIN_VIEWS });
    }
    let (camera, camera_from_board) = first_camera(side, &seen, image_size, options)?;
    if plan.is_focal_free(side) {
        rig::require_tilt(&camera_from_board)?;
    }
    // A rig whose right camera saw nothing.
    let alone: Vec<View<'_>> =
        seen.iter().map(|view| View { board_m: &view.board_m, pixels: [&view.pixels, &[]] }).collect();
    let mut estimate = Estimate {
        intrinsics: [pack(&camera); 2],
        right_from_left: Pose::identity(),
        left_from_board: camera_from_board,
        board_warp_m: Vector2::zeros(),
    };
    // Coefficients that do nearly the same are let go when the others are about right.
    let stages: &[usize] = if N > 5 { &[4, N] } else { &[N] };
    for coefficients in stages {
        let freedom = plan.of_camera(side, *coefficients);
        let bundle = Bundle::new(&PixelCamera::<F, N>::NEW, &alone, &freedom);
        estimate = bundle.minimise(estimate, Huber::SQUARED, TOLERANCE).estimate;
    }
    let mut camera_from_board = vec![None; views.len()];
    for (view, pose) in seen.iter().zip(&estimate.left_from_board) {
        camera_from_board[view.index] = Some(*pose);
    }
    Ok(RefinedCamera { intrinsics: estimate.intrinsics[0], camera_from_board })
}

/// A camera that is roughly right, and the poses of its views under it.
fn first_camera(
    side: usize,
    seen: &[SeenView],
    image_size: (usize, usize),
    options: &BundleOptions,
) -> Result<(CameraModel, Vec<Pose>)> {
    let constraints = &options.constraints;
    let blank = blank(options.lens, image_size);
    if let Some(initial) = &constraints.initial {
        let camera = if side == 0 { initial.left } else { initial.right };
        if camera.lens.name() != blank.lens.name() || (camera.width, camera.height) != image_size {
            let value = format!("a {} lens, {}x{} px", camera.lens.name(), camera.width, camera.height);
            let expected =
                format!("must be of the model solved for, {}, and of the images' size", blank.lens.name());
            return Err(Error::invalid("initial", value, expected));
        }
        return Ok((camera, start::poses_under(CAMERAS[side], &camera, seen)?));
    }
    if options.lens == LensModel::Fisheye {
        return fisheye_start::camera(CAMERAS[side], &blank, seen);
    }
    let homographies = start::homographies(CAMERAS[side], seen)?;
    let CameraStart { mut pinhole, camera_from_board } = start::camera(&homographies, seen, image_size)?;
    for (axis, name) in ["cx", "cy"].into_iter().enumerate() {
        let one = format!("{}_{name}", CAMERAS[side]);
        if constraints.fixed.iter().any(|fixed| *fixed == name || *fixed == one) {
            pinhole.center_px[axis] = blank.center_px[axis];
        }
    }
    if constraints.square_pixels {
        pinhole.focal_px = [0.5 * (pinhole.focal_px[0] + pinhole.focal_px[1]); 2];
    }
    let camera = CameraModel { focal_px: pinhole.focal_px, center_px: pinhole.center_px, ..blank };
    Ok((camera, camera_from_board))
}
