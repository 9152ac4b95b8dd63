//! What each column of the image sees at each disparity: how many pixels, their mean, and between which rows.

use std::ops::RangeInclusive;

use super::standing::Standing;
use crate::matching::{DisparityMap, Validity};

/// Sixteenths of a pixel in a bin: half a pixel of disparity.
const RAW_PER_BIN: u16 = DisparityMap::SCALE / 2;
/// At least so many rows are looked at, and fewer than twice as many.
const ROWS: usize = 240;
/// Mean rows are the same if they differ by no more than this share of the pixels they are of, or so many.
const SAME_ROWS_SHARE: f64 = 0.25;
const SAME_ROWS_LEAST: f64 = 2.0;

/// The pixels of one column in one bin of disparity, in 64 bits, so that a pixel is added by one load and one store:
/// how many (10 bits), the sum of what they have beyond the bin's lower end (14), the sum of their rows (18), the first
/// row (11), the last (11). Rows are those looked at, counted from 0, of which there are fewer than `2 · ROWS`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Cell(u64);

impl Cell {
    const COUNT_SHIFT: u32 = 54;
    const BEYOND_SHIFT: u32 = 40;
    const SUM_SHIFT: u32 = 22;
    const TOP_SHIFT: u32 = 11;
    const ROW_MASK: u64 = (1 << 11) - 1;
    const BEYOND_MASK: u64 = (1 << 14) - 1;
    const SUM_MASK: u64 = (1 << 18) - 1;

    /// Adds a pixel of the `row`-th row looked at; rows come from the top.
    #[inline]
    fn add(&mut self, row: u64, beyond: u16) {
        let first = if self.0 == 0 { row << Self::TOP_SHIFT } else { 0 };
        let pixel = (1 << Self::COUNT_SHIFT) | (u64::from(beyond) << Self::BEYOND_SHIFT);
        let rows = (row << Self::SUM_SHIFT) | row;
        self.0 = (self.0 & !Self::ROW_MASK) + first + pixel + rows;
    }

    /// Pixels.
    #[inline]
    pub fn count(self) -> usize {
        (self.0 >> Self::COUNT_SHIFT) as usize
    }

    fn sum_beyond(self) -> usize {
        (self.0 >> Self::BEYOND_SHIFT & Self::BEYOND_MASK) as usize
    }

    fn sum_of_rows(self) -> usize {
        (self.0 >> Self::SUM_SHIFT & Self::SUM_MASK) as usize
    }

    fn mean_row(self) -> f64 {
        self.sum_of_rows() as f64 / self.count() as f64
    }

    /// The sum of the disparities, in sixteenths of a pixel, of the cell of a bin.
    fn sum_of_raws(self, bin: usize) -> usize {
        self.sum_beyond() + self.count() * bin * usize::from(RAW_PER_BIN)
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
            let row = (y / self.row_step) as u64;
            for (x, (&raw, &bits)) in raws.iter().zip(bits).enumerate() {
                let at = plane.next();
                if Validity::has_value(bits) && standing.holds(raw, at) {
                    let bin = usize::from(raw / RAW_PER_BIN);
                    if !self.used[bin] {
                        self.used[bin] = true;
                        self.cells[bin * width..(bin + 1) * width].fill(Cell::default());
                    }
                    self.cells[bin * width + x].add(row, raw % RAW_PER_BIN);
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
    pub fn seen(&self, column: usize, bins: RangeInclusive<usize>) -> Seen {
        self.seen_where(column, bins, |_| true)
    }

    /// The same for a bin with pixels, and of some bins around it those whose pixels lie in the same rows on average, as
    /// those of one upright surface do at all its disparities.
    pub fn seen_with(&self, column: usize, bin: usize, around: RangeInclusive<usize>) -> Seen {
        let model = self.cells[bin * self.width + column];
        let tolerance = (SAME_ROWS_SHARE * model.count() as f64).max(SAME_ROWS_LEAST);
        let mean_row = model.mean_row();
        self.seen_where(column, around, |cell| (cell.mean_row() - mean_row).abs() <= tolerance)
    }

    #[inline]
    fn seen_where(&self, column: usize, bins: RangeInclusive<usize>, counts: impl Fn(Cell) -> bool) -> Seen {
        let (mut count, mut raw) = (0, 0);
        let (mut top, mut bottom) = (usize::MAX, 0);
        for bin in bins {
            let Some(row) = self.row(bin) else { continue };
            let cell = row[column];
            if cell.count() > 0 && counts(cell) {
                count += cell.count();
                raw += cell.sum_of_raws(bin);
                top = top.min(cell.top());
                bottom = bottom.max(cell.bottom());
            }
        }
        let disparity_px = raw as f64 / count as f64 / f64::from(DisparityMap::SCALE);
        let row = |index: usize| index * self.row_step + self.row_step / 2;
        Seen { count, disparity_px, top: row(top), bottom: row(bottom) }
    }

    /// By how much disparity changes from row to row among the pixels of a column in some bins, px: the slope of their
    /// regression line. In each bin they are taken to lie one below the other.
    pub fn lean_px(&self, column: usize, bins: RangeInclusive<usize>) -> f64 {
        let (mut n, mut rows, mut raws, mut products, mut squares) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for bin in bins {
            let Some(cells) = self.row(bin) else { continue };
            let cell = cells[column];
            if cell.count() == 0 {
                continue;
            }
            let count = cell.count() as f64;
            let (raw, row) = (cell.sum_of_raws(bin) as f64, cell.sum_of_rows() as f64);
            n += count;
            rows += row;
            raws += raw;
            products += row * raw / count;
            // Of `count` rows in sequence.
            squares += row * row / count + count * count * count / 12.0;
        }
        let covariance = products - rows * raws / n;
        let variance = squares - rows * rows / n;
        covariance / variance / f64::from(DisparityMap::SCALE) / self.row_step as f64
    }
}

/// In large images only every so manieth row is looked at: neighbouring rows share nearly all of their matching windows.
fn row_step(height: usize) -> usize {
    (height / ROWS).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_keeps_the_most_rows_apart() {
        let rows = 2 * ROWS - 1;
        let mut cell = Cell::default();
        for y in 0..rows {
            cell.add(y as u64, 7);
        }
        assert_eq!(
            (cell.count(), cell.sum_beyond(), cell.top(), cell.bottom()),
            (rows, 7 * rows, 0, rows - 1)
        );
        assert_eq!(cell.sum_of_rows(), rows * (rows - 1) / 2);
        let mut lone = Cell::default();
        lone.add(5, 0);
        lone.add(9, 3);
        let told = (lone.count(), lone.sum_beyond(), lone.sum_of_rows(), lone.top(), lone.bottom());
        assert_eq!(told, (2, 3, 14, 5, 9));
    }
}
