//! The matcher against its definition computed directly, at every instruction level and any number of threads.

mod settings;

use epiline::image::{Image, ImageRef};
use epiline::kernels::Level;
use epiline::matching::{
    DisparityMap, MatcherParams, Method, Prefilter, StereoMatcher, Subpixel, Validity, brute_force,
};
use proptest::prelude::*;
use settings::window_settings;

/// A pair and its masks.
#[derive(Debug, Clone)]
struct Scene {
    left: Image<u8>,
    right: Image<u8>,
    left_valid: Option<Image<u8>>,
    right_valid: Option<Image<u8>>,
}

impl Scene {
    fn masks(&self) -> [Option<ImageRef<'_, u8>>; 2] {
        [&self.left_valid, &self.right_valid].map(|mask| mask.as_ref().map(Image::view))
    }

    fn brute_force(&self, params: &MatcherParams) -> DisparityMap {
        let [left_valid, right_valid] = self.masks();
        brute_force::compute_masked(params, self.left.view(), self.right.view(), left_valid, right_valid)
            .expect("parameters fit the images")
    }

    fn matcher(&self, matcher: &mut StereoMatcher) -> DisparityMap {
        let [left_valid, right_valid] = self.masks();
        let mut map = DisparityMap::default();
        matcher
            .compute_masked(self.left.view(), self.right.view(), left_valid, right_valid, &mut map)
            .expect("parameters fit the images");
        map
    }
}

/// Repeatable pixels from a seed: no crate decides what they are.
fn noise(seed: u64) -> impl FnMut() -> u8 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    }
}

/// How the pixels are distributed: what breaks sums is not what breaks ties.
#[derive(Debug, Clone, Copy)]
enum Content {
    /// Right is left, shifted by a disparity that varies, plus a little noise.
    Shifted,
    /// Only 0 and 255: the largest sums there are.
    Extreme,
    /// Few grey levels: ties everywhere.
    Coarse,
    /// One grey level: nothing but ties.
    Flat,
}

fn scene(width: usize, height: usize, content: Content, masked: [bool; 2], seed: u64) -> Scene {
    let mut next = noise(seed);
    let left = Image::from_fn(width, height, |_, _| match content {
        Content::Shifted => next(),
        Content::Extreme => 255 * (next() & 1),
        Content::Coarse => 40 * (next() & 3),
        Content::Flat => 77,
    });
    let right = Image::from_fn(width, height, |x, y| {
        let shift = 1 + y / 4 + usize::from(x > width / 2) * 3;
        match content {
            Content::Shifted => left.row(y)[(x + shift).min(width - 1)].saturating_add(next() & 3),
            Content::Extreme => 255 * (next() & 1),
            Content::Coarse => left.row(y)[(x + shift).min(width - 1)],
            Content::Flat => 77,
        }
    });
    let [left_valid, right_valid] =
        masked.map(|masked| masked.then(|| Image::from_fn(width, height, |_, _| u8::from(next() > 40))));
    Scene { left, right, left_valid, right_valid }
}

fn assert_same(actual: &DisparityMap, expected: &DisparityMap, what: &str) {
    for y in 0..expected.height() {
        for x in 0..expected.width() {
            let of = |map: &DisparityMap| (map.values.row(y)[x], map.validity.row(y)[x]);
            assert_eq!(of(actual), of(expected), "{what}: (value, bits) at x = {x}, y = {y}");
        }
    }
    assert_eq!(actual, expected, "{what}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 160, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_level_computes_the_definition(
        params in window_settings(8, 1..=70),
        extra_width in 0..40_usize,
        height in 1..=14_usize,
        content in prop::sample::select(vec![Content::Shifted, Content::Extreme, Content::Coarse, Content::Flat]),
        masked in prop::array::uniform2(prop::bool::weighted(0.3)),
        seed in any::<u64>(),
    ) {
        let width = params.min_disparity + params.num_disparities + extra_width;
        let scene = scene(width, height, content, masked, seed);
        let expected = scene.brute_force(&params);
        for level in Level::available() {
            let mut matcher = StereoMatcher::with_level(params, level).expect("legal parameters");
            assert_same(&scene.matcher(&mut matcher), &expected, level.name());
        }
    }
}

/// All tests at once, on a content that each of them rejects something of.
fn strict() -> MatcherParams {
    MatcherParams {
        num_disparities: 24,
        block_size: 5,
        uniqueness_ratio: 10,
        texture_threshold: 300,
        left_right_max_diff: Some(1),
        speckle_size: 20,
        threads: Some(1),
        ..MatcherParams::default()
    }
}

