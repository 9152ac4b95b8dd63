//! Obstacles: clusters of pixels that stand upright at one distance.
//!
//! An upright surface puts as many pixels of a column into one pixel of disparity as it is high; a level floor `h`
//! metres below the camera puts `h / baseline` into each, because on it disparity grows by `baseline / h` from row
//! to row. So a column's disparities are counted in windows of 1 px, and what has [`ObstacleParams::min_support`]
//! pixels is an obstacle: floors are not, while `h / baseline < min_support`, nor are stray mismatches. A column
//! minimum, in contrast, takes every single mismatch for an obstacle.

mod clusters;
mod measure;

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::matching::DisparityMap;
use crate::range::check_disparity_sigma;
use crate::rectification::RectifiedGeometry;
use crate::regions::Region;

pub use clusters::ObstacleFinder;

/// How obstacles are found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleParams {
    /// Pixels that a column must have within 1 px of disparity to see an obstacle there, 1 to 10000. Above
    /// `camera height / baseline` the floor is no obstacle; an obstacle lower than this many rows is missed.
    pub min_support: usize,
    /// Columns an obstacle must be seen in, 1 to 10000.
    pub min_columns: usize,
    /// Pixels an obstacle must have in all, 0 to 1000000.
    pub min_pixels: usize,
    /// Nothing lower is reported, metres, not negative, unless it reaches the upper or lower edge of its region, where
    /// more of it may be hidden. Drops the level patches that windows make of markings and shadows on a floor.
    pub min_height_m: f64,
    /// Nothing farther is reported; `None`: nothing whose disparity is less than 3 sigma.
    pub max_range_m: Option<f64>,
    /// Things this much apart in depth are two, metres, positive; where 1 px of disparity is more, 1 px.
    pub range_gap_m: f64,
    /// Standard deviation of a disparity, px, finite and not negative: what `sigma_m` is made from.
    pub disparity_sigma_px: f64,
}

impl Default for ObstacleParams {
    fn default() -> Self {
        Self {
            min_support: 8,
            min_columns: 3,
            min_pixels: 64,
            min_height_m: 0.1,
            max_range_m: None,
            range_gap_m: 0.3,
            disparity_sigma_px: 0.25,
        }
    }
}

impl ObstacleParams {
    /// Fails with the name and value of the first parameter outside its range.
    pub fn validate(&self) -> Result<()> {
        for (name, value) in [("min_support", self.min_support), ("min_columns", self.min_columns)] {
            if !(1..=10_000).contains(&value) {
                return Err(Error::invalid(name, format!("{value} px"), "must be 1 to 10000 px"));
            }
        }
        if self.min_pixels > 1_000_000 {
            return Err(Error::invalid(
                "min_pixels",
                format!("{} px", self.min_pixels),
                "must be 0 to 1000000 px",
            ));
        }
        let positive = |value: f64| value > 0.0 && !value.is_nan();
        for (name, value) in [("max_range_m", self.max_range_m), ("range_gap_m", Some(self.range_gap_m))] {
            if let Some(value) = value.filter(|&value| !positive(value)) {
                return Err(Error::invalid(name, format!("{value} m"), "must be positive"));
            }
        }
        if !(self.min_height_m >= 0.0 && self.min_height_m.is_finite()) {
            let value = format!("{} m", self.min_height_m);
            return Err(Error::invalid("min_height_m", value, "must be finite and not negative"));
        }
        check_disparity_sigma(self.disparity_sigma_px)
    }

    /// Whether an obstacle of `region` is one to report.
    fn wants(&self, obstacle: &Obstacle, region: &Region) -> bool {
        // The outermost pixels do not count towards the height, so an edge is reached two rows before it.
        let end = obstacle.bounds.y + obstacle.bounds.height;
        let at_edge = obstacle.bounds.y <= region.y + 2 || end + 2 >= region.y + region.height;
        let tall_enough = at_edge || obstacle.height_m >= self.min_height_m;
        tall_enough && self.max_range_m.is_none_or(|limit_m| obstacle.range_m <= limit_m)
    }

    /// Smallest disparity, infinity at zero, that is not too far away to report, px.
    fn smallest_disparity_px(&self, geometry: &RectifiedGeometry) -> f64 {
        let of_range =
            self.max_range_m.map_or(0.0, |limit_m| geometry.focal_px * geometry.baseline_m / limit_m);
        // At least a bin's width, so that no pixel of the last bin is beyond infinity.
        of_range.max(3.0 * self.disparity_sigma_px).max(0.5)
    }
}

/// A box of pixels of the left aligned image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelBox {
    /// Leftmost column.
    pub x: usize,
    /// Topmost row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Something that stands in the way.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Rank in its frame, nearest first, from 0.
    pub id: usize,
    /// Name of the region it was found in; one that stands in two regions is found twice.
    pub region: Arc<str>,
    /// Where it is seen: all its columns, and the rows between which 96 % of its pixels lie.
    pub bounds: PixelBox,
    /// Euclidean range of its near side, metres: from the median disparity of the pixels not more than
    /// [`range_gap_m`](ObstacleParams::range_gap_m) behind its nearest supported ones.
    pub range_m: f64,
    /// Z of its near side, metres.
    pub depth_m: f64,
    /// Standard deviation of `range_m`, metres: that of a single pixel, for neighbours share their windows.
    pub sigma_m: f64,
    /// Bearing of its near side, radians: positive to the right of the optical axis.
    pub bearing_rad: f64,
    /// Horizontal extent of its near side across the optical axis, metres.
    pub width_m: f64,
    /// Vertical extent of `bounds` at the depth of the near side, metres: no more than the region shows.
    pub height_m: f64,
    /// Pixels.
    pub support: usize,
}

/// Finds the obstacles of one map, nearest first; [`ObstacleFinder`] does the same for many frames.
///
/// # Errors
///
/// As [`ObstacleFinder::find`].
pub fn find_obstacles(
    disparity: &DisparityMap,
    geometry: &RectifiedGeometry,
    regions: &[Region],
    params: &ObstacleParams,
) -> Result<Vec<Obstacle>> {
    geometry.require_pinhole("find_obstacles")?;
    let mut obstacles = Vec::new();
    ObstacleFinder::default().find(disparity, geometry, regions, params, &mut obstacles)?;
    Ok(obstacles)
}
