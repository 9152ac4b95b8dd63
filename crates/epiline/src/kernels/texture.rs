//! Texture of windows: how much there is to match.

use super::portable;

/// Marks windows whose sums fall short of a threshold.
///
/// Sums are of bytes up to 63 over windows up to 31: `31²·63 < 2¹⁶`.
#[derive(Debug)]
pub struct TextureRow<'a> {
    /// Per column: the sum over the window's rows. `radius` cells to both sides are overwritten with the first and the
    /// last, for the columns outside the image.
    pub columns: &'a mut [u16],
    /// Half the window's side.
    pub radius: usize,
    /// Windows that sum to less are marked,
    pub threshold: u32,
    /// with this bit,
    pub bit: u8,
    /// unless they have one of these.
    pub except: u8,
    /// In and out, per column.
    pub bits: &'a mut [u8],
}

impl TextureRow<'_> {
    pub(super) fn check(&self) {
        assert!(!self.bits.is_empty(), "an empty row");
        assert!(self.columns.len() == self.bits.len() + 2 * self.radius, "columns");
    }
}

/// Columns at a time: sums of a constant number stay in registers.
const CHUNK: usize = 64;

#[inline(always)]
pub(super) fn texture_row(row: &mut TextureRow<'_>) {
    let (width, radius) = (row.bits.len(), row.radius);
    let columns = &mut *row.columns;
    let (first, last) = (columns[radius], columns[radius + width - 1]);
    columns[..radius].fill(first);
    columns[radius + width..].fill(last);
    let mut windows = [0; CHUNK];
    for (i, bits) in row.bits.chunks_mut(CHUNK).enumerate() {
        let columns = &columns[i * CHUNK..][..bits.len() + 2 * radius];
        windows.fill(0);
        // One addition for each column of the window, but whole vectors of them: faster than a running sum.
        if bits.len() == CHUNK {
            for columns in columns.windows(CHUNK) {
                add(&mut windows, columns);
            }
        } else {
            for columns in columns.windows(bits.len()) {
                add(&mut windows, columns);
            }
        }
        for (bits, &window) in bits.iter_mut().zip(&windows) {
            let is_low = (u32::from(window) < row.threshold) & (*bits & row.except == 0);
            *bits |= if is_low { row.bit } else { 0 };
        }
    }
}

#[inline(always)]
fn add(windows: &mut [u16; CHUNK], columns: &[u16]) {
    for (window, &column) in windows.iter_mut().zip(columns) {
        *window += column;
    }
}

portable!(row, texture_row, TextureRow<'_>);
