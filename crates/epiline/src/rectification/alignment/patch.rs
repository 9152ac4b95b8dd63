//! Patches that compare by zero-mean normalised cross-correlation (ZNCC).

use crate::image::ImageRef;

/// Half side of a patch, pixels.
pub(super) const HALF: usize = 6;
/// Side of a patch, pixels.
pub(super) const SIDE: usize = 2 * HALF + 1;
/// Pixels in a patch.
pub(super) const AREA: usize = SIDE * SIDE;

/// Length of a normalised patch; rounding its entries to integers costs about 1/2000 of correlation.
const LENGTH: f32 = 16_384.0;
/// Entries of a patch, filled up with zeros to whole vectors.
const LANES: usize = AREA.next_multiple_of(8);

/// A patch less its mean, scaled to one length: the product of two is their ZNCC.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch([i16; LANES]);

impl Patch {
    /// The patch around `(x, y)`, which lies at least [`HALF`] inside the image.
    pub fn around(image: ImageRef<'_, u8>, x: usize, y: usize) -> Self {
        let mut levels = [0f32; AREA];
        for (row, y) in levels.chunks_exact_mut(SIDE).zip(y - HALF..) {
            let source = &image.row(y)[x - HALF..=x + HALF];
            row.iter_mut().zip(source).for_each(|(level, &pixel)| *level = f32::from(pixel));
        }
        let mean = levels.iter().sum::<f32>() / AREA as f32;
        let energy: f32 = levels.iter().map(|level| (level - mean) * (level - mean)).sum();
        let scale = if energy > 0.0 { LENGTH / energy.sqrt() } else { 0.0 };
        let mut entries = [0i16; LANES];
        for (entry, level) in entries.iter_mut().zip(levels) {
            *entry = ((level - mean) * scale).round_ties_even() as i16;
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
