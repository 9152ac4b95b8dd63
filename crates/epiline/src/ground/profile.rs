//! How the ground rises and falls ahead: elevations over the plane at a row of depths.

/// Depth of a knot over that of the one before.
const RATIO: f64 = 1.12;
/// Knots: they reach from once to forty times the camera's height.
pub(super) const KNOTS: usize = 33;

/// Elevation of the ground over the plane as a function of depth, straight between knots.
///
/// The knots lie at depths that grow by 12 % from one to the next, as the resolution of stereo does not let more be
/// told; before the first and beyond the last the elevation is theirs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    first_depth_m: f64,
    elevation_m: [f64; KNOTS],
}

impl Profile {
    /// No elevation anywhere.
    pub fn level(camera_height_m: f64) -> Self {
        Self::from_fn(camera_height_m, |_| 0.0)
    }

    /// The elevations of a function of depth at the knots.
    pub fn from_fn(camera_height_m: f64, elevation_m: impl Fn(f64) -> f64) -> Self {
        let mut profile = Self { first_depth_m: camera_height_m, elevation_m: [0.0; KNOTS] };
        profile.elevation_m = std::array::from_fn(|knot| elevation_m(profile.depth_m(knot)));
        profile
    }

    /// Depth and elevation of each knot, metres.
    pub fn knots(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.elevation_m.iter().enumerate().map(|(knot, &elevation_m)| (self.depth_m(knot), elevation_m))
    }

    /// Elevation at a depth, metres.
    pub fn elevation_m(&self, depth_m: f64) -> f64 {
        self.elevation_and_slope(depth_m).0
    }

    /// Elevation at a positive depth, metres, and how much it rises there per metre ahead.
    pub(super) fn elevation_and_slope(&self, depth_m: f64) -> (f64, f64) {
        let knot = (self.place(depth_m).max(0.0) as usize).min(KNOTS - 2);
        let (before_m, after_m) = (self.depth_m(knot), self.depth_m(knot + 1));
        let slope = (self.elevation_m[knot + 1] - self.elevation_m[knot]) / (after_m - before_m);
        if depth_m < before_m {
            (self.elevation_m[knot], 0.0)
        } else if depth_m > after_m {
            (self.elevation_m[knot + 1], 0.0)
        } else {
            (self.elevation_m[knot] + slope * (depth_m - before_m), slope)
        }
    }

    /// Depth of a knot, metres.
    pub(super) fn depth_m(&self, knot: usize) -> f64 {
        self.first_depth_m * RATIO.powi(knot as i32)
    }

    /// Nearer than this, half a knot before the first, nothing belongs to a knot.
    pub(super) fn nearest_m(&self) -> f64 {
        self.first_depth_m * RATIO.powf(-0.5)
    }

    /// Where a positive depth lies among the knots; between them in terms of its logarithm.
    fn place(&self, depth_m: f64) -> f64 {
        Self::places_between(self.first_depth_m, depth_m)
    }

    /// How many knots lie between two positive depths.
    pub(super) fn places_between(near_m: f64, far_m: f64) -> f64 {
        (far_m / near_m).log2() * (1.0 / RATIO.log2())
    }

    pub(super) fn set(&mut self, elevation_m: [f64; KNOTS]) {
        self.elevation_m = elevation_m;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elevations_are_met_at_knots_and_straight_between() {
        let profile = Profile::from_fn(0.5, |depth_m| 0.1 * depth_m);
        for depth_m in [0.5, 0.77, 3.0, 9.9, 15.0] {
            assert!((profile.elevation_m(depth_m) - 0.1 * depth_m).abs() < 1e-12);
        }
        assert_eq!(profile.elevation_m(0.1), profile.elevation_m(0.5));
        assert_eq!(profile.elevation_m(1e6), profile.elevation_m[KNOTS - 1]);
    }
}
