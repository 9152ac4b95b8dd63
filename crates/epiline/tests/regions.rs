//! Regions against brute force, and nearest surfaces against worlds whose distances are known.

#[path = "scene/matched.rs"]
mod matched;
mod scene;

use epiline::matching::{DisparityMap, Validity};
use epiline::rectification::RectifiedGeometry;
use epiline::regions::{
    NearestSurface, ProfileParams, Profiler, Region, RegionProfile, paper_regions, profile,
};
use matched::{Flaws, NO_FLAWS, ORDINARY, disparity_of};
use scene::{Board, HEIGHT, Random, WIDTH, World, geometry};

fn random_map(width: usize, height: usize, seed: u64) -> DisparityMap {
    let mut random = Random::new(seed);
    let mut map = DisparityMap::new(width, height);
    (map.min_disparity, map.num_disparities) = (3, 20);
    for i in 0..width * height {
        // Clustered, so that support is sometimes found and sometimes not.
        let cluster = random.within(0.0, 5.0).floor() * 4.0;
        map.values.as_mut_slice()[i] = (16.0 * (3.0 + cluster + random.within(0.0, 3.0))) as u16;
        map.validity.as_mut_slice()[i] = if random.uniform() < 0.4 { Validity::SPECKLE } else { 0 };
    }
    map
}

fn disparities(map: &DisparityMap, x: usize, rows: std::ops::Range<usize>) -> Vec<(f32, usize)> {
    rows.filter_map(|y| map.at(x, y).map(|d| (d, y))).collect()
}

fn same(got: f32, expected: Option<f32>) -> bool {
    expected.map_or(got.is_nan(), |expected| got == expected)
}

#[test]
fn columns_match_brute_force() {
    let map = random_map(71, 23, 5);
    let geometry = RectifiedGeometry::new(71, 23, 80.0, 33.0, 12.0, 0.0, 0.1).expect("a rig");
    for (region, min_support) in [
        (Region::new("all", 0, 0, 71, 23), 3),
        (Region::new("part", 7, 2, 41, 11), 4),
        (Region::new("plain maximum", 0, 5, 71, 6), 1),
        (Region::new("one column", 70, 0, 1, 23), 2),
        (Region::new("one row", 0, 22, 71, 1), 1),
        (Region::new("hopeless", 3, 3, 50, 9), 40),
    ] {
        let params = ProfileParams { min_support, ..ProfileParams::default() };
        let got = &profile(&map, std::slice::from_ref(&region), Some(&geometry), &params).expect("inside")[0];
        let ranges_m = got.nearest_range_m.as_ref().expect("with geometry");
        let mut all = Vec::new();
        for (column, &range_got_m) in ranges_m.iter().enumerate() {
            let x = region.x + column;
            let values = disparities(&map, x, region.y..region.y + region.height);
            let mut sorted: Vec<f32> = values.iter().map(|v| v.0).collect();
            sorted.sort_by(f32::total_cmp);
            let supporters = |d: f32| values.iter().filter(move |v| (v.0 - d).abs() <= 1.0);
            let nearest =
                sorted.iter().copied().filter(|&d| supporters(d).count() >= min_support).reduce(f32::max);
            let n = sorted.len();
            let median = (n > 0).then(|| 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]));
            let context = format!("{}, column {column}", region.name);
            assert_eq!(got.count[column] as usize, n, "{context}");
            assert!(
                same(got.nearest_px[column], nearest),
                "{context}: {:?} {nearest:?}",
                got.nearest_px[column]
            );
            assert!(same(got.median_px[column], median), "{context}");
            let spread = median.map(|median| {
                let mut off: Vec<f32> = sorted.iter().map(|d| (d - median).abs()).collect();
                off.sort_by(f32::total_cmp);
                1.482_602_2 * 0.5 * (off[(n - 1) / 2] + off[n / 2])
            });
            assert!(same(got.spread_px[column], spread), "{context}: {:?} {spread:?}", got.spread_px[column]);
            assert_eq!(got.unknown[column] as usize, region.height - n, "{context}");
            assert!(same(got.minimum_px[column], sorted.first().copied()), "{context}");
            assert!(same(got.maximum_px[column], sorted.last().copied()), "{context}");
            let range_m = nearest.map(|d| {
                let rows: f64 = supporters(d).map(|v| v.1 as f64).sum();
                let mean_row = rows / supporters(d).count() as f64;
                (geometry.depth_m(f64::from(d)) * geometry.range_per_depth(x as f64, mean_row)) as f32
            });
            assert!(same(range_got_m, range_m), "{context}: {range_got_m} {range_m:?}");
            all.extend(sorted);
        }
        assert!(all.len() > 10, "{}: too few values to test anything", region.name);
        let total: f64 = all.iter().map(|&d| f64::from(d)).sum();
        assert!((got.total - total).abs() < 1e-9 * total);
        assert_eq!(got.minimum, f64::from(all.iter().copied().fold(f32::INFINITY, f32::min)));
        assert_eq!(got.maximum, f64::from(all.iter().copied().fold(0.0, f32::max)));
        assert_eq!(got.valid_share, all.len() as f64 / (region.width * region.height) as f64);
        let mut histogram = vec![0; 23];
        for d in all {
            let bin = (d + 0.5).floor() as usize;
            histogram.resize(histogram.len().max(bin + 1), 0);
            histogram[bin] += 1;
        }
        assert_eq!(got.histogram, histogram, "{}", region.name);
    }
}

