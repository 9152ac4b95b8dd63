//! The range curve of eq. 6 and what its uncertainty does to a prediction.

use nalgebra::{Matrix4, Vector4};

use super::student::two_sided_quantile;
use crate::error::{Error, Result};

/// `distance = a·e^(b·x) + c·e^(d·x)` with `x` a disparity in pixels and distance in metres: eq. 6 of the paper.
///
/// `b < d` always. Made by [`fit_range_curve`](super::fit_range_curve); it means nothing outside
/// [`span_px`](Self::span_px), where a sum of exponentials may do anything.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeCurve {
    /// Amplitude of the first exponential, metres.
    pub a: f64,
    /// Rate of the first exponential, 1/px.
    pub b: f64,
    /// Amplitude of the second exponential, metres.
    pub c: f64,
    /// Rate of the second exponential, 1/px.
    pub d: f64,
    /// `sqrt(Σ(measured - predicted)² / n)`, metres.
    pub rmse_m: f64,
    /// `1 - Σ(measured - predicted)² / Σ(measured - mean)²`.
    pub r_squared: f64,
    /// Smallest and largest disparity it was fitted to, pixels.
    pub span_px: (f64, f64),
    /// Pairs it was fitted to.
    pub samples: usize,
    /// Which of the pairs given were left out as outliers, by their place in the list, ascending.
    pub outliers: Vec<usize>,
    pub(super) uncertainty: Uncertainty,
}

/// Covariance of `(α, b, γ, d)` in `α·e^(b·(x - anchor)) + γ·e^(d·(x - anchor'))`.
///
/// Each anchor is the end of the span where its exponential is largest: there α and γ have the size of distances,
/// while `a` and `c` are what is left after extrapolating to x = 0 and may be astronomical.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Uncertainty {
    pub anchors_px: [f64; 2],
    pub covariance: Matrix4<f64>,
    /// Variance of one measurement about the curve, metres².
    pub residual_variance: f64,
}

impl RangeCurve {
    /// Whether a disparity lies in the span that was fitted; elsewhere a prediction is a guess.
    pub fn covers(&self, disparity_px: f64) -> bool {
        (self.span_px.0..=self.span_px.1).contains(&disparity_px)
    }

    /// Distance at a disparity, metres.
    pub fn predict(&self, disparity_px: f64) -> f64 {
        self.a * (self.b * disparity_px).exp() + self.c * (self.d * disparity_px).exp()
    }

    /// Bounds between which one new measurement at this disparity falls with probability `confidence`, metres:
    /// `predict(x) ± t·sqrt(s² + gᵀ C g)`, `g` the curve's gradient by its constants (delta method), `C` their
    /// covariance, `s²` the residual variance, `t` Student's with `samples - 4` degrees of freedom.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] unless `0 < confidence < 1`.
    pub fn predict_interval(&self, disparity_px: f64, confidence: f64) -> Result<(f64, f64)> {
        if !(confidence > 0.0 && confidence < 1.0) {
            return Err(Error::invalid("confidence", confidence, "must lie between 0 and 1, both excluded"));
        }
        let gradient = self.anchored_gradient(disparity_px);
        let of_curve = (gradient.transpose() * self.uncertainty.covariance * gradient).x.max(0.0);
        let sigma_m = (self.uncertainty.residual_variance + of_curve).sqrt();
        let half_width_m = two_sided_quantile(confidence, self.samples - 4) * sigma_m;
        let distance_m = self.predict(disparity_px);
        Ok((distance_m - half_width_m, distance_m + half_width_m))
    }

    /// Covariance of `(a, b, c, d)`, metres and 1/px, in the linear approximation at the fit.
    ///
    /// Entries are very large where the data leave a constant open, as both rates are when the measurements follow
    /// one exponential.
    pub fn covariance(&self) -> Matrix4<f64> {
        // a = α·e^(-b·anchor), so da = e^(-b·anchor)·dα - anchor·a·db; likewise c.
        let [anchor, other_anchor] = self.uncertainty.anchors_px;
        let mut change = Matrix4::identity();
        change[(0, 0)] = (-self.b * anchor).exp();
        change[(0, 1)] = -anchor * self.a;
        change[(2, 2)] = (-self.d * other_anchor).exp();
        change[(2, 3)] = -other_anchor * self.c;
        change * self.uncertainty.covariance * change.transpose()
    }

    /// Standard errors of a, b, c, d.
    pub fn standard_errors(&self) -> [f64; 4] {
        let covariance = self.covariance();
        [0, 1, 2, 3].map(|i| covariance[(i, i)].max(0.0).sqrt())
    }

    /// Derivative of the curve by `(α, b, γ, d)`.
    fn anchored_gradient(&self, disparity_px: f64) -> Vector4<f64> {
        let [anchor, other_anchor] = self.uncertainty.anchors_px;
        Vector4::new(
            (self.b * (disparity_px - anchor)).exp(),
            (disparity_px - anchor) * self.a * (self.b * disparity_px).exp(),
            (self.d * (disparity_px - other_anchor)).exp(),
            (disparity_px - other_anchor) * self.c * (self.d * disparity_px).exp(),
        )
    }

    /// Rows of the fit's Jacobian by `(α, b, γ, d)`.
    pub(super) fn jacobian_rows<'a>(
        &'a self,
        disparity_px: &'a [f64],
    ) -> impl Iterator<Item = Vector4<f64>> + 'a {
        disparity_px.iter().map(|&x| self.anchored_gradient(x))
    }
}
