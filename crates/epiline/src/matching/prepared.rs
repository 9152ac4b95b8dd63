//! The pair as the kernels read it: prefiltered, right rows padded.

use super::crew::Crew;
use super::params::{MatcherParams, Prefilter};
use super::threads::share_rows;
use crate::image::{Image, ImageRef};
use crate::kernels::Kernels;
use crate::kernels::sad::RowPair;
use crate::preprocess::xsobel_row;

/// Both images after the prefilter.
#[derive(Debug, Default)]
pub(super) struct PreparedPair {
    left: Image<u8>,
    /// Rows of `padding + width` pixels: the first pixel `padding` times, then the image.
    right: Image<u8>,
    /// x-Sobel of the left image where texture is tested and the prefilter has not made it.
    texture: Option<Image<u8>>,
    lanes: usize,
}

impl PreparedPair {
    /// Prefilters a pair for matching with `lanes` costs per pixel.
    pub fn prepare(
        &mut self,
        kernels: &Kernels,
        params: &MatcherParams,
        lanes: usize,
        left: ImageRef<'_, u8>,
        right: ImageRef<'_, u8>,
        crew: &Crew,
    ) {
        let (width, height) = (left.width(), left.height());
        // Lane 0 of column 0 is the largest disparity, so many pixels left of the image.
        let padding = params.min_disparity + lanes - 1;
        self.lanes = lanes;
        self.left.resize(width, height);
        self.right.resize(padding + width, height);
        let cap = params.prefilter_cap;
        let filter = |image: ImageRef<'_, u8>, y: usize, row: &mut [u8]| match params.prefilter {
            Prefilter::None => row.copy_from_slice(image.row(y)),
            Prefilter::XSobel => xsobel_row(kernels, image, y, cap, row),
        };
        share_rows(crew, &mut self.left, &mut self.right, |rows, lefts, rights| {
            let both = lefts.chunks_exact_mut(width).zip(rights.chunks_exact_mut(padding + width));
            for (y, (left_row, right_row)) in rows.zip(both) {
                filter(left, y, left_row);
                let (pad, inside) = right_row.split_at_mut(padding);
                filter(right, y, inside);
                pad.fill(inside[0]);
            }
        });

        let separate_texture = params.texture_threshold > 0 && params.prefilter == Prefilter::None;
        if !separate_texture {
            self.texture = None;
            return;
        }
        let texture = self.texture.get_or_insert_default();
        texture.resize(width, height);
        for y in 0..height {
            xsobel_row(kernels, left, y, cap, texture.row_mut(y));
        }
    }

    /// Width of the images, pixels.
    pub fn width(&self) -> usize {
        self.left.width()
    }

    /// Height of the images, pixels.
    pub fn height(&self) -> usize {
        self.left.height()
    }

    /// A row of both; rows beyond the image are its first or last.
    pub fn row(&self, y: isize) -> RowPair<'_> {
        let y = self.clamped(y);
        RowPair { left: self.left.row(y), right: &self.right.row(y)[..self.width() + self.lanes - 1] }
    }

    /// A row of the left image's x-Sobel; rows beyond the image are its first or last.
    pub fn texture_row(&self, y: isize) -> &[u8] {
        self.texture.as_ref().unwrap_or(&self.left).row(self.clamped(y))
    }

    fn clamped(&self, y: isize) -> usize {
        y.clamp(0, self.height() as isize - 1) as usize
    }
}