#[test]
fn a_region_without_values_says_so() {
    let map = DisparityMap::new(40, 20);
    let geometry = RectifiedGeometry::new(40, 20, 50.0, 20.0, 10.0, 0.0, 0.1).expect("a rig");
    let whole = [Region::whole(40, 20)];
    let got = &profile(&map, &whole, Some(&geometry), &ProfileParams::default()).expect("inside")[0];
    assert!(got.nearest_px.iter().chain(&got.median_px).all(|v| v.is_nan()));
    assert_eq!((got.nearest_px.len(), got.total, got.valid_share, got.nearest), (40, 0.0, 0.0, None));
    assert!(got.minimum.is_nan() && got.maximum.is_nan());
}

#[test]
fn a_warm_profiler_forgets_the_frame_before() {
    let geometry = geometry();
    let world = World { wall: Some((2.0, 0.3)), ..World::default() };
    let maps = [disparity_of(&world, &geometry, ORDINARY, 1), DisparityMap::new(WIDTH, HEIGHT)];
    let mut profiler = Profiler::default();
    let mut warm = RegionProfile::new(Region::new("r", 10, 20, 200, 64));
    for map in [&maps[0], &maps[1], &maps[0]] {
        profiler.read(map, Some(&geometry), &ProfileParams::default(), &mut warm).expect("inside");
        let region = std::slice::from_ref(&warm.region);
        let fresh = &profile(map, region, Some(&geometry), &ProfileParams::default()).expect("inside")[0];
        assert_eq!(format!("{warm:?}"), format!("{fresh:?}"));
    }
}

#[test]
fn regions_outside_the_image_are_named() {
    let map = DisparityMap::new(64, 48);
    for region in [
        Region::new("low", 0, 40, 64, 9),
        Region::new("low", 60, 0, 5, 1),
        Region::new("low", 0, 0, 0, 4),
        Region::new("low", usize::MAX, 0, 2, 4),
    ] {
        let error =
            profile(&map, &[region], None, &ProfileParams::default()).expect_err("outside").to_string();
        assert!(error.contains("'low'") && error.contains("64x48"), "{error}");
    }
    let params = ProfileParams { min_support: 0, ..ProfileParams::default() };
    let error =
        profile(&map, &[], None, &params).map(|_| ()).and(params.validate()).expect_err("0").to_string();
    assert!(error.contains("min_support = 0 px"), "{error}");
}

