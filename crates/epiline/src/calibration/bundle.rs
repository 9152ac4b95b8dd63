//! The calibration of a pair by bundle adjustment, from corners to [`StereoCalibration`].

use nalgebra::SVector;

use super::held_out;
use super::lens::BrownConrady;
use super::solver::{Bundle, Estimate, Huber, View};
use super::start::{self, CameraStart};
use super::{BoardView, BundleOptions, LensModel, input, rig};
use crate::camera::{Pose, StereoCalibration};
use crate::error::Result;

/// With one view neither camera's principal point is determined.
const MIN_VIEWS: usize = 2;

const K: usize = BrownConrady::PARAMETERS;

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
    held_out::fit_and_test(views, options.held_out_folds, |part| fit(part, image_size, options))
}

fn fit(
    views: &[BoardView],
    image_size: (usize, usize),
    options: &BundleOptions,
) -> Result<StereoCalibration> {
    let left = refined_camera("left", views, |v| &v.left_px, image_size, options.lens)?;
    let right = refined_camera("right", views, |v| &v.right_px, image_size, options.lens)?;
    let estimate = Estimate {
        right_from_left: start::right_from_left(&left.camera_from_board, &right.camera_from_board)?,
        intrinsics: [left.intrinsics, right.intrinsics],
        left_from_board: left.camera_from_board,
    };
    let camera = free_intrinsics(options.lens);
    let free: Vec<bool> = camera.into_iter().chain(camera).chain([true; 6]).collect();
    let fit = rig::fit(&BrownConrady, &rig::solver_views(views), estimate, &free, options.loss)?;
    let [left, right] = fit.estimate.intrinsics.map(|i| BrownConrady::unpack(&i, image_size));
    let covariance = fit.covariance.clone();
    rig::finish(fit, left, right, covariance)
}

fn free_intrinsics(lens: LensModel) -> [bool; K] {
    let mut free = [true; K];
    free[K - 1] = lens == LensModel::Brown5;
    free
}

/// One camera's intrinsics and poses, good enough to start the joint fit from.
struct RefinedCamera {
    intrinsics: SVector<f64, K>,
    camera_from_board: Vec<Pose>,
}

/// Closed form, then least squares of this camera alone.
fn refined_camera(
    name: &str,
    views: &[BoardView],
    pixels: impl Fn(&BoardView) -> &Vec<[f64; 2]>,
    image_size: (usize, usize),
    lens: LensModel,
) -> Result<RefinedCamera> {
    /// The joint fit moves on from here: digits beyond this are not worth an iteration.
    const TOLERANCE: f64 = 1e-3;
    let corners = || views.iter().map(|v| (v.board_m.as_slice(), pixels(v).as_slice()));
    let homographies = start::homographies(name, corners())?;
    let CameraStart { pinhole, camera_from_board } = start::camera(&homographies, corners(), image_size)?;
    rig::require_tilt(&camera_from_board)?;
    // A rig whose right camera saw nothing.
    let alone: Vec<View<'_>> =
        corners().map(|(board_m, pixels)| View { board_m, pixels: [pixels, &[]] }).collect();
    let intrinsics = BrownConrady::pack_pinhole(pinhole.focal_px, pinhole.center_px);
    let estimate = Estimate {
        intrinsics: [intrinsics; 2],
        right_from_left: Pose::identity(),
        left_from_board: camera_from_board,
    };
    let free: Vec<bool> = free_intrinsics(lens).into_iter().chain([false; K + 6]).collect();
    let refined =
        Bundle::new(&BrownConrady, &alone, &free).minimise(estimate, Huber::SQUARED, TOLERANCE).estimate;
    Ok(RefinedCamera { intrinsics: refined.intrinsics[0], camera_from_board: refined.left_from_board })
}
