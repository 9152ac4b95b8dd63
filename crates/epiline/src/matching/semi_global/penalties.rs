//! What a step of disparity costs.

/// P1, and P2 by the difference of the grey values between which the step lies.
#[derive(Debug, Clone)]
pub(in crate::matching) struct Penalties {
    /// For a step of one disparity: slanted surfaces.
    pub p1: u8,
    by_contrast: [u8; 256],
}

impl Penalties {
    /// How fast P2 falls with the difference of grey values.
    const CONTRAST: f64 = 15.0;

    /// `P2(ΔI) = P_min + (p2 - P_min)·exp(-|ΔI| / 15)` with `P_min = p1 + (p2 - p1) / 8`: disparity jumps where objects
    /// end, and there the grey value jumps too.
    pub fn new(p1: u8, p2: u8) -> Self {
        let [low, high] = [p1 + (p2 - p1) / 8, p2].map(f64::from);
        let by_contrast = std::array::from_fn(|difference| {
            (low + (high - low) * (-(difference as f64) / Self::CONTRAST).exp()).round() as u8
        });
        Self { p1, by_contrast }
    }

    /// P2 between the pixels of two rows.
    pub fn between(&self, row: &[u8], other: &[u8], p2: &mut [u8]) {
        for ((p2, &a), &b) in p2.iter_mut().zip(row).zip(other) {
            *p2 = self.by_contrast[usize::from(a.abs_diff(b))];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::semi_global::LARGEST_PENALTY;

    #[test]
    fn penalties_fall_with_contrast_and_stay_between_their_limits() {
        for (p1, p2) in [(0, 0), (10, 10), (48, 127), (0, LARGEST_PENALTY)] {
            let penalties = Penalties::new(p1, p2);
            assert_eq!(penalties.by_contrast[0], p2);
            assert!(penalties.by_contrast.is_sorted_by(|a, b| a >= b), "{p1} {p2}");
            assert!(penalties.by_contrast[255] >= p1, "{p1} {p2}");
        }
    }
}
