//! Patches that compare by zero-mean normalised cross-correlation (ZNCC).

use crate::image::ImageRef;

/// Half side of a patch, pixels.
pub(super) const HALF: usize = 6;
/// Side of a patch, pixels.
pub(super) const SIDE: usize = 2 * HALF + 1;
/// Pixels in a patch.
pub(super) const AREA: usize = SIDE * SIDE;

/// Length of a normalised patch; cutting its entries to integers costs about 1/1000 of correlation.
const LENGTH: f32 = 16_384.0;
/// Entries of a patch, filled up with zeros to whole vectors.
const LANES: usize = AREA.next_multiple_of(8);

/// A patch less its mean, scaled to one length: the product of two is their ZNCC.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch([i16; LANES]);

impl Patch {
    /// The patch around `(x, y)`, which lies at least [`HALF`] inside the image.
    pub fn around(image: ImageRef<'_, u8>, x: usize, y: usize) -> Self {
        let mut levels = [0u8; AREA];
        for (row, y) in levels.chunks_exact_mut(SIDE).zip(y - HALF..) {
            row.copy_from_slice(&image.row(y)[x - HALF..=x + HALF]);
        }
        let sum: u32 = levels.iter().map(|&level| u32::from(level)).sum();
        let squares: u32 = levels.iter().map(|&level| u32::from(level) * u32::from(level)).sum();
        let mean = sum as f32 / AREA as f32;
        // AREA²·variance, exact: at most 169²·255² needs the 32 bits and no more.
        let spread = AREA as u32 * squares - sum * sum;
        let scale = if spread > 0 { LENGTH / (spread as f32 / AREA as f32).sqrt() } else { 0.0 };
        let mut entries = [0i16; LANES];
        for (entry, &level) in entries.iter_mut().zip(&levels) {
            *entry = ((f32::from(level) - mean) * scale) as i16;
        }
        Self(entries)
    }

    /// Zero-mean normalised cross-correlation, -1 to 1; 0 if either patch is flat.
    pub fn zncc(&self, other: &Self) -> f32 {
        // Cauchy–Schwarz bounds the sum by LENGTH², which 32 bits hold.
        let sum: i32 = self.0.iter().zip(&other.0).map(|(&a, &b)| i32::from(a) * i32::from(b)).sum();
        sum as f32 / (LENGTH * LENGTH)
    }
}
