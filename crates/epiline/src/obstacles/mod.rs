//! Obstacles: what stands in the way.
//!
//! An upright surface puts as many pixels of a column into one pixel of disparity as it is high; a level floor `h`
//! metres below the camera puts `h / baseline` into each, because on it disparity grows by `baseline / h` from row
//! to row. So the disparities of a column are counted (u-disparity; Hu and Uchimura 2005), and what has enough pixels
//! in 1 px of disparity stands upright. Where the [ground](crate::ground) is known, only pixels higher over it than a
//! step count, and far fewer are enough: a kerb has a handful. A column minimum, in contrast, takes every single
//! mismatch for an obstacle.

mod cells;
mod columns;
mod finder;
mod footing;
mod measure;
mod paper;
mod polyline;
mod standing;

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::ground::GroundPlane;
use crate::matching::DisparityMap;
use crate::range::check_disparity_sigma;
use crate::rectification::RectifiedGeometry;
use crate::regions::Region;

pub use finder::ObstacleFinder;

/// What is taken for an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ObstacleMethod {
    /// What has enough pixels at one disparity in its columns, over the ground where that is known.
    #[default]
    UDisparity,
    /// That of the 2011 paper: what is brighter, that is, nearer, than its neighbourhood (eq. 7).
    Paper,
}

/// How obstacles are found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleParams {
    /// What is taken for an obstacle.
    pub method: ObstacleMethod,
    /// [`ObstacleMethod::Paper`]: σ of the low-pass filter, whole periods across the image, positive. A small one makes
    /// the neighbourhood large.
    pub low_pass_sigma: f64,
    /// [`ObstacleMethod::Paper`]: how much nearer than its neighbourhood an obstacle is, px of disparity, not negative.
    pub brighter_px: f64,
    /// Pixels that a column must have within 1 px of disparity to see an obstacle there where no ground is known, 1 to
    /// 10000. Above `camera height / baseline` the floor is no obstacle; an obstacle lower than this many rows is missed.
    pub min_support: usize,
    /// Columns an obstacle must be seen in, 1 to 10000.
    pub min_columns: usize,
    /// Pixels an obstacle must have in all, 0 to 1000000.
    pub min_pixels: usize,
    /// Where no ground is known, nothing lower is reported, metres, not negative, unless it reaches the lower edge of the
    /// image, where more of it may be hidden. Drops the level patches that windows make of a floor of little
    /// texture; what is lower cannot be told from them.
    pub min_height_m: f64,
    /// What rises less over the ground can be driven over, metres, not negative.
    pub step_m: f64,
    /// What hangs higher over the ground can be passed under, metres, more than `step_m`.
    pub headroom_m: f64,
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
            method: ObstacleMethod::default(),
            low_pass_sigma: 3.0,
            brighter_px: 1.0,
            min_support: 8,
            min_columns: 4,
            min_pixels: 64,
            min_height_m: 0.3,
            step_m: 0.05,
            headroom_m: 2.0,
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
        if !(self.low_pass_sigma > 0.0 && self.low_pass_sigma.is_finite()) {
            let value = format!("{} frequency samples", self.low_pass_sigma);
            return Err(Error::invalid("low_pass_sigma", value, "must be positive and finite"));
        }
        if !(self.brighter_px >= 0.0 && self.brighter_px.is_finite()) {
            let value = format!("{} px", self.brighter_px);
            return Err(Error::invalid("brighter_px", value, "must be finite and not negative"));
        }
        if !(self.step_m >= 0.0 && self.step_m.is_finite()) {
            let value = format!("{} m", self.step_m);
            return Err(Error::invalid("step_m", value, "must be finite and not negative"));
        }
        if !(self.headroom_m > self.step_m && self.headroom_m.is_finite()) {
            let value = format!("{} m", self.headroom_m);
            return Err(Error::invalid("headroom_m", value, "must be finite and more than step_m"));
        }
        check_disparity_sigma(self.disparity_sigma_px)
    }

    /// A pixel this much of a step over the ground stands: of an obstacle a step high, the upper part.
    const STANDS_FROM: f64 = 0.7;
    /// … and so many deviations of its disparity: what is nearer to the ground may be noise.
    const MARGIN_SIGMAS: f64 = 2.0;
    /// With a ground, a column must have at least this many pixels.
    const FEWEST: usize = 3;
    /// The least that is to be found: as high as a kerb, as wide as a pole is thin; metres.
    const LOWEST_M: f64 = 0.08;
    const SMALLEST_AREA_M2: f64 = 0.03 * 0.25;
    /// Of what the least thing should show, this much must be there.
    const SHARE_SEEN: f64 = 0.5;
    /// Of an obstacle's box, this much must be seen: scattered mismatches fill less.
    const LEAST_FILL: f64 = 0.15;
    /// What is lower than this over the ground must have more pixels than a patch of its noise.
    const LOW_M: f64 = 0.25;
    const LOW_PIXELS: usize = 60;
    /// What begins higher than this over the ground must fill this much of its box: most mismatches hang in the air.
    const FLOATS_M: f64 = 0.2;
    const FLOATING_FILL: f64 = 0.7;

    /// Pixels a column must have at a disparity.
    fn support_px(&self, geometry: &RectifiedGeometry, disparity_px: f64, has_ground: bool) -> usize {
        if !has_ground {
            return self.min_support;
        }
        let over_the_step_m = (Self::LOWEST_M - Self::STANDS_FROM * self.step_m).max(0.01);
        let expected = geometry.focal_px * over_the_step_m / geometry.depth_m(disparity_px);
        ((Self::SHARE_SEEN * expected) as usize).clamp(Self::FEWEST, self.min_support.max(Self::FEWEST))
    }

    /// Pixels an obstacle must have at a depth.
    fn area_px(&self, geometry: &RectifiedGeometry, depth_m: f64) -> usize {
        let per_m = geometry.focal_px / depth_m;
        (Self::SHARE_SEEN * Self::SMALLEST_AREA_M2 * per_m * per_m) as usize
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
    /// Name of the first region it stands in.
    pub region: Arc<str>,
    /// Names of all regions it stands in, in their order.
    pub regions: Vec<Arc<str>>,
    /// Where it is seen: all its columns, and the rows that three quarters of them do not reach beyond.
    pub bounds: PixelBox,
    /// Euclidean range of its nearest point, metres, as its outline over all columns has it.
    pub range_m: f64,
    /// Z of that point, metres.
    pub depth_m: f64,
    /// Standard deviation of `range_m`, metres: the matcher's noise, of which many columns take away a part, what all
    /// columns share, and the calibration.
    pub sigma_m: f64,
    /// Bearing of that point, radians: positive to the right of the optical axis.
    pub bearing_rad: f64,
    /// Horizontal extent of `bounds` at that depth, metres.
    pub width_m: f64,
    /// Vertical extent of `bounds` at that depth, metres.
    pub height_m: f64,
    /// How high its top is over the ground, metres; `None` without a ground.
    pub height_above_ground_m: Option<f64>,
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
    ground: Option<&GroundPlane>,
    regions: &[Region],
    params: &ObstacleParams,
) -> Result<Vec<Obstacle>> {
    let mut obstacles = Vec::new();
    ObstacleFinder::default().find(disparity, geometry, ground, regions, params, &mut obstacles)?;
    Ok(obstacles)
}
