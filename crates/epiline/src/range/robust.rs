//! The curve of eq. 6 from pairs of which some are wrong: a distance mistyped, a disparity of something else.
//!
//! ```text
//! weights 1 / |residual|, again and again: the curve of least absolute residuals, which few wrong pairs hardly move
//! sigma = from the median of its residuals
//! Tukey's weights, again and again: pairs beyond 4.685 sigma have none
//! leave those out; least squares of the rest
//! ```
//!
//! Every step is a fit from all starts, so that no step is caught in the valley of the step before.

use super::curve::RangeCurve;
use super::fit::{fit_range_curve, weighted_residuals_m};
use crate::error::Result;

/// Residuals from which Tukey's weight is zero, in standard deviations: 95 % efficient where nothing is wrong.
const TUKEY: f64 = 4.685;
/// Weight of a pair that counts for nothing, where a fit needs a positive one.
const NONE: f64 = 1e-12;
const MAX_ROUNDS: usize = 30;

/// Fits eq. 6 as [`fit_range_curve`] does, to the pairs that are not outliers; [`RangeCurve::outliers`] names those.
///
/// Up to about a quarter of the pairs may be wrong, if they do not agree with one another. At the ends of the span, where
/// a steep exponential can pass through a single pair, and among fewer than about eight pairs, an outlier may not show.
///
/// # Errors
///
/// As [`fit_range_curve`].
pub fn fit_range_curve_robustly(disparity_px: &[f64], distance_m: &[f64]) -> Result<RangeCurve> {
    let whole = fit_range_curve(disparity_px, distance_m)?;
    let size_m = distance_m.iter().map(|distance| distance.abs()).fold(0.0, f64::max);
    // Below this nothing is told apart: rounding of the distances themselves.
    let finest_m = 1e-9 * size_m;

    let mut residuals_m: Vec<f64> =
        disparity_px.iter().zip(distance_m).map(|(&x, &y)| y - whole.predict(x)).collect();
    let refit = |residuals_m: &[f64], weight: &dyn Fn(f64) -> f64| {
        let weights: Vec<f64> = residuals_m.iter().map(|&residual| weight(residual).max(NONE)).collect();
        weighted_residuals_m(disparity_px, distance_m, &weights)
    };
    for _ in 0..MAX_ROUNDS {
        let floor_m = finest_m.max(1e-3 * typical_m(&residuals_m));
        let next = refit(&residuals_m, &|residual| floor_m / residual.abs().max(floor_m))?;
        let settled = moved_m(&residuals_m, &next) <= 1e-3 * typical_m(&next) + finest_m;
        residuals_m = next;
        if settled {
            break;
        }
    }
    let sigma_m = typical_m(&residuals_m).max(finest_m);
    for _ in 0..MAX_ROUNDS {
        let tukey = |residual: f64| {
            let share = residual / (TUKEY * sigma_m);
            (1.0 - share * share).max(0.0).powi(2)
        };
        let next = refit(&residuals_m, &tukey)?;
        let settled = moved_m(&residuals_m, &next) <= 1e-3 * sigma_m;
        residuals_m = next;
        if settled {
            break;
        }
    }
    let (kept, outliers): (Vec<usize>, Vec<usize>) =
        (0..residuals_m.len()).partition(|&i| residuals_m[i].abs() <= TUKEY * sigma_m);
    if outliers.is_empty() {
        return Ok(whole);
    }
    let of_kept = |values: &[f64]| kept.iter().map(|&i| values[i]).collect::<Vec<_>>();
    let curve = fit_range_curve(&of_kept(disparity_px), &of_kept(distance_m))?;
    Ok(RangeCurve { outliers, ..curve })
}

/// Standard deviation by the median of the residuals that four constants leave free: a curve of least absolute residuals
/// passes through as many pairs as it has constants.
fn typical_m(residuals_m: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals_m.iter().map(|residual| residual.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let free = &sizes[4.min(sizes.len() - 1)..];
    1.4826 * 0.5 * (free[(free.len() - 1) / 2] + free[free.len() / 2])
}

fn moved_m(before: &[f64], after: &[f64]) -> f64 {
    before.iter().zip(after).map(|(before, after)| (before - after).abs()).fold(0.0, f64::max)
}
