//! Resampling an image through a table of source positions, in fixed point.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::{Image, ImageRef, check_sides};
use crate::kernels::remap::{FRACTION_BITS, ONE, RemapRow, Table, Tap};
use crate::kernels::{Kernels, Level};

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
    table: Table,
    valid: Image<u8>,
    kernels: Kernels,
}

impl Remap {
    /// A table from `source_of(x, y)`: the source position (x, y), in pixels, of each output pixel, `None` where
    /// there is none. `size` and `source_size` are (width, height), pixels.
    pub fn from_fn(
        size: (usize, usize),
        source_size: (usize, usize),
        source_of: impl Fn(usize, usize) -> Option<[f64; 2]> + Sync,
    ) -> Result<Self> {
        Self::with_level(size, source_size, source_of, Level::current())
    }

    /// The same with the kernels of `level`; its images are the same at every level.
    pub fn with_level(
        (width, height): (usize, usize),
        (source_width, source_height): (usize, usize),
        source_of: impl Fn(usize, usize) -> Option<[f64; 2]> + Sync,
        level: Level,
    ) -> Result<Self> {
        check_sides("output", width, height)?;
        check_sides("source", source_width, source_height)?;
        let mut taps = vec![None; width * height];
        taps.par_chunks_mut(width).enumerate().for_each(|(y, taps)| {
            for (x, tap) in taps.iter_mut().enumerate() {
                *tap = source_of(x, y).and_then(|[u, v]| {
                    let (x, right) = split(u, source_width)?;
                    let (y, down) = split(v, source_height)?;
                    Some(Tap { x, y, right, down })
                });
            }
        });
        let has_source = taps.iter().map(|tap| if tap.is_some() { u8::MAX } else { 0 }).collect();
        Ok(Self {
            table: Table::new(&taps, width, (source_width, source_height)),
            valid: Image::from_vec("valid", has_source, width, height)?,
            kernels: Kernels::new(level),
        })
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
        let (source_width, source_height) = self.table.source_size();
        if (src.width(), src.height()) != (source_width, source_height) {
            return Err(Error::SizeMismatch {
                first: name,
                first_width: src.width(),
                first_height: src.height(),
                second: "the calibrated image",
                second_width: source_width,
                second_height: source_height,
            });
        }
        dst.resize(self.valid.width(), self.valid.height());
        for y in 0..dst.height() {
            self.kernels.remap(&mut RemapRow {
                table: &self.table,
                y,
                source: src.elements_from(0, 0),
                stride: src.stride(),
                values: dst.row_mut(y),
            });
        }
        Ok(())
    }
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
