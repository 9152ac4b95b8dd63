//! The largest magnitude of a row.

use super::portable;

/// `largest = max_x |pixels[x]|`, where NaN counts as larger than everything.
#[derive(Debug)]
pub struct MagnitudeRow<'a> {
    /// The pixels.
    pub pixels: &'a [f32],
    /// Out: the bits of the largest magnitude. Those of numbers without a sign are ordered as the numbers are, those of
    /// infinity and NaN above them.
    pub largest: u32,
}

#[inline(always)]
pub(super) fn magnitude_row(row: &mut MagnitudeRow<'_>) {
    let bits = |pixel: &f32| pixel.to_bits() & !(1 << 31);
    row.largest = row.pixels.iter().map(bits).fold(0, u32::max);
}

portable!(row, magnitude_row, MagnitudeRow<'_>);
