//! Fisheye lenses: the image's radius is a polynomial of the angle from the axis.
//!
//! Kannala & Brandt, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye
//! lenses", 2006, with four coefficients as in OpenCV's `fisheye`, ROS's and Kalibr's `equidistant`:
//! `r = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`.

use std::f64::consts::PI;

use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};

use super::{LensFormula, LensImage, roots};

/// Kannala–Brandt coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KannalaBrandt {
    /// θ³.
    pub k1: f64,
    /// θ⁵.
    pub k2: f64,
    /// θ⁷.
    pub k3: f64,
    /// θ⁹.
    pub k4: f64,
}

impl KannalaBrandt {
    fn radius(&self, angle: f64) -> f64 {
        let t = angle * angle;
        angle * (1.0 + t * (self.k1 + t * (self.k2 + t * (self.k3 + t * self.k4))))
    }

    fn slope(&self, angle: f64) -> f64 {
        let t = angle * angle;
        1.0 + t * (3.0 * self.k1 + t * (5.0 * self.k2 + t * (7.0 * self.k3 + t * 9.0 * self.k4)))
    }
}

impl LensFormula<4> for KannalaBrandt {
    const COEFFICIENTS: [&'static str; 4] = ["k1", "k2", "k3", "k4"];

    fn to_array(&self) -> [f64; 4] {
        [self.k1, self.k2, self.k3, self.k4]
    }

    fn from_array([k1, k2, k3, k4]: [f64; 4]) -> Self {
        Self { k1, k2, k3, k4 }
    }

    fn image(&self, ray: &Vector3<f64>) -> Option<LensImage<4>> {
        let across = ray.xy().norm();
        // On the axis every lens is a pinhole; the first neglected term is of the order of its square.
        if across <= 1e-8 * ray.z {
            let at = ray.xy() / ray.z;
            let by_ray = Matrix2x3::new(1.0, 0.0, -at.x, 0.0, 1.0, -at.y) / ray.z;
            return Some(LensImage { at, by_ray, by_coefficient: SMatrix::zeros() });
        }
        if across.is_nan() || across == 0.0 {
            return None;
        }
        let angle = across.atan2(ray.z);
        let outward = ray.xy() / across;
        let radius = self.radius(angle);
        let squared = ray.norm_squared();
        // The radius changes by the angle; the direction outward turns with the point.
        let angle_by_ray =
            Vector3::new(outward.x * ray.z / squared, outward.y * ray.z / squared, -across / squared);
        let by_angle = outward * (self.slope(angle) * angle_by_ray).transpose();
        let tangent = Vector2::new(-outward.y, outward.x);
        let by_turn = tangent * (radius / across) * Vector3::new(tangent.x, tangent.y, 0.0).transpose();
        let power = |exponent| outward * angle.powi(exponent);
        Some(LensImage {
            at: outward * radius,
            by_ray: by_angle + by_turn,
            by_coefficient: SMatrix::from_columns(&[power(3), power(5), power(7), power(9)]),
        })
    }
}

/// With its fold known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounded {
    lens: KannalaBrandt,
    /// Largest angle from the axis, radians.
    fold: f64,
}

impl Bounded {
    pub fn new(lens: KannalaBrandt) -> Self {
        let KannalaBrandt { k1, k2, k3, k4 } = lens;
        let slope = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4];
        Self { lens, fold: roots::first_zero(&slope, PI * PI).map_or(PI, f64::sqrt) }
    }

    pub fn largest_angle(&self) -> f64 {
        self.fold
    }

    /// Where a direction is imaged; `None` beyond the fold and straight behind.
    pub fn image(&self, ray: &Vector3<f64>) -> Option<Vector2<f64>> {
        let across = ray.xy().norm();
        let angle = across.atan2(ray.z);
        if across == 0.0 {
            return (ray.z > 0.0).then(Vector2::zeros);
        }
        (angle < self.fold).then(|| ray.xy() * (self.lens.radius(angle) / across))
    }

    /// The direction imaged at `distorted`, of length one: Newton's method kept inside a shrinking bracket.
    pub fn direction(&self, distorted: Vector2<f64>) -> Option<Vector3<f64>> {
        let target = distorted.norm();
        if target == 0.0 {
            return Some(Vector3::z());
        }
        let (mut low, mut high) = (0.0, self.fold);
        if target.is_nan() || target >= self.lens.radius(high) {
            return None;
        }
        let mut angle = target.min(0.5 * high);
        for _ in 0..100 {
            let error = self.lens.radius(angle) - target;
            if error < 0.0 {
                low = angle
            } else {
                high = angle
            }
            let step = angle - error / self.lens.slope(angle);
            let next = if low < step && step < high { step } else { 0.5 * (low + high) };
            if (next - angle).abs() <= f64::EPSILON * angle {
                break;
            }
            angle = next;
        }
        let outward = distorted / target;
        Some((outward * angle.sin()).push(angle.cos()))
    }
}
