//! What the rows of pairs say about the four values of a drift and about a field beside them.

use nalgebra::{ArrayStorage, Matrix4, SMatrix, SVector, Vector4};

use super::super::alignment::{PointMatch, median};
use super::super::geometry::RectifiedGeometry;
use super::{at_edge, pattern};

/// Coefficients of the field.
const FIELD: usize = 8;
/// The four values, then the field's coefficients.
const STATE: usize = 4 + FIELD;

type State = SVector<f64, STATE>;
type Information = SMatrix<f64, STATE, STATE>;

/// Standard deviation of a coefficient of the field, pixels at half the image's width and height, and per eight pixels
/// of disparity.
const FIELD_PX: f64 = 0.05;
const FIELD_DISPARITY_PX: f64 = 8.0;
/// No match's row is known better, pixels.
const LEAST_SIGMA_PX: f64 = 0.05;
/// Beyond so many standard deviations a match has no weight.
const CUTOFF: f64 = 4.0;
const ITERATIONS: usize = 7;
/// What a single pair's fit is held to where its matches leave it open, pixels at the edge.
const OPEN_PX: f64 = 5.0;

/// Normal equations of `dy = row · state`, matches whitened.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Evidence {
    normal: Information,
    right_side: State,
}

impl std::fmt::Debug for Evidence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Twelve rows of numbers would hide what a drift says.
        f.debug_struct("Evidence").finish_non_exhaustive()
    }
}

/// What is known of the state beforehand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior {
    mean: State,
    covariance: Information,
}

impl Prior {
    /// Values near zero with these variances, and a small field.
    pub fn about_zero(variance: [f64; 4]) -> Self {
        let variance = State::from_fn(|i, _| if i < 4 { variance[i] } else { FIELD_PX * FIELD_PX });
        Self { mean: State::zeros(), covariance: Information::from_diagonal(&variance) }
    }

    /// After some evidence.
    pub fn after(&self, evidence: &Evidence) -> Option<Self> {
        let information = self.covariance.try_inverse()?;
        let covariance = (information + evidence.normal).try_inverse()?;
        Some(Self { mean: covariance * (information * self.mean + evidence.right_side), covariance })
    }

    /// With the values less certain by these variances.
    pub fn widened(mut self, variance: [f64; 4]) -> Self {
        for (i, variance) in variance.into_iter().enumerate() {
            self.covariance[(i, i)] += variance;
        }
        self
    }
}

impl Evidence {
    /// Nothing seen.
    pub const NONE: Self = Self {
        normal: Information::from_array_storage(ArrayStorage([[0.0; STATE]; STATE])),
        right_side: State::from_array_storage(ArrayStorage([[0.0; STATE]; 1])),
    };

    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    pub fn fade(&mut self, by: f64) {
        self.normal *= by;
        self.right_side *= by;
    }

    pub fn add(&mut self, other: &Self) {
        self.normal += other.normal;
        self.right_side += other.right_side;
    }

    /// Information about a shift of the four values since `before` was true, and its right side; the state itself is
    /// marginalised.
    ///
    /// With `N` and `b` the normal equations and `(m, P)` the prior, `N⁻¹b - m` has the covariance `P + N⁻¹`. Its inverse is
    /// `(I + N·P)⁻¹·N`, which needs no inverse of `N`.
    pub fn about_shift(&self, before: &Prior) -> Option<(Matrix4<f64>, Vector4<f64>)> {
        let share = (Information::identity() + self.normal * before.covariance).try_inverse()?;
        let information = share * self.normal;
        let right_side = share * (self.right_side - self.normal * before.mean);
        let information = information.fixed_view::<4, 4>(0, 0).into_owned();
        Some((0.5 * (information + information.transpose()), right_side.fixed_rows::<4>(0).into_owned()))
    }

    /// Of one pair, weighted by Tukey's biweight about the pair's own best fit.
    pub fn of_pair(geometry: &RectifiedGeometry, matches: &[PointMatch], residuals: &mut Vec<f64>) -> Self {
        let open = at_edge(geometry, [OPEN_PX; 4]).map(|sigma| sigma * sigma);
        let Some(prior) = Prior::about_zero(open).covariance.try_inverse() else { return Self::NONE };
        // Starts from the middle of the residuals: a pitch beyond the cutoff must not hide all matches.
        residuals.clear();
        residuals.extend(matches.iter().map(PointMatch::vertical_px));
        let mut fit = State::zeros();
        fit[0] = median(residuals) / geometry.focal_px;
        let mut evidence = Self::NONE;
        for _ in 0..ITERATIONS {
            evidence = Self::weighted(geometry, matches, &fit, residuals);
            if let Some(decomposed) = (evidence.normal + prior).cholesky() {
                fit = decomposed.solve(&evidence.right_side);
            }
        }
        evidence
    }

    fn weighted(
        geometry: &RectifiedGeometry,
        matches: &[PointMatch],
        fit: &State,
        residuals: &mut Vec<f64>,
    ) -> Self {
        residuals.clear();
        residuals.extend(matches.iter().map(|m| (m.vertical_px() - row(geometry, m).dot(fit)).abs()));
        // 1.4826 makes the median distance of a normal distribution its standard deviation.
        let sigma = (1.4826 * median(residuals)).max(LEAST_SIGMA_PX);
        let mut evidence = Self::NONE;
        for found in matches {
            let row = row(geometry, found);
            let dy = found.vertical_px();
            let t = (dy - row.dot(fit)) / (CUTOFF * sigma);
            if t.abs() < 1.0 {
                let w = (1.0 - t * t).powi(2) / (sigma * sigma);
                evidence.normal += row * (row * w).transpose();
                evidence.right_side += row * (dy * w);
            }
        }
        evidence
    }
}

/// Change of `dy` at a match by each part of the state: pixels per unit of a value, and pixels of the field.
///
/// The field holds what a lens model leaves of second and third order. A baseline that points elsewhere than calibration
/// said, and a rig that moves between exposures that are apart, shift rows in proportion to disparity.
fn row(geometry: &RectifiedGeometry, found: &PointMatch) -> State {
    let [x, y] = found.right_px;
    let a = (x - geometry.cx_px - geometry.doffs_px) / (0.5 * geometry.width as f64);
    let b = (y - geometry.cy_px) / (0.5 * geometry.height as f64);
    let near = (found.left_px[0] - x) / FIELD_DISPARITY_PX;
    let values = pattern(geometry, found);
    let field = [a * a - 1.0 / 3.0, a * a * b, a * b * b, a * a * a, b * b, b * b * b, near, near * b];
    State::from_fn(|i, _| if i < 4 { values[i] } else { field[i - 4] })
}
