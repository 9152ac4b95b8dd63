//! Where a polynomial first meets zero.

/// The smallest zero in `(0, largest)` at which `c0 + c1 s + c2 s² + …`, positive at 0, changes sign; `None` if it
/// stays positive.
///
/// Between two neighbouring zeros of its derivative a polynomial crosses zero at most once: bisection there, with
/// the derivative's own zeros found the same way.
pub(super) fn first_zero(coefficients: &[f64], largest: f64) -> Option<f64> {
    zeros(coefficients, largest).first().copied()
}

fn zeros(coefficients: &[f64], largest: f64) -> Vec<f64> {
    let derivative: Vec<f64> = coefficients.iter().enumerate().skip(1).map(|(i, c)| i as f64 * c).collect();
    if derivative.iter().all(|&c| c == 0.0) {
        return Vec::new();
    }
    let mut ends = zeros(&derivative, largest);
    ends.push(largest);
    let mut low = 0.0;
    let mut found = Vec::new();
    for high in ends {
        found.extend(crossing(coefficients, low, high));
        low = high;
    }
    found
}

/// The zero between two ends of a stretch without turning points.
fn crossing(coefficients: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    // A sum that overflows to NaN counts as negative: nothing is known to be monotonic there.
    let positive = |s: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c) > 0.0;
    let sign = positive(low);
    if positive(high) == sign {
        return None;
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return Some(low);
        }
        if positive(middle) == sign { low = middle } else { high = middle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_several_zeros() {
        // (1 - s)(1 - s/2)(1 - s/5)
        let zero = first_zero(&[1.0, -1.7, 0.8, -0.1], 1e8).expect("at 1");
        assert!((zero - 1.0).abs() < 1e-12, "{zero}");
        // Two zeros close together are not stepped over.
        let close =
            first_zero(&[1.0, -(1.0 / 3.0 + 1.0 / 3.001), 1.0 / (3.0 * 3.001)], 1e8).expect("next to 3");
        assert!((close - 3.0).abs() < 1e-6, "{close}");
        assert_eq!(first_zero(&[1.0, 0.0, 2.0], 1e8), None);
        assert_eq!(first_zero(&[1.0, -0.001], 500.0), None, "beyond the largest");
        let tiny = first_zero(&[1.0, -3e300], 1e8).expect("an absurd lens has a tiny view");
        assert!(tiny < 1e-300);
    }
}
