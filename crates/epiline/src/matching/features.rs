//! What the pixels of a row are compared by, where that is more than their prefiltered values.

use super::params::{MatcherParams, Prefilter};
use crate::image::ImageRef;
use crate::kernels::Kernels;
use crate::kernels::semi_global::features::{
    CENSUS_BYTES, CENSUS_RADIUS, CensusRow, Channel, ExtremesRow, PixelRow,
};
use crate::preprocess::xsobel_row;

/// What the pixels of one row are compared by, in planes that begin with `padding` copies of their first pixel's.
#[derive(Debug, Default)]
pub(super) struct Features {
    padding: usize,
    filtered: [Vec<u8>; 3],
    grey: [Vec<u8>; 3],
    census: [Vec<u8>; CENSUS_BYTES],
    /// Rows of the census window, extended to both sides.
    extended: [Vec<u8>; 2 * CENSUS_RADIUS + 1],
}

impl Features {
    /// Sizes the planes for rows of `width` pixels after `padding` more.
    pub fn resize(&mut self, width: usize, padding: usize) {
        self.padding = padding;
        let planes = self.filtered.iter_mut().chain(&mut self.grey).chain(&mut self.census);
        planes.for_each(|plane| plane.resize(padding + width, 0));
        self.extended.iter_mut().for_each(|row| row.resize(width + 2 * CENSUS_RADIUS, 0));
    }

    /// Those of row `y` of an image.
    pub fn compute(&mut self, kernels: &Kernels, params: &MatcherParams, image: ImageRef<'_, u8>, y: usize) {
        let padding = self.padding;
        match params.prefilter {
            // Grey values are compared in any case.
            Prefilter::None => self.filtered[0].fill(0),
            Prefilter::XSobel => {
                let filtered = &mut self.filtered[0][padding..];
                xsobel_row(kernels, image, y, params.prefilter_cap, filtered);
            }
        }
        self.grey[0][padding..].copy_from_slice(image.row(y));
        for [value, low, high] in [&mut self.filtered, &mut self.grey] {
            kernels.extremes(&mut ExtremesRow {
                value: &value[padding..],
                low: &mut low[padding..],
                high: &mut high[padding..],
            });
        }
        let last = image.height() as isize - 1;
        for (j, extended) in self.extended.iter_mut().enumerate() {
            let row = image.row((y as isize + j as isize - CENSUS_RADIUS as isize).clamp(0, last) as usize);
            let (front, rest) = extended.split_at_mut(CENSUS_RADIUS);
            let (inside, back) = rest.split_at_mut(row.len());
            front.fill(row[0]);
            inside.copy_from_slice(row);
            back.fill(row[row.len() - 1]);
        }
        kernels.census(&mut CensusRow {
            rows: self.extended.each_ref().map(Vec::as_slice),
            planes: self.census.each_mut().map(|plane| &mut plane[padding..]),
        });
        for plane in self.filtered.iter_mut().chain(&mut self.grey).chain(&mut self.census) {
            let first = plane[padding];
            plane[..padding].fill(first);
        }
    }

    /// The first `len` pixels.
    pub fn row(&self, len: usize) -> PixelRow<'_> {
        fn cut(planes: &[Vec<u8>; 3], len: usize) -> Channel<'_> {
            let [value, low, high] = planes;
            Channel { value: &value[..len], low: &low[..len], high: &high[..len] }
        }
        PixelRow {
            filtered: cut(&self.filtered, len),
            grey: cut(&self.grey, len),
            census: self.census.each_ref().map(|plane| &plane[..len]),
        }
    }
}
