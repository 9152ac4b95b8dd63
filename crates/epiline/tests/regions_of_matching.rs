//! Matching of boxes against matching of the whole image.

mod settings;

use epiline::image::{Image, ImageRef};
use epiline::kernels::Level;
use epiline::matching::{DisparityMap, MatchRegion, MatcherParams, Method, StereoMatcher, Validity};
use proptest::prelude::*;
use settings::window_settings;

struct Scene {
    left: Image<u8>,
    right: Image<u8>,
    valid: Option<[Image<u8>; 2]>,
}

/// Repeatable pixels: shifted by a disparity that varies, with noise and flat patches, so that every test rejects some.
fn scene(width: usize, height: usize, masked: bool, seed: u64) -> Scene {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    let left =
        Image::from_fn(width, height, |x, y| if (x / 9 + y / 7) % 5 == 0 { 90 } else { next() & 0xF8 });
    let right = Image::from_fn(width, height, |x, y| {
        let shift = 1 + y / 6 + usize::from(x / 16 % 2 == 0) * 3;
        left.row(y)[(x + shift).min(width - 1)].saturating_add(next() & 7)
    });
    let valid = masked.then(|| [0, 1].map(|_| Image::from_fn(width, height, |_, _| u8::from(next() > 20))));
    Scene { left, right, valid }
}

impl Scene {
    fn masks(&self) -> [Option<ImageRef<'_, u8>>; 2] {
        [0, 1].map(|i| self.valid.as_ref().map(|masks| masks[i].view()))
    }

    fn whole(&self, params: &MatcherParams) -> DisparityMap {
        let mut map = DisparityMap::default();
        let [left_valid, right_valid] = self.masks();
        StereoMatcher::new(*params)
            .expect("legal")
            .compute_masked(self.left.view(), self.right.view(), left_valid, right_valid, &mut map)
            .expect("fits");
        map
    }

    fn of_regions(&self, matcher: &mut StereoMatcher, regions: &[MatchRegion]) -> DisparityMap {
        let mut map = DisparityMap::default();
        let [left_valid, right_valid] = self.masks();
        matcher
            .compute_regions(self.left.view(), self.right.view(), left_valid, right_valid, regions, &mut map)
            .expect("fits");
        map
    }
}

/// Every pixel: that of the whole image matched with the range of the first box around it, or none.
fn assert_exact(scene: &Scene, params: &MatcherParams, regions: &[MatchRegion], actual: &DisparityMap) {
    let mut maps: Vec<(Option<(usize, usize)>, DisparityMap)> = Vec::new();
    for region in regions {
        if !maps.iter().any(|(range, _)| *range == region.disparities) {
            let mut params = *params;
            if let Some((min, num)) = region.disparities {
                (params.min_disparity, params.num_disparities) = (min, num);
            }
            maps.push((region.disparities, scene.whole(&params)));
        }
    }
    for y in 0..scene.left.height() {
        for x in 0..scene.left.width() {
            let inside =
                |r: &&MatchRegion| (r.x..r.x + r.width).contains(&x) && (r.y..r.y + r.height).contains(&y);
            let expected = regions.iter().find(inside).map_or((0, Validity::BORDER), |region| {
                let (_, map) =
                    maps.iter().find(|(range, _)| *range == region.disparities).expect("made above");
                (map.values.row(y)[x], map.validity.row(y)[x])
            });
            let actual = (actual.values.row(y)[x], actual.validity.row(y)[x]);
            assert_eq!(actual, expected, "(value, bits) at ({x}, {y}) with {regions:?} of {params:?}");
        }
    }
}

fn region(x: usize, y: usize, width: usize, height: usize) -> MatchRegion {
    MatchRegion { x, y, width, height, disparities: None }
}

fn regions(width: usize, height: usize) -> impl Strategy<Value = Vec<MatchRegion>> {
    let range = prop::sample::select(vec![None, None, Some((0, 9)), Some((3, 17))]);
    let one = (0..width, 0..height, 1..=width, 1..=height, range).prop_map(
        move |(x, y, region_width, region_height, disparities)| MatchRegion {
            x,
            y,
            width: region_width.min(width - x),
            height: region_height.min(height - y),
            disparities,
        },
    );
    prop::collection::vec(one, 1..5)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn boxes_have_the_answers_of_the_whole_image(
        params in window_settings(4, 1..=24),
        regions in regions(120, 40),
        masked in prop::bool::weighted(0.3),
        seed in any::<u64>(),
    ) {
        let scene = scene(120, 40, masked, seed);
        let mut matcher = StereoMatcher::new(params).expect("legal");
        let map = scene.of_regions(&mut matcher, &regions);
        assert_exact(&scene, &params, &regions, &map);
    }
}

