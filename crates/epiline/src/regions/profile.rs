//! What the paper plots for a region: value against column, and the figures read from it.

use super::Region;
use super::surface::{NearestSurface, SurfaceFinder};
use super::u_disparity::UDisparity;
use crate::error::{Error, Result};
use crate::kernels::sort::{LANES, SortColumns};
use crate::kernels::{Kernels, Level};
use crate::matching::{DisparityMap, Validity};
use crate::range::{check_disparity_sigma, check_size};
use crate::rectification::RectifiedGeometry;

/// How regions are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfileParams {
    /// A column's nearest disparity counts only if at least this many of its pixels, itself included, lie within
    /// ±1 px of it; 1 is the plain maximum. A region's nearest surface needs ten times as many pixels among
    /// neighbouring columns. 1 to 10000; raise it when mismatches show up as near spikes.
    pub min_support: usize,
    /// Standard deviation of a disparity, px, finite and not negative: what `sigma_m` is made from.
    pub disparity_sigma_px: f64,
}

impl Default for ProfileParams {
    fn default() -> Self {
        Self { min_support: 3, disparity_sigma_px: 0.25 }
    }
}

impl ProfileParams {
    /// Fails with the name and value of the first parameter outside its range.
    pub fn validate(&self) -> Result<()> {
        if !(1..=10_000).contains(&self.min_support) {
            return Err(Error::invalid(
                "min_support",
                format!("{} px", self.min_support),
                "must be 1 to 10000 px",
            ));
        }
        check_disparity_sigma(self.disparity_sigma_px)
    }
}

/// A region read column by column and as a whole.
///
/// Vectors with one entry per column have `region.width` entries, NaN where the column has no such value.
/// Disparities are in pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionProfile {
    /// Where.
    pub region: Region,
    /// Per column: the largest disparity with enough support ([`ProfileParams::min_support`]).
    pub nearest_px: Vec<f32>,
    /// Per column: the median; of an even number, the mean of the middle two.
    pub median_px: Vec<f32>,
    /// Per column: the spread, `1.4826·median(|d - median|)`, which is the standard deviation where values scatter
    /// normally and hardly moves with a few that are wild.
    pub spread_px: Vec<f32>,
    /// Per column: the smallest.
    pub minimum_px: Vec<f32>,
    /// Per column: the largest, supported or not.
    pub maximum_px: Vec<f32>,
    /// Per column: how many pixels carry a value.
    pub count: Vec<u32>,
    /// Per column: how many pixels carry none. In a region of space ([`Region::space`]) the two need not make up the
    /// column: a known point outside the space is neither.
    pub unknown: Vec<u32>,
    /// Per column: Euclidean range of `nearest_px` at the mean row of its supporters, metres. `None` without geometry.
    pub nearest_range_m: Option<Vec<f32>>,
    /// Entry `i` counts the pixels whose disparity rounds to `i` px.
    pub histogram: Vec<u32>,
    /// Share of the region's pixels that carry a value, wherever its point lies, 0 to 1.
    pub valid_share: f64,
    /// Smallest disparity, px; NaN without a value.
    pub minimum: f64,
    /// Largest disparity, px; NaN without a value.
    pub maximum: f64,
    /// Sum of all disparities, px: the paper's total of pixel values.
    pub total: f64,
    /// The nearest surface, if one has enough support. Its ranges are NaN without geometry.
    pub nearest: Option<NearestSurface>,
}

impl RegionProfile {
    /// A profile that has read nothing yet.
    pub fn new(region: Region) -> Self {
        Self {
            region,
            nearest_px: Vec::new(),
            median_px: Vec::new(),
            spread_px: Vec::new(),
            minimum_px: Vec::new(),
            maximum_px: Vec::new(),
            count: Vec::new(),
            unknown: Vec::new(),
            nearest_range_m: None,
            histogram: Vec::new(),
            valid_share: 0.0,
            minimum: f64::NAN,
            maximum: f64::NAN,
            total: 0.0,
            nearest: None,
        }
    }

