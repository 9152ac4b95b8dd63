//! A first estimate of a fisheye, whose pictures no homography explains.

use nalgebra::{Vector2, Vector3};

use super::start::{SeenView, nothing_explains, poses_under};
use crate::camera::{CameraModel, Pose};
use crate::error::Result;

/// Focal lengths tried, as shares of the longer side: 180 degrees over the side is 0.32.
const FOCAL_SHARES: [f64; 12] = [0.2, 0.24, 0.28, 0.32, 0.36, 0.41, 0.47, 0.54, 0.62, 0.75, 0.9, 1.2];

/// The equidistant lens with its axis in the image centre whose boards reproject best, with their poses.
pub(super) fn camera(
    name: &str,
    blank: &CameraModel,
    views: &[SeenView],
) -> Result<(CameraModel, Vec<Pose>)> {
    let side = blank.width.max(blank.height) as f64;
    let trials = FOCAL_SHARES.into_iter().filter_map(|share| {
        let camera = CameraModel { focal_px: [share * side; 2], ..*blank };
        let poses = poses_under(name, &camera, views).ok()?;
        let error = reprojection_error(&camera, views, &poses)?;
        Some((error, camera, poses))
    });
    let best = trials.min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, camera, poses)| (camera, poses)).ok_or_else(nothing_explains)
}

/// Sum of squared distances, px²; `None` if a corner has no image.
fn reprojection_error(camera: &CameraModel, views: &[SeenView], poses: &[Pose]) -> Option<f64> {
    let camera = camera.view();
    let mut sum = 0.0;
    for (view, pose) in views.iter().zip(poses) {
        for (point, pixel) in view.board_m.iter().zip(&view.pixels) {
            let predicted = camera.project(&pose.apply(Vector3::from(*point)))?;
            sum += (predicted - Vector2::from(*pixel)).norm_squared();
        }
    }
    sum.is_finite().then_some(sum)
}
