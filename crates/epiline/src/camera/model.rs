//! The pinhole camera with Brown–Conrady distortion.
//!
//! With normalised coordinates `x = X/Z`, `y = Y/Z` and `r² = x² + y²`,
//!
//! ```text
//! x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
//! y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y
//! u  = fx x' + cx,   v = fy y' + cy
//! ```
//!
//! as in Brown, "Close-range camera calibration", 1971, in the order OpenCV and ROS ("plumb_bob") use.

use nalgebra::{Matrix2, SMatrix, Vector2, Vector3};

use crate::error::{Error, Result};

/// Brown–Conrady coefficients, for coordinates in units of the focal length.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial, r².
    pub k1: f64,
    /// Radial, r⁴.
    pub k2: f64,
    /// Tangential, along y.
    pub p1: f64,
    /// Tangential, along x.
    pub p2: f64,
    /// Radial, r⁶.
    pub k3: f64,
}

impl Distortion {
    /// The five coefficients in the order k1, k2, p1, p2, k3.
    pub fn to_array(self) -> [f64; 5] {
        [self.k1, self.k2, self.p1, self.p2, self.k3]
    }

    /// From k1, k2, p1, p2, k3.
    pub fn from_array([k1, k2, p1, p2, k3]: [f64; 5]) -> Self {
        Self { k1, k2, p1, p2, k3 }
    }

    /// Normalised ideal point to normalised distorted point.
    pub fn apply(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    /// Derivative of [`apply`](Self::apply) by the ideal point.
    pub fn jacobian(&self, ideal: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        // d radial / d(r²), so that d radial / dx = slope * 2x.
        let slope = self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3);
        let cross = 2.0 * x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        )
    }

    /// Derivative of [`apply`](Self::apply) by k1, k2, p1, p2, k3.
    pub fn jacobian_coefficients(ideal: Vector2<f64>) -> SMatrix<f64, 2, 5> {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        SMatrix::<f64, 2, 5>::from_row_slice(&[
            x * r2,
            x * r4,
            2.0 * x * y,
            r2 + 2.0 * x * x,
            x * r6, //
            y * r2,
            y * r4,
            r2 + 2.0 * y * y,
            2.0 * x * y,
            y * r6,
        ])
    }

    /// Normalised distorted point to normalised ideal point: Newton's method on [`apply`](Self::apply).
    ///
    /// `None` where the model folds over itself and no ideal point belongs to the distorted one.
    pub fn remove(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut ideal = distorted;
        for _ in 0..50 {
            let error = self.apply(ideal) - distorted;
            if error.norm_squared() < 1e-26 {
                break;
            }
            ideal -= self.jacobian(ideal).try_inverse()? * error;
        }
        // Convergence to another branch of a folded polynomial is no answer either.
        let converged = (self.apply(ideal) - distorted).norm_squared() < 1e-18;
        (converged && self.is_monotonic_at(ideal)).then_some(ideal)
    }

    /// Whether the radius still grows outward everywhere between the centre and `ideal`.
    pub fn is_monotonic_at(&self, ideal: Vector2<f64>) -> bool {
        // d(r·radial)/dr = 1 + 3 k1 s + 5 k2 s² + 7 k3 s³ with s = r²; a zero of it between 0 and r² is the fold.
        const STEPS: u32 = 16;
        let r2 = ideal.norm_squared();
        (1..=STEPS).all(|i| {
            let s = r2 * f64::from(i) / f64::from(STEPS);
            1.0 + s * (3.0 * self.k1 + s * (5.0 * self.k2 + s * 7.0 * self.k3)) > 0.0
        })
    }
}

/// One camera: pinhole with Brown–Conrady distortion and an image size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraModel {
    /// Focal lengths along x and y, pixels.
    pub focal_px: [f64; 2],
    /// Principal point (x, y), pixels; (0, 0) is the centre of the top-left pixel.
    pub center_px: [f64; 2],
    /// Lens distortion.
    pub distortion: Distortion,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
}

