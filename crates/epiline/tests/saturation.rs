//! The saturation test against its definition, computed window by window.

use epiline::image::Image;
use epiline::matching::{DisparityMap, MatchRegion, MatcherParams, Method, StereoMatcher, Validity};
use proptest::prelude::*;

/// Noise with clipped patches of both kinds.
fn image(width: usize, height: usize, seed: u64) -> Image<u8> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    Image::from_fn(width, height, |x, y| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let noise = (state >> 32) as u8;
        match (x / 8 + y / 5) % 4 {
            0 if noise > 30 => 255,
            1 if noise > 90 => 0,
            _ => noise.clamp(1, 254),
        }
    })
}

/// Percent of the clamped window around a pixel that is at 0 or 255, compared without division.
fn is_saturated(image: &Image<u8>, x: usize, y: usize, params: &MatcherParams) -> bool {
    let radius = (params.block_size / 2) as isize;
    let clamp = |v: isize, len: usize| v.clamp(0, len as isize - 1) as usize;
    let mut clipped = 0;
    for j in -radius..=radius {
        let row = image.row(clamp(y as isize + j, image.height()));
        for i in -radius..=radius {
            clipped += usize::from(matches!(row[clamp(x as isize + i, image.width())], 0 | 255));
        }
    }
    100 * clipped >= usize::from(params.saturation_threshold) * params.block_size * params.block_size
}

fn matched(params: &MatcherParams, left: &Image<u8>, right: &Image<u8>) -> DisparityMap {
    let mut map = DisparityMap::default();
    StereoMatcher::new(*params).expect("legal").compute(left.view(), right.view(), &mut map).expect("fits");
    map
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn clipped_windows_are_marked_and_nothing_else_changes(
        radius in 0..=7_usize,
        threshold in 1..=100_u8,
        min_disparity in 0..=2_usize,
        method in prop::sample::select(Method::ALL.to_vec()),
        height in 1..=30_usize,
        threads in 1..=3_usize,
        seed in any::<u64>(),
    ) {
        let (left, right) = (image(53, height, seed), image(53, height, seed ^ 1));
        let params = MatcherParams {
            num_disparities: 12,
            min_disparity,
            block_size: 2 * radius + 1,
            left_right_max_diff: Some(1),
            threads: Some(threads),
            ..MatcherParams::for_method(method)
        };
        let without = matched(&params, &left, &right);
        let params = MatcherParams { saturation_threshold: threshold, ..params };
        let with = matched(&params, &left, &right);
        prop_assert_eq!(&with.values, &without.values);
        for y in 0..height {
            for x in 0..53 {
                let before = without.validity.row(y)[x];
                let marked = x >= min_disparity && is_saturated(&left, x, y, &params);
                let expected = before | if marked { Validity::SATURATED } else { 0 };
                prop_assert_eq!(with.validity.row(y)[x], expected, "({}, {})", x, y);
            }
        }
    }
}

#[test]
fn boxes_are_tested_like_the_whole_image() {
    let (left, right) = (image(90, 50, 4), image(90, 50, 5));
    let params = MatcherParams {
        num_disparities: 12,
        block_size: 9,
        saturation_threshold: 30,
        ..MatcherParams::default()
    };
    let whole = matched(&params, &left, &right);
    let region = MatchRegion { x: 30, y: 13, width: 41, height: 21, disparities: None };
    let mut map = DisparityMap::default();
    let mut matcher = StereoMatcher::new(params).expect("legal");
    matcher.compute_regions(left.view(), right.view(), None, None, &[region], &mut map).expect("fits");
    let mut seen = 0;
    for y in 13..34 {
        assert_eq!(map.validity.row(y)[30..71], whole.validity.row(y)[30..71], "row {y}");
        seen += whole.validity.row(y)[30..71].iter().filter(|&&bits| bits & Validity::SATURATED != 0).count();
    }
    assert!((50..800).contains(&seen), "{seen} pixels are marked");
}

#[test]
fn a_share_beyond_all_is_refused() {
    let params = MatcherParams { saturation_threshold: 101, ..MatcherParams::default() };
    let message = StereoMatcher::new(params).expect_err("101 %").to_string();
    assert!(message.contains("saturation_threshold = 101 %: must be 0 to 100 %"), "{message}");
}
