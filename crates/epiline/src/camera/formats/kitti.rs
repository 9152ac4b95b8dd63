//! KITTI's calibration files: lines of `name: numbers`, 3x4 projection matrices of pictures already aligned.
//!
//! - `calib_cam_to_cam.txt` of the raw recordings: `P_rect_00` … `P_rect_03`, the size in `S_rect_00` …;
//! - the benchmarks' `P0` … `P3`, without a size;
//! - the `calib.txt` of the Karlsruhe sequences, KITTI's predecessor: `P1_roi` and `P2_roi` of cropped pictures; `roi`
//!   is (first column, last column, first row, last row) of the crop, as the size of the pictures shows.
//!
//! Cameras 0 and 1 are KITTI's grey pair, 2 and 3 the one in colour.

use std::path::Path;

use super::aligned::Aligned;
use super::{Pair, ReadOptions, file_error, finite_numbers, read_text, size_from_options};
use crate::camera::StereoCalibration;
use crate::error::Result;

/// Which of KITTI's two pairs of cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cameras {
    Grey,
    Colour,
}

/// Whether a text is one of the three files: such a name, and a number behind it.
pub(super) fn recognises(text: &str) -> bool {
    let names = ["P0", "P2", "P_rect_00", "P_rect_02", "P1_roi"];
    let numeric =
        |value: &str| value.split_whitespace().next().is_some_and(|word| word.parse::<f64>().is_ok());
    text.lines()
        .filter_map(|line| line.split_once(':'))
        .any(|(key, value)| names.contains(&key.trim()) && numeric(value))
}

/// The rig of the file.
pub(super) fn read_pair(path: &Path, text: &str, cameras: Cameras, options: &ReadOptions) -> Result<Pair> {
    let has =
        |name: &str| text.lines().any(|line| line.split_once(':').is_some_and(|(key, _)| key.trim() == name));
    if has("P1_roi") {
        return Ok(karlsruhe(path, text)?.pair());
    }
    let numbers_of = match cameras {
        Cameras::Grey => [0, 1],
        Cameras::Colour => [2, 3],
    };
    if has("P_rect_00") || has("P_rect_02") {
        let [left, right] = numbers_of.map(|i| format!("P_rect_0{i}"));
        let name = format!("S_rect_0{}", numbers_of[0]);
        let size: [f64; 2] = numbers(path, text, &name)?;
        let sensible = size.iter().all(|side| side.fract() == 0.0 && (1.0..=16_384.0).contains(side));
        if !sensible {
            return Err(file_error(path, name, format!("is {size:?}, which is no image")));
        }
        return Ok(projections(path, text, [&left, &right], size.map(|side| side as usize))?.pair());
    }
    let [left, right] = numbers_of.map(|i| format!("P{i}"));
    let size = size_from_options(path, options)?;
    Ok(projections(path, text, [&left, &right], size)?.pair())
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

/// What the two projection matrices say about an aligned pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KittiProjection {
    /// Focal length of both views, pixels.
    pub focal_px: f64,
    /// Principal column of the left view, pixels.
    pub cx_px: f64,
    /// Principal row of both views, pixels.
    pub cy_px: f64,
    /// Principal column of the right view less that of the left, pixels.
    pub doffs_px: f64,
    /// Distance between the cameras, metres.
    pub baseline_m: f64,
    /// Width of the pictures, pixels.
    pub width: usize,
    /// Height of the pictures, pixels.
    pub height: usize,
}

/// Reads the projection of the cropped pictures.
///
/// # Errors
///
/// [`Error::Io`](crate::Error::Io) if the file cannot be read; [`Error::InvalidFile`](crate::Error::InvalidFile)
/// with the file and the entry if one is missing, incomplete, not a number, or does not describe an aligned pair.
pub fn read(path: impl AsRef<Path>) -> Result<KittiProjection> {
    let path = path.as_ref();
    let text = read_text(path)?;
    let Aligned { focal_px, left_cx_px, right_cx_px, cy_px, baseline_m, width, height } =
        karlsruhe(path, &text)?;
    let doffs_px = right_cx_px - left_cx_px;
    Ok(KittiProjection { focal_px, cx_px: left_cx_px, cy_px, doffs_px, baseline_m, width, height })
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
