//! Student's t distribution for a whole number of degrees of freedom.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// Probability that `|t|` stays below `tan(theta)·sqrt(degrees)`: the finite sums of Abramowitz & Stegun, 26.7.3–4.
fn central_probability(theta: f64, degrees: usize) -> f64 {
    let (sin, cos) = theta.sin_cos();
    let cos2 = cos * cos;
    let odd = degrees % 2 == 1;
    // Terms run cos, (2/3)cos³, (2·4/3·5)cos⁵ … for odd and 1, (1/2)cos², (1·3/2·4)cos⁴ … for even degrees.
    let (mut term, first) = if odd { (cos, 1) } else { (1.0, 0) };
    let mut sum = 0.0;
    for power in (first..=degrees.saturating_sub(2)).step_by(2) {
        sum += term;
        term *= cos2 * (power + 1) as f64 / (power + 2) as f64;
    }
    if odd { FRAC_2_PI * (theta + sin * sum) } else { sin * sum }
}

/// The `t` that a Student variable stays within, on both sides, with probability `confidence`.
///
/// `degrees` is at least 1 and `confidence` in (0, 1): callers check.
pub(super) fn two_sided_quantile(confidence: f64, degrees: usize) -> f64 {
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    // Halving reaches neighbouring floating-point numbers in about 60 steps; the sum is monotonic in theta.
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle.tan() * (degrees as f64).sqrt();
        }
        if central_probability(middle, degrees) < confidence {
            low = middle;
        } else {
            high = middle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_match_the_printed_table() {
        // Abramowitz & Stegun, table 26.10.
        let table = [
            (0.95, 1, 12.706),
            (0.95, 2, 4.303),
            (0.95, 3, 3.182),
            (0.95, 10, 2.228),
            (0.99, 5, 4.032),
            (0.90, 30, 1.697),
            (0.95, 120, 1.980),
        ];
        for (confidence, degrees, expected) in table {
            let t = two_sided_quantile(confidence, degrees);
            assert!((t - expected).abs() < 6e-4, "t({confidence}, {degrees}) = {t}, table {expected}");
        }
    }

    #[test]
    fn one_degree_is_cauchy_and_two_have_a_closed_form() {
        for confidence in [0.01_f64, 0.5, 0.9, 0.999] {
            let cauchy = (confidence * FRAC_PI_2).tan();
            assert!((two_sided_quantile(confidence, 1) / cauchy - 1.0).abs() < 1e-12);
            let two = confidence * (2.0 / (1.0 - confidence * confidence)).sqrt();
            assert!((two_sided_quantile(confidence, 2) / two - 1.0).abs() < 1e-12);
        }
    }
}
