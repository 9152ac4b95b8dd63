//! Windows with too little texture, found once the map is there.

use super::map::{DisparityMap, Validity};
use super::params::MatcherParams;
use super::texture::TextureSums;
use crate::image::{Image, ImageRef};
use crate::kernels::Kernels;
use crate::preprocess::xsobel_row;

/// The test of [`MatcherParams::texture_threshold`]; its buffers are kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct TextureTest {
    derivative: Image<u8>,
    sums: TextureSums,
}

impl TextureTest {
    /// Adds [`Validity::LOW_TEXTURE`] to the map where it applies. The map's first row is `first_row` of the image.
    pub fn mark(
        &mut self,
        kernels: &Kernels,
        params: &MatcherParams,
        left: ImageRef<'_, u8>,
        first_row: usize,
        out: &mut DisparityMap,
    ) {
        let (radius, cap) = (params.radius() as isize, params.prefilter_cap);
        self.derivative.resize(left.width(), left.height());
        for y in 0..left.height() {
            xsobel_row(kernels, left, y, cap, self.derivative.row_mut(y));
        }
        let last = left.height() as isize - 1;
        let derivative = &self.derivative;
        let row = |y: isize| derivative.row(y.clamp(0, last) as usize);
        let first = first_row as isize;
        self.sums.reset(left.width(), params.radius());
        (first - radius - 1..first + radius).for_each(|y| self.sums.enter(row(y), cap));
        for i in 0..out.height() {
            let y = first + i as isize;
            self.sums.enter(row(y + radius), cap);
            self.sums.leave(row(y - radius - 1), cap);
            let (bit, except) = (Validity::LOW_TEXTURE, Validity::NO_CANDIDATE);
            let bits = out.validity.row_mut(i);
            self.sums.mark(kernels, params.texture_threshold, bit, except, bits);
        }
    }
}