    /// Per column: share of its pixels that carry no value, 0 to 1.
    pub fn unknown_shares(&self) -> impl Iterator<Item = f32> {
        let height = self.region.height as f32;
        self.unknown.iter().map(move |&unknown| unknown as f32 / height)
    }
}

fn px(raw: u16) -> f32 {
    f32::from(raw) / f32::from(DisparityMap::SCALE)
}

/// One pixel of each of [`LANES`] neighbouring columns.
type Row = [u16; LANES];

/// What a pixel without a value has in a tile: more than any disparity, so that it is sorted to the end.
const NO_VALUE: u16 = u16::MAX;

/// Reads regions; keeps its buffers from frame to frame.
#[derive(Debug, Clone)]
pub struct Profiler {
    kernels: Kernels,
    /// Some neighbouring columns of the region, row by row.
    tile: Vec<Row>,
    /// The same, each column in ascending order.
    sorted: Vec<Row>,
    /// The map without what lies outside a region of space.
    inside: DisparityMap,
    u_disparity: UDisparity,
    surface: SurfaceFinder,
}

impl Default for Profiler {
    fn default() -> Self {
        Self {
            kernels: Kernels::new(Level::current()),
            tile: Vec::new(),
            sorted: Vec::new(),
            inside: DisparityMap::default(),
            u_disparity: UDisparity::default(),
            surface: SurfaceFinder::default(),
        }
    }
}

impl Profiler {
    /// Reads `out.region` of the map into `out`, keeping its memory.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for a region outside the map, a region of space without geometry, or parameters out of
    /// range, [`Error::SizeMismatch`] if map and geometry differ in size.
    pub fn read(
        &mut self,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        params: &ProfileParams,
        out: &mut RegionProfile,
    ) -> Result<()> {
        params.validate()?;
        out.region.validate(disparity.width(), disparity.height())?;
        if let Some(geometry) = geometry {
            check_size(disparity, geometry)?;
        }
        count_unknown(disparity, &out.region, &mut out.unknown);
        let Some(space) = out.region.space else {
            self.read_map(disparity, geometry, params, out);
            return Ok(());
        };
        let Some(geometry) = geometry else {
            let value = format!("'{}'", out.region.name);
            return Err(Error::invalid(
                "region",
                value,
                "is a part of space and needs the geometry of the pair",
            ));
        };
        let mut inside = std::mem::take(&mut self.inside);
        space.select(disparity, geometry, &out.region, &mut inside, Validity::BORDER);
        self.read_map(&inside, Some(geometry), params, out);
        self.inside = inside;
        Ok(())
    }

    fn read_map(
        &mut self,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        params: &ProfileParams,
        out: &mut RegionProfile,
    ) {
        self.read_columns(disparity, geometry, params.min_support, out);
        self.u_disparity.count(disparity, &out.region);
        fill_histogram(&self.u_disparity, disparity, &mut out.histogram);
        let pixels = (out.region.width * out.region.height) as f64;
        let unknown: f64 = out.unknown.iter().map(|&n| f64::from(n)).sum();
        out.valid_share = (pixels - unknown) / pixels;
        // f32::min and max pass over NaN.
        out.minimum = f64::from(out.minimum_px.iter().copied().fold(f32::NAN, f32::min));
        out.maximum = f64::from(out.maximum_px.iter().copied().fold(f32::NAN, f32::max));
        out.nearest = self.surface.nearest(&self.u_disparity, disparity, geometry, &out.region, params);
    }