#[test]
fn every_test_has_its_own_bit() {
    let scene = scene(96, 40, Content::Shifted, [true, true], 3);
    let params = MatcherParams { min_disparity: 1, ..strict() };
    let map = scene.matcher(&mut StereoMatcher::new(params).expect("legal"));
    let seen = map.validity.as_slice().iter().fold(0, |seen, bits| seen | bits);
    for (name, bit) in [
        ("border", Validity::BORDER),
        ("no source", Validity::NO_SOURCE),
        ("not unique", Validity::NOT_UNIQUE),
        ("left-right", Validity::LEFT_RIGHT),
        ("texture", Validity::LOW_TEXTURE),
        ("speckle", Validity::SPECKLE),
    ] {
        assert_ne!(seen & bit, 0, "no pixel was rejected for: {name}");
    }
    assert!(map.density() > 0.05, "something is left");
}

#[test]
fn the_result_depends_neither_on_threads_nor_on_the_level() {
    let scene = scene(83, 131, Content::Shifted, [false, true], 9);
    for method in [Method::Sad, Method::Sad5, Method::Census, Method::Bt] {
        let params = MatcherParams { method, ..strict() };
        let single = scene.matcher(&mut StereoMatcher::with_level(params, Level::SCALAR).expect("legal"));
        for (threads, level) in [1, 2, 3, 4, 16].iter().flat_map(|&n| Level::available().map(move |l| (n, l)))
        {
            let params = MatcherParams { threads: Some(threads), ..params };
            let map = scene.matcher(&mut StereoMatcher::with_level(params, level).expect("legal"));
            assert_same(&map, &single, &format!("{} {threads} threads {}", method.name(), level.name()));
        }
    }
}

#[test]
fn a_matcher_forgets_the_frames_before() {
    for method in [Method::Sad, Method::Sad5, Method::Census, Method::Bt] {
        let params = MatcherParams { method, ..strict() };
        let mut warm = StereoMatcher::new(params).expect("legal");
        for (width, height, masked) in [(70, 33, true), (40, 60, false), (90, 5, true), (70, 33, false)] {
            let scene = scene(width, height, Content::Shifted, [masked, false], width as u64);
            let mut cold = StereoMatcher::new(params).expect("legal");
            assert_same(&scene.matcher(&mut warm), &scene.matcher(&mut cold), &format!("{width}x{height}"));
        }
    }
}

#[test]
fn the_largest_sums_there_are_do_not_overflow() {
    // Black against white: with sad, every window sums to 255·31² = 245 055, which takes 32 bits; the other methods stay
    // within 16 by truncating pixel costs. A grating of single pixels has the largest derivatives and the longest census
    // distances; for the latter, left and right are each other's negative.
    let (width, height) = (40, 12);
    let constant = Scene {
        left: Image::from_fn(width, height, |_, _| 255),
        right: Image::from_fn(width, height, |x, _| if x == 7 { 10 } else { 0 }),
        left_valid: None,
        right_valid: None,
    };
    let dots = |x: usize, y: usize| x.is_multiple_of(3) && y.is_multiple_of(3);
    let opposite = Scene {
        left: Image::from_fn(width, height, |x, y| if dots(x, y) { 255 } else { 0 }),
        right: Image::from_fn(width, height, |x, y| if dots(x, y) { 0 } else { 255 }),
        left_valid: None,
        right_valid: None,
    };
    let settings = [Method::Sad, Method::Sad5, Method::Census, Method::Bt]
        .into_iter()
        .flat_map(|method| [Prefilter::None, Prefilter::XSobel].map(|prefilter| (method, prefilter)));
    for ((method, prefilter), scene) in
        settings.flat_map(|setting| [(setting, &constant), (setting, &opposite)])
    {
        let params = MatcherParams {
            method,
            num_disparities: 20,
            block_size: 31,
            prefilter,
            prefilter_cap: 63,
            uniqueness_ratio: 1,
            left_right_max_diff: Some(0),
            threads: Some(1),
            ..MatcherParams::default()
        };
        let expected = scene.brute_force(&params);
        for level in Level::available() {
            let mut matcher = StereoMatcher::with_level(params, level).expect("legal parameters");
            assert_same(&scene.matcher(&mut matcher), &expected, &format!("{method:?} {}", level.name()));
        }
    }
}

