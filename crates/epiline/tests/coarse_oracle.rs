//! Window sums guided by coarse costs: the matcher against the definition of both, at every instruction level.

mod oracle;

use epiline::image::Image;
use epiline::kernels::Kernels;
use epiline::kernels::Level;
use epiline::kernels::coarse::{RefineRow, padding};
use epiline::matching::{DisparityMap, MatcherParams, Method, Prefilter, StereoMatcher, brute_force};
use oracle::{NO_CANDIDATE, Oracle, Scene, scene};
use proptest::prelude::*;

/// Four pixels to one, the last column and row repeated beyond an odd side.
fn halved(image: &Image<u8>, of_four: impl Fn([u32; 4]) -> u32) -> Image<u8> {
    let (width, height) = (image.width(), image.height());
    Image::from_fn(width.div_ceil(2), height.div_ceil(2), |x, y| {
        let at = |i: usize, j: usize| {
            u32::from(image.row((2 * y + j).min(height - 1))[(2 * x + i).min(width - 1)])
        };
        of_four([at(0, 0), at(1, 0), at(0, 1), at(1, 1)]) as u8
    })
}

/// What is added to the costs of a scene, by column, row and disparity.
fn added(params: &MatcherParams, scene: &Scene) -> impl Fn(usize, usize, usize) -> i64 + use<> {
    let mean = |image: &Image<u8>| halved(image, |four| (four.iter().sum::<u32>() + 2) / 4);
    let any = |mask: &Image<u8>| halved(mask, |four| u32::from(four.iter().any(|&pixel| pixel != 0)));
    let half = Scene {
        left: mean(&scene.left),
        right: mean(&scene.right),
        valid: scene.valid.as_ref().map(|valid| valid.each_ref().map(any)),
    };
    let (first, last) = (params.min_disparity / 2, (params.min_disparity + params.num_disparities - 1) / 2);
    let coarse = MatcherParams {
        min_disparity: first,
        num_disparities: last - first + 1,
        prefilter: params.prefilter,
        block_size: 3,
        prefilter_cap: 15,
        paths: 3,
        p1: 48,
        p2: 127,
        ..MatcherParams::for_method(Method::Sgm)
    };
    let oracle = Oracle { params: &coarse, scene: &half };
    let sums = oracle.sums();
    let excess = |x: usize, y: usize, d: usize| -> i64 {
        let candidate = |d: usize| oracle.is_candidate(x as isize, y as isize, d as isize);
        let sum = |d: usize| i64::from(sums[y][x][d - first]);
        match (first..=last).filter(|&d| candidate(d)).map(sum).min() {
            None => 0,
            Some(smallest) if candidate(d) => (sum(d) - smallest).min(NO_CANDIDATE.into()),
            Some(_) => NO_CANDIDATE.into(),
        }
    };
    let (width, height) = (half.left.width(), half.left.height());
    let volume: Vec<Vec<Vec<i64>>> = (0..height)
        .map(|y| (0..width).map(|x| (first..=last).map(|d| excess(x, y, d)).collect()).collect())
        .collect();
    let area = (params.block_size * params.block_size) as i64;
    let weight = (i64::from(params.coarse_weight) * area * 256 + 99) / 100;
    move |x, y, d| {
        let at = |half_d: usize| volume[y / 2][x / 2][half_d.clamp(first, last) - first];
        (at(d / 2) + at(d.div_ceil(2)) + 1) / 2 * weight / 256
    }
}

