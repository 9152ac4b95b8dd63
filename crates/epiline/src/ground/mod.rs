//! The ground the rig stands on: where it is in the disparity map, and how the camera stands over it.
//!
//! A plane in space is a plane in disparity. Of the planes that a camera of plausible height, pitch and roll could see
//! below itself ([`GroundParams`]) the one that most pixels lie on and next to none lie below is fitted to those pixels
//! ([`GroundEstimator`]) and followed over the frames. Ramps and bends ahead are a [`Profile`] of elevations over it.
//! Without such a plane there is no ground, and [`NoGround`] says why: a wall is never one.

mod bend;
mod elevation;
mod estimator;
mod evidence;
mod plane;
mod plane_fit;
mod profile;
mod samples;
mod search;
mod sums;
mod uncertainty;

use crate::error::{Error, Result};
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;
use crate::regions::CameraOverGround;

pub use estimator::GroundEstimator;
pub use plane::GroundPlane;
pub use profile::Profile;

/// How the camera is mounted, as far as the user knows: a first guess, and what the first frame is drawn toward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounting {
    /// Height of the left camera's centre above the ground, metres, positive.
    pub camera_height_m: f64,
    /// How far the optical axis points below the horizon, radians.
    pub pitch_rad: f64,
    /// How far the image's right side hangs lower than its left, radians.
    pub roll_rad: f64,
    /// Standard deviation of `camera_height_m`, metres, positive.
    pub camera_height_sigma_m: f64,
    /// Standard deviation of `pitch_rad`, radians, positive.
    pub pitch_sigma_rad: f64,
    /// Standard deviation of `roll_rad`, radians, positive.
    pub roll_sigma_rad: f64,
}

impl Mounting {
    fn pose(&self) -> CameraOverGround {
        CameraOverGround {
            height_m: self.camera_height_m,
            pitch_rad: self.pitch_rad,
            roll_rad: self.roll_rad,
        }
    }

    /// Whether a pose is within five standard deviations.
    fn allows(&self, pose: &CameraOverGround) -> bool {
        let near = |value: f64, mean: f64, sigma: f64| (value - mean).abs() <= 5.0 * sigma;
        near(pose.height_m, self.camera_height_m, self.camera_height_sigma_m)
            && near(pose.pitch_rad, self.pitch_rad, self.pitch_sigma_rad)
            && near(pose.roll_rad, self.roll_rad, self.roll_sigma_rad)
    }
}

/// What a plane must be like to be the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundParams {
    /// Lowest and highest plausible camera, metres, `0 < lowest < highest`.
    pub camera_height_m: (f64, f64),
    /// Least and most plausible pitch, radians, within ±π/2: how far the camera looks down.
    pub pitch_rad: (f64, f64),
    /// Most plausible roll to either side, radians, above 0 and below π/2.
    pub max_roll_rad: f64,
    /// How the camera is mounted, if that is known; then only planes within five standard deviations count.
    pub mounting: Option<Mounting>,
    /// Standard deviation of a disparity, px, finite and not negative.
    pub disparity_sigma_px: f64,
}

impl Default for GroundParams {
    fn default() -> Self {
        Self {
            camera_height_m: (0.05, 4.0),
            pitch_rad: (-0.35, 1.0),
            max_roll_rad: 0.35,
            mounting: None,
            disparity_sigma_px: 0.25,
        }
    }
}

impl GroundParams {
    /// Fails with the name and value of the first parameter outside its range.
    pub fn validate(&self) -> Result<()> {
        let (low, high) = self.camera_height_m;
        if !(low > 0.0 && low < high && high.is_finite()) {
            let value = format!("({low}, {high}) m");
            return Err(Error::invalid(
                "camera_height_m",
                value,
                "must be two heights, 0 < lowest < highest",
            ));
        }
        let quarter = std::f64::consts::FRAC_PI_2;
        let (least, most) = self.pitch_rad;
        if !(-quarter < least && least < most && most < quarter) {
            let value = format!("({least}, {most}) rad");
            return Err(Error::invalid("pitch_rad", value, "must be two angles, -π/2 < least < most < π/2"));
        }
        if !(self.max_roll_rad > 0.0 && self.max_roll_rad < quarter) {
            let value = format!("{} rad", self.max_roll_rad);
            return Err(Error::invalid("max_roll_rad", value, "must be above 0 and below π/2"));
        }
        if let Some(mounting) = &self.mounting {
            mounting.validate()?;
        }
        crate::range::check_disparity_sigma(self.disparity_sigma_px)
    }

    fn is_plausible(&self, pose: &CameraOverGround) -> bool {
        let within = |value: f64, (low, high): (f64, f64)| low <= value && value <= high;
        within(pose.height_m, self.camera_height_m)
            && within(pose.pitch_rad, self.pitch_rad)
            && pose.roll_rad.abs() <= self.max_roll_rad
            && self.mounting.is_none_or(|mounting| mounting.allows(pose))
    }
}

impl Mounting {
    fn validate(&self) -> Result<()> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        for (name, value) in [
            ("mounting.camera_height_m", self.camera_height_m),
            ("mounting.camera_height_sigma_m", self.camera_height_sigma_m),
        ] {
            if !positive(value) {
                return Err(Error::invalid(name, format!("{value} m"), "must be positive and finite"));
            }
        }
        for (name, value) in [
            ("mounting.pitch_sigma_rad", self.pitch_sigma_rad),
            ("mounting.roll_sigma_rad", self.roll_sigma_rad),
        ] {
            if !positive(value) {
                return Err(Error::invalid(name, format!("{value} rad"), "must be positive and finite"));
            }
        }
        for (name, value) in [("mounting.pitch_rad", self.pitch_rad), ("mounting.roll_rad", self.roll_rad)] {
            if value.is_nan() || value.abs() >= std::f64::consts::FRAC_PI_2 {
                return Err(Error::invalid(name, format!("{value} rad"), "must be within ±π/2"));
            }
        }
        Ok(())
    }
}

/// Why no ground is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoGround {
    /// Too few pixels have a disparity.
    TooFewPixels,
    /// Nothing plausible holds enough of them: a wall fills the view, or the camera does not look at the floor.
    NoPlane,
    /// What looks like ground has too much below it: a table top, a shelf.
    SomethingBelow,
    /// Not asked for.
    NotAsked,
}

impl NoGround {
    /// In words.
    pub fn reason(self) -> &'static str {
        match self {
            Self::TooFewPixels => "too few pixels have a disparity",
            Self::NoPlane => "no plane at a plausible height and angle holds enough pixels",
            Self::SomethingBelow => "the best plane has too much below it to be the ground",
            Self::NotAsked => "not asked for",
        }
    }
}

/// The ground, or why there is none.
pub type Ground = std::result::Result<GroundPlane, NoGround>;

/// The ground of one map; [`GroundEstimator`] follows it over many.
///
/// # Errors
///
/// As [`GroundEstimator::new`] and [`GroundEstimator::estimate`].
pub fn find_ground(
    disparity: &DisparityMap,
    geometry: &RectifiedGeometry,
    params: &GroundParams,
) -> Result<Ground> {
    GroundEstimator::new(*params)?.estimate(disparity, geometry)
}