/// Black against white in every pixel: windows of both sides of the switch to 32-bit sums.
#[test]
fn checkerboards_are_exact_where_sums_outgrow_sixteen_bits() {
    let (width, height) = (47, 39);
    let board = |offset: usize| Image::from_fn(width, height, |x, y| 255 * ((x + y + offset) % 2) as u8);
    let stripes = |offset: usize| Image::from_fn(width, height, |x, _| 255 * ((x + offset) / 2 % 2) as u8);
    for (prefilter, block_sizes, images) in [
        (Prefilter::None, [15, 17], [board(0), board(1)]),
        (Prefilter::None, [15, 17], [board(0), Image::from_fn(width, height, |x, _| 255 * u8::from(x > 9))]),
        (Prefilter::XSobel, [21, 23], [stripes(0), stripes(2)]),
    ] {
        let [left, right] = images;
        let scene = Scene { left, right, left_valid: None, right_valid: None };
        for block_size in block_sizes {
            let params = MatcherParams {
                num_disparities: 33,
                block_size,
                prefilter,
                prefilter_cap: 63,
                uniqueness_ratio: 100,
                left_right_max_diff: Some(1),
                threads: Some(1),
                ..MatcherParams::default()
            };
            let expected = scene.brute_force(&params);
            for level in Level::available() {
                let mut matcher = StereoMatcher::with_level(params, level).expect("legal parameters");
                let name = format!("{} {prefilter:?} {block_size}", level.name());
                assert_same(&scene.matcher(&mut matcher), &expected, &name);
            }
        }
    }
}

#[test]
fn the_largest_settings_find_a_known_shift() {
    let (width, height, shift) = (8192, 2, 1000);
    let mut next = noise(3);
    let right = Image::from_fn(width, height, |_, _| 255 * (next() & 1));
    let left = Image::from_fn(width, height, |x, y| match x.checked_sub(shift) {
        Some(opposite) => right.row(y)[opposite],
        None => 255 * (next() & 1),
    });
    let scene = Scene { left, right, left_valid: None, right_valid: None };
    for prefilter in [Prefilter::XSobel, Prefilter::None] {
        let params = MatcherParams {
            num_disparities: 1024,
            block_size: 31,
            prefilter,
            uniqueness_ratio: 10,
            left_right_max_diff: Some(1),
            subpixel: Subpixel::Off,
            threads: Some(2),
            ..MatcherParams::default()
        };
        for level in Level::available() {
            let mut matcher = StereoMatcher::with_level(params, level).expect("legal parameters");
            let map = scene.matcher(&mut matcher);
            // Windows whose every column the right image contains too, with its x-Sobel.
            let inside = shift + 16..width - 16;
            for y in 0..height {
                assert!(map.values.row(y)[inside.clone()].iter().all(|&value| value == 16 * shift as u16));
                assert!(
                    map.validity.row(y)[inside.clone()].iter().all(|&bits| bits == 0),
                    "{}",
                    level.name()
                );
            }
        }
    }
}

#[test]
fn a_pixel_near_the_left_edge_has_fewer_candidates_not_none() {
    let scene = scene(64, 9, Content::Shifted, [false, false], 1);
    let params =
        MatcherParams { num_disparities: 32, block_size: 5, threads: Some(1), ..MatcherParams::default() };
    let map = scene.matcher(&mut StereoMatcher::new(params).expect("legal"));
    assert_eq!(map.density(), 1.0);
    for y in 0..map.height() {
        for x in 0..map.width() {
            assert!(map.at(x, y).expect("dense") <= x as f32 + 0.5, "the match of x = {x} lies in the image");
        }
    }
}

#[test]
fn a_range_wider_than_the_image_is_an_error_that_names_both() {
    let scene = scene(48, 8, Content::Shifted, [false, false], 1);
    let params = MatcherParams { num_disparities: 46, min_disparity: 3, ..MatcherParams::default() };
    let mut matcher = StereoMatcher::new(params).expect("legal in itself");
    let error = matcher
        .compute(scene.left.view(), scene.right.view(), &mut DisparityMap::default())
        .expect_err("49 disparities do not fit 48 columns");
    let message = error.to_string();
    assert!(message.contains("num_disparities = 46 px") && message.contains("width of 48 px"), "{message}");
}

#[test]
fn images_and_masks_of_other_sizes_are_errors_that_name_them() {
    let (a, b) = (Image::<u8>::new(40, 10), Image::<u8>::new(40, 11));
    let params = MatcherParams { num_disparities: 16, ..MatcherParams::default() };
    let mut matcher = StereoMatcher::new(params).expect("legal");
    let mut map = DisparityMap::default();
    let error = matcher.compute(a.view(), b.view(), &mut map).expect_err("heights differ").to_string();
    assert!(error.contains("left is 40x10 px but right is 40x11 px"), "{error}");
    let error = matcher
        .compute_masked(a.view(), a.view(), None, Some(b.view()), &mut map)
        .expect_err("the mask's height differs")
        .to_string();
    assert!(error.contains("right_valid is 40x11 px"), "{error}");
}
