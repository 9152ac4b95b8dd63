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
    /// Per column: the smallest.
    pub minimum_px: Vec<f32>,
    /// Per column: the largest, supported or not.
    pub maximum_px: Vec<f32>,
    /// Per column: how many pixels carry a value.
    pub count: Vec<u32>,
    /// Per column: Euclidean range of `nearest_px` at the mean row of its supporters, metres. `None` without geometry.
    pub nearest_range_m: Option<Vec<f32>>,
    /// Entry `i` counts the pixels whose disparity rounds to `i` px.
    pub histogram: Vec<u32>,
    /// Share of the region's pixels that carry a value, 0 to 1.
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
            minimum_px: Vec::new(),
            maximum_px: Vec::new(),
            count: Vec::new(),
            nearest_range_m: None,
            histogram: Vec::new(),
            valid_share: 0.0,
            minimum: f64::NAN,
            maximum: f64::NAN,
            total: 0.0,
            nearest: None,
        }
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
    surface: SurfaceFinder,
}

impl Profiler {
    /// Reads `out.region` of the map into `out`, keeping its memory.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for a region outside the map or parameters out of range,
    /// [`Error::SizeMismatch`] if map and geometry differ in size.
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
        self.read_columns(disparity, geometry, params.min_support, out);
        let pixels = (out.region.width * out.region.height) as f64;
        out.valid_share = out.count.iter().map(|&n| f64::from(n)).sum::<f64>() / pixels;
        // f32::min and max pass over NaN.
        out.minimum = f64::from(out.minimum_px.iter().copied().fold(f32::NAN, f32::min));
        out.maximum = f64::from(out.maximum_px.iter().copied().fold(f32::NAN, f32::max));
        out.nearest = self.surface.nearest(disparity, geometry, &out.region, params);
        Ok(())
    }

    fn read_columns(
        &mut self,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        min_support: usize,
        out: &mut RegionProfile,
    ) {
        let Region { x: left, y: top, width, height, .. } = out.region;
        for values in [&mut out.nearest_px, &mut out.median_px, &mut out.minimum_px, &mut out.maximum_px] {
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
