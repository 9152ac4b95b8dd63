//! The surface that both aligned images are drawn on.

use nalgebra::{Vector2, Vector3};

/// From directions of the aligned frame (x along the baseline) to positions in units of the focal length, and back.
///
/// On both surfaces a point's rows agree in the two images, because a row is a plane through the baseline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Projection {
    /// A plane: `(X/Z, Y/Z)`. Straight lines stay straight and disparity is `f·b/Z`; a view cannot reach 180 degrees
    /// and its sides stretch long before.
    #[default]
    Pinhole,
    /// A transverse cylinder around the baseline, by angles: `(ψ, φ)` with `ψ = atan2(X, √(Y² + Z²))` the angle from
    /// the plane square to the baseline and `φ = atan2(Y, Z)` that of the epipolar plane. For wide lenses: a pixel is
    /// as many degrees everywhere, and disparity is `f` times the angle between the two rays at the point.
    Cylindrical,
}

impl Projection {
    /// Where a direction lies; `None` if the surface does not meet it.
    pub(super) fn flat(self, ray: &Vector3<f64>) -> Option<Vector2<f64>> {
        match self {
            Self::Pinhole => (ray.z > 0.0).then(|| ray.xy() / ray.z),
            Self::Cylindrical => {
                let around = ray.y.hypot(ray.z);
                (around > 0.0).then(|| Vector2::new(ray.x.atan2(around), ray.y.atan2(ray.z)))
            }
        }
    }

    /// The direction at a position; `None` beyond the surface.
    pub(super) fn ray(self, at: Vector2<f64>) -> Option<Vector3<f64>> {
        use std::f64::consts::{FRAC_PI_2, PI};
        match self {
            Self::Pinhole => Some(at.push(1.0)),
            Self::Cylindrical => {
                let ((sin, cos), (sin_row, cos_row)) = (at.x.sin_cos(), at.y.sin_cos());
                let on = at.x.abs() < FRAC_PI_2 && at.y.abs() <= PI;
                on.then(|| Vector3::new(sin, cos * sin_row, cos * cos_row))
            }
        }
    }

    /// Half the width, in units of the focal length, of a view of so many radians.
    pub(super) fn half_width(self, fov_rad: f64) -> f64 {
        match self {
            Self::Pinhole => (0.5 * fov_rad).tan(),
            Self::Cylindrical => 0.5 * fov_rad,
        }
    }
}
