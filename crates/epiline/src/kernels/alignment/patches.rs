//! Patches of whole pixels: their sums, and their products with one another.

use super::{LANES, SIDE};
use crate::kernels::portable;

/// Pixels in a patch.
pub const AREA: usize = SIDE * SIDE;

/// Sums of patches: what a zero-mean normalised cross-correlation needs of each by itself.
#[derive(Debug)]
pub struct PatchSums<'a> {
    /// The image's elements from some row on, and how far apart its rows start.
    pub image: &'a [u8],
    /// Elements from one row to the next.
    pub stride: usize,
    /// Where in `image` the patches begin; each reads [`LANES`] elements of [`SIDE`] rows.
    pub at: &'a [u32],
    /// Out, for every patch: the sum of its levels and of their squares.
    pub sums: &'a mut [[u32; 2]],
}

impl PatchSums<'_> {
    pub(in crate::kernels) fn check(&self) {
        assert!(self.at.len() == self.sums.len(), "patches and sums");
    }
}

/// Products of one patch with others.
#[derive(Debug)]
pub struct Correlate<'a> {
    /// The patch: the elements of its image from its beginning on,
    pub patch: &'a [u8],
    /// and how far apart that image's rows start.
    pub patch_stride: usize,
    /// The image of the others, as in [`PatchSums`].
    pub image: &'a [u8],
    /// Elements from one row of it to the next.
    pub stride: usize,
    /// Where in `image` the others begin.
    pub at: &'a [u32],
    /// Out: the sum of products of levels, for each of the others.
    pub products: &'a mut [u32],
}

impl Correlate<'_> {
    pub(in crate::kernels) fn check(&self) {
        assert!(self.at.len() == self.products.len(), "patches and products");
    }
}

/// A row of a patch, as many elements as a vector has.
#[inline(always)]
fn row(image: &[u8], at: usize) -> &[u8; LANES] {
    image[at..].first_chunk().expect("a patch lies inside")
}

#[inline(always)]
pub(in crate::kernels) fn patch_sums(call: &mut PatchSums<'_>) {
    for (sums, &at) in call.sums.iter_mut().zip(call.at) {
        let (mut sum, mut squares) = ([0u16; LANES], [0u32; LANES]);
        for y in 0..SIDE {
            let levels = row(call.image, at as usize + y * call.stride);
            for x in 0..LANES {
                let level = u16::from(levels[x]);
                sum[x] += level;
                squares[x] += u32::from(level * level);
            }
        }
        *sums = [0; 2];
        for x in 0..SIDE {
            sums[0] += u32::from(sum[x]);
            sums[1] += squares[x];
        }
    }
}

#[inline(always)]
pub(in crate::kernels) fn correlate(call: &mut Correlate<'_>) {
    let mut patch = [[0i16; LANES]; SIDE];
    for (y, levels) in patch.iter_mut().enumerate() {
        let source = row(call.patch, y * call.patch_stride);
        for x in 0..SIDE {
            levels[x] = i16::from(source[x]);
        }
    }
    for (product, &at) in call.products.iter_mut().zip(call.at) {
        // At most 169·255², which 24 bits hold; beyond SIDE the patch is 0.
        let mut sums = [0i32; LANES];
        for (y, levels) in patch.iter().enumerate() {
            let other = row(call.image, at as usize + y * call.stride);
            for x in 0..LANES {
                sums[x] += i32::from(levels[x]) * i32::from(other[x]);
            }
        }
        *product = 0;
        for sum in sums {
            *product += sum as u32;
        }
    }
}

portable!(sums, patch_sums, PatchSums<'_>);
portable!(products, correlate, Correlate<'_>);
