//! Texture of a window: how much there is to match.

use crate::kernels::Kernels;
use crate::kernels::texture::TextureRow;

/// Sliding window sums of `|I - level|` over the left image.
#[derive(Debug, Default)]
pub(super) struct TextureSums {
    /// Per column: the sum over the window's rows, between cells for the columns beyond the image.
    columns: Vec<u16>,
    radius: usize,
}

impl TextureSums {
    /// Starts with an empty window.
    pub fn reset(&mut self, width: usize, radius: usize) {
        self.radius = radius;
        self.columns.clear();
        self.columns.resize(width + 2 * radius, 0);
    }

    /// A row enters the window.
    pub fn enter(&mut self, row: &[u8], level: u8) {
        for (sum, &pixel) in self.columns[self.radius..].iter_mut().zip(row) {
            *sum += u16::from(pixel.abs_diff(level));
        }
    }

    /// A row that had entered leaves it.
    pub fn leave(&mut self, row: &[u8], level: u8) {
        for (sum, &pixel) in self.columns[self.radius..].iter_mut().zip(row) {
            *sum -= u16::from(pixel.abs_diff(level));
        }
    }

    /// Adds `bit` to `bits[x]` where the window around `x` sums to less than `threshold` and `bits[x]` has none of
    /// `except`.
    pub fn mark(&mut self, kernels: &Kernels, threshold: u32, bit: u8, except: u8, bits: &mut [u8]) {
        let Self { columns, radius } = self;
        kernels.texture(&mut TextureRow { columns, radius: *radius, threshold, bit, except, bits });
    }
}
