//! Texture of a window: how much there is to match.

/// Sliding window sums of `|I - level|` over the left image.
///
/// They are sums of bytes, `31²·63 < 2¹⁶` at most.
#[derive(Debug, Default)]
pub(super) struct TextureSums {
    /// Per column: the sum over the window's rows.
    columns: Vec<u16>,
    /// The same, with the first and last column repeated for those beyond the image.
    padded: Vec<u16>,
    /// Per column: the sum over the window.
    windows: Vec<u16>,
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
    pub fn mark(&mut self, radius: usize, threshold: u32, bit: u8, except: u8, bits: &mut [u8]) {
        let Self { columns, padded, windows } = self;
        let width = columns.len();
        let (first, last) = (columns[0], columns[width - 1]);
        padded.clear();
        padded.extend(std::iter::repeat_n(first, radius));
        padded.extend_from_slice(columns);
        padded.extend(std::iter::repeat_n(last, radius));
        windows.clear();
        windows.resize(width, 0);
        // One addition for each column of the window, but whole vectors of them: faster than a running sum.
        for shift in 0..=2 * radius {
            for (window, &column) in windows.iter_mut().zip(&padded[shift..]) {
                *window += column;
            }
        }
        for (bits, &window) in bits.iter_mut().zip(&*windows) {
            let is_low = (u32::from(window) < threshold) & (*bits & except == 0);
            *bits |= if is_low { bit } else { 0 };
        }
    }
}
