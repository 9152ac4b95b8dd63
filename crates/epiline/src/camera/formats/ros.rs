//! ROS `camera_info` files, one per camera, as `camera_calibration` and `camera_info_manager` write them.
//!
//! The pose between the cameras is in their rectification: `X_rectified = R X_camera`, and the right camera's
//! projection matrix has `P(0,3) = -fx' b` (REP 104, `sensor_msgs/CameraInfo`). So `right_from_left = R_rightᵀ R_left`
//! and the right camera sees the left centre at `R_rightᵀ (P(0,3), P(1,3), 0) / f'`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Vector3};

use super::document::Entry;
use super::{Pair, file_error};
use crate::camera::{AlignedFrame, Brown, CameraModel, KannalaBrandt, Lens, Pose, StereoCalibration};
use crate::error::Result;

/// Whether a parsed document is a `camera_info`.
pub(super) fn recognises(root: &Entry<'_>) -> bool {
    ["camera_matrix", "distortion_model", "projection_matrix"]
        .iter()
        .all(|key| root.optional(key).is_ok_and(|entry| entry.is_some()))
}

/// The rig of the two files.
pub(super) fn read(left: &Entry<'_>, right: &Entry<'_>) -> Result<Pair> {
    let (left_camera, left_turn, left_shift) = camera(left)?;
    let (right_camera, right_turn, right_shift) = camera(right)?;
    if left_shift.norm() > 0.0 {
        let name = "projection_matrix.data";
        let shift = left_shift.x;
        let reason = format!("puts the left camera {shift} m off the common origin; were the files swapped?");
        return Err(left.about(name, reason));
    }
    if right_shift.norm() == 0.0 {
        let reason = "has no baseline: P(0,3) is 0, so this is a file of a single camera";
        return Err(right.about("projection_matrix.data", reason));
    }
    let right_from_left = Pose {
        rotation: right_turn.transpose() * left_turn,
        translation_m: right_turn.transpose() * right_shift,
    };
    Ok(Pair { left: left_camera, right: right_camera, right_from_left })
}

/// The camera, its rectification, and the left camera's centre in its rectified frame, metres.
fn camera(root: &Entry<'_>) -> Result<(CameraModel, Matrix3<f64>, Vector3<f64>)> {
    let data = |key: &str, count| {
        let data = root.get(key)?.get("data")?;
        Ok((data.clone(), data.all_numbers(count)?))
    };
    let (entry, k) = data("camera_matrix", 9)?;
    let (focal_px, center_px) = entry.pinhole(&k)?;
    let (entry, turn) = data("rectification_matrix", 9)?;
    let turn = entry.rotation(&turn)?;
    let (entry, p) = data("projection_matrix", 12)?;
    if p[0] <= 0.0 || p[5] <= 0.0 {
        return Err(entry.error(format!("has focal lengths {} and {} px; they must be positive", p[0], p[5])));
    }
    let shift = Vector3::new(p[3] / p[0], p[7] / p[5], 0.0);
    let camera = CameraModel {
        focal_px,
        center_px,
        lens: lens(root)?,
        width: root.get("image_width")?.side_px()?,
        height: root.get("image_height")?.side_px()?,
    };
    Ok((camera, turn, shift))
}

fn lens(root: &Entry<'_>) -> Result<Lens> {
    let model = root.get("distortion_model")?;
    let known = match model.text()? {
        "plumb_bob" => Lens::Brown(Brown::default()),
        "rational_polynomial" => Lens::Rational(Default::default()),
        "equidistant" | "fisheye" => Lens::KannalaBrandt(KannalaBrandt::default()),
        other => {
            let known = "plumb_bob, rational_polynomial, equidistant";
            return Err(model.error(format!("is '{other}'; expected one of {known}")));
        }
    };
    let data = root.get("distortion_coefficients")?.get("data")?;
    let count = data.list()?.len();
    let coefficients = data.all_numbers(count)?;
    let lens = match (known, count) {
        (Lens::Brown(_), 4 | 5) | (Lens::Rational(_), 8 | 12 | 14) => {
            // A list of twelve or fourteen zeros at its end is OpenCV's longer form of eight.
            let used =
                if coefficients[count.min(8)..].iter().all(|&c| c == 0.0) { count.min(8) } else { count };
            Lens::from_opencv(&coefficients[..used]).map_err(|e| data.error(e.to_string()))?
        }
        (known, _) => known.with_coefficients(&coefficients).ok_or_else(|| {
            let expected = known.coefficient_names().len();
            data.error(format!("has {count} coefficients; expected {expected}"))
        })?,
    };
    Ok(lens)
}

/// The texts of the left and the right file.
pub(super) fn texts_of(paths: &[PathBuf], rig: &StereoCalibration) -> Result<Vec<String>> {
    let frame = AlignedFrame::of(&rig.right_from_left)?;
    let focal = AlignedFrame::common_focal_px(&rig.left, &rig.right);
    let sides = [
        (&paths[0], "left", &rig.left, frame.aligned_from_left, 0.0),
        (&paths[1], "right", &rig.right, frame.aligned_from_right, -focal * frame.baseline_m),
    ];
    let text = |(path, name, camera, turn, shift): (&PathBuf, &str, &CameraModel, Matrix3<f64>, f64)| {
        camera_text(path, name, camera, &turn, focal, shift)
    };
    sides.into_iter().map(text).collect()
}

fn camera_text(
    path: &Path,
    name: &str,
    camera: &CameraModel,
    turn: &Matrix3<f64>,
    focal: f64,
    shift: f64,
) -> Result<String> {
    let model = match camera.lens {
        Lens::Brown(_) => "plumb_bob",
        Lens::Rational(_) => "rational_polynomial",
        Lens::KannalaBrandt(_) => "equidistant",
        Lens::ThinPrism(_) | Lens::Tsai(_) => {
            let reason = format!("cannot be '{}': camera_info has no such lens", camera.lens.name());
            return Err(file_error(path, "distortion_model", reason));
        }
    };
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.center_px);
    // A principal point in the middle: only the pose is read back from this matrix.
    let (px, py) = (0.5 * (camera.width as f64 - 1.0), 0.5 * (camera.height as f64 - 1.0));
    let mut text =
        format!("image_width: {}\nimage_height: {}\ncamera_name: {name}\n", camera.width, camera.height);
    let mut matrix = |name: &str, rows: usize, values: &[f64]| {
        let numbers: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
        let cols = values.len() / rows;
        writeln!(text, "{name}:\n  rows: {rows}\n  cols: {cols}\n  data: [{}]", numbers.join(", "))
            .expect("a string takes everything");
    };
    matrix("camera_matrix", 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    matrix("distortion_coefficients", 1, &camera.lens.coefficients());
    matrix("rectification_matrix", 3, turn.transpose().as_slice());
    matrix("projection_matrix", 3, &[focal, 0.0, px, shift, 0.0, focal, py, 0.0, 0.0, 0.0, 1.0, 0.0]);
    writeln!(text, "distortion_model: {model}").expect("a string takes everything");
    Ok(text)
}
