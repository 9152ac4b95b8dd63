//! How often each disparity occurs in each column of a region.

use super::tiles::Tiles;
use crate::kernels::sort::LANES;
use crate::kernels::tile::Row;
use crate::matching::DisparityMap;

/// The u-disparity histogram of a region in steps of half a pixel of disparity.
///
/// Two neighbouring bins together are a window of 1 px that can lie anywhere to within half a bin: wide enough for
/// the scatter of an upright surface, narrow enough that a level floor, whose disparity changes from row to row,
/// leaves few pixels in it (see [`obstacles`](crate::obstacles)).
///
/// Stored tile by tile, in each a bin to a row: what is counted stays in the nearest memory.
#[derive(Debug, Clone, Default)]
pub(crate) struct UDisparity {
    counts: Vec<Row>,
    bins: usize,
    /// Pixels in each bin.
    totals: Vec<u32>,
}

impl UDisparity {
    /// Sixteenths of a pixel in a bin.
    pub const RAW_PER_BIN: u16 = DisparityMap::SCALE / 2;

    /// The bin of a disparity.
    #[inline]
    pub fn bin(raw: u16) -> usize {
        usize::from(raw / Self::RAW_PER_BIN)
    }

    /// The disparity in the middle of a bin, pixels; bins may be a mean.
    pub fn center_px(bin: f64) -> f64 {
        (bin + 0.5) * f64::from(Self::RAW_PER_BIN) / f64::from(DisparityMap::SCALE)
    }

    /// Counts the pixels of a region none of whose disparities exceeds `largest`.
    pub fn count(&mut self, tiles: &Tiles, largest: u16) {
        self.bins = Self::bin(largest) + 1;
        // One bin more in each tile, for what has no value.
        let stride = self.bins + 1;
        self.counts.clear();
        self.counts.resize(tiles.len() * stride, [0; LANES]);
        self.totals.clear();
        self.totals.resize(self.bins, 0);
        for (number, counts) in self.counts.chunks_exact_mut(stride).enumerate() {
            for row in tiles.tile(number) {
                for (lane, &raw) in row.iter().enumerate() {
                    // At most 16 384 rows: no overflow.
                    counts[Self::bin(raw).min(stride - 1)][lane] += 1;
                }
            }
            for (total, counts) in self.totals.iter_mut().zip(counts.iter()) {
                *total += counts.iter().map(|&n| u32::from(n)).sum::<u32>();
            }
        }
    }

    /// Pixels in each bin.
    pub fn totals(&self) -> &[u32] {
        &self.totals
    }

    /// A bin's counts of each tile.
    pub fn of_bin(&self, bin: usize) -> impl Iterator<Item = &Row> {
        self.counts.chunks_exact(self.bins + 1).map(move |counts| &counts[bin])
    }
}
