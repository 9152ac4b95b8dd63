//! The scan: what stands nearest, how far it is free, and what is not known, for every direction over the floor.
//!
//! A direction is a vertical plane through the camera. In the image that is a line towards the point where verticals
//! meet; of a camera that is held level, a column. Following those lines instead of columns is what keeps an obstacle
//! off the middle as wide, and as far, as it is when the camera is tilted.
//!
//! Along a direction three things are told apart:
//!
//! * **obstacle**: enough pixels of the line have one horizontal distance, between the lowest height that matters and
//!   the highest the robot reaches;
//! * **free**: the floor was seen without a gap in which an obstacle of the lowest height that matters could stand,
//!   from where the view begins;
//! * **unknown**: everything else. A wall without texture is unknown, and so is what lies beyond it.
//!
//! What hangs in the air without texture before a floor that is seen is not noticed: free means free of what stands.
//! Without a ground, heights are not known, and a direction is free up to its nearest obstacle as far as what could
//! hide in the rows without an answer would have to be.

mod histogram;
mod laser;
mod rays;
mod robot_from_camera;
mod scanner;
mod view;

use crate::error::{Error, Result};
use crate::range::check_disparity_sigma;

pub use laser::LaserScan;
pub use robot_from_camera::RobotFromCamera;
pub use scanner::Scanner;

/// How a scan is read from a disparity map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanParams {
    /// Pixels that a direction must have within 1 px of disparity to see an obstacle there, 1 to 10000.
    pub min_support: usize,
    /// What rises less over the floor can be driven over, metres, positive.
    pub step_m: f64,
    /// What hangs higher over the floor can be passed under, metres, above `step_m`; may be infinite.
    pub headroom_m: f64,
    /// Nothing farther is looked for, metres, positive: a direction that is free up to here has nothing in range.
    pub max_range_m: f64,
    /// Rows by which the matcher's window may shrink a gap in the floor, px, not negative: half its height for each end
    /// that it blurs. A larger value sees less floor as free.
    pub gap_guard_px: f64,
    /// Standard deviation of a disparity, px, finite and not negative. The floor is seen as such only where what is
    /// `step_m` high would stand out from it by 3 of these.
    pub disparity_sigma_px: f64,
}

impl Default for ScanParams {
    fn default() -> Self {
        Self {
            min_support: 8,
            step_m: 0.05,
            headroom_m: 2.0,
            max_range_m: 10.0,
            gap_guard_px: 4.0,
            disparity_sigma_px: 0.25,
        }
    }
}

impl ScanParams {
    /// Fails with the name and value of the first parameter outside its range.
    pub fn validate(&self) -> Result<()> {
        if !(1..=10_000).contains(&self.min_support) {
            let value = format!("{} px", self.min_support);
            return Err(Error::invalid("min_support", value, "must be 1 to 10000 px"));
        }
        for (name, value) in [("step_m", self.step_m), ("max_range_m", self.max_range_m)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::invalid(name, format!("{value} m"), "must be positive and finite"));
            }
        }
        if self.headroom_m.is_nan() || self.headroom_m <= self.step_m {
            let expected = format!("must be above step_m, {} m", self.step_m);
            return Err(Error::invalid("headroom_m", format!("{} m", self.headroom_m), expected));
        }
        if !(self.gap_guard_px >= 0.0 && self.gap_guard_px.is_finite()) {
            let value = format!("{} px", self.gap_guard_px);
            return Err(Error::invalid("gap_guard_px", value, "must be finite and not negative"));
        }
        check_disparity_sigma(self.disparity_sigma_px)
    }
}

/// What lies in a direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Seen {
    /// Not known: neither an obstacle nor all of the floor was seen.
    Unknown = 0,
    /// The floor, up to [`ScanParams::max_range_m`].
    Nothing = 1,
    /// An obstacle.
    Obstacle = 2,
}

/// The scan of a frame: an entry per direction, counter-clockwise, so from the right edge of the image to the left.
///
/// Distances are metres over the floor from the foot of the left camera ([`origin_m`](Self::origin_m)), for that is
/// where the lines of sight begin; angles are about the robot's z axis, from its x axis. NaN where there is no such
/// distance.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scan {
    /// Direction, radians, ascending.
    pub angle_rad: Vec<f32>,
    /// What was seen, as [`Seen`].
    pub seen: Vec<u8>,
    /// Distance of the nearest obstacle.
    pub nearest_m: Vec<f32>,
    /// Its standard deviation, metres.
    pub sigma_m: Vec<f32>,
    /// Where the free stretch begins: nothing nearer is in view, or in reach of the disparities searched.
    pub free_from_m: Vec<f32>,
    /// Where it ends; never beyond `nearest_m`.
    pub free_to_m: Vec<f32>,
    /// The camera's foot in the robot's frame, `[x, y]`, metres.
    pub origin_m: [f64; 2],
    /// How far was looked, metres.
    pub max_range_m: f64,
    /// What is nearer than this cannot be measured straight ahead: its disparity was not searched; metres.
    pub blind_m: f64,
}

impl Scan {
    /// Directions.
    pub fn len(&self) -> usize {
        self.angle_rad.len()
    }

    /// Whether there is no direction: nothing was scanned yet.
    pub fn is_empty(&self) -> bool {
        self.angle_rad.is_empty()
    }

    /// Where the obstacles are, in the robot's frame, `[x, y]`, metres.
    pub fn obstacle_points_m(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        let [x, y] = self.origin_m.map(|v| v as f32);
        self.angle_rad.iter().zip(&self.nearest_m).filter(|(_, range_m)| range_m.is_finite()).map(
            move |(angle, range_m)| {
                let (sin, cos) = angle.sin_cos();
                [x + range_m * cos, y + range_m * sin]
            },
        )
    }
}

fn refill<T: Clone>(values: &mut Vec<T>, length: usize, value: T) {
    values.clear();
    values.resize(length, value);
}
