//! Obstacle pixels by distance ahead and direction, and the nearest that are enough.

use super::refill;
use crate::matching::DisparityMap;

/// Sixteenths of a pixel in a bin of distances ahead: two bins are a window of 1 px.
const RAW_PER_BIN: i32 = 8;
/// In a cell the count stands above the sum of what the disparities exceed their bin by. A column has no more than
/// 16384 pixels: neither overflows.
const COUNT_SHIFT: u32 = 17;
const ONE_PIXEL: u32 = 1 << COUNT_SHIFT;
/// Bins behind the first with enough pixels where more may still be the same surface: the scatter of its near side.
const CLIMB: usize = 3;
/// From bin to bin the scatter of an upright surface grows by more than this; what recedes, a wall seen askew, by less,
/// and there the first bin is what is nearest.
const SCATTER_GROWTH: (u32, u32) = (3, 2);
/// Directions looked at together for whether any has an obstacle.
const BLOCK: usize = 16;
/// Bins at most: nothing is nearer than what a disparity of 4096 px says.
const MOST_BINS: usize = 8192;

/// Counts of pixels; a bin to a row, for neighbouring directions mostly see one distance.
#[derive(Debug, Clone, Default)]
pub(super) struct Histogram {
    cells: Vec<u32>,
    directions: usize,
    /// Nearest bin with enough pixels of each direction, together with the one behind it; 0 is none.
    nearest: Vec<u32>,
}

impl Histogram {
    /// Empties it for disparities ahead of up to `largest` sixteenths of a pixel, and says how large they may be.
    pub fn begin(&mut self, directions: usize, largest: f64) -> f32 {
        let bins = (largest as usize / RAW_PER_BIN as usize + 2).min(MOST_BINS);
        self.directions = directions;
        refill(&mut self.cells, bins * directions, 0);
        // Half a step less, for what is to come is rounded.
        (bins * RAW_PER_BIN as usize) as f32 - 1.0
    }

    /// Counts a row: for each direction a disparity ahead, or -1.
    pub fn count(&mut self, aheads: &[i32]) {
        for (block, aheads) in aheads.chunks(BLOCK).enumerate() {
            // All bits of all are set only if all are -1.
            if aheads.iter().fold(-1, |all, &ahead| all & ahead) == -1 {
                continue;
            }
            for (i, &ahead) in aheads.iter().enumerate() {
                // Counted always, as nothing where there is nothing: which it is cannot be predicted.
                let raw = ahead.max(0) as u32;
                let one = if ahead < 0 { 0 } else { ONE_PIXEL + raw % RAW_PER_BIN as u32 };
                self.cells[(raw / RAW_PER_BIN as u32) as usize * self.directions + block * BLOCK + i] += one;
            }
        }
    }

    /// Finds for each direction the nearest two bins with enough pixels together.
    pub fn find_nearest(&mut self, min_support: u32) {
        let directions = self.directions;
        refill(&mut self.nearest, directions, 0);
        for bin in 1..self.cells.len() / directions {
            let pair = &self.cells[(bin - 1) * directions..(bin + 1) * directions];
            let (farther, nearer) = pair.split_at(directions);
            for ((nearest, &nearer), &farther) in self.nearest.iter_mut().zip(nearer).zip(farther) {
                let enough = (nearer >> COUNT_SHIFT) + (farther >> COUNT_SHIFT) >= min_support;
                *nearest = if enough { bin as u32 } else { *nearest };
            }
        }
        // The first window to qualify may hold only the near tail of a surface's scatter.
        for line in 0..directions {
            let first = self.nearest[line] as usize;
            let pixels = |bin: usize| self.pixels(bin, line) + self.pixels(bin - 1, line);
            let mut bin = first;
            let (much, little) = SCATTER_GROWTH;
            while bin > 1 && first - bin < CLIMB && little * pixels(bin - 1) > much * pixels(bin) {
                bin -= 1;
            }
            self.nearest[line] = bin as u32;
        }
    }

    /// Mean disparity ahead of a direction's nearest obstacle, px from infinity; distances come in whole sixteenths.
    pub fn nearest_px(&self, line: usize) -> Option<f64> {
        let nearest = self.nearest[line] as usize;
        if nearest == 0 {
            return None;
        }
        let (mut pixels, mut sum) = (0.0, 0.0);
        for bin in [nearest - 1, nearest] {
            let here = f64::from(self.pixels(bin, line));
            let excess = self.cells[bin * self.directions + line] & (ONE_PIXEL - 1);
            pixels += here;
            sum += here * (bin * RAW_PER_BIN as usize) as f64 + f64::from(excess);
        }
        Some(sum / pixels / f64::from(DisparityMap::SCALE))
    }

    /// The nearest edge of a bin with any pixel that is nearer than the nearest obstacle's and has no more than
    /// `limit_px`; px from infinity. What is not enough for an obstacle is still not the floor.
    pub fn stray_px(&self, line: usize, limit_px: f64) -> Option<f64> {
        let bins = self.cells.len() / self.directions;
        let scale = f64::from(DisparityMap::SCALE) / f64::from(RAW_PER_BIN);
        let end = ((limit_px * scale).max(0.0).ceil() as usize).min(bins);
        let first = self.nearest[line] as usize + 1;
        (first..end).rev().find(|&bin| self.pixels(bin, line) > 0).map(|bin| (bin + 1) as f64 / scale)
    }

    fn pixels(&self, bin: usize, line: usize) -> u32 {
        self.cells[bin * self.directions + line] >> COUNT_SHIFT
    }
}
