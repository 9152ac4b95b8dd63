//! The `calib.txt` that comes with the Karlsruhe sequences, KITTI's predecessor: pictures already aligned and cropped.
//!
//! Lines of `name: numbers`. `P1_roi` and `P2_roi` are the 3x4 projection matrices of the cropped pictures, row after
//! row; `roi` is (first column, last column, first row, last row) of the crop, as the size of the pictures shows.

use std::path::Path;

use super::{file_error, read_text};
use crate::error::Result;

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
    let [x_first, x_last, y_first, y_last] = numbers(path, &text, "roi")?;
    let left: [f64; 12] = numbers(path, &text, "P1_roi")?;
    let right: [f64; 12] = numbers(path, &text, "P2_roi")?;
    let side = |first: f64, last: f64| {
        let pixels = last - first + 1.0;
        let sensible = pixels.fract() == 0.0 && (1.0..=16_384.0).contains(&pixels);
        sensible
            .then_some(pixels as usize)
            .ok_or_else(|| file_error(path, "roi", format!("spans {first} to {last} px, which is no image")))
    };
    let (focal_px, baseline_m) = (left[0], (left[3] - right[3]) / left[0]);
    if focal_px <= 0.0 {
        return Err(file_error(
            path,
            "P1_roi",
            format!("has a focal length of {focal_px} px; must be positive"),
        ));
    }
    // One focal length, one row, no shift but along the row: otherwise the pictures are not aligned.
    let aligned = [(0, 5), (5, 5), (6, 6), (7, 7)];
    for (a, b) in aligned {
        if (left[a] - right[b]).abs() > 1e-3 {
            let reason = format!(
                "disagrees with P1_roi: {} against {}; the pictures are not aligned",
                right[b], left[a]
            );
            return Err(file_error(path, "P2_roi", reason));
        }
    }
    if baseline_m <= 0.0 {
        let reason = format!("puts the right camera {} m to the left of the left one", -baseline_m);
        return Err(file_error(path, "P2_roi", reason));
    }
    Ok(KittiProjection {
        focal_px,
        cx_px: left[2],
        cy_px: left[6],
        doffs_px: right[2] - left[2],
        baseline_m,
        width: side(x_first, x_last)?,
        height: side(y_first, y_last)?,
    })
}

/// The `N` finite numbers of the line `name: …`.
fn numbers<const N: usize>(path: &Path, text: &str, name: &str) -> Result<[f64; N]> {
    let line = text
        .lines()
        .find_map(|line| line.split_once(':').filter(|(key, _)| key.trim() == name))
        .ok_or_else(|| file_error(path, name, "is missing"))?;
    let words: Vec<&str> = line.1.split_whitespace().collect();
    if words.len() != N {
        return Err(file_error(path, name, format!("has {} numbers; expected {N}", words.len())));
    }
    let mut values = [0.0; N];
    for (value, word) in values.iter_mut().zip(words) {
        *value =
            word.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                file_error(path, name, format!("holds '{word}', which is not a finite number"))
            })?;
    }
    Ok(values)
}
