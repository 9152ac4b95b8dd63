//! What the paper plots for a region: value against column, and the figures read from it.

use super::Region;
use super::columns::ColumnReader;
use super::plane::Scene;
use super::surface::{NearestSurface, SurfaceFinder};
use super::tiles::Tiles;
use super::u_disparity::UDisparity;
use crate::error::{Error, Result};
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

/// Reads regions; keeps its buffers from frame to frame.
#[derive(Debug, Clone)]
pub struct Profiler {
    kernels: Kernels,
    tiles: Tiles,
    columns: ColumnReader,
    /// The map without what lies outside a region of space.
    inside: DisparityMap,
    u_disparity: UDisparity,
    surface: SurfaceFinder,
}

impl Default for Profiler {
    fn default() -> Self {
        Self {
            kernels: Kernels::new(Level::current()),
            tiles: Tiles::default(),
            columns: ColumnReader::default(),
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
        let Some(space) = out.region.space else {
            self.read_map(disparity, geometry, params, out);
            let height = out.region.height as u32;
            out.unknown.clear();
            out.unknown.extend(out.count.iter().map(|count| height - count));
            set_valid_share(out);
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
        count_unknown(disparity, &out.region, &mut out.unknown);
        set_valid_share(out);
        Ok(())
    }

    fn read_map(
        &mut self,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        params: &ProfileParams,
        out: &mut RegionProfile,
    ) {
        self.tiles.gather(&self.kernels, disparity, &out.region);
        let largest = self.columns.read(&self.kernels, &self.tiles, geometry, params.min_support, out);
        self.u_disparity.count(&self.tiles, largest);
        fill_histogram(&self.u_disparity, disparity, &mut out.histogram);
        // f32::min and max pass over NaN.
        out.minimum = f64::from(out.minimum_px.iter().copied().fold(f32::NAN, f32::min));
        out.maximum = f64::from(out.maximum_px.iter().copied().fold(f32::NAN, f32::max));
        let scene = Scene { tiles: &self.tiles, geometry, region: &out.region, params };
        let image_size = (disparity.width(), disparity.height());
        out.nearest = self.surface.nearest(&self.kernels, &scene, &self.u_disparity, image_size);
    }
}

fn set_valid_share(profile: &mut RegionProfile) {
    let pixels = (profile.region.width * profile.region.height) as f64;
    let unknown: f64 = profile.unknown.iter().map(|&n| f64::from(n)).sum();
    profile.valid_share = (pixels - unknown) / pixels;
}

/// Counts disparities by the whole pixel they round to: two bins of half a pixel, one on either side.
fn fill_histogram(u_disparity: &UDisparity, disparity: &DisparityMap, histogram: &mut Vec<u32>) {
    histogram.clear();
    histogram.resize(disparity.min_disparity + disparity.num_disparities, 0);
    for (bin, &pixels) in u_disparity.totals().iter().enumerate().filter(|(_, pixels)| **pixels > 0) {
        let rounded = bin.div_ceil(2);
        if rounded >= histogram.len() {
            histogram.resize(rounded + 1, 0);
        }
        histogram[rounded] += pixels;
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
