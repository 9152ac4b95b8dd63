//! Texture of a window: how much there is to match.

/// Sliding window sums of `|I - level|` over the left image.
#[derive(Debug, Default)]
pub(super) struct TextureSums {
    /// Per column: the sum over the window's rows. At most `31·63`; a whole window's at most `31²·63 < 2¹⁶`.
    columns: Vec<u16>,
}

impl TextureSums {
    /// Starts with an empty window.
    pub fn reset(&mut self, width: usize) {
        self.columns.clear();
        self.columns.resize(width, 0);
    }

    /// A row enters the window.
    pub fn enter(&mut self, row: &[u8], level: u8) {
        for (sum, &pixel) in self.columns.iter_mut().zip(row) {
            *sum += u16::from(pixel.abs_diff(level));
        }
    }

    /// A row that had entered leaves it.
    pub fn leave(&mut self, row: &[u8], level: u8) {
        for (sum, &pixel) in self.columns.iter_mut().zip(row) {
            *sum -= u16::from(pixel.abs_diff(level));
        }
    }

    /// Adds `bit` to `bits[x]` where the window around `x` sums to less than `threshold` and `bits[x]` has none of
    /// `except`.
    pub fn mark(&self, radius: usize, threshold: u32, bit: u8, except: u8, bits: &mut [u8]) {
        let column = |x: usize| u32::from(self.columns[x]);
        let last = self.columns.len() - 1;
        let mut sum: u32 = (0..=2 * radius).map(|i| column(i.saturating_sub(radius).min(last))).sum();
        for (x, bits) in bits.iter_mut().enumerate() {
            if x > 0 {
                sum = sum + column((x + radius).min(last)) - column(x.saturating_sub(radius + 1));
            }
            *bits |= if sum < threshold && *bits & except == 0 { bit } else { 0 };
        }
    }
}
