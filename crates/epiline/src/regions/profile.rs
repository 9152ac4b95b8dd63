//! What the paper plots for a region: value against column, and the figures read from it.

use super::Region;
use super::surface::{NearestSurface, SurfaceFinder};
use crate::error::{Error, Result};
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

/// Columns gathered at a time: reading the map by rows, in spans of a cache line or more.
const TILE: usize = 32;

/// A pixel of a column: disparity in the upper half, so that pixels sort by it, row within the region in the lower.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Pixel(u32);

impl Pixel {
    fn new(raw: u16, row: usize) -> Self {
        Self(u32::from(raw) << 16 | row as u32)
    }

    fn raw(self) -> u16 {
        (self.0 >> 16) as u16
    }

    fn row(self) -> u32 {
        self.0 & 0xffff
    }
}

fn px(raw: u16) -> f32 {
    f32::from(raw) / f32::from(DisparityMap::SCALE)
}

/// Reads regions; keeps its buffers from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Profiler {
    /// The pixels of [`TILE`] columns, each `region.height` apart.
    columns: Vec<Pixel>,
    /// The map without what lies outside a region of space.
    inside: DisparityMap,
    surface: SurfaceFinder,
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
        let pixels = (out.region.width * out.region.height) as f64;
        let unknown: f64 = out.unknown.iter().map(|&n| f64::from(n)).sum();
        out.valid_share = (pixels - unknown) / pixels;
        // f32::min and max pass over NaN.
        out.minimum = f64::from(out.minimum_px.iter().copied().fold(f32::NAN, f32::min));
        out.maximum = f64::from(out.maximum_px.iter().copied().fold(f32::NAN, f32::max));
        out.nearest = self.surface.nearest(disparity, geometry, &out.region, params);
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
        out.histogram.clear();
        out.histogram.resize(disparity.min_disparity + disparity.num_disparities, 0);
        let mut total_raw = 0_u64;

        self.columns.clear();
        self.columns.resize(TILE * height, Pixel(0));
        for tile_left in (left..left + width).step_by(TILE) {
            let tile_width = TILE.min(left + width - tile_left);
            let counts = self.gather(disparity, tile_left, tile_width, top, height);
            for (i, &count) in counts[..tile_width].iter().enumerate() {
                let column = &mut self.columns[i * height..i * height + count];
                column.sort_unstable();
                for pixel in &*column {
                    total_raw += u64::from(pixel.raw());
                    let bin =
                        usize::from(pixel.raw() + DisparityMap::SCALE / 2) / usize::from(DisparityMap::SCALE);
                    if bin >= out.histogram.len() {
                        out.histogram.resize(bin + 1, 0);
                    }
                    out.histogram[bin] += 1;
                }
                let at = |k: usize| column.get(k).map_or(f32::NAN, |pixel| px(pixel.raw()));
                out.count.push(count as u32);
                out.minimum_px.push(at(0));
                out.maximum_px.push(if count > 0 { at(count - 1) } else { f32::NAN });
                out.median_px.push(if count > 0 {
                    0.5 * (at((count - 1) / 2) + at(count / 2))
                } else {
                    f32::NAN
                });
                out.spread_px.push(spread_px(column));
                let supported = nearest_supported(column, min_support);
                out.nearest_px.push(supported.map_or(f32::NAN, |(raw, _)| px(raw)));
                if let (Some(geometry), Some(ranges_m)) = (geometry, &mut ranges_m) {
                    ranges_m.push(supported.map_or(f32::NAN, |(raw, mean_row)| {
                        let (x, y) = ((tile_left + i) as f64, top as f64 + mean_row);
                        finite_range_m(geometry, f64::from(px(raw)), x, y) as f32
                    }));
                }
            }
        }
        out.nearest_range_m = ranges_m;
        out.total = total_raw as f64 / f64::from(DisparityMap::SCALE);
    }

    /// Collects the valid pixels of up to [`TILE`] columns; returns how many each has.
    fn gather(
        &mut self,
        disparity: &DisparityMap,
        left: usize,
        width: usize,
        top: usize,
        height: usize,
    ) -> [usize; TILE] {
        let mut counts = [0; TILE];
        for row in 0..height {
            let raws = &disparity.values.row(top + row)[left..left + width];
            let bits = &disparity.validity.row(top + row)[left..left + width];
            for (i, (&raw, &bits)) in raws.iter().zip(bits).enumerate() {
                // Written always, counted only if valid: which it is cannot be predicted.
                self.columns[i * height + counts[i]] = Pixel::new(raw, row);
                counts[i] += usize::from(Validity::has_value(bits));
            }
        }
        counts
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

/// `1.4826·median(|d - median|)` of a sorted column, px; NaN of none.
fn spread_px(column: &[Pixel]) -> f32 {
    /// What makes a normal distribution's median deviation its standard deviation: `1/Φ⁻¹(3/4)`.
    const PER_MEDIAN_DEVIATION: f32 = 1.482_602_2;
    let count = column.len();
    if count == 0 {
        return f32::NAN;
    }
    let doubled = |i: usize| 2 * u32::from(column[i].raw());
    let median_doubled = (doubled((count - 1) / 2) + doubled(count / 2)) / 2;
    // Deviations come in order when taken from the middle outward: `column[low..high]` is taken.
    let (mut low, mut high) = (count / 2, count / 2);
    let mut last_two = [0; 2];
    while high - low <= count / 2 {
        let below = low.checked_sub(1).map_or(u32::MAX, |i| median_doubled - doubled(i));
        let above = if high < count { doubled(high) - median_doubled } else { u32::MAX };
        if below < above {
            low -= 1;
        } else {
            high += 1;
        }
        last_two = [last_two[1], below.min(above)];
    }
    let middle_two = if count % 2 == 1 { [last_two[1]; 2] } else { last_two };
    let deviation = (middle_two[0] + middle_two[1]) as f32 / (4.0 * f32::from(DisparityMap::SCALE));
    PER_MEDIAN_DEVIATION * deviation
}

/// The largest disparity of a sorted column that has enough support, and the mean row of its supporters.
fn nearest_supported(column: &[Pixel], min_support: usize) -> Option<(u16, f64)> {
    let scale = DisparityMap::SCALE;
    // For each candidate, from the largest down, column[low..high] lies within ±1 px of it.
    let mut high = column.len();
    let mut low = column.len();
    for candidate in column.iter().rev().map(|pixel| pixel.raw()) {
        while high > 0 && column[high - 1].raw() > candidate.saturating_add(scale) {
            high -= 1;
        }
        while low > 0 && column[low - 1].raw() >= candidate.saturating_sub(scale) {
            low -= 1;
        }
        if high - low >= min_support {
            let rows: f64 = column[low..high].iter().map(|pixel| f64::from(pixel.row())).sum();
            return Some((candidate, rows / (high - low) as f64));
        }
    }
    None
}

/// Euclidean range of a pixel, metres; NaN where the rays do not meet in front of the cameras.
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
