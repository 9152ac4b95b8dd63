//! KITTI's calibration files: lines of `name: numbers`, 3x4 projection matrices of pictures already aligned.
//!
//! - `calib_cam_to_cam.txt` of the raw recordings: `P_rect_00` … `P_rect_03`, the size in `S_rect_00` …; and of the
//!   cameras as they are, for pictures that were not aligned: `K_00`, `D_00` (Brown's k1 k2 p1 p2 k3), the size in
//!   `S_00`, and the pose from camera 0, `x = R_02 x_0 + T_02`;
//! - the benchmarks' `P0` … `P3`, without a size;
//! - the `calib.txt` of the Karlsruhe sequences, KITTI's predecessor: `P1_roi` and `P2_roi` of cropped pictures; `roi`
//!   is (first column, last column, first row, last row) of the crop, as the size of the pictures shows.
//!
//! Cameras 0 and 1 are KITTI's grey pair, 2 and 3 the one in colour.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::aligned::Aligned;
use super::{Format, Pair, ReadOptions, file_error, finite_numbers, size_from_options};
use crate::camera::{Brown, CameraModel, Lens, Pose, StereoCalibration};
use crate::error::{Error, Result};

/// The pair in colour.
const COLOUR: [usize; 2] = [2, 3];

/// The grey pair.
const GREY: [usize; 2] = [0, 1];

/// Which format a text is of, if it is one of the files: such a name, and a number behind it.
pub(super) fn recognised(text: &str) -> Option<Format> {
    let numeric =
        |value: &str| value.split_whitespace().next().is_some_and(|word| word.parse::<f64>().is_ok());
    let has = |names: &[&str]| {
        let mut lines = text.lines().filter_map(|line| line.split_once(':'));
        lines.any(|(key, value)| names.contains(&key.trim()) && numeric(value))
    };
    if has(&["P0", "P2", "P_rect_00", "P_rect_02", "P1_roi"]) {
        Some(Format::Kitti)
    } else {
        has(&["K_00", "K_02"]).then_some(Format::KittiRaw)
    }
}

/// The rig of the file: of the cameras as they are with [`Format::KittiRaw`], else of the aligned pictures.
pub(super) fn read_pair(path: &Path, text: &str, format: Format, options: &ReadOptions) -> Result<Pair> {
    let cameras = options.cameras.unwrap_or(if format == Format::KittiGrey { GREY } else { COLOUR });
    if cameras[0] == cameras[1] || cameras.iter().any(|number| *number > 99) {
        let expected = "expected the numbers of the left and of another, the right camera";
        return Err(Error::invalid("cameras", format!("{cameras:?}"), expected));
    }
    if format == Format::KittiRaw {
        return raw(path, text, cameras);
    }
    let has =
        |name: &str| text.lines().any(|line| line.split_once(':').is_some_and(|(key, _)| key.trim() == name));
    if has("P1_roi") {
        return Ok(karlsruhe(path, text)?.pair());
    }
    if has("P_rect_00") || has("P_rect_02") {
        let [left, right] = cameras.map(|number| format!("P_rect_{number:02}"));
        let size = size(path, text, &format!("S_rect_{:02}", cameras[0]))?;
        return Ok(projections(path, text, [&left, &right], size)?.pair());
    }
    let [left, right] = cameras.map(|number| format!("P{number}"));
    let size = size_from_options(path, options)?;
    Ok(projections(path, text, [&left, &right], size)?.pair())
}

/// Two cameras before their pictures were aligned.
fn raw(path: &Path, text: &str, cameras: [usize; 2]) -> Result<Pair> {
    let [left, right] = cameras.map(|number| raw_camera(path, text, number));
    let ((left, left_from_0), (right, right_from_0)) = (left?, right?);
    Ok(Pair { left, right, right_from_left: right_from_0.after(&left_from_0.inverse()) })
}

/// A camera of the raw recordings, and where camera 0 is to it.
fn raw_camera(path: &Path, text: &str, number: usize) -> Result<(CameraModel, Pose)> {
    let name = |letter: &str| format!("{letter}_{number:02}");
    let [width, height] = size(path, text, &name("S"))?;
    let k: [f64; 9] = numbers(path, text, &name("K"))?;
    let [fx, _, cx, _, fy, cy, ..] = k;
    if k != [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0] || fx <= 0.0 || fy <= 0.0 {
        let reason = format!("is {k:?}; expected fx 0 cx, 0 fy cy, 0 0 1 with positive focal lengths");
        return Err(file_error(path, name("K"), reason));
    }
    let [k1, k2, p1, p2, k3] = numbers(path, text, &name("D"))?;
    let rotation = Matrix3::from_row_slice(&numbers::<9>(path, text, &name("R"))?);
    let off = (rotation.transpose() * rotation - Matrix3::identity()).abs().max();
    if off > 1e-4 || rotation.determinant() < 0.0 {
        return Err(file_error(
            path,
            name("R"),
            format!("is no rotation matrix: off orthonormal by {off:.2e}"),
        ));
    }
    let camera = CameraModel {
        focal_px: [fx, fy],
        center_px: [cx, cy],
        lens: Lens::Brown(Brown { k1, k2, p1, p2, k3 }),
        width,
        height,
    };
    let translation_m = Vector3::from(numbers::<3>(path, text, &name("T"))?);
    Ok((camera, Pose { rotation, translation_m }))
}