#[test]
fn levels_threads_and_frames_before_change_nothing() {
    let scene = scene(150, 100, false, 5);
    let regions = [region(3, 0, 147, 34), region(40, 30, 20, 40), region(100, 60, 50, 40)];
    for level in Level::available() {
        for threads in [1, 3] {
            let params = MatcherParams {
                num_disparities: 32,
                block_size: 7,
                threads: Some(threads),
                ..MatcherParams::with_all_tests()
            };
            let mut matcher = StereoMatcher::with_level(params, level).expect("legal");
            for regions in [&regions[..], &regions[1..2], &regions[..]] {
                let map = scene.of_regions(&mut matcher, regions);
                assert_exact(&scene, &params, regions, &map);
            }
            let mut whole = DisparityMap::default();
            matcher.compute(scene.left.view(), scene.right.view(), &mut whole).expect("fits");
            assert_eq!(whole, scene.whole(&params), "the whole image after boxes");
        }
    }
}

#[test]
fn paths_and_filling_need_the_whole_image_and_get_it() {
    let scene = scene(80, 40, true, 6);
    let regions =
        [region(10, 5, 30, 9), MatchRegion { disparities: Some((2, 12)), ..region(30, 10, 40, 25) }];
    for params in [
        MatcherParams {
            num_disparities: 16,
            fill: true,
            left_right_max_diff: Some(0),
            ..MatcherParams::default()
        },
        MatcherParams { num_disparities: 16, speckle_size: 20, ..MatcherParams::for_method(Method::Sgm) },
    ] {
        let mut matcher = StereoMatcher::new(params).expect("legal");
        let map = scene.of_regions(&mut matcher, &regions);
        assert_exact(&scene, &params, &regions, &map);
    }
}

/// A snake of one disparity, too long to be a speckle, of which the box sees single rows.
#[test]
fn islands_are_followed_out_of_the_box() {
    let (width, height) = (140, 90);
    let random = scene(width, height, false, 9).left;
    let shift = |x: usize, y: usize| {
        let corridor = y % 8 < 4 || (x / 6) % 18 == if (y / 8).is_multiple_of(2) { 16 } else { 3 };
        if corridor { 12 } else { 3 }
    };
    let right = Image::from_fn(width, height, |x, y| random.row(y)[(x + shift(x, y)).min(width - 1)]);
    let scene = Scene { left: random, right, valid: None };
    for speckle_size in [30, 200, 900, 3000] {
        let params = MatcherParams {
            num_disparities: 16,
            block_size: 3,
            left_right_max_diff: Some(1),
            speckle_size,
            speckle_range: 1,
            ..MatcherParams::default()
        };
        let regions = [region(50, 30, 20, 9), region(100, 80, 30, 10)];
        let mut matcher = StereoMatcher::new(params).expect("legal");
        let map = scene.of_regions(&mut matcher, &regions);
        assert_exact(&scene, &params, &regions, &map);
    }
}

#[test]
fn boxes_that_make_no_sense_are_refused_by_name() {
    let scene = scene(60, 40, false, 1);
    let params = MatcherParams { num_disparities: 16, ..MatcherParams::default() };
    let mut matcher = StereoMatcher::new(params).expect("legal");
    let ranged = |disparities| MatchRegion { disparities: Some(disparities), ..region(0, 0, 9, 9) };
    for (regions, expected) in [
        (vec![], "regions = 0 boxes: must be 1 to 256"),
        (vec![region(0, 0, 1, 1); 257], "regions = 257 boxes: must be 1 to 256"),
        (vec![region(0, 0, 9, 9), region(5, 6, 0, 3)], "regions = 0x3 px at (5, 6): must not be empty"),
        (vec![region(52, 0, 9, 3)], "must lie inside the image of 60x40 px"),
        (vec![region(0, 38, 9, 3)], "must lie inside the image of 60x40 px"),
        (vec![region(usize::MAX, 0, 2, 3)], "must lie inside the image of 60x40 px"),
        (vec![ranged((0, 0))], "num_disparities = 0 px: must be 1 to 1024"),
        (vec![ranged((50, 16))], "= 66 px must not exceed the images' width of 60 px"),
        (vec![ranged((usize::MAX, 2))], "must not exceed 4095 px"),
    ] {
        let mut map = DisparityMap::default();
        let error = matcher
            .compute_regions(scene.left.view(), scene.right.view(), None, None, &regions, &mut map)
            .expect_err(expected)
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}
