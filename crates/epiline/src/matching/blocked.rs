//! What is not a candidate: pixels without source, right pixels outside the image, disparities not asked for.

use super::params::MatcherParams;
use crate::image::ImageRef;

/// 255 where blocked, else 0.
#[derive(Debug, Default)]
pub(super) struct BlockedPixels {
    /// Per left column.
    pub left: Vec<u8>,
    /// Per padded right column: that of column `c`, lane `k` is `right[c + k]`.
    pub right: Vec<u8>,
    /// Per lane.
    pub lanes: Vec<u8>,
    /// Disparity of lane 0, px; so many right columns less one lie left of the image.
    first_disparity: usize,
}

impl BlockedPixels {
    /// For rows whose pixels all have a source.
    pub fn reset(&mut self, width: usize, lanes: usize, params: &MatcherParams) {
        let fill = |cells: &mut Vec<u8>, len: usize, blocked: usize| {
            cells.clear();
            cells.resize(blocked.min(len), u8::MAX);
            cells.resize(len, 0);
        };
        self.first_disparity = params.min_disparity + lanes - 1;
        fill(&mut self.left, width, 0);
        fill(&mut self.right, width + lanes - 1, self.first_disparity);
        fill(&mut self.lanes, lanes, lanes - params.num_disparities);
    }

    /// Reads row `y` of the masks of both images.
    pub fn read(&mut self, [left_valid, right_valid]: [Option<ImageRef<'_, u8>>; 2], y: usize) {
        let block = |cells: &mut [u8], valid: &[u8]| {
            for (cell, &valid) in cells.iter_mut().zip(valid) {
                *cell = if valid == 0 { u8::MAX } else { 0 };
            }
        };
        if let Some(valid) = left_valid {
            block(&mut self.left, valid.row(y));
        }
        if let Some(valid) = right_valid
            && let Some(inside) = self.right.get_mut(self.first_disparity..)
        {
            block(inside, valid.row(y));
        }
    }
}