/// Width and height of pictures.
fn size(path: &Path, text: &str, name: &str) -> Result<[usize; 2]> {
    let size: [f64; 2] = numbers(path, text, name)?;
    let sensible = size.iter().all(|side| side.fract() == 0.0 && (1.0..=16_384.0).contains(side));
    if !sensible {
        return Err(file_error(path, name, format!("is {size:?}, which is no image")));
    }
    Ok(size.map(|side| side as usize))
}

/// The text of a `calib_cam_to_cam.txt` with the cameras 0 and 1.
pub(super) fn text_of(path: &Path, rig: &StereoCalibration) -> Result<String> {
    let Aligned { focal_px: f, left_cx_px, right_cx_px, cy_px, baseline_m, width, height } =
        Aligned::of(path, rig)?;
    let camera = |i: usize, cx: f64, shift: f64| {
        let (width, height) = (width as f64, height as f64);
        format!(
            "S_rect_0{i}: {width:e} {height:e}\nR_rect_0{i}: 1 0 0 0 1 0 0 0 1\n\
             P_rect_0{i}: {f:e} 0 {cx:e} {shift:e} 0 {f:e} {cy_px:e} 0 0 0 1 0\n"
        )
    };
    Ok(camera(0, left_cx_px, 0.0) + &camera(1, right_cx_px, -f * baseline_m))
}

fn karlsruhe(path: &Path, text: &str) -> Result<Aligned> {
    let [x_first, x_last, y_first, y_last] = numbers(path, text, "roi")?;
    let side = |first: f64, last: f64| {
        let pixels = last - first + 1.0;
        let sensible = pixels.fract() == 0.0 && (1.0..=16_384.0).contains(&pixels);
        sensible
            .then_some(pixels as usize)
            .ok_or_else(|| file_error(path, "roi", format!("spans {first} to {last} px, which is no image")))
    };
    let size = [side(x_first, x_last)?, side(y_first, y_last)?];
    projections(path, text, ["P1_roi", "P2_roi"], size)
}

/// The pair of two named projection matrices.
fn projections(
    path: &Path,
    text: &str,
    [left_name, right_name]: [&str; 2],
    [width, height]: [usize; 2],
) -> Result<Aligned> {
    let left: [f64; 12] = numbers(path, text, left_name)?;
    let right: [f64; 12] = numbers(path, text, right_name)?;
    let (focal_px, baseline_m) = (left[0], (left[3] - right[3]) / left[0]);
    if focal_px <= 0.0 {
        let reason = format!("has a focal length of {focal_px} px; must be positive");
        return Err(file_error(path, left_name, reason));
    }
    // One focal length and one row: otherwise the pictures are not aligned. KITTI's own colour cameras differ by
    // 1e-5 of the fourth column's second row, which moves nothing by a hundredth of a pixel.
    let aligned = [(0, 5, 1e-3), (5, 5, 1e-3), (6, 6, 1e-3), (7, 7, 0.05 * focal_px)];
    for (a, b, tolerance) in aligned {
        if (left[a] - right[b]).abs() > tolerance {
            let reason = format!(
                "disagrees with {left_name}: {} against {}; the pictures are not aligned",
                right[b], left[a]
            );
            return Err(file_error(path, right_name, reason));
        }
    }
    if baseline_m <= 0.0 {
        let reason = format!("puts the right camera {} m to the left of the left one", -baseline_m);
        return Err(file_error(path, right_name, reason));
    }
    Ok(Aligned {
        focal_px,
        left_cx_px: left[2],
        right_cx_px: right[2],
        cy_px: left[6],
        baseline_m,
        width,
        height,
    })
}

/// The `N` finite numbers of the line `name: …`.
fn numbers<const N: usize>(path: &Path, text: &str, name: &str) -> Result<[f64; N]> {
    let line = text
        .lines()
        .find_map(|line| line.split_once(':').filter(|(key, _)| key.trim() == name))
        .ok_or_else(|| file_error(path, name, "is missing"))?;
    finite_numbers(path, name, line.1.split_whitespace())
}
