//! Semi-global matching against its definition computed directly, and against itself at every instruction level and number
//! of threads.

mod oracle;

use epiline::image::Image;
use epiline::kernels::Level;
use epiline::matching::{DisparityMap, MatcherParams, Method, Prefilter, StereoMatcher, Subpixel, Validity};
use oracle::{Oracle, Scene, scene};
use proptest::prelude::*;

/// What the matcher makes of the oracle's sums.
fn map_of(oracle: &Oracle<'_>) -> DisparityMap {
    let (width, height) = oracle.size();
    let params = oracle.params;
    let sums = oracle.sums();
    let sum = |x: isize, y: isize, d: isize| -> Option<i32> {
        let i = usize::try_from(d - params.min_disparity as isize).ok()?;
        let inside = (0..width).contains(&x) && i < params.num_disparities && oracle.is_candidate(x, y, d);
        inside.then(|| sums[y as usize][x as usize][i])
    };
    let disparities = || (0..params.num_disparities).map(|i| (params.min_disparity + i) as isize);
    let mut map = DisparityMap::new(width as usize, height as usize);
    (map.min_disparity, map.num_disparities) = (params.min_disparity, params.num_disparities);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let best = disparities().filter_map(|d| Some((sum(x, y, d)?, std::cmp::Reverse(d)))).min();
        let (value, bits) = match best {
            None => {
                let beyond = x < params.min_disparity as isize;
                let sourceless = oracle
                    .scene
                    .valid
                    .as_ref()
                    .is_some_and(|valid| valid[0].row(y as usize)[x as usize] == 0);
                let bits = if beyond { Validity::BORDER } else { Validity::NO_SOURCE };
                (0, bits | if sourceless { Validity::NO_SOURCE } else { 0 })
            }
            Some((best, std::cmp::Reverse(d))) => {
                let mut value_256 = 256 * d as i32;
                if let (Some(smaller), Some(larger)) = (sum(x, y, d - 1), sum(x, y, d + 1))
                    && smaller.max(larger) > best
                {
                    value_256 += match params.subpixel {
                        Subpixel::Off => 0,
                        Subpixel::VFit => 256 * (smaller - larger) / (2 * (smaller.max(larger) - best)),
                        Subpixel::Parabola => 256 * (smaller - larger) / (2 * (smaller + larger - 2 * best)),
                    };
                }
                let limit = best + best * i32::from(params.uniqueness_ratio) / 100;
                let rival = |e: isize| (e - d).abs() > 1 && sum(x, y, e).is_some_and(|sum| sum <= limit);
                let mut bits = 0;
                if params.uniqueness_ratio > 0 && disparities().any(rival) {
                    bits |= Validity::NOT_UNIQUE;
                }
                if let Some(reach) = params.left_right_max_diff {
                    let of_right = |e: isize| sum(x - d + e, y, e);
                    let own = disparities().filter_map(of_right).min();
                    let reach = reach as isize;
                    if (d - reach..=d + reach).filter_map(of_right).min() != own {
                        bits |= Validity::LEFT_RIGHT;
                    }
                }
                (((value_256 + 15) >> 4) as u16, bits)
            }
        };
        map.values.row_mut(y as usize)[x as usize] = value;
        map.validity.row_mut(y as usize)[x as usize] = bits;
    }
    map
}

fn matched(params: &MatcherParams, scene: &Scene, level: Level) -> DisparityMap {
    let mut map = DisparityMap::default();
    let [left_valid, right_valid] = match &scene.valid {
        Some([left, right]) => [Some(left.view()), Some(right.view())],
        None => [None, None],
    };
    StereoMatcher::with_level(*params, level)
        .and_then(|mut matcher| {
            // Twice: nothing is left over from the frame before.
            matcher.compute(scene.right.view(), scene.left.view(), &mut map)?;
            matcher.compute_masked(scene.left.view(), scene.right.view(), left_valid, right_valid, &mut map)
        })
        .expect("parameters fit the images");
    map
}

