//! Middlebury's `calib.txt` (2014 and later): `cam0=[f 0 cx; 0 f cy; 0 0 1]`, `doffs` in pixels, `baseline` in
//! millimetres, `width`, `height`.

use std::path::Path;

use super::aligned::Aligned;
use super::{Pair, file_error};
use crate::camera::StereoCalibration;
use crate::error::Result;

const MM_PER_M: f64 = 1e3;
/// The largest image side accepted, pixels.
const MAX_SIDE_PX: f64 = 16_384.0;

/// Whether a text is such a file.
pub(super) fn recognises(text: &str) -> bool {
    text.lines().filter_map(|line| line.split_once('=')).any(|(key, _)| key.trim() == "cam0")
}

/// The rig of the file.
pub(super) fn read(path: &Path, text: &str) -> Result<Pair> {
    let number = |name: &str| -> Result<f64> { Ok(numbers::<1>(path, text, name)?[0]) };
    let cam0: [f64; 9] = numbers(path, text, "cam0")?;
    let cam1: [f64; 9] = numbers(path, text, "cam1")?;
    for (name, k) in [("cam0", cam0), ("cam1", cam1)] {
        if k[0] <= 0.0 || [k[1], k[3], k[6], k[7], k[8]] != [0.0, 0.0, 0.0, 0.0, 1.0] || k[0] != k[4] {
            return Err(file_error(path, name, format!("is {k:?}; expected f 0 cx; 0 f cy; 0 0 1")));
        }
    }
    if (cam0[0], cam0[5]) != (cam1[0], cam1[5]) {
        return Err(file_error(path, "cam1", "has another focal length or principal row than cam0"));
    }
    let doffs = number("doffs")?;
    if (cam1[2] - cam0[2] - doffs).abs() > 0.01 {
        let reason = format!("is {doffs} px, but the principal columns differ by {} px", cam1[2] - cam0[2]);
        return Err(file_error(path, "doffs", reason));
    }
    let baseline_mm = number("baseline")?;
    if baseline_mm <= 0.0 {
        return Err(file_error(path, "baseline", format!("is {baseline_mm} mm; must be positive")));
    }
    let side = |name: &str| {
        let value = number(name)?;
        let sensible = value.fract() == 0.0 && (1.0..=MAX_SIDE_PX).contains(&value);
        sensible.then_some(value as usize).ok_or_else(|| {
            file_error(path, name, format!("is {value}; expected a whole number from 1 to {MAX_SIDE_PX}"))
        })
    };
    let aligned = Aligned {
        focal_px: cam0[0],
        left_cx_px: cam0[2],
        right_cx_px: cam1[2],
        cy_px: cam0[5],
        baseline_m: baseline_mm / MM_PER_M,
        width: side("width")?,
        height: side("height")?,
    };
    Ok(aligned.pair())
}

/// The `N` finite numbers of the line `name=…`.
fn numbers<const N: usize>(path: &Path, text: &str, name: &str) -> Result<[f64; N]> {
    let value = text
        .lines()
        .filter_map(|line| line.split_once('='))
        .find(|(key, _)| key.trim() == name)
        .map(|(_, value)| value)
        .ok_or_else(|| file_error(path, name, "is missing"))?;
    let words =
        value.split(|c: char| c.is_whitespace() || "[];,".contains(c)).filter(|word| !word.is_empty());
    super::finite_numbers(path, name, words)
}

/// The text of the file.
pub(super) fn text_of(path: &Path, rig: &StereoCalibration) -> Result<String> {
    let Aligned { focal_px: f, left_cx_px, right_cx_px, cy_px, baseline_m, width, height } =
        Aligned::of(path, rig)?;
    Ok(format!(
        "cam0=[{f:?} 0 {left_cx_px:?}; 0 {f:?} {cy_px:?}; 0 0 1]\n\
         cam1=[{f:?} 0 {right_cx_px:?}; 0 {f:?} {cy_px:?}; 0 0 1]\n\
         doffs={:?}\nbaseline={:?}\nwidth={width}\nheight={height}\n",
        right_cx_px - left_cx_px,
        baseline_m * MM_PER_M
    ))
}
