//! What is read from each column of a region.

use super::Region;
use super::profile::{RegionProfile, finite_range_m};
use super::tiles::Tiles;
use crate::kernels::Kernels;
use crate::kernels::sort::{LANES, SortColumns};
use crate::kernels::tile::{NO_VALUE, Row, SpanTile};
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;

fn px(raw: u16) -> f32 {
    f32::from(raw) / f32::from(DisparityMap::SCALE)
}

/// Reads columns; keeps its buffers from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct ColumnReader {
    /// A tile, each column in ascending order.
    sorted: Vec<Row>,
}

impl ColumnReader {
    /// Fills what `out` has for each column, and its total; returns the largest value, sixteenths.
    pub fn read(
        &mut self,
        kernels: &Kernels,
        tiles: &Tiles,
        geometry: Option<&RectifiedGeometry>,
        min_support: usize,
        out: &mut RegionProfile,
    ) -> u16 {
        let Region { x: left, y: top, width, .. } = out.region;
        for values in [
            &mut out.nearest_px,
            &mut out.median_px,
            &mut out.spread_px,
            &mut out.minimum_px,
            &mut out.maximum_px,
        ] {
            values.resize(width, f32::NAN);
        }
        out.count.resize(width, 0);
        let mut ranges_m = geometry.map(|_| out.nearest_range_m.take().unwrap_or_default());
        if let Some(ranges_m) = &mut ranges_m {
            ranges_m.resize(width, f32::NAN);
        }
        let mut largest = 0;
        for number in 0..tiles.len() {
            let (tile, counts) = (tiles.tile(number), tiles.counts(number));
            self.sorted.clear();
            self.sorted.extend_from_slice(tile);
            kernels.sort(&mut SortColumns { rows: &mut self.sorted });
            let columns: [Sorted<'_>; LANES] =
                std::array::from_fn(|lane| Sorted { rows: &self.sorted[..usize::from(counts[lane])], lane });
            let supported = columns.map(|column| column.nearest_supported(min_support));
            // No disparity lies between the ends of a column without an answer.
            let spans = supported.map(|raw| raw.map_or((1, 0), around));
            let (mut span_counts, mut row_sums) = ([0; LANES], [0; LANES]);
            kernels.span(&mut SpanTile {
                rows: tile,
                low: spans.map(|(low, _)| low),
                high: spans.map(|(_, high)| high),
                counts: &mut span_counts,
                row_sums: &mut row_sums,
            });
            for (x, lane) in (number * LANES..width).zip(0..LANES) {
                let (column, supported) = (columns[lane], supported[lane]);
                out.count[x] = column.count() as u32;
                out.minimum_px[x] = column.minimum().map_or(f32::NAN, px);
                out.maximum_px[x] = column.maximum().map_or(f32::NAN, px);
                (out.median_px[x], out.spread_px[x]) = column.median_and_spread_px();
                out.nearest_px[x] = supported.map_or(f32::NAN, px);
                largest = largest.max(column.maximum().unwrap_or(0));
                if let (Some(geometry), Some(ranges_m)) = (geometry, &mut ranges_m) {
                    ranges_m[x] = supported.map_or(f32::NAN, |raw| {
                        let mean_row = f64::from(row_sums[lane]) / f64::from(span_counts[lane]);
                        let at = ((left + x) as f64, top as f64 + mean_row);
                        finite_range_m(geometry, f64::from(px(raw)), at.0, at.1) as f32
                    });
                }
            }
        }
        out.nearest_range_m = ranges_m;
        out.total = tiles.total() as f64 / f64::from(DisparityMap::SCALE);
        largest
    }
}

/// Disparities within ±1 px of one.
fn around(raw: u16) -> (u16, u16) {
    // Valid disparities end at 4095 px, below what stands for none.
    (raw.saturating_sub(DisparityMap::SCALE), raw.saturating_add(DisparityMap::SCALE).min(NO_VALUE - 1))
}

/// The values of one column in ascending order.
#[derive(Debug, Clone, Copy)]
struct Sorted<'a> {
    rows: &'a [Row],
    lane: usize,
}

impl Sorted<'_> {
    fn count(self) -> usize {
        self.rows.len()
    }

    #[inline]
    fn at(self, i: usize) -> u16 {
        self.rows[i][self.lane]
    }

    fn minimum(self) -> Option<u16> {
        self.rows.first().map(|row| row[self.lane])
    }

    fn maximum(self) -> Option<u16> {
        self.rows.last().map(|row| row[self.lane])
    }

    /// The median, and `1.4826·median(|d - median|)`, px; NaN of none.
    fn median_and_spread_px(self) -> (f32, f32) {
        /// What makes a normal distribution's median deviation its standard deviation: `1/Φ⁻¹(3/4)`.
        const PER_MEDIAN_DEVIATION: f32 = 1.482_602_2;
        let count = self.count();
        if count == 0 {
            return (f32::NAN, f32::NAN);
        }
        let median_doubled = u32::from(self.at((count - 1) / 2)) + u32::from(self.at(count / 2));
        let (one, other) = self.middle_deviations_doubled(median_doubled);
        let scale = f32::from(DisparityMap::SCALE);
        let deviation_px = (one + other) as f32 / (4.0 * scale);
        (median_doubled as f32 / (2.0 * scale), PER_MEDIAN_DEVIATION * deviation_px)
    }

    /// Twice the deviations from the median that are in the middle, one and the same of an odd number.
    ///
    /// The nearer half of the values are neighbours: of all windows of so many, the one whose ends deviate least. Moving it
    /// up, its lower end comes nearer and its upper end goes away. The next farther value is beyond one of its ends.
    fn middle_deviations_doubled(self, median_doubled: u32) -> (u32, u32) {
        let taken = self.count().div_ceil(2);
        let of = |i: usize| (2 * u32::from(self.at(i))).abs_diff(median_doubled);
        // The first window whose lower end is not farther off than the value after its upper end.
        let (mut first, mut windows) = (0, self.count() - taken);
        while windows > 0 {
            let half = windows.div_ceil(2);
            let moves_on = of(first + half - 1) > of(first + half - 1 + taken);
            first += if moves_on { half } else { 0 };
            windows -= half;
        }
        let one = of(first).max(of(first + taken - 1));
        if self.count() % 2 == 1 {
            return (one, one);
        }
        let below = first.checked_sub(1).map_or(u32::MAX, of);
        let above = if first + taken < self.count() { of(first + taken) } else { u32::MAX };
        (one, below.min(above))
    }

    /// The largest disparity that has enough support.
    fn nearest_supported(self, min_support: usize) -> Option<u16> {
        let mut high = self.count();
        // For each candidate, from the largest down, all below `high` are at most 1 px larger.
        for i in (0..self.count()).rev() {
            let candidate = self.at(i);
            let (least, most) = around(candidate);
            while self.at(high - 1) > most {
                high -= 1;
            }
            if high >= min_support && self.at(high - min_support) >= least {
                return Some(candidate);
            }
        }
        None
    }
}
