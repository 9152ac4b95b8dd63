//! Resampling an image through a table of source positions, in fixed point.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::{Image, ImageRef, check_sides};

/// Fractional bits of a source position.
const FRACTION_BITS: u32 = 8;
/// One pixel in units of a source position.
const ONE: u16 = 1 << FRACTION_BITS;

/// Where one output pixel comes from: `(x, y)` is the upper left of its four source pixels; `right` and `down` are
/// the weights, in 1/256, of the right against the left and the lower against the upper ones.
///
/// On the last column `right` is 256 of the column before, so that all four pixels always exist.
#[derive(Debug, Clone, Copy, Default)]
struct Tap {
    x: u16,
    y: u16,
    right: u16,
    down: u16,
}

/// A table that says, for every pixel of an image to make, which four pixels of a source it combines:
/// eq. 4 of the paper, `I_new(x0,y0) = a1·I_old(x1,y1) + a2·I_old(x2,y2) + a3·I_old(x3,y3) + a4·I_old(x4,y4)`.
///
/// The weights are bilinear. Source positions are rounded to 1/256 px and the sum is exact integer arithmetic
/// rounded to nearest, so the result differs from real-valued bilinear interpolation by at most
/// `0.5 + (gx + gy)/512` grey levels, where `gx` and `gy` are the steps between the neighbours combined
/// (at most 255): 1.5 levels at worst, under 0.6 in ordinary pictures.
///
/// A pixel whose rounded source position lies outside the source, so that a pixel with a weight does not exist,
/// has no source: its value is 0 and so is its entry in [`valid`](Self::valid).
#[derive(Debug, Clone)]
pub struct Remap {
    taps: Image<Tap>,
    valid: Image<u8>,
    source_width: usize,
    source_height: usize,
}

impl Remap {
    /// A table from `source_of(x, y)`: the source position (x, y), in pixels, of each output pixel, `None` where
    /// there is none. `size` and `source_size` are (width, height), pixels.
    pub fn from_fn(
        (width, height): (usize, usize),
        (source_width, source_height): (usize, usize),
        source_of: impl Fn(usize, usize) -> Option<[f64; 2]> + Sync,
    ) -> Result<Self> {
        check_sides("output", width, height)?;
        check_sides("source", source_width, source_height)?;
        let mut taps = Image::<Tap>::new(width, height);
        let mut valid = Image::<u8>::new(width, height);
        let rows = taps.as_mut_slice().par_chunks_mut(width).zip(valid.as_mut_slice().par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (taps, valid))| {
            for (x, (tap, valid)) in taps.iter_mut().zip(valid).enumerate() {
                let found = source_of(x, y).and_then(|[u, v]| {
                    let (x, right) = split(u, source_width)?;
                    let (y, down) = split(v, source_height)?;
                    Some(Tap { x, y, right, down })
                });
                if let Some(found) = found {
                    (*tap, *valid) = (found, u8::MAX);
                }
            }
        });
        Ok(Self { taps, valid, source_width, source_height })
    }

    /// 255 where the output pixel has a source, 0 where it has none.
    pub fn valid(&self) -> ImageRef<'_, u8> {
        self.valid.view()
    }

    /// Resamples `src` into `dst`, which takes the table's size. `name` is what an error calls the image.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] unless `src` has the source size of the table.
    pub fn apply(&self, name: &'static str, src: ImageRef<'_, u8>, dst: &mut Image<u8>) -> Result<()> {
        if (src.width(), src.height()) != (self.source_width, self.source_height) {
            return Err(Error::SizeMismatch {
                first: name,
                first_width: src.width(),
                first_height: src.height(),
                second: "the calibrated image",
                second_width: self.source_width,
                second_height: self.source_height,
            });
        }
        dst.resize(self.taps.width(), self.taps.height());
        // A source one pixel wide or high has no neighbour to combine with; the neighbour's weight is 0 there.
        let (step_x, step_y) = (usize::from(src.width() > 1), usize::from(src.height() > 1));
        for y in 0..self.taps.height() {
            let combined = self.taps.row(y).iter().map(|tap| {
                let (x1, y1) = (usize::from(tap.x), usize::from(tap.y));
                let (upper, lower) = (src.row(y1), src.row(y1 + step_y));
                bilinear(tap, [upper[x1], upper[x1 + step_x], lower[x1], lower[x1 + step_x]])
            });
            for ((value, &valid), out) in combined.zip(self.valid.row(y)).zip(dst.row_mut(y)) {
                *out = value & valid;
            }
        }
        Ok(())
    }
}

/// `a1·I1 + a2·I2 + a3·I3 + a4·I4`, rounded: upper left, upper right, lower left, lower right.
fn bilinear(tap: &Tap, [i1, i2, i3, i4]: [u8; 4]) -> u8 {
    let (right, down) = (u32::from(tap.right), u32::from(tap.down));
    let (left, up) = (u32::from(ONE) - right, u32::from(ONE) - down);
    let sum = (u32::from(i1) * left + u32::from(i2) * right) * up
        + (u32::from(i3) * left + u32::from(i4) * right) * down;
    ((sum + (1 << (2 * FRACTION_BITS - 1))) >> (2 * FRACTION_BITS)) as u8
}

/// Rounds a source coordinate to 1/256 px and splits it into the first of its two pixels and the weight of the
/// second; `None` outside the `len` pixels there are.
fn split(position: f64, len: usize) -> Option<(u16, u16)> {
    let last = (len - 1) as f64 * f64::from(ONE);
    let rounded = (position * f64::from(ONE)).round();
    if !(0.0..=last).contains(&rounded) {
        return None;
    }
    // At most 16383·256, by the limit on an image's sides.
    let fixed = rounded as usize;
    let first = (fixed >> FRACTION_BITS).min(len.saturating_sub(2));
    Some((first as u16, (fixed - (first << FRACTION_BITS)) as u16))
}
