//! The disparities of a region in tiles of neighbouring columns, as the kernels read them.

use super::Region;
use crate::kernels::Kernels;
use crate::kernels::sort::LANES;
use crate::kernels::tile::{GatherTile, NO_VALUE, Row};
use crate::matching::{DisparityMap, Validity};

/// A region's disparities, gathered once and read by all that follows.
#[derive(Debug, Clone, Default)]
pub(super) struct Tiles {
    /// Tile after tile, each row by row. Columns beyond the region are without a value.
    rows: Vec<Row>,
    /// Values of each column, by tile, and their sums, sixteenths.
    counts: Vec<Row>,
    sums: Vec<[u32; LANES]>,
    width: usize,
    height: usize,
}

impl Tiles {
    /// Gathers a region, which the caller has validated.
    pub fn gather(&mut self, kernels: &Kernels, disparity: &DisparityMap, region: &Region) {
        let Region { x, y, width, height, .. } = *region;
        let tiles = width.div_ceil(LANES);
        (self.width, self.height) = (width, height);
        self.rows.resize(tiles * height, [NO_VALUE; LANES]);
        self.counts.resize(tiles, [0; LANES]);
        self.sums.resize(tiles, [0; LANES]);
        let (values, bits) = (disparity.values.view(), disparity.validity.view());
        let of_each = self.rows.chunks_exact_mut(height).zip(&mut self.counts).zip(&mut self.sums);
        for (tile, ((rows, counts), sums)) in of_each.enumerate() {
            let left = tile * LANES;
            kernels.gather(&mut GatherTile {
                values: values.elements_from(x + left, y),
                bits: bits.elements_from(x + left, y),
                stride: values.stride(),
                width: LANES.min(width - left),
                harmless: Validity::FILLED,
                rows,
                counts,
                sums,
            });
        }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// How many tiles.
    pub fn len(&self) -> usize {
        self.counts.len()
    }

    /// The rows of a tile.
    pub fn tile(&self, number: usize) -> &[Row] {
        &self.rows[number * self.height..][..self.height]
    }

    /// How many values each column of a tile has.
    pub fn counts(&self, number: usize) -> &Row {
        &self.counts[number]
    }

    /// Sum of all values, sixteenths.
    pub fn total(&self) -> u64 {
        self.sums.iter().flatten().map(|&sum| u64::from(sum)).sum()
    }

    /// The disparity at a column and row of the region, px.
    pub fn at(&self, x: usize, y: usize) -> Option<f64> {
        let raw = self.tile(x / LANES)[y][x % LANES];
        (raw != NO_VALUE).then(|| f64::from(raw) / f64::from(DisparityMap::SCALE))
    }
}