impl CameraModel {
    /// Fails unless every number is finite and both focal lengths are positive.
    pub fn validate(&self) -> Result<()> {
        let named = [
            ("fx", self.focal_px[0]),
            ("fy", self.focal_px[1]),
            ("cx", self.center_px[0]),
            ("cy", self.center_px[1]),
            ("k1", self.distortion.k1),
            ("k2", self.distortion.k2),
            ("p1", self.distortion.p1),
            ("p2", self.distortion.p2),
            ("k3", self.distortion.k3),
        ];
        for (name, value) in named {
            if !value.is_finite() {
                return Err(Error::invalid(name, value, "must be finite"));
            }
        }
        for (name, value) in &named[..2] {
            if *value <= 0.0 {
                return Err(Error::invalid(name, format!("{value} px"), "a focal length must be positive"));
            }
        }
        if self.width == 0 || self.height == 0 {
            let size = format!("{}x{} px", self.width, self.height);
            return Err(Error::invalid("image_size", size, "both sides must be positive"));
        }
        Ok(())
    }

    /// Where a point of the camera's frame appears, pixels; `None` behind the camera.
    pub fn project(&self, point_m: Vector3<f64>) -> Option<Vector2<f64>> {
        (point_m.z > 0.0).then(|| self.pixel_from_normalised(point_m.xy() / point_m.z))
    }

    /// Normalised ideal point to pixel.
    pub fn pixel_from_normalised(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let distorted = self.distortion.apply(ideal);
        Vector2::new(
            self.focal_px[0] * distorted.x + self.center_px[0],
            self.focal_px[1] * distorted.y + self.center_px[1],
        )
    }

    /// Pixel to normalised ideal point; `None` where the distortion has no inverse.
    pub fn normalised_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        self.distortion.remove(Vector2::new(
            (pixel.x - self.center_px[0]) / self.focal_px[0],
            (pixel.y - self.center_px[1]) / self.focal_px[1],
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Distortion = Distortion { k1: -0.29, k2: 0.11, p1: 1.3e-3, p2: -4e-4, k3: 0.012 };

    #[test]
    fn removal_inverts_application() {
        for i in -10..=10 {
            for j in -8..=8 {
                let ideal = Vector2::new(f64::from(i) * 0.06, f64::from(j) * 0.06);
                let back = LENS.remove(LENS.apply(ideal)).expect("inside the fold");
                assert!((back - ideal).norm() < 1e-9, "{ideal:?} came back as {back:?}");
            }
        }
    }

    #[test]
    fn no_ideal_point_beyond_the_fold() {
        let barrel = Distortion { k1: -0.5, ..Distortion::default() };
        // The distorted radius never exceeds (2/3)·sqrt(1/(3·0.5)) = 0.544.
        assert_eq!(barrel.remove(Vector2::new(0.6, 0.0)), None);
    }

    #[test]
    fn jacobians_match_central_differences() {
        let at = Vector2::new(0.31, -0.22);
        let h = 1e-6;
        let analytic = LENS.jacobian(at);
        for column in 0..2 {
            let mut step = Vector2::zeros();
            step[column] = h;
            let numeric = (LENS.apply(at + step) - LENS.apply(at - step)) / (2.0 * h);
            assert!((analytic.column(column) - numeric).norm() < 1e-8);
        }
        let by_coefficient = Distortion::jacobian_coefficients(at);
        for column in 0..5 {
            let shifted = |sign: f64| {
                let mut c = LENS.to_array();
                c[column] += sign * h;
                Distortion::from_array(c).apply(at)
            };
            let numeric = (shifted(1.0) - shifted(-1.0)) / (2.0 * h);
            assert!((by_coefficient.column(column) - numeric).norm() < 1e-8);
        }
    }

    #[test]
    fn nan_is_named() {
        let camera = CameraModel {
            focal_px: [500.0, f64::NAN],
            center_px: [320.0, 240.0],
            distortion: Distortion::default(),
            width: 640,
            height: 480,
        };
        let message = camera.validate().expect_err("NaN must be refused").to_string();
        assert!(message.contains("fy = NaN"), "{message}");
    }
}
