//! What each column of the image sees at each disparity: how many pixels, their mean, and between which rows.

use super::standing::Standing;
use crate::matching::{DisparityMap, Validity};

/// Sixteenths of a pixel in a bin: half a pixel of disparity.
const RAW_PER_BIN: u16 = DisparityMap::SCALE / 2;

/// The pixels of one column in one bin of disparity, in 64 bits, so that a pixel is added by one load and one store:
/// how many (16 bits), the sum of what they have beyond the bin's lower end (18), the first row (15), the last (15).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Cell(u64);

impl Cell {
    const COUNT_SHIFT: u32 = 48;
    const SUM_SHIFT: u32 = 30;
    const TOP_SHIFT: u32 = 15;
    const ROW_MASK: u64 = (1 << 15) - 1;
    const SUM_MASK: u64 = (1 << 18) - 1;

    /// Rows come from the top; there are at most 16 384, so no part overflows.
    #[inline]
    fn add(&mut self, y: usize, beyond: u16) {
        let first = u64::from(self.0 == 0) * ((y as u64) << Self::TOP_SHIFT);
        let pixel = (1 << Self::COUNT_SHIFT) | (u64::from(beyond) << Self::SUM_SHIFT) | y as u64;
        self.0 = (self.0 & !Self::ROW_MASK) + first + pixel;
    }

    /// Pixels.
    #[inline]
    pub fn count(self) -> usize {
        (self.0 >> Self::COUNT_SHIFT) as usize
    }

    fn sum(self) -> usize {
        (self.0 >> Self::SUM_SHIFT & Self::SUM_MASK) as usize
    }

    fn top(self) -> usize {
        (self.0 >> Self::TOP_SHIFT & Self::ROW_MASK) as usize
    }

    fn bottom(self) -> usize {
        (self.0 & Self::ROW_MASK) as usize
    }
}

/// Some neighbouring bins of a column together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    pub count: usize,
    /// Mean disparity, px.
    pub disparity_px: f64,
    pub top: usize,
    pub bottom: usize,
}

/// The u-disparity of a map: columns along x, bins along y.
#[derive(Debug, Clone, Default)]
pub(super) struct Cells {
    /// Only the rows of bins in use mean something.
    cells: Vec<Cell>,
    used: Vec<bool>,
    width: usize,
    /// Rows from one looked at to the next.
    pub row_step: usize,
}

impl Cells {
    /// The disparity in the middle of a bin, pixels.
    pub fn center_px(bin: usize) -> f64 {
        (bin as f64 + 0.5) * f64::from(RAW_PER_BIN) / f64::from(DisparityMap::SCALE)
    }

    /// Counts the pixels that stand on or hang over the ground; no disparity is larger than `largest` sixteenths.
    pub fn count(&mut self, disparity: &DisparityMap, standing: &Standing, largest: u16) {
        let (width, height) = (disparity.width(), disparity.height());
        let bins = usize::from(largest / RAW_PER_BIN) + 1;
        self.width = width;
        self.used.clear();
        self.used.resize(bins, false);
        self.cells.resize((width * bins).max(self.cells.len()), Cell::default());
        self.row_step = row_step(height);
        for y in (self.row_step / 2..height).step_by(self.row_step) {
            let mut plane = standing.row(y);
            let raws = disparity.values.row(y);
            let bits = disparity.validity.row(y);
            for (x, (&raw, &bits)) in raws.iter().zip(bits).enumerate() {
                let at = plane.next();
                if Validity::has_value(bits) && standing.holds(raw, at) {
                    let bin = usize::from(raw / RAW_PER_BIN);
                    if !self.used[bin] {
                        self.used[bin] = true;
                        self.cells[bin * width..(bin + 1) * width].fill(Cell::default());
                    }
                    self.cells[bin * width + x].add(y, raw % RAW_PER_BIN);
                }
            }
        }
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn bins(&self) -> usize {
        self.used.len()
    }

    /// The cells of a bin, column by column; `None` if there is no pixel in it.
    #[inline]
    pub fn row(&self, bin: usize) -> Option<&[Cell]> {
        let used = self.used.get(bin).is_some_and(|&used| used);
        used.then(|| &self.cells[bin * self.width..(bin + 1) * self.width])
    }

    /// Pixels of a column in a bin.
    pub fn count_at(&self, column: usize, bin: usize) -> usize {
        self.row(bin).map_or(0, |row| row[column].count())
    }

    /// What a column sees in some bins; they hold a pixel at least.
    pub fn seen(&self, column: usize, bins: std::ops::RangeInclusive<usize>) -> Seen {
        let (mut count, mut raw) = (0, 0);
        let (mut top, mut bottom) = (usize::MAX, 0);
        for bin in bins {
            let Some(row) = self.row(bin) else { continue };
            let cell = row[column];
            if cell.count() > 0 {
                count += cell.count();
                raw += cell.sum() + cell.count() * bin * usize::from(RAW_PER_BIN);
                top = top.min(cell.top());
                bottom = bottom.max(cell.bottom());
            }
        }
        let disparity_px = raw as f64 / count as f64 / f64::from(DisparityMap::SCALE);
        Seen { count, disparity_px, top, bottom }
    }
}

/// In large images only every so manieth row is looked at: neighbouring rows share nearly all of their matching windows.
fn row_step(height: usize) -> usize {
    const ROWS: usize = 240;
    (height / ROWS).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_keeps_the_largest_image_apart() {
        let mut cell = Cell::default();
        for y in 0..16_384 {
            cell.add(y, 7);
        }
        assert_eq!((cell.count(), cell.sum(), cell.top(), cell.bottom()), (16_384, 7 * 16_384, 0, 16_383));
        let mut lone = Cell::default();
        lone.add(5, 0);
        lone.add(9, 3);
        assert_eq!((lone.count(), lone.sum(), lone.top(), lone.bottom()), (2, 3, 5, 9));
    }
}