fn sgm() -> MatcherParams {
    MatcherParams { threads: Some(1), ..MatcherParams::for_method(Method::Sgm) }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_matcher_computes_its_definition(
        width in 18_usize..40,
        height in 1_usize..12,
        (min_disparity, num_disparities) in (0_usize..4, 1_usize..15),
        block_size in prop::sample::select(vec![1, 3, 5, 15]),
        paths in 3_usize..=4,
        (p1, p2) in prop::sample::select(vec![(0, 0), (5, 40), (48, 127), (127, 127)]),
        levels in prop::sample::select(vec![2_u8, 4, 18]),
        subpixel in prop::sample::select(vec![Subpixel::Off, Subpixel::VFit, Subpixel::Parabola]),
        masked in any::<bool>(),
        seed in any::<u64>(),
    ) {
        let scene = scene(width, height, levels, masked, seed);
        let params = MatcherParams {
            min_disparity, num_disparities, block_size, paths, p1, p2, subpixel,
            prefilter: if seed % 5 == 0 { Prefilter::None } else { Prefilter::XSobel },
            prefilter_cap: if seed % 3 == 0 { 63 } else { 15 },
            uniqueness_ratio: (seed % 4 * 8) as u8,
            left_right_max_diff: ((seed % 3) as u16).checked_sub(1),
            ..sgm()
        };
        let expected = map_of(&Oracle { params: &params, scene: &scene });
        for level in Level::available() {
            prop_assert_eq!(&matched(&params, &scene, level), &expected, "{}", level.name());
        }
    }
}

#[test]
fn neither_level_nor_threads_change_the_result() {
    for (paths, num_disparities, width) in [(3, 64, 131), (4, 64, 97), (4, 100, 211), (3, 200, 203)] {
        let scene = scene(width, 90, 18, false, width as u64);
        let params = MatcherParams {
            paths,
            num_disparities,
            uniqueness_ratio: 5,
            left_right_max_diff: Some(1),
            fill: true,
            smooth: true,
            ..sgm()
        };
        let expected = matched(&params, &scene, Level::SCALAR);
        for level in Level::available() {
            for threads in [1, 2, 3, 7] {
                let params = MatcherParams { threads: Some(threads), ..params };
                assert_eq!(matched(&params, &scene, level), expected, "{} {threads} threads", level.name());
            }
        }
    }
}

#[test]
fn the_left_border_is_answered_from_what_the_right_image_shows() {
    let scene = scene(120, 40, 18, false, 7);
    let params = MatcherParams { num_disparities: 64, ..sgm() };
    let map = matched(&params, &scene, Level::best());
    assert!(map.validity.as_slice().iter().all(|&bits| bits == 0), "every pixel has a candidate");
    for (i, &value) in map.values.as_slice().iter().enumerate() {
        assert!(usize::from(value) <= 16 * (i % 120) + 8, "pixel {i}: {value}/16 px points outside");
    }
}

/// Nearest values of the row, and of the rows around if it has none; then medians by sorting, plain ones everywhere and
/// weighted ones at edges.
fn filled(map: &DisparityMap, guide: &Image<u8>) -> Option<Vec<u16>> {
    let (width, height) = (map.width(), map.height());
    let value =
        |x: usize, y: usize| Validity::has_value(map.validity.row(y)[x]).then(|| map.values.row(y)[x]);
    let mut rows: Vec<Option<Vec<u16>>> = (0..height)
        .map(|y| {
            (0..width)
                .map(|x| {
                    let left = (0..x).rev().find_map(|x| value(x, y));
                    let right = (x..width).find_map(|x| value(x, y));
                    value(x, y).or(left.into_iter().chain(right).min())
                })
                .collect()
        })
        .collect();
    let first = rows.iter().position(Option::is_some)?;
    for y in 0..height {
        if rows[y].is_none() {
            rows[y] = rows[if y < first { first } else { y - 1 }].clone();
        }
    }
    let rows: Vec<Vec<u16>> = rows.into_iter().flatten().collect();
    let median = |x: usize, y: usize| {
        let mut around: Vec<u16> = [y.saturating_sub(1), y, (y + 1).min(height - 1)]
            .iter()
            .flat_map(|&y| [x.saturating_sub(1), x, (x + 1).min(width - 1)].map(|x| rows[y][x]))
            .collect();
        around.sort_unstable();
        around[4]
    };
    let smooth = Image::from_fn(width, height, median);
    Some(sharpened(map, &smooth, guide).into_vec())
}