fn matched(params: MatcherParams, scene: &Scene, level: Level) -> DisparityMap {
    let mut map = DisparityMap::default();
    let [left_valid, right_valid] = match &scene.valid {
        Some([left, right]) => [Some(left.view()), Some(right.view())],
        None => [None, None],
    };
    StereoMatcher::with_level(params, level)
        .and_then(|mut matcher| {
            // Twice: nothing is left over from the frame before.
            matcher.compute(scene.right.view(), scene.left.view(), &mut map)?;
            matcher.compute_masked(scene.left.view(), scene.right.view(), left_valid, right_valid, &mut map)
        })
        .expect("parameters fit the images");
    map
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn guided_sums_are_those_of_their_definition(
        extra_width in 0_usize..20,
        height in 1_usize..12,
        (min_disparity, num_disparities) in (0_usize..6, 1_usize..40),
        block_size in prop::sample::select(vec![1_usize, 3, 9, 31]),
        coarse_weight in prop::sample::select(vec![1_u8, 4, 25]),
        (prefilter, prefilter_cap) in prop::sample::select(vec![(Prefilter::XSobel, 15), (Prefilter::XSobel, 63), (Prefilter::None, 31)]),
        uniqueness_ratio in prop::sample::select(vec![0_u8, 20]),
        left_right_max_diff in prop::sample::select(vec![None, Some(1_u16)]),
        levels in prop::sample::select(vec![2_u8, 4, 18]),
        masked in any::<bool>(),
        seed in any::<u64>(),
    ) {
        let width = min_disparity + num_disparities + extra_width;
        let scene = scene(width, height, levels, masked, seed);
        let params = MatcherParams {
            min_disparity, num_disparities, block_size, coarse_weight, prefilter, prefilter_cap, uniqueness_ratio,
            left_right_max_diff, threads: Some(1), ..MatcherParams::default()
        };
        let [left_valid, right_valid] = match &scene.valid {
            Some([left, right]) => [Some(left.view()), Some(right.view())],
            None => [None, None],
        };
        let added = added(&params, &scene);
        let expected = brute_force::compute_guided(
            &params, scene.left.view(), scene.right.view(), left_valid, right_valid, &added,
        ).expect("parameters fit the images");
        for level in Level::available() {
            prop_assert_eq!(&matched(params, &scene, level), &expected, "{}", level.name());
        }
    }
}

#[test]
fn the_number_of_threads_does_not_matter_and_coarse_costs_do() {
    let scene = scene(150, 131, 18, true, 5);
    let guided = MatcherParams { num_disparities: 40, ..MatcherParams::with_all_tests() };
    let single = matched(MatcherParams { threads: Some(1), ..guided }, &scene, Level::best());
    for threads in [2, 3, 5, 16] {
        let map = matched(MatcherParams { threads: Some(threads), ..guided }, &scene, Level::best());
        assert!(map == single, "{threads} threads");
    }
    let alone = MatcherParams { coarse_weight: 0, threads: Some(1), ..guided };
    assert!(matched(alone, &scene, Level::best()) != single, "they change something");
}

#[test]
fn a_weight_beyond_its_range_is_an_error_that_names_it() {
    let error = StereoMatcher::new(MatcherParams { coarse_weight: 26, ..MatcherParams::default() })
        .expect_err("more than 25 %")
        .to_string();
    assert!(error.contains("coarse_weight = 26 %") && error.contains("0 to 25 %"), "{error}");
}

#[test]
fn refined_costs_are_the_same_at_every_level() {
    let (coarse_lanes, columns) = (32, 5);
    for (lanes, num_disparities) in [(64, 64), (64, 63), (32, 17), (96, 62), (16, 16), (64, 1)] {
        let costs: Vec<u8> = (0..padding(coarse_lanes, lanes) + columns * coarse_lanes)
            .map(|i| (i * 97 % 256) as u8)
            .collect();
        for starts_odd in [false, true] {
            let refined = |level: Level| {
                let mut added = vec![u16::MAX; columns * lanes];
                Kernels::new(level).refine(&mut RefineRow {
                    coarse_lanes,
                    weight: 61_503,
                    costs: &costs,
                    lanes,
                    num_disparities,
                    starts_odd,
                    added: &mut added,
                });
                added
            };
            // Both resolutions end with the smallest disparity, `starts_odd` tells which; 7 and 6 are 3 at half of it.
            let smallest = if starts_odd { 6 } else { 7 };
            let largest = smallest + num_disparities - 1;
            for (i, &value) in refined(Level::SCALAR).iter().enumerate() {
                // Even lanes first.
                let (x, at) = (i / lanes, i % lanes);
                let lane = if at < lanes / 2 { 2 * at } else { 2 * (at - lanes / 2) + 1 };
                let disparity = smallest + lanes - 1 - lane;
                if disparity > largest {
                    continue;
                }
                let cost = |half: usize| {
                    let end = padding(coarse_lanes, lanes) + (x + 1) * coarse_lanes;
                    u64::from(costs[end - 1 - (half.min(largest / 2) - 3)])
                };
                let mean = (cost(disparity / 2) + cost(disparity.div_ceil(2))).div_ceil(2);
                assert_eq!(u64::from(value), mean * 61_503 / 256, "column {x}, disparity {disparity}");
            }
            for level in Level::available() {
                assert_eq!(refined(level), refined(Level::SCALAR), "{}", level.name());
            }
        }
    }
}
