//! Lenses that bend the perspective image: Brown's, its rational extension, and thin prisms.
//!
//! With `x = X/Z`, `y = Y/Z` and `r² = x² + y²`,
//!
//! ```text
//! q  = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
//! x' = x q + 2 p1 x y + p2 (r² + 2 x²) + s1 r² + s2 r⁴
//! y' = y q + p1 (r² + 2 y²) + 2 p2 x y + s3 r² + s4 r⁴
//! ```
//!
//! in OpenCV's order of coefficients. Brown, "Close-range camera calibration", 1971 (k1 k2 k3 p1 p2); Claus &
//! Fitzgibbon, "A rational function lens distortion model", 2005; Weng, Cohen & Herniou, "Camera calibration with
//! distortion models and accuracy evaluation", 1992 (thin prism).

use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};

use super::{LensFormula, LensImage, roots};

/// Directions farther than this from the axis count as seen by every lens whose polynomial does not fold before:
/// 89.99 degrees.
const LARGEST_TANGENT: f64 = 1e4;

/// Brown–Conrady coefficients, for coordinates in units of the focal length: OpenCV's four or five, ROS's
/// `plumb_bob`, Kalibr's `radtan`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Brown {
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

/// Brown's model with a denominator: OpenCV's eight, ROS's `rational_polynomial`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rational {
    /// Numerator and tangential part.
    pub brown: Brown,
    /// Denominator, r².
    pub k4: f64,
    /// Denominator, r⁴.
    pub k5: f64,
    /// Denominator, r⁶.
    pub k6: f64,
}

/// The rational model with thin prisms: OpenCV's twelve.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ThinPrism {
    /// Everything but the prisms.
    pub rational: Rational,
    /// Prism along x, r².
    pub s1: f64,
    /// Prism along x, r⁴.
    pub s2: f64,
    /// Prism along y, r².
    pub s3: f64,
    /// Prism along y, r⁴.
    pub s4: f64,
}

impl Brown {
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
}

impl ThinPrism {
    fn apply(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        self.bend(ideal).0
    }

    /// The distorted point, and its derivatives by the ideal point and by the coefficients.
    fn bend(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>, SMatrix<f64, 2, 12>) {
        let Self { rational: Rational { brown, k4, k5, k6 }, s1, s2, s3, s4 } = *self;
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let numerator = 1.0 + r2 * (brown.k1 + r2 * (brown.k2 + r2 * brown.k3));
        let inverse = 1.0 / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        let q = numerator * inverse;
        // dq / d(r²)
        let slope = (brown.k1 + r2 * (2.0 * brown.k2 + 3.0 * r2 * brown.k3)
            - q * (k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6)))
            * inverse;
        let Brown { p1, p2, .. } = brown;
        let at = Vector2::new(
            x * q + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + s1 * r2 + s2 * r4,
            y * q + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + s3 * r2 + s4 * r4,
        );
        let (prism_x, prism_y) = (2.0 * (s1 + 2.0 * s2 * r2), 2.0 * (s3 + 2.0 * s4 * r2));
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let by_ideal = Matrix2::new(
            q + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x,
            cross + prism_x * y,
            cross + prism_y * x,
            q + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y,
        );
        let by_numerator = ideal * inverse;
        let by_denominator = -ideal * (q * inverse);
        let by_coefficient = SMatrix::from_columns(&[
            by_numerator * r2,
            by_numerator * r4,
            Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
            Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
            by_numerator * r6,
            by_denominator * r2,
            by_denominator * r4,
            by_denominator * r6,
            Vector2::new(r2, 0.0),
            Vector2::new(r4, 0.0),
            Vector2::new(0.0, r2),
            Vector2::new(0.0, r4),
        ]);
        (at, by_ideal, by_coefficient)
    }

    /// The radius at which the radial part stops growing outward.
    fn fold(&self) -> f64 {
        let Rational { brown, k4, k5, k6 } = self.rational;
        let n = [1.0, brown.k1, brown.k2, brown.k3];
        let d = [1.0, k4, k5, k6];
        // d(r n/d)/dr · d² = n d + 2 s (n' d - n d') with s = r²; a zero of d is a pole.
        let mut growth = [0.0; 7];
        for (i, a) in n.iter().enumerate() {
            for (j, b) in d.iter().enumerate() {
                growth[i + j] += a * b * (1.0 + 2.0 * (i as f64 - j as f64));
            }
        }
        let largest = LARGEST_TANGENT * LARGEST_TANGENT;
        let fold = roots::first_zero(&growth, largest).unwrap_or(largest);
        roots::first_zero(&d, fold).unwrap_or(fold).sqrt()
    }
}

/// Projection onto the plane Z = 1 and its derivative; `None` unless the point is in front.
pub(super) fn perspective(ray: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    if ray.z.is_nan() || ray.z <= 0.0 {
        return None;
    }
    let inverse_depth = 1.0 / ray.z;
    let ideal = ray.xy() * inverse_depth;
    let by_ray = Matrix2x3::new(
        inverse_depth,
        0.0,
        -ideal.x * inverse_depth, //
        0.0,
        inverse_depth,
        -ideal.y * inverse_depth,
    );
    Some((ideal, by_ray))
}

