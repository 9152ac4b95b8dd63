//! Tsai's lens: the ideal radius is a cubic of the distorted one.
//!
//! Tsai, "A versatile camera calibration technique", 1987: `u = d (1 + kappa1 |d|²)` from the distorted point d to
//! the ideal point u; here in units of the focal length, so that `kappa1 = kappa1[1/mm²] · f[mm]²`.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::perspective::perspective;
use super::{LensFormula, LensImage};

/// Tsai's coefficient.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tsai {
    /// Radial, per squared distorted radius; negative for pincushion images, positive for barrel images.
    pub kappa1: f64,
}

/// The radius `r` with `r (1 + kappa1 r²) = undistorted`; `None` beyond the limit `r² = -1/(3 kappa1)`.
///
/// Newton's method from the undistorted radius: the cubic is convex (kappa1 > 0) or concave (kappa1 < 0) and
/// increasing between there and the root, so the iteration is monotonic; Willson solves the same cubic by Cardano.
pub fn distorted_radius(undistorted: f64, kappa1: f64) -> Option<f64> {
    if kappa1 < 0.0 && undistorted >= largest_distorted_radius(kappa1) * (2.0 / 3.0) {
        return None;
    }
    let mut r = undistorted;
    for _ in 0..60 {
        let step = (r * (1.0 + kappa1 * r * r) - undistorted) / (1.0 + 3.0 * kappa1 * r * r);
        r -= step;
        if step.abs() <= 1e-15 * r {
            break;
        }
    }
    r.is_finite().then_some(r)
}

fn largest_distorted_radius(kappa1: f64) -> f64 {
    if kappa1 < 0.0 { (-1.0 / (3.0 * kappa1)).sqrt() } else { f64::INFINITY }
}

impl Tsai {
    pub(super) fn largest_angle(&self) -> f64 {
        (largest_distorted_radius(self.kappa1) * (2.0 / 3.0)).atan()
    }

    pub(super) fn apply(&self, ideal: Vector2<f64>) -> Option<Vector2<f64>> {
        let radius = ideal.norm();
        if radius == 0.0 {
            return Some(ideal);
        }
        Some(ideal * (distorted_radius(radius, self.kappa1)? / radius))
    }

    pub(super) fn ideal(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        let r2 = distorted.norm_squared();
        (r2.sqrt() < largest_distorted_radius(self.kappa1)).then(|| distorted * (1.0 + self.kappa1 * r2))
    }
}

impl LensFormula<1> for Tsai {
    const COEFFICIENTS: [&'static str; 1] = ["kappa1"];

    fn to_array(&self) -> [f64; 1] {
        [self.kappa1]
    }

    fn from_array([kappa1]: [f64; 1]) -> Self {
        Self { kappa1 }
    }

    fn image(&self, ray: &Vector3<f64>) -> Option<LensImage<1>> {
        let (ideal, ideal_by_ray) = perspective(ray)?;
        let at = self.apply(ideal)?;
        // Implicit function of u = d (1 + kappa1 |d|²): d' = (∂u/∂d)⁻¹.
        let r2 = at.norm_squared();
        let by_distorted =
            Matrix2::identity() * (1.0 + self.kappa1 * r2) + at * at.transpose() * (2.0 * self.kappa1);
        let by_ideal = by_distorted.try_inverse()?;
        Some(LensImage { at, by_ray: by_ideal * ideal_by_ray, by_coefficient: by_ideal * at * -r2 })
    }
}
