//! What a disparity's confidence says of its standard deviation.

/// Standard deviations, px, at these confidences; in between, straight lines.
///
/// Of the errors on every second of 27 public scenes, presets `fast`, `balanced` and `accurate` together, pixels that both
/// cameras see: the half-width that holds 68 % of those about each confidence, widened by 4 %.
/// `benchmarks/range_sigma.py` prints how many lie within one and two of them, on these scenes and on the others.
const KNOTS: [(u8, f32); 11] = [
    (0, 1.95),
    (32, 1.2),
    (64, 0.87),
    (96, 0.66),
    (128, 0.6),
    (160, 0.54),
    (192, 0.45),
    (216, 0.43),
    (232, 0.36),
    (244, 0.26),
    (255, 0.15),
];

/// Standard deviation of a disparity of this confidence ([`DisparityMap::confidence`](crate::matching::DisparityMap::confidence)), px.
///
/// Errors have longer tails than a normal distribution: on real scenes 89 to 93 % lie within twice of it, not 95 %.
pub fn disparity_sigma_px(confidence: u8) -> f32 {
    let above = KNOTS
        .iter()
        .position(|&(knot, _)| knot >= confidence)
        .expect("the last knot is the largest confidence");
    let Some(below) = above.checked_sub(1) else { return KNOTS[0].1 };
    let ((low, low_px), (high, high_px)) = (KNOTS[below], KNOTS[above]);
    let share = f32::from(confidence - low) / f32::from(high - low);
    low_px + share * (high_px - low_px)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knots_are_met_and_more_confidence_is_less_sigma() {
        for (confidence, sigma_px) in KNOTS {
            assert!((disparity_sigma_px(confidence) - sigma_px).abs() < 1e-6);
        }
        let all: Vec<f32> = (0..=u8::MAX).map(disparity_sigma_px).collect();
        assert!(all.windows(2).all(|pair| pair[1] < pair[0]));
        assert!((disparity_sigma_px(112) - 0.63).abs() < 1e-6, "half-way between two knots");
    }
}
