//! How well a plane is known: covariances of its three numbers, and what they mean of height, pitch and roll.

use nalgebra::{Matrix3, Vector3};

use super::plane_fit::{DisparityPlane, FittedPlane};
use crate::rectification::RectifiedGeometry;

/// How much the pose changes from frame to frame, one standard deviation: a vehicle nods more than it heaves.
const HEIGHT_WALK: f64 = 0.01;
const PITCH_WALK_RAD: f64 = 0.01;
const ROLL_WALK_RAD: f64 = 0.007;
/// What a fit cannot know of the pose, one standard deviation: lenses, alignment, and that no floor is quite plane.
const HEIGHT_FLOOR: f64 = 0.003;
const ANGLE_FLOOR_RAD: f64 = 0.0005;
/// What a matcher sees wrong of a slope and no number of samples or frames averages away, px, one standard deviation: it
/// may be the same everywhere, and grow to this toward the lower edge of the image; across, it differs by a share.
const BIAS_PX: f64 = 0.145;
const BIAS_ACROSS: f64 = 0.2;

/// Deviations of height (m), pitch and roll (radians); `None` of a plane that no pose sees.
pub(super) fn sigmas_of_pose(fitted: &FittedPlane, geometry: &RectifiedGeometry) -> Option<[f64; 3]> {
    let inverse = jacobian(&fitted.plane, geometry).try_inverse()?;
    let covariance = inverse * fitted.covariance * inverse.transpose();
    Some([0, 1, 2].map(|i| covariance[(i, i)].max(0.0).sqrt()))
}

/// What height, pitch and roll do to the plane's three numbers, column by column.
fn jacobian(plane: &DisparityPlane, geometry: &RectifiedGeometry) -> Matrix3<f64> {
    let pose = plane.pose(geometry);
    let per_m = geometry.baseline_m / pose.height_m;
    let (sin_pitch, cos_pitch) = pose.pitch_rad.sin_cos();
    let (sin_roll, cos_roll) = pose.roll_rad.sin_cos();
    let focal_px = geometry.focal_px;
    Matrix3::from_columns(&[
        -plane.vector() / pose.height_m,
        per_m * Vector3::new(-sin_pitch * sin_roll, -sin_pitch * cos_roll, cos_pitch * focal_px),
        per_m * Vector3::new(cos_pitch * cos_roll, -cos_pitch * sin_roll, 0.0),
    ])
}

/// Covariance of a plane's three numbers from deviations of height (m), pitch and roll (radians).
pub(super) fn in_disparity(
    plane: &DisparityPlane,
    geometry: &RectifiedGeometry,
    sigmas: [f64; 3],
) -> Matrix3<f64> {
    let jacobian = jacobian(plane, geometry);
    let variances = Vector3::from(sigmas.map(|sigma| sigma * sigma));
    jacobian * Matrix3::from_diagonal(&variances) * jacobian.transpose()
}

/// What a pose may change from one frame to the next.
pub(super) fn walk(plane: &DisparityPlane, geometry: &RectifiedGeometry) -> Matrix3<f64> {
    let height_m = plane.pose(geometry).height_m;
    in_disparity(plane, geometry, [HEIGHT_WALK * height_m, PITCH_WALK_RAD, ROLL_WALK_RAD])
}

/// What no fit knows better.
pub(super) fn floor(plane: &DisparityPlane, geometry: &RectifiedGeometry) -> Matrix3<f64> {
    let height_m = plane.pose(geometry).height_m;
    in_disparity(plane, geometry, [HEIGHT_FLOOR * height_m, ANGLE_FLOOR_RAD, ANGLE_FLOOR_RAD])
}

/// What the matcher sees wrong.
pub(super) fn bias(plane: &DisparityPlane, geometry: &RectifiedGeometry) -> Matrix3<f64> {
    let lowest_px = plane.by_v * (geometry.height as f64 - geometry.cy_px) + plane.at_center;
    let everywhere = Vector3::new(0.0, 0.0, BIAS_PX);
    let downward = plane.vector() * (BIAS_PX / lowest_px.max(1.0));
    let across = Vector3::new(2.0 * BIAS_ACROSS * BIAS_PX / geometry.width as f64, 0.0, 0.0);
    [everywhere, downward, across].iter().map(|way| way * way.transpose()).sum()
}
