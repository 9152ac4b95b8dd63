//! What a track is fed with: where something was seen, and how surely.

use nalgebra::{Matrix2, Vector2};

use super::TrackParams;
use crate::error::{Error, Result};
use crate::obstacles::{Obstacle, PixelBox};

/// Something seen in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Euclidean range, metres, positive.
    pub range_m: f64,
    /// Z along the optical axis, metres, positive, at most `range_m`.
    pub depth_m: f64,
    /// Standard deviation of `range_m`, metres, positive.
    pub sigma_m: f64,
    /// Positive to the right of the optical axis, radians, within ±π/2.
    pub bearing_rad: f64,
    /// Width, metres, not negative.
    pub width_m: f64,
    /// Height, metres, not negative.
    pub height_m: f64,
    /// Pixels it was seen by: the better seen of two that are one thing stands for both.
    pub support: usize,
    /// Where it was seen; boxes tell two parts of one thing from two things.
    pub bounds: PixelBox,
}

impl From<&Obstacle> for Detection {
    fn from(obstacle: &Obstacle) -> Self {
        let Obstacle { range_m, depth_m, sigma_m, bearing_rad, width_m, height_m, support, bounds, .. } =
            *obstacle;
        Self { range_m, depth_m, sigma_m, bearing_rad, width_m, height_m, support, bounds }
    }
}

impl Detection {
    /// Something of no size at the camera's height.
    pub fn level(range_m: f64, bearing_rad: f64, sigma_m: f64) -> Self {
        Self {
            range_m,
            depth_m: range_m * bearing_rad.cos(),
            sigma_m,
            bearing_rad,
            width_m: 0.0,
            height_m: 0.0,
            support: 1,
            bounds: PixelBox { x: 0, y: 0, width: 0, height: 0 },
        }
    }

    /// Fails with the name and value of the first field outside its range.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`].
    pub fn validate(&self) -> Result<()> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        for (name, value) in [("range_m", self.range_m), ("depth_m", self.depth_m), ("sigma_m", self.sigma_m)]
        {
            if !positive(value) {
                return Err(Error::invalid(name, format!("{value} m"), "must be positive and finite"));
            }
        }
        for (name, value) in [("width_m", self.width_m), ("height_m", self.height_m)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::invalid(name, format!("{value} m"), "must be finite and not negative"));
            }
        }
        if self.bearing_rad.is_nan() || self.bearing_rad.abs() >= std::f64::consts::FRAC_PI_2 {
            let value = format!("{} rad", self.bearing_rad);
            return Err(Error::invalid("bearing_rad", value, "must be within ±π/2"));
        }
        Ok(())
    }

    /// `[x, z]`, metres.
    pub(super) fn position_m(&self) -> Vector2<f64> {
        Vector2::new(self.depth_m * self.bearing_rad.tan(), self.depth_m)
    }

    /// How far it lies above or below the camera: range² = x² + y² + z².
    pub(super) fn offset_m(&self) -> f64 {
        (self.range_m * self.range_m - self.position_m().norm_squared()).max(0.0).sqrt()
    }

    /// Standard deviations along and across the ray, metres.
    pub(super) fn sigmas_m(&self, params: &TrackParams) -> (f64, f64) {
        let ground_m = self.position_m().norm();
        let wander_m = params.extent_share * self.width_m;
        let along_m = (self.sigma_m * ground_m / self.range_m).hypot(0.5 * wander_m);
        (along_m, (ground_m * params.bearing_sigma_rad).hypot(wander_m))
    }

    /// Covariance of `position_m`: long along the ray, short across it.
    pub(super) fn covariance(&self, params: &TrackParams) -> Matrix2<f64> {
        let (along_m, across_m) = self.sigmas_m(params);
        let (sin, cos) = self.bearing_rad.sin_cos();
        let ray = Matrix2::new(cos, sin, -sin, cos);
        ray * Matrix2::new(across_m * across_m, 0.0, 0.0, along_m * along_m) * ray.transpose()
    }
}
