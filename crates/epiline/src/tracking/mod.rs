//! Tracks: which obstacle is which from frame to frame, and how fast it moves.
//!
//! A track's state is a position and a velocity over the ground plane of the left aligned camera, `x` to the right
//! and `z` forward. Between frames it moves at constant velocity, disturbed by white acceleration (Bar-Shalom, Li and
//! Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 6.2.2); an obstacle measures
//! its position with a covariance that is long along the ray, as a stereo range's is, and short across it. Time comes
//! from the frames' stamps alone.
//!
//! Without the camera's own motion, velocity is relative to the camera: what stands still comes nearer as fast as the
//! camera drives. With it ([`EgoMotion`]), given or estimated, velocity is over the ground, in the camera's present
//! axes.

mod assignment;
mod detection;
mod kalman;
mod own_motion;
mod tracker;

use crate::error::{Error, Result};
use crate::obstacles::PixelBox;

pub use assignment::{Assignment, UNASSIGNED};
pub use detection::Detection;
pub use tracker::Tracker;

/// How obstacles are tracked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackParams {
    /// Standard deviation of the change of each component of velocity within one second, m/s, positive: large for what
    /// brakes and turns, small for what rolls.
    pub velocity_walk_mps: f64,
    /// Standard deviation of each component of the velocity of what is seen first, m/s, positive. A camera that drives
    /// sees everything come: at least its own speed.
    pub initial_velocity_mps: f64,
    /// Standard deviation of a bearing, radians, positive.
    pub bearing_sigma_rad: f64,
    /// How far the middle of what is seen of an obstacle wanders as more or less of it is seen: one standard deviation
    /// as a share of its width, 0 to 1. Along the ray it is half as much.
    pub extent_share: f64,
    /// Probability that a track's own obstacle lies in its gate, above 0 and below 1.
    pub gate_probability: f64,
    /// A track is confirmed by obstacles in so many of its last [`confirm_window`](Self::confirm_window) frames, 1 to
    /// the window.
    pub confirm_hits: u32,
    /// Frames that `confirm_hits` are counted in, 1 to 32.
    pub confirm_window: u32,
    /// A confirmed track ends after more than so many frames in a row without an obstacle.
    pub max_misses: u32,
    /// All tracks end where no frame came for longer, seconds, positive.
    pub max_gap_s: f64,
    /// Take most of what is seen to stand still, and the camera to drive straight ahead: where its motion is not given
    /// it is estimated from the obstacles themselves, and velocities are over the ground. For a camera that drives past
    /// many things; not for one that stands and watches few.
    pub scene_stands_still: bool,
}

impl Default for TrackParams {
    fn default() -> Self {
        Self {
            velocity_walk_mps: 2.0,
            initial_velocity_mps: 5.0,
            bearing_sigma_rad: 0.005,
            extent_share: 0.1,
            gate_probability: 0.99,
            confirm_hits: 3,
            confirm_window: 5,
            max_misses: 5,
            max_gap_s: 1.0,
            scene_stands_still: false,
        }
    }
}

impl TrackParams {
    /// Fails with the name and value of the first parameter outside its range.
    pub fn validate(&self) -> Result<()> {
        let positive = [
            ("velocity_walk_mps", self.velocity_walk_mps, "m/s"),
            ("initial_velocity_mps", self.initial_velocity_mps, "m/s"),
            ("bearing_sigma_rad", self.bearing_sigma_rad, "rad"),
            ("max_gap_s", self.max_gap_s, "s"),
        ];
        for (name, value, unit) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::invalid(name, format!("{value} {unit}"), "must be positive and finite"));
            }
        }
        if !(0.0..=1.0).contains(&self.extent_share) {
            return Err(Error::invalid("extent_share", self.extent_share, "must be 0 to 1"));
        }
        if !(self.gate_probability > 0.0 && self.gate_probability < 1.0) {
            let expected = "must be above 0 and below 1";
            return Err(Error::invalid("gate_probability", self.gate_probability, expected));
        }
        if !(1..=32).contains(&self.confirm_window) {
            return Err(Error::invalid(
                "confirm_window",
                format!("{} frames", self.confirm_window),
                "must be 1 to 32",
            ));
        }
        if !(1..=self.confirm_window).contains(&self.confirm_hits) {
            let expected = format!("must be 1 to confirm_window, {}", self.confirm_window);
            return Err(Error::invalid("confirm_hits", format!("{} frames", self.confirm_hits), expected));
        }
        Ok(())
    }

    /// Largest squared Mahalanobis distance of the gate: the chi-square quantile with two degrees of freedom, which has
    /// a closed form.
    pub fn gate(&self) -> f64 {
        -2.0 * (1.0 - self.gate_probability).ln()
    }
}

/// How the camera moved between two updates, in its axes of the first.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EgoMotion {
    /// To the right, metres.
    pub right_m: f64,
    /// Forward, metres.
    pub forward_m: f64,
    /// Turn, radians: positive to the right, as bearings are.
    pub yaw_rad: f64,
}

impl EgoMotion {
    fn validate(&self) -> Result<()> {
        let Self { right_m, forward_m, yaw_rad } = *self;
        for (name, value, unit) in
            [("right_m", right_m, "m"), ("forward_m", forward_m, "m"), ("yaw_rad", yaw_rad, "rad")]
        {
            if !value.is_finite() {
                return Err(Error::invalid(name, format!("{value} {unit}"), "must be finite"));
            }
        }
        Ok(())
    }
}

/// What a frame was to the tracks before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Continuity {
    /// The first one.
    Started,
    /// Later than the one before.
    Advanced,
    /// The same stamp again: nothing new was seen, and nothing changed.
    Repeated,
    /// An earlier stamp: the source began anew, and so did the tracks.
    Backward,
    /// Later by more than [`TrackParams::max_gap_s`]: the tracks began anew.
    Gap,
}

impl Continuity {
    /// One word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Started => "started",
            Self::Advanced => "advanced",
            Self::Repeated => "repeated",
            Self::Backward => "backward",
            Self::Gap => "gap",
        }
    }
}

/// An obstacle followed over frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// Its own as long as it lives, and never another's: ids count up from 0.
    pub id: u64,
    /// `[x, z]`, metres: to the right of the left camera, and along its optical axis.
    pub position_m: [f64; 2],
    /// `[x, z]`, m/s: relative to the camera, or over the ground where its motion is given.
    pub velocity_mps: [f64; 2],
    /// Covariance of `[x, z, vx, vz]`.
    pub covariance: [[f64; 4]; 4],
    /// Euclidean range, metres, as its last obstacle lay above or below the camera.
    pub range_m: f64,
    /// Standard deviation of `range_m`, metres.
    pub sigma_m: f64,
    /// Positive to the right of the optical axis, radians.
    pub bearing_rad: f64,
    /// Seconds since it was first seen.
    pub age_s: f64,
    /// Frames with an obstacle.
    pub hits: u32,
    /// Frames since the last obstacle; 0 if this one has it.
    pub misses: u32,
    /// Whether it was seen often enough to be believed ([`TrackParams::confirm_hits`]); stays so.
    pub confirmed: bool,
    /// Which of this frame's obstacles it is, as an index; `None` if none.
    pub obstacle: Option<usize>,
    /// Where it was last seen.
    pub bounds: PixelBox,
    /// Width, metres, smoothed.
    pub width_m: f64,
    /// Height, metres, smoothed.
    pub height_m: f64,
    /// Squared Mahalanobis distance of its last obstacle from where it was expected; NaN for its first. On average 2
    /// if the sigmas are honest.
    pub surprise: f64,
}