#[test]
fn paper_bands_scale_and_do_not_overlap() {
    let sizes: Vec<_> =
        paper_regions(320, 240).expect("the paper's size").iter().map(|r| (r.width, r.height)).collect();
    assert_eq!(sizes, [(320, 20), (320, 30), (320, 40), (320, 50)]);
    for (width, height) in [(320, 240), (640, 480), (1280, 720), (1242, 375), (33, 12), (100, 1001)] {
        let bands = paper_regions(width, height).expect("large enough");
        for pair in bands.windows(2) {
            assert_eq!(pair[0].y + pair[0].height, pair[1].y);
        }
        for band in &bands {
            band.validate(width, height).expect("inside");
        }
        assert_eq!(bands[3].y + bands[3].height, height);
    }
    assert!(paper_regions(320, 11).is_err() && paper_regions(0, 240).is_err());
}

fn nearest(world: &World, region: &Region, flaws: Flaws, seed: u64) -> Option<NearestSurface> {
    let geometry = geometry();
    let map = disparity_of(world, &geometry, flaws, seed);
    profile(&map, std::slice::from_ref(region), Some(&geometry), &ProfileParams::default()).expect("inside")
        [0]
    .nearest
}

/// The smallest range of any pixel of the region.
fn true_range_m(world: &World, region: &Region) -> f64 {
    let geometry = geometry();
    let rows = region.y..region.y + region.height;
    let ranges = rows
        .flat_map(|y| (region.x..region.x + region.width).map(move |x| (x, y)))
        .map(|(x, y)| world.depth_m(&geometry, x, y) * geometry.range_per_depth(x as f64, y as f64));
    ranges.fold(f64::INFINITY, f64::min)
}

fn worlds() -> Vec<(&'static str, World)> {
    let wall = |z, slope| World { wall: Some((z, slope)), ..World::default() };
    let in_room = |boards| World { boards, floor_m: Some(0.5), wall: Some((14.0, 0.0)) };
    let board =
        |z: f64, x: f64, width: f64, top: f64| Board { z, left: x, right: x + width, top, bottom: 0.5 };
    let mut worlds = vec![
        ("wall at 1.2 m", wall(1.2, 0.0)),
        ("wall at 2.5 m", wall(2.5, 0.0)),
        ("wall at 4 m", wall(4.0, 0.0)),
        ("wall at 8 m", wall(8.0, 0.0)),
        ("slanted wall", wall(3.0, 0.8)),
        ("wall slanted the other way", wall(2.2, -1.3)),
        ("floor and far wall", in_room(vec![])),
    ];
    for z in [1.3, 2.0, 3.1, 3.9, 5.5, 7.6] {
        worlds.push(("box", in_room(vec![board(z, -0.4, 0.5, -0.3)])));
        worlds.push(("pole of 12 px", in_room(vec![board(z, 0.1 * z, 12.0 * z / 300.0, -1.0)])));
        worlds.push((
            "two boxes",
            in_room(vec![board(z, -0.3 * z, 0.4, -0.3), board(1.07 * z, 0.2 * z, 0.4, -0.3)]),
        ));
    }
    worlds
}

fn is_far_floor(region: &Region, truth_m: f64) -> bool {
    region.name.as_ref() == "band_30" && (4.9..5.0).contains(&truth_m)
}

#[test]
fn nearest_ranges_are_true_to_two_percent_up_to_four_metres_and_five_up_to_eight() {
    let mut errors = Vec::new();
    for (name, world) in worlds() {
        for region in paper_regions(WIDTH, HEIGHT).expect("large enough") {
            let truth_m = true_range_m(&world, &region);
            if truth_m > 8.0 {
                continue;
            }
            let limit = match name {
                // The last three rows of a floor 5 m away, half a pixel of disparity before what stands on it.
                _ if is_far_floor(&region, truth_m) => 0.11,
                _ if truth_m > 4.0 => 0.05,
                // 12 columns of 20 rows are some ten independent values of 0.25 px: 1 % at 4 m.
                "pole of 12 px" => 0.03,
                _ => 0.02,
            };
            for seed in 0..3 {
                let found = nearest(&world, &region, ORDINARY, seed).expect("a surface");
                let error = found.range_m / truth_m - 1.0;
                assert!(error.abs() <= limit, "{name}, {}: {found:?} instead of {truth_m} m", region.name);
                assert!((0.5..20.0).contains(&(found.sigma_m / (found.range_m.powi(2) * 0.25 / 36.0))));
                errors.push(error);
            }
        }
    }
    let bias = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(errors.len() > 200 && bias.abs() < 0.005, "bias {bias} over {} surfaces", errors.len());
}