    fn read_columns(
        &mut self,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        min_support: usize,
        out: &mut RegionProfile,
    ) {
        let Region { x: left, y: top, width, height, .. } = out.region;
        for values in [
            &mut out.nearest_px,
            &mut out.median_px,
            &mut out.spread_px,
            &mut out.minimum_px,
            &mut out.maximum_px,
        ] {
            values.clear();
        }
        out.count.clear();
        let mut ranges_m = geometry.map(|_| out.nearest_range_m.take().unwrap_or_default());
        if let Some(ranges_m) = &mut ranges_m {
            ranges_m.clear();
        }
        let mut total_raw = 0;
        for tile_left in (left..left + width).step_by(LANES) {
            let tile_width = LANES.min(left + width - tile_left);
            let counts = self.gather(disparity, tile_left, tile_width, top, height);
            self.sorted.clone_from(&self.tile);
            self.kernels.sort(&mut SortColumns { rows: &mut self.sorted });
            let columns: [Sorted<'_>; LANES] =
                std::array::from_fn(|lane| Sorted { rows: &self.sorted[..usize::from(counts[lane])], lane });
            let supported: [Option<u16>; LANES] =
                std::array::from_fn(|lane| columns[lane].nearest_supported(min_support));
            // No disparity lies between the ends of a column without an answer.
            let spans = supported.map(|raw| raw.map_or((1, 0), around));
            let mean_rows = mean_rows(&self.tile, &spans.map(|(low, _)| low), &spans.map(|(_, high)| high));
            total_raw += total(&self.tile);
            for (lane, column) in columns[..tile_width].iter().enumerate() {
                out.count.push(column.count() as u32);
                out.minimum_px.push(column.minimum().map_or(f32::NAN, px));
                out.maximum_px.push(column.maximum().map_or(f32::NAN, px));
                let (median_px, spread_px) = column.median_and_spread_px();
                out.median_px.push(median_px);
                out.spread_px.push(spread_px);
                out.nearest_px.push(supported[lane].map_or(f32::NAN, px));
                if let (Some(geometry), Some(ranges_m)) = (geometry, &mut ranges_m) {
                    ranges_m.push(supported[lane].map_or(f32::NAN, |raw| {
                        let (x, y) = ((tile_left + lane) as f64, top as f64 + mean_rows[lane]);
                        finite_range_m(geometry, f64::from(px(raw)), x, y) as f32
                    }));
                }
            }
        }
        out.nearest_range_m = ranges_m;
        out.total = total_raw as f64 / f64::from(DisparityMap::SCALE);
    }

    /// Fills the tile with up to [`LANES`] columns; returns how many values each has.
    fn gather(
        &mut self,
        disparity: &DisparityMap,
        left: usize,
        width: usize,
        top: usize,
        height: usize,
    ) -> Row {
        let mut counts = [0; LANES];
        self.tile.clear();
        self.tile.resize(height, [NO_VALUE; LANES]);
        for (y, row) in (top..).zip(&mut self.tile) {
            let raws = &disparity.values.row(y)[left..left + width];
            let bits = &disparity.validity.row(y)[left..left + width];
            for (((value, count), &raw), &bits) in row.iter_mut().zip(&mut counts).zip(raws).zip(bits) {
                let has_value = u16::from(Validity::has_value(bits));
                // All ones, which is no value, where there is none.
                *value = raw | has_value.wrapping_sub(1);
                *count += has_value;
            }
        }
        counts
    }
}

/// Sum of the values of a tile, sixteenths.
fn total(tile: &[Row]) -> u64 {
    let of_row =
        |row: &Row| -> u32 { row.iter().map(|&raw| if raw == NO_VALUE { 0 } else { u32::from(raw) }).sum() };
    tile.iter().map(|row| u64::from(of_row(row))).sum()
}

/// Mean row, from the top of the tile, of each column's pixels of disparities `low..=high`; NaN of none.
fn mean_rows(tile: &[Row], low: &Row, high: &Row) -> [f64; LANES] {
    let (mut counts, mut sums) = ([0_u16; LANES], [0_u32; LANES]);
    for (y, row) in (0_u16..).zip(tile) {
        // All ones or all zeros.
        let inside: Row = std::array::from_fn(|lane| {
            0_u16.wrapping_sub(u16::from((row[lane] >= low[lane]) & (row[lane] <= high[lane])))
        });
        for ((count, sum), inside) in counts.iter_mut().zip(&mut sums).zip(inside) {
            *count += inside & 1;
            *sum += u32::from(inside & y);
        }
    }
    std::array::from_fn(|lane| f64::from(sums[lane]) / f64::from(counts[lane]))
}

/// Counts disparities by the whole pixel they round to: two bins of half a pixel, one on either side.
fn fill_histogram(u_disparity: &UDisparity, disparity: &DisparityMap, histogram: &mut Vec<u32>) {
    histogram.clear();
    histogram.resize(disparity.min_disparity + disparity.num_disparities, 0);
    let counts = u_disparity.counts();
    for (bin, row) in counts.rows().enumerate() {
        let pixels: u32 = row.iter().map(|&n| u32::from(n)).sum();
        let rounded = bin.div_ceil(2);
        if pixels > 0 && rounded >= histogram.len() {
            histogram.resize(rounded + 1, 0);
        }
        if pixels > 0 {
            histogram[rounded] += pixels;
        }
    }
}

/// Counts the pixels of each column of a region that carry no value.
fn count_unknown(disparity: &DisparityMap, region: &Region, unknown: &mut Vec<u32>) {
    unknown.clear();
    unknown.resize(region.width, 0);
    for y in region.y..region.y + region.height {
        let bits = &disparity.validity.row(y)[region.x..region.x + region.width];
        for (unknown, &bits) in unknown.iter_mut().zip(bits) {
            *unknown += u32::from(!Validity::has_value(bits));
        }
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
        let lower = count.div_ceil(2);
        let median_doubled = u32::from(self.at(lower - 1)) + u32::from(self.at(count / 2));
        let one = self.deviation_doubled(median_doubled, lower);
        let other = if count % 2 == 1 { one } else { self.deviation_doubled(median_doubled, lower + 1) };
        let scale = f32::from(DisparityMap::SCALE);
        let deviation_px = (one + other) as f32 / (4.0 * scale);
        (median_doubled as f32 / (2.0 * scale), PER_MEDIAN_DEVIATION * deviation_px)
    }

    /// Twice the deviation from the median that `taken` values do not exceed.
    ///
    /// Those are neighbours: of all windows of `taken`, the one whose ends deviate least. Moving it up, its lower end
    /// comes nearer and its upper end goes away.
    fn deviation_doubled(self, median_doubled: u32, taken: usize) -> u32 {
        let below = |first: usize| median_doubled.saturating_sub(2 * u32::from(self.at(first)));
        let above = |first: usize| (2 * u32::from(self.at(first + taken - 1))).saturating_sub(median_doubled);
        let (mut low, mut high) = (0, self.count() - taken);
        while low < high {
            let middle = low.midpoint(high);
            if below(middle) <= above(middle) {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        let of = |first: usize| below(first).max(above(first));
        low.checked_sub(1).map_or(of(low), |before| of(low).min(of(before)))
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

/// Euclidean range of a pixel, metres; NaN where the rays do not meet in front of the cameras.
#[inline]
pub(crate) fn finite_range_m(geometry: &RectifiedGeometry, disparity_px: f64, x: f64, y: f64) -> f64 {
    let depth_m = geometry.depth_m(disparity_px);
    if depth_m.is_finite() && depth_m > 0.0 { depth_m * geometry.range_per_depth(x, y) } else { f64::NAN }
}

/// Reads several regions of one map; [`Profiler`] does the same for many frames.
///
/// # Errors
///
/// As [`Profiler::read`].
pub fn profile(
    disparity: &DisparityMap,
    regions: &[Region],
    geometry: Option<&RectifiedGeometry>,
    params: &ProfileParams,
) -> Result<Vec<RegionProfile>> {
    geometry.map_or(Ok(()), |geometry| geometry.require_pinhole("profile"))?;
    let mut profiler = Profiler::default();
    regions
        .iter()
        .map(|region| {
            let mut profile = RegionProfile::new(region.clone());
            profiler.read(disparity, geometry, params, &mut profile)?;
            Ok(profile)
        })
        .collect()
}