/// Weighted medians near what was filled and near steps of more than a pixel.
fn sharpened(map: &DisparityMap, values: &Image<u16>, guide: &Image<u8>) -> Image<u16> {
    let (width, height) = (values.width() as isize, values.height() as isize);
    let at = |x: isize, y: isize| (x.clamp(0, width - 1) as usize, y.clamp(0, height - 1) as usize);
    let value = |x, y| {
        let (x, y) = at(x, y);
        values.row(y)[x]
    };
    let grey = |x, y| {
        let (x, y) = at(x, y);
        f64::from(guide.row(y)[x])
    };
    let uncertain = |x: isize, y: isize| {
        let (own_x, own_y) = at(x, y);
        let (x, y) = (own_x as isize, own_y as isize);
        !Validity::has_value(map.validity.row(own_y)[own_x])
            || [(1, 0), (-1, 0), (0, 1), (0, -1)]
                .iter()
                .any(|(i, j)| value(x + i, y + j).abs_diff(value(x, y)) > 16)
    };
    let around = |step: isize| (-1..=1).flat_map(move |j| (-1..=1).map(move |i| (i * step, j * step)));
    Image::from_fn(values.width(), values.height(), |x, y| {
        let (x, y) = (x as isize, y as isize);
        let mut samples: Vec<(u16, f64)> = around(4)
            .map(|(i, j)| {
                let weight = (-(grey(x + i, y + j) - grey(x, y)).abs() / 12.0).exp();
                (value(x + i, y + j), (1024.0 * weight).round())
            })
            .collect();
        samples.sort_by_key(|sample| sample.0);
        if samples[8].0 - samples[0].0 <= 16 || !around(1).any(|(i, j)| uncertain(x + i, y + j)) {
            return value(x, y);
        }
        let up_to = |value: u16| samples.iter().filter(|s| s.0 <= value).map(|s| s.1).sum::<f64>();
        let total = up_to(u16::MAX);
        samples.iter().find(|s| 2.0 * up_to(s.0) >= total).expect("all of them have all the weight").0
    })
}

#[test]
fn filling_answers_every_pixel_from_the_background() {
    for (width, height, method) in [(40, 9, Method::Sgm), (33, 14, Method::Sad), (17, 1, Method::Sgm)] {
        let scene = scene(width, height, 4, true, 11);
        let params = MatcherParams {
            num_disparities: 16,
            left_right_max_diff: Some(0),
            uniqueness_ratio: 20,
            ..MatcherParams::for_method(method)
        };
        let map = matched(&params, &scene, Level::best());
        let full = matched(&MatcherParams { fill: true, ..params }, &scene, Level::best());
        assert_eq!(Some(full.values.as_slice().to_vec()), filled(&map, &scene.left), "{width}x{height}");
        for (&before, &after) in map.validity.as_slice().iter().zip(full.validity.as_slice()) {
            assert_eq!(after, if Validity::has_value(before) { before } else { Validity::FILLED });
        }
    }
}

#[test]
fn a_map_without_any_value_is_left_as_it_is() {
    let mut scene = scene(20, 5, 4, true, 3);
    scene.valid = Some([0, 1].map(|_| Image::new(20, 5)));
    let params = MatcherParams { num_disparities: 8, fill: true, ..sgm() };
    let map = matched(&params, &scene, Level::best());
    assert!(map.validity.as_slice().iter().all(|&bits| bits == Validity::NO_SOURCE));
}

#[test]
fn parameters_outside_their_range_are_refused_by_name() {
    let refused = [
        (MatcherParams { block_size: 17, ..sgm() }, "block_size = 17 px"),
        (MatcherParams { paths: 5, ..sgm() }, "paths = 5"),
        (MatcherParams { p1: 128, p2: 128, ..sgm() }, "p1 = 128"),
        (MatcherParams { p1: 50, p2: 49, ..sgm() }, "p2 = 49"),
    ];
    for (params, expected) in refused {
        let message = StereoMatcher::new(params).expect_err(expected).to_string();
        assert!(message.contains(expected), "{message}");
    }
}
