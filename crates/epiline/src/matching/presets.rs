//! Combinations of parameters chosen by measurement.

use super::params::{MatcherParams, Method};

/// What matters most to the user. The semi-global ones were chosen on the even of the 27 public scenes with ground truth,
/// in the order of their names; an earlier choice had looked at the others too, so they are no clean test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Window sums, guided by semi-global costs from half the resolution, with every test: the most frames per second.
    Fast,
    /// Semi-global over three paths, a row of costs at a time: what it answers can be relied upon.
    Balanced,
    /// Semi-global over four paths: the best map; use it with [`MatcherParams::fill`] where every pixel needs an answer.
    Accurate,
}

impl Preset {
    /// Every preset, fastest first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::Accurate];

    /// The name it is asked for by.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::Accurate => "accurate",
        }
    }

    /// Its parameters; the range of disparities is the default one.
    pub fn params(self) -> MatcherParams {
        let sgm = MatcherParams {
            left_right_max_diff: Some(1),
            speckle_range: 1,
            prefilter_cap: 23,
            p1: 28,
            p2: 90,
            ..MatcherParams::for_method(Method::Sgm)
        };
        match self {
            Self::Fast => MatcherParams::with_all_tests(),
            Self::Balanced => {
                MatcherParams { paths: 3, p2: 70, uniqueness_ratio: 8, speckle_size: 200, ..sgm }
            }
            // What is not unique is filled better by its own value than by its neighbours'.
            Self::Accurate => MatcherParams { speckle_size: 400, smooth: true, ..sgm },
        }
    }
}
