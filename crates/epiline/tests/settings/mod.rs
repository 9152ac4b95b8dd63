//! Settings of window methods, drawn at random: every test on and off, every cost, ranges that start anywhere.

use std::ops::RangeInclusive;

use epiline::matching::{MatcherParams, Method, Prefilter, Subpixel};
use proptest::prelude::*;

/// One thread; windows up to `largest_radius`, the disparities asked for of a number in `num_disparities`, the first of
/// them at most 5 px.
pub fn window_settings(
    largest_radius: usize,
    num_disparities: RangeInclusive<usize>,
) -> impl Strategy<Value = MatcherParams> {
    // `sad` twice: it has the most instances.
    let methods = vec![Method::Sad, Method::Sad, Method::Sad5, Method::Census, Method::Bt];
    let cost = (prop::sample::select(methods), 0..=largest_radius, prop::bool::ANY, 1..=63_u8);
    let range = (num_disparities, 0..=5_usize);
    let tests = (
        prop::sample::select(vec![0_u8, 5, 15, 100]),
        prop::sample::select(vec![0_u32, 40, 300, 900]),
        prop::sample::select(vec![None, Some(0_u16), Some(1), Some(2), Some(40)]),
        prop::sample::select(vec![0_usize, 1, 4, 12, 25]),
        prop::sample::select(vec![Subpixel::Off, Subpixel::VFit, Subpixel::Parabola]),
    );
    (cost, range, tests).prop_map(
        |((method, radius, raw, cap), (num, min), (unique, texture, left_right, speckle, subpixel))| {
            MatcherParams {
                method,
                num_disparities: num,
                min_disparity: min,
                block_size: 2 * radius + 1,
                prefilter: if raw { Prefilter::None } else { Prefilter::XSobel },
                prefilter_cap: cap,
                uniqueness_ratio: unique,
                texture_threshold: texture,
                left_right_max_diff: left_right,
                speckle_size: speckle,
                speckle_range: 1,
                subpixel,
                threads: Some(1),
                ..MatcherParams::default()
            }
        },
    )
}
