//! A first estimate: Zhang's closed form for each camera, then the pose between them that most views agree on.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::BoardView;
use super::homography::{self, Pinhole};
use super::input::MIN_CORNERS;
use super::solver::is_seen;
use crate::camera::{CameraModel, Pose};
use crate::error::{Error, Result};

/// Directions farther than this from the axis, 84 degrees, spoil a homography.
const LARGEST_TANGENT: f64 = 10.0;

/// Intrinsics without distortion and a pose for every view.
#[derive(Debug, Clone)]
pub(super) struct CameraStart {
    pub pinhole: Pinhole,
    pub camera_from_board: Vec<Pose>,
}

/// What one camera saw of one board: the corners in sight alone.
pub(super) struct SeenView {
    /// Among all views.
    pub index: usize,
    pub board_m: Vec<[f64; 3]>,
    pub pixels: Vec<[f64; 2]>,
}

/// The views of which a camera saw enough for a pose.
pub(super) fn seen_by(camera: usize, views: &[BoardView]) -> Vec<SeenView> {
    let enough = views.iter().enumerate().filter(|(_, view)| view.seen_by(camera) >= MIN_CORNERS);
    enough
        .map(|(index, view)| {
            let corners = view.board_m.iter().zip(view.pixels(camera));
            let (board_m, pixels) =
                corners.filter(|(_, pixel)| is_seen(pixel)).map(|(p, q)| (*p, *q)).unzip();
            SeenView { index, board_m, pixels }
        })
        .collect()
}

fn unspread(camera: &str, view: usize) -> Error {
    let reason =
        format!("the {camera} corners of view {view} lie on a line or a point; a board must be spread out");
    Error::degenerate("calibration", reason)
}

/// Homographies of one camera's views; fails, naming the view, where corners do not span the board.
pub(super) fn homographies(camera: &str, views: &[SeenView]) -> Result<Vec<Matrix3<f64>>> {
    views
        .iter()
        .map(|v| homography::fit(&v.board_m, &v.pixels).ok_or_else(|| unspread(camera, v.index)))
        .collect()
}

/// Poses of one camera's views if the camera is known, from its corners with the distortion taken out.
pub(super) fn poses_under(name: &str, camera: &CameraModel, views: &[SeenView]) -> Result<Vec<Pose>> {
    const IDEAL: Pinhole = Pinhole { focal_px: [1.0; 2], center_px: [0.0; 2] };
    let camera = camera.view();
    views
        .iter()
        .map(|view| {
            let straight = |pixel: &[f64; 2]| -> Option<[f64; 2]> {
                let ideal = camera.normalised_from_pixel(Vector2::from(*pixel))?;
                (ideal.norm() < LARGEST_TANGENT).then(|| ideal.into())
            };
            let corners = view.board_m.iter().zip(&view.pixels);
            let (board_m, ideal): (Vec<_>, Vec<_>) =
                corners.filter_map(|(point, pixel)| Some((*point, straight(pixel)?))).unzip();
            homography::fit(&board_m, &ideal)
                .and_then(|h| homography::pose(&h, &IDEAL))
                .ok_or_else(|| unspread(name, view.index))
        })
        .collect()
}

/// Pose of every board in the left camera's frame, by the right camera where the left one did not see it.
pub(super) fn left_from_board(
    left: &[Option<Pose>],
    right: &[Option<Pose>],
    right_from_left: &Pose,
) -> Vec<Pose> {
    let left_from_right = right_from_left.inverse();
    left.iter()
        .zip(right)
        .map(|(left, right)| match (left, right) {
            (Some(pose), _) => *pose,
            (None, Some(pose)) => left_from_right.after(pose),
            (None, None) => unreachable!("views that no camera saw are refused"),
        })
        .collect()
}

/// The best of several closed forms and guesses, judged by how well it reprojects the corners.
///
/// The closed forms have no distortion, and a strongly distorted or barely tilted set throws each of them off in
/// its own way; refinement needs only one that is roughly right.
pub(super) fn camera(
    homographies: &[Matrix3<f64>],
    views: &[SeenView],
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
            let error = reprojection_error(&start, views)?;
            Some((error, start))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, start)| start)
        .ok_or_else(nothing_explains)
}

/// That no start was found.
pub(super) fn nothing_explains() -> Error {
    Error::degenerate("calibration", "no camera in front of the boards explains the corners")
}

/// Sum of squared distances, px²; `None` if a corner would be behind the camera.
fn reprojection_error(start: &CameraStart, views: &[SeenView]) -> Option<f64> {
    let Pinhole { focal_px: [fx, fy], center_px: [cx, cy] } = start.pinhole;
    let mut sum = 0.0;
    for (view, pose) in views.iter().zip(&start.camera_from_board) {
        for (point, [x, y]) in view.board_m.iter().zip(&view.pixels) {
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
pub(super) fn right_from_left(
    left_from_board: &[Option<Pose>],
    right_from_board: &[Option<Pose>],
) -> Result<Pose> {
    // Poses of single views are a few degrees off at worst; a grid read from another end is 90 or 180 off.
    const LARGEST_TURN: f64 = 0.6;
    let sides = left_from_board.iter().zip(right_from_board);
    let (views, poses): (Vec<usize>, Vec<Pose>) = sides
        .enumerate()
        .filter_map(|(v, (l, r))| Some((v, r.as_ref()?.after(&l.as_ref()?.inverse()))))
        .unzip();
    let Some(medoid) = medoid(&poses) else {
        let what = "board views that both cameras saw";
        return Err(Error::NotEnoughData { what, actual: 0, needed: 1 });
    };
    for (view, pose) in views.into_iter().zip(&poses) {
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

fn medoid(poses: &[Pose]) -> Option<Pose> {
    let mut lengths: Vec<f64> = poses.iter().map(|p| p.translation_m.norm()).collect();
    lengths.sort_by(f64::total_cmp);
    let length = lengths.get(lengths.len() / 2)?.max(f64::MIN_POSITIVE);
    // Chordal distance of the rotations, and of the translations in units of the baseline.
    let disagreement = |a: &Pose, b: &Pose| {
        (a.rotation - b.rotation).norm() + (a.translation_m - b.translation_m).norm() / length
    };
    let total = |a: &Pose| poses.iter().map(|b| disagreement(a, b)).sum::<f64>();
    let best = poses.iter().map(|pose| (total(pose), pose)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, pose)| *pose)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn pose(angle: f64, x: f64) -> Option<Pose> {
        Some(Pose {
            rotation: Rotation3::from_scaled_axis(Vector3::new(0.01, 0.0, angle)).into_inner(),
            translation_m: Vector3::new(x, 0.0, 0.0),
        })
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
