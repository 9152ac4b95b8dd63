//! Clipped windows: highlights and shadows that the sensor did not resolve say nothing about disparity.

use super::map::{DisparityMap, Validity};
use super::params::MatcherParams;
use super::texture::TextureSums;
use crate::image::ImageRef;
use crate::kernels::Kernels;

/// Finds windows that are mostly clipped; its buffers are kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct SaturationTest {
    sums: TextureSums,
    informative: Vec<u8>,
}

impl SaturationTest {
    /// Marks pixels of the map that have a candidate and at least
    /// [`saturation_threshold`](MatcherParams::saturation_threshold) percent of whose window in the left image, clamped as
    /// for matching, are at 0 or 255. The map's first row is `first_row` of the image.
    pub fn mark(
        &mut self,
        kernels: &Kernels,
        params: &MatcherParams,
        left: ImageRef<'_, u8>,
        first_row: usize,
        out: &mut DisparityMap,
    ) {
        let (radius, block_size) = (params.radius() as isize, params.block_size as u32);
        let area = block_size * block_size;
        let saturated = (area * u32::from(params.saturation_threshold)).div_ceil(100);
        // So many informative pixels would be enough.
        let enough = area - saturated + 1;
        self.sums.reset(left.width(), params.radius());
        let first = first_row as isize;
        (first - radius - 1..first + radius).for_each(|y| self.slide(left, y, TextureSums::enter));
        for y in 0..out.height() {
            let centre = first + y as isize;
            self.slide(left, centre + radius, TextureSums::enter);
            self.slide(left, centre - radius - 1, TextureSums::leave);
            let (bit, except) = (Validity::SATURATED, Validity::NO_CANDIDATE);
            self.sums.mark(kernels, enough, bit, except, out.validity.row_mut(y));
        }
    }

    /// Lets a row enter the windows or leave them; rows beyond the image are its first or last.
    fn slide(&mut self, left: ImageRef<'_, u8>, y: isize, step: fn(&mut TextureSums, &[u8], u8)) {
        let row = left.row(y.clamp(0, left.height() as isize - 1) as usize);
        self.informative.clear();
        self.informative.extend(row.iter().map(|&pixel| u8::from((pixel != 0) & (pixel != u8::MAX))));
        step(&mut self.sums, &self.informative, 0);
    }
}