impl LensFormula<5> for Brown {
    const COEFFICIENTS: [&'static str; 5] = ["k1", "k2", "p1", "p2", "k3"];

    fn to_array(&self) -> [f64; 5] {
        [self.k1, self.k2, self.p1, self.p2, self.k3]
    }

    fn from_array([k1, k2, p1, p2, k3]: [f64; 5]) -> Self {
        Self { k1, k2, p1, p2, k3 }
    }

    fn image(&self, ray: &Vector3<f64>) -> Option<LensImage<5>> {
        let (ideal, ideal_by_ray) = perspective(ray)?;
        Some(LensImage {
            at: self.apply(ideal),
            by_ray: self.jacobian(ideal) * ideal_by_ray,
            by_coefficient: Self::jacobian_coefficients(ideal),
        })
    }
}

impl LensFormula<8> for Rational {
    const COEFFICIENTS: [&'static str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];

    fn to_array(&self) -> [f64; 8] {
        let Self { brown: Brown { k1, k2, p1, p2, k3 }, k4, k5, k6 } = *self;
        [k1, k2, p1, p2, k3, k4, k5, k6]
    }

    fn from_array([k1, k2, p1, p2, k3, k4, k5, k6]: [f64; 8]) -> Self {
        Self { brown: Brown { k1, k2, p1, p2, k3 }, k4, k5, k6 }
    }

    fn image(&self, ray: &Vector3<f64>) -> Option<LensImage<8>> {
        let LensImage { at, by_ray, by_coefficient } = ThinPrism::from(*self).image(ray)?;
        Some(LensImage { at, by_ray, by_coefficient: by_coefficient.fixed_columns::<8>(0).into_owned() })
    }
}

impl LensFormula<12> for ThinPrism {
    const COEFFICIENTS: [&'static str; 12] =
        ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"];

    fn to_array(&self) -> [f64; 12] {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.rational.to_array();
        [k1, k2, p1, p2, k3, k4, k5, k6, self.s1, self.s2, self.s3, self.s4]
    }

    fn from_array([k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4]: [f64; 12]) -> Self {
        Self { rational: Rational::from_array([k1, k2, p1, p2, k3, k4, k5, k6]), s1, s2, s3, s4 }
    }

    fn image(&self, ray: &Vector3<f64>) -> Option<LensImage<12>> {
        let (ideal, ideal_by_ray) = perspective(ray)?;
        let (at, by_ideal, by_coefficient) = self.bend(ideal);
        Some(LensImage { at, by_ray: by_ideal * ideal_by_ray, by_coefficient })
    }
}

impl From<Brown> for ThinPrism {
    fn from(brown: Brown) -> Self {
        Rational { brown, ..Rational::default() }.into()
    }
}

impl From<Rational> for ThinPrism {
    fn from(rational: Rational) -> Self {
        Self { rational, ..Self::default() }
    }
}

/// Any of the three with its fold known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounded {
    lens: ThinPrism,
    /// Tangent of the largest angle from the axis.
    fold: f64,
}

impl Bounded {
    pub fn new(lens: impl Into<ThinPrism>) -> Self {
        let lens = lens.into();
        Self { lens, fold: lens.fold() }
    }

    pub fn largest_angle(&self) -> f64 {
        self.fold.atan()
    }

    /// Where a direction is imaged; `None` behind the camera and beyond the fold.
    pub fn image(&self, ray: &Vector3<f64>) -> Option<Vector2<f64>> {
        let inside = ray.z > 0.0 && ray.xy().norm_squared() < self.fold * self.fold * ray.z * ray.z;
        let ideal = inside.then(|| ray.xy() / ray.z)?;
        let (at, by_ideal, _) = self.lens.bend(ideal);
        // Tangential parts and prisms may fold where the radial part does not.
        (by_ideal.determinant() > 0.0).then_some(at)
    }

    /// The ideal point imaged at `distorted`: the radial part inverted, then Newton's method on the whole.
    pub fn ideal(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        const TOLERANCE: f64 = 1e-13;
        let mut ideal = self.radial_inverse(distorted);
        for _ in 0..50 {
            let (at, by_ideal, _) = self.lens.bend(ideal);
            let error = at - distorted;
            if error.norm() <= TOLERANCE * (1.0 + distorted.norm()) {
                break;
            }
            ideal -= by_ideal.try_inverse()? * error;
        }
        // Convergence to another branch of a folded polynomial is no answer either.
        let converged = (self.lens.apply(ideal) - distorted).norm() <= 1e-10 * (1.0 + distorted.norm());
        (converged && self.image(&ideal.push(1.0)).is_some()).then_some(ideal)
    }

    /// Exact where there is neither tangential distortion nor prism; the fold where the radius is never reached.
    fn radial_inverse(&self, distorted: Vector2<f64>) -> Vector2<f64> {
        let Rational { brown: Brown { k1, k2, k3, .. }, k4, k5, k6 } = self.lens.rational;
        let target = distorted.norm();
        if target == 0.0 {
            return distorted;
        }
        let radius_of = |r: f64| {
            let s = r * r;
            r * (1.0 + s * (k1 + s * (k2 + s * k3))) / (1.0 + s * (k4 + s * (k5 + s * k6)))
        };
        let (mut low, mut high) = (0.0, target.min(self.fold));
        while radius_of(high) < target && high < self.fold {
            low = high;
            high = (2.0 * high).min(self.fold);
        }
        // A dozen halvings land where Newton's method converges.
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            if radius_of(middle) < target { low = middle } else { high = middle }
        }
        distorted * (0.5 * (low + high) / target)
    }
}