#[test]
fn without_flaws_nearest_ranges_are_exact() {
    for (name, world) in worlds() {
        for region in paper_regions(WIDTH, HEIGHT).expect("large enough") {
            let truth_m = true_range_m(&world, &region);
            let found = nearest(&world, &region, NO_FLAWS, 0).expect("a surface");
            // A sixteenth of a pixel is the resolution of the map, and the slope prior may cost another.
            let resolution = if is_far_floor(&region, truth_m) { 0.11 } else { 0.003 + truth_m / 36.0 / 8.0 };
            let error = (found.range_m / truth_m - 1.0).abs();
            assert!(error <= resolution, "{name}, {}: {found:?} instead of {truth_m} m", region.name);
        }
    }
}

#[test]
fn surfaces_go_on_to_the_end_of_the_image_where_windows_are_cut() {
    let geometry = geometry();
    let floor = World { floor_m: Some(0.5), ..World::default() };
    for slope in [1.3, -1.3] {
        let world = World { wall: Some((2.2, slope)), ..World::default() };
        let mut map = disparity_of(&world, &geometry, NO_FLAWS, 0);
        for y in 0..HEIGHT {
            for x in (0..5).chain(WIDTH - 5..WIDTH) {
                map.validity.row_mut(y)[x] = Validity::NOT_UNIQUE;
            }
        }
        let region = Region::new("band", 0, 90, WIDTH, 50);
        let got = &profile(&map, std::slice::from_ref(&region), Some(&geometry), &ProfileParams::default())
            .expect("inside")[0];
        let (found, truth_m) = (got.nearest.expect("the wall"), true_range_m(&world, &region));
        assert!((found.range_m / truth_m - 1.0).abs() < 0.005, "{found:?} instead of {truth_m} m");
        assert!(!(5..WIDTH - 5).contains(&found.at.0), "{found:?} is not in the margin");
    }
    // Of a floor, a window cut at the bottom sees the rows above.
    let mut map = disparity_of(&floor, &geometry, NO_FLAWS, 0);
    for (y, lost) in (HEIGHT - 4..HEIGHT).zip([1, 2, 3, 5]) {
        for value in map.values.row_mut(y) {
            *value -= lost;
        }
    }
    let region = Region::new("band", 0, HEIGHT - 50, WIDTH, 50);
    let got = &profile(&map, std::slice::from_ref(&region), Some(&geometry), &ProfileParams::default())
        .expect("inside")[0];
    let (found, truth_m) = (got.nearest.expect("the floor"), true_range_m(&floor, &region));
    assert!((found.range_m / truth_m - 1.0).abs() < 0.003, "{found:?} instead of {truth_m} m");
}

#[test]
fn mismatches_alone_are_no_surface() {
    let world = World { wall: Some((6.0, 0.0)), ..World::default() };
    let region = Region::new("band", 0, 90, WIDTH, 50);
    for seed in 0..20 {
        let flaws = Flaws { mismatches: 0.08, ..ORDINARY };
        let found = nearest(&world, &region, flaws, seed).expect("the wall");
        assert!((found.range_m / 6.0 - 1.0).abs() < 0.05, "{found:?}");
    }
}

#[test]
fn without_geometry_the_nearest_surface_is_the_largest_disparity() {
    let geometry = geometry();
    let board = Board { z: 2.0, left: -0.2, right: 0.3, top: -1.0, bottom: 1.0 };
    let world = World { boards: vec![board], wall: Some((5.0, 0.0)), ..World::default() };
    let map = disparity_of(&world, &geometry, NO_FLAWS, 0);
    let region = [Region::new("band", 0, 100, WIDTH, 30)];
    let got = &profile(&map, &region, None, &ProfileParams::default()).expect("inside")[0];
    let nearest = got.nearest.expect("the board");
    assert!((nearest.disparity_px - 18.0).abs() < 0.1 && nearest.range_m.is_nan(), "{nearest:?}");
    assert_eq!(got.nearest_range_m, None);
}
