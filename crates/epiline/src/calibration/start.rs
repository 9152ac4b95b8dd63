//! A first estimate: Zhang's closed form for each camera, then the pose between them that most views agree on.

use nalgebra::{Matrix3, Vector3};

use super::homography::{self, Pinhole};
use crate::camera::Pose;
use crate::error::{Error, Result};

/// Intrinsics without distortion and a pose for every view.
#[derive(Debug, Clone)]
pub(super) struct CameraStart {
    pub pinhole: Pinhole,
    pub camera_from_board: Vec<Pose>,
}

/// Homographies of one camera's views; fails, naming the view, where corners do not span the board.
pub(super) fn homographies<'a>(
    camera: &str,
    views: impl Iterator<Item = (&'a [[f64; 3]], &'a [[f64; 2]])>,
) -> Result<Vec<Matrix3<f64>>> {
    views
        .enumerate()
        .map(|(v, (board_m, pixels))| {
            homography::fit(board_m, pixels).ok_or_else(|| {
                let reason = format!(
                    "the {camera} corners of view {v} lie on a line or a point; a board must be spread out"
                );
                Error::degenerate("calibration", reason)
            })
        })
        .collect()
}

/// The best of several closed forms and guesses, judged by how well it reprojects the corners.
///
/// The closed forms have no distortion, and a strongly distorted or barely tilted set throws each of them off in
/// its own way; refinement needs only one that is roughly right.
pub(super) fn camera<'a>(
    homographies: &[Matrix3<f64>],
    views: impl Iterator<Item = (&'a [[f64; 3]], &'a [[f64; 2]])> + Clone,
    size: (usize, usize),
) -> Result<CameraStart> {
    let side = size.0.max(size.1) as f64;
    let guess = |factor: f64| Pinhole {
        focal_px: [factor * side; 2],
        center_px: homography::image_center(size), //
    };
    let in_reach = |p: &Pinhole| {
        let focal = |f: f64| (0.2..20.0).contains(&(f / side));
        let center = |c: f64, extent: usize| (-0.5..1.5).contains(&(c / extent as f64));
        p.focal_px.iter().all(|&f| focal(f))
            && center(p.center_px[0], size.0)
            && center(p.center_px[1], size.1)
    };
    let closed_forms = [homography::zhang(homographies, size), homography::centred_focal(homographies, size)];
    let candidates = closed_forms.into_iter().flatten().filter(in_reach).chain([0.6, 1.0, 1.8].map(guess));
    candidates
        .filter_map(|pinhole| {
            let poses: Option<Vec<_>> = homographies.iter().map(|h| homography::pose(h, &pinhole)).collect();
            let start = CameraStart { pinhole, camera_from_board: poses? };
            let error = reprojection_error(&start, views.clone())?;
            Some((error, start))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, start)| start)
        .ok_or_else(|| {
            Error::degenerate(
                "calibration",
                "no camera in front of the boards explains the corners".to_owned(),
            )
        })
}

/// Sum of squared distances, px²; `None` if a corner would be behind the camera.
fn reprojection_error<'a>(
    start: &CameraStart,
    views: impl Iterator<Item = (&'a [[f64; 3]], &'a [[f64; 2]])>,
) -> Option<f64> {
    let Pinhole { focal_px: [fx, fy], center_px: [cx, cy] } = start.pinhole;
    let mut sum = 0.0;
    for ((board_m, pixels), pose) in views.zip(&start.camera_from_board) {
        for (point, [x, y]) in board_m.iter().zip(pixels) {
            let p = pose.apply(Vector3::from(*point));
            if p.z <= 0.0 {
                return None;
            }
            sum += (fx * p.x / p.z + cx - x).powi(2) + (fy * p.y / p.z + cy - y).powi(2);
        }
    }
    sum.is_finite().then_some(sum)
}

/// The pose between the cameras that is closest to what all views say: their medoid.
///
/// A few views with a mis-found grid cannot move it, as they would a mean; such a view is named instead.
pub(super) fn right_from_left(left_from_board: &[Pose], right_from_board: &[Pose]) -> Result<Pose> {
    // Poses of single views are a few degrees off at worst; a grid read from another end is 90 or 180 off.
    const LARGEST_TURN: f64 = 0.6;
    let poses: Vec<Pose> =
        left_from_board.iter().zip(right_from_board).map(|(l, r)| r.after(&l.inverse())).collect();
    let medoid = medoid(&poses);
    for (view, pose) in poses.iter().enumerate() {
        let turn = pose.after(&medoid.inverse()).angle_rad();
        if turn > LARGEST_TURN {
            let degrees = turn.to_degrees();
            let reason = format!(
                "in view {view} (counting from 0) the board turns by {degrees:.0} degrees between the cameras compared \
                 with the other views; its corners are mis-found or listed from the other end of the board in one camera"
            );
            return Err(Error::degenerate("calibration", reason));
        }
    }
    Ok(medoid)
}

fn medoid(poses: &[Pose]) -> Pose {
    let mut lengths: Vec<f64> = poses.iter().map(|p| p.translation_m.norm()).collect();
    lengths.sort_by(f64::total_cmp);
    let length = lengths[lengths.len() / 2].max(f64::MIN_POSITIVE);
    // Chordal distance of the rotations, and of the translations in units of the baseline.
    let disagreement = |a: &Pose, b: &Pose| {
        (a.rotation - b.rotation).norm() + (a.translation_m - b.translation_m).norm() / length
    };
    let total = |a: &Pose| poses.iter().map(|b| disagreement(a, b)).sum::<f64>();
    let best = poses.iter().map(|pose| (total(pose), pose)).min_by(|a, b| a.0.total_cmp(&b.0));
    *best.expect("views were counted before").1
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn pose(angle: f64, x: f64) -> Pose {
        Pose {
            rotation: Rotation3::from_scaled_axis(Vector3::new(0.01, 0.0, angle)).into_inner(),
            translation_m: Vector3::new(x, 0.0, 0.0),
        }
    }

    #[test]
    fn a_minority_of_wild_views_does_not_move_the_start() {
        let left = vec![pose(0.0, 0.0); 7];
        let mut right: Vec<_> = (0..7).map(|i| pose(0.02 + 1e-4 * f64::from(i), -0.12)).collect();
        right[1] = pose(0.3, 0.9);
        right[4] = pose(-0.2, 0.8);
        let found = right_from_left(&left, &right).expect("five views agree");
        assert!((found.translation_m.x + 0.12).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn a_view_read_from_the_other_end_is_named() {
        let left = vec![pose(0.0, 0.0); 5];
        let mut right = vec![pose(0.02, -0.12); 5];
        right[3] = pose(std::f64::consts::PI, -0.1);
        let message = right_from_left(&left, &right).expect_err("one view is turned").to_string();
        assert!(message.contains("view 3") && message.contains("other end"), "{message}");
    }
}
