//! Some neighbouring columns of disparities as rows of equal length, so that each column is a lane.

use super::portable;
use super::sort::LANES;

/// One pixel of each of [`LANES`] neighbouring columns.
pub type Row = [u16; LANES];

/// What a pixel without a value has in a tile: more than any disparity, so that it is sorted to the end.
pub const NO_VALUE: u16 = u16::MAX;

/// Copies columns into a tile, and counts and adds up their values.
///
/// ```text
/// rows[y][x]  = values[y·stride + x] where bits[y·stride + x] & !harmless is 0, else NO_VALUE
/// counts[x]   = how many values, sums[x] = their sum
/// ```
#[derive(Debug)]
pub struct GatherTile<'a> {
    /// Disparities from the first of the columns and rows on.
    pub values: &'a [u16],
    /// Why a pixel has no value.
    pub bits: &'a [u8],
    /// From one row to the next.
    pub stride: usize,
    /// Columns, at most [`LANES`]; lanes beyond are without a value.
    pub width: usize,
    /// Bits that do not make a pixel one without a value.
    pub harmless: u8,
    /// Out: as many rows as are wanted, at most 16 384.
    pub rows: &'a mut [Row],
    /// Out.
    pub counts: &'a mut Row,
    /// Out.
    pub sums: &'a mut [u32; LANES],
}

impl GatherTile<'_> {
    pub(super) fn check(&self) {
        let Some(last) = self.rows.len().checked_sub(1) else { return };
        assert!(self.width <= LANES && self.rows.len() <= 16_384, "a tile's size");
        let needed = last * self.stride + self.width;
        assert!(self.values.len() >= needed && self.bits.len() >= needed, "a tile's pixels");
    }
}

#[inline(always)]
pub(super) fn gather_tile(tile: &mut GatherTile<'_>) {
    // A number known beforehand is what lets rows become registers.
    if tile.width == LANES {
        gather(tile, LANES);
    } else {
        gather(tile, tile.width);
    }
}

#[inline(always)]
fn gather(tile: &mut GatherTile<'_>, width: usize) {
    let (mut counts, mut sums) = ([0; LANES], [0; LANES]);
    for (y, row) in tile.rows.iter_mut().enumerate() {
        let values = &tile.values[y * tile.stride..][..width];
        let bits = &tile.bits[y * tile.stride..][..width];
        let mut gathered = [NO_VALUE; LANES];
        for lane in 0..width {
            let has_value = u16::from(bits[lane] & !tile.harmless == 0);
            // All ones, which is no value, where there is none.
            gathered[lane] = values[lane] | has_value.wrapping_sub(1);
            counts[lane] += has_value;
            sums[lane] += u32::from(values[lane] & 0_u16.wrapping_sub(has_value));
        }
        *row = gathered;
    }
    (*tile.counts, *tile.sums) = (counts, sums);
}

/// Counts each column's values between two ends, which belong to them, and adds up their rows, counted from 0.
#[derive(Debug)]
pub struct SpanTile<'a> {
    /// At most 16 384.
    pub rows: &'a [Row],
    /// Least value of each column.
    pub low: Row,
    /// Greatest, below [`NO_VALUE`].
    pub high: Row,
    /// Out.
    pub counts: &'a mut Row,
    /// Out.
    pub row_sums: &'a mut [u32; LANES],
}

#[inline(always)]
pub(super) fn span_tile(tile: &mut SpanTile<'_>) {
    let (mut counts, mut sums) = ([0_u16; LANES], [0_u32; LANES]);
    for (y, row) in (0_u16..).zip(tile.rows) {
        for lane in 0..LANES {
            let is_inside = u16::from((row[lane] >= tile.low[lane]) & (row[lane] <= tile.high[lane]));
            counts[lane] += is_inside;
            sums[lane] += u32::from(0_u16.wrapping_sub(is_inside) & y);
        }
    }
    (*tile.counts, *tile.row_sums) = (counts, sums);
}

portable!(gathered, gather_tile, GatherTile<'_>);
portable!(span, span_tile, SpanTile<'_>);
