//! Obstacles in worlds whose boxes, poles, floor and wall are known.

#[path = "scene/matched.rs"]
mod matched;
mod scene;

use epiline::ground::GroundPlane;
use epiline::matching::DisparityMap;
use epiline::obstacles::{Obstacle, ObstacleFinder, ObstacleMethod, ObstacleParams, find_obstacles};
use epiline::regions::{Region, paper_regions};
use matched::{Flaws, NO_FLAWS, ORDINARY, disparity_of};
use scene::{Board, HEIGHT, Random, WIDTH, World, geometry};

fn whole() -> Vec<Region> {
    vec![Region::whole(WIDTH, HEIGHT)]
}

fn find(world: &World, flaws: Flaws, seed: u64, params: &ObstacleParams) -> Vec<Obstacle> {
    let geometry = geometry();
    let map = disparity_of(world, &geometry, flaws, seed);
    find_obstacles(&map, &geometry, None, &whole(), params).expect("parameters")
}

const NEAR_ROOM: ObstacleParams = ObstacleParams {
    method: ObstacleMethod::UDisparity,
    low_pass_sigma: 3.0,
    brighter_px: 1.0,
    min_support: 8,
    min_columns: 4,
    min_pixels: 64,
    min_height_m: 0.1,
    step_m: 0.05,
    headroom_m: 2.0,
    max_range_m: Some(7.0),
    range_gap_m: 0.3,
    disparity_sigma_px: 0.25,
};

/// Boxes and poles between 1 and 6 m on a floor, none before another, before a wall at 10 m.
fn random_world(seed: u64) -> World {
    let mut random = Random::new(seed);
    let mut boards = Vec::new();
    // Sectors of 76 px keep them apart by more than a few columns.
    for sector in 0..4 {
        if random.uniform() < 0.3 {
            continue;
        }
        let z = random.within(1.0, 6.0);
        let (width_px, top) = if random.uniform() < 0.5 {
            (random.within(20.0, 60.0), random.within(-0.5, 0.2))
        } else {
            (random.within(5.0, 12.0), random.within(-1.0, -0.3))
        };
        let from_px = 4.0 + 80.0 * f64::from(sector) + random.within(0.0, 72.0 - width_px) - 161.3;
        let metres = |px: f64| px * z / 300.0;
        boards.push(Board { z, left: metres(from_px), right: metres(from_px + width_px), top, bottom: 0.5 });
    }
    World { boards, floor_m: Some(0.5), wall: Some((10.0, 0.0)) }
}

/// Columns of the image a board covers.
fn columns(board: &Board) -> (f64, f64) {
    let x = |metres: f64| 161.3 + 300.0 * metres / board.z;
    (x(board.left), x(board.right))
}

fn is(obstacle: &Obstacle, board: &Board) -> bool {
    let (left, right) = columns(board);
    let box_left = obstacle.bounds.x as f64;
    let box_right = box_left + obstacle.bounds.width as f64;
    let overlap = right.min(box_right) - left.max(box_left);
    // 1 px of disparity or 5 %, whichever is more.
    let limit_m = (board.z * board.z / 36.0).max(0.05 * board.z);
    overlap > 0.5 * (right - left).max(box_right - box_left) && (obstacle.depth_m - board.z).abs() < limit_m
}

#[test]
fn boxes_and_poles_are_found_and_nothing_else() {
    let (mut boards, mut found, mut obstacles, mut right) = (0, 0, 0, 0);
    let mut errors = Vec::new();
    for seed in 0..60 {
        let world = random_world(seed);
        let got = find(&world, ORDINARY, seed, &NEAR_ROOM);
        assert!(
            got.is_sorted_by(|a, b| a.range_m <= b.range_m) && got.iter().enumerate().all(|(i, o)| o.id == i)
        );
        boards += world.boards.len();
        found += world.boards.iter().filter(|board| got.iter().any(|o| is(o, board))).count();
        obstacles += got.len();
        for obstacle in &got {
            if let Some(board) = world.boards.iter().find(|board| is(obstacle, board)) {
                right += 1;
                errors.push(obstacle.depth_m / board.z - 1.0);
                let (left, end) = columns(board);
                let x = 161.3 + 300.0 * obstacle.bearing_rad.tan();
                assert!((left - 3.0..=end + 3.0).contains(&x), "{obstacle:?} {board:?}");
                let limit_m = 4.0 * board.z / 300.0 + 0.45 * (board.right - board.left);
                assert!(
                    (obstacle.width_m - (board.right - board.left)).abs() < limit_m,
                    "{obstacle:?} {board:?}"
                );
            } else {
                eprintln!("false, seed {seed}: {obstacle:?} among {:?}", world.boards);
            }
        }
        for board in world.boards.iter().filter(|board| !got.iter().any(|o| is(o, board))) {
            eprintln!("missed, seed {seed}: {board:?} {got:?}");
        }
    }
    let (precision, recall) = (f64::from(right) / obstacles as f64, found as f64 / boards as f64);
    let bias = errors.iter().sum::<f64>() / errors.len() as f64;
    eprintln!("precision {precision} recall {recall} of {boards} boards, bias {bias}");
    assert!(boards > 120);
    // Without a ground a board may come in two pieces, one of which counts here.
    assert!(precision >= 0.95 && recall >= 0.95, "precision {precision} recall {recall} of {boards} boards");
    assert!(bias.abs() < 0.005, "depth is off by {bias} in the mean");
}

#[test]
fn a_floor_is_no_obstacle_however_far_below() {
    let below = |floor_m, wall| World { floor_m: Some(floor_m), wall, ..World::default() };
    assert_eq!(find(&below(0.5, None), ORDINARY, 1, &NEAR_ROOM), []);
    // 2 m above the floor each pixel of disparity holds 16.7 rows, twice what a column must have: they are others.
    for seed in 0..10 {
        for wall in [None, Some((10.0, 0.0))] {
            assert_eq!(find(&below(2.0, wall), ORDINARY, seed, &NEAR_ROOM), [], "seed {seed}, wall {wall:?}");
        }
    }
}

#[test]
fn mismatches_give_birth_to_nothing() {
    let world = World { wall: Some((10.0, 0.0)), ..World::default() };
    for seed in 0..30 {
        let flaws = Flaws { mismatches: 0.05, ..ORDINARY };
        assert_eq!(find(&world, flaws, seed, &NEAR_ROOM), []);
    }
}

#[test]
fn a_gap_in_range_makes_two_and_none_makes_one() {
    let board = |z: f64| Board { z, left: -0.1 * z, right: 0.1 * z, top: -0.2, bottom: 0.4 };
    let behind = |z: f64| Board { z, left: 0.1 * z, right: 0.25 * z, top: -0.2, bottom: 0.4 };
    let pair = |z: f64| World { boards: vec![board(1.0), behind(z)], ..World::default() };
    let count = |world: &World, range_gap_m| {
        find(world, NO_FLAWS, 0, &ObstacleParams { range_gap_m, ..NEAR_ROOM }).len()
    };
    assert_eq!(count(&pair(1.2), 0.1), 2);
    assert_eq!(count(&pair(1.05), 0.3), 1);
    assert_eq!(count(&pair(1.5), 0.3), 2);
}

#[test]
fn low_things_are_left_out_where_all_of_them_is_seen() {
    // 12 rows, 8 cm high.
    let low = Board { z: 2.0, left: -0.2, right: 0.2, top: 0.3, bottom: 0.38 };
    let world = World { boards: vec![low], ..World::default() };
    let count = |min_height_m| find(&world, NO_FLAWS, 0, &ObstacleParams { min_height_m, ..NEAR_ROOM }).len();
    assert_eq!((count(0.1), count(0.06)), (0, 1));
}

#[test]
fn measures_are_those_of_the_board() {
    let board = Board { z: 2.0, left: 0.3, right: 0.8, top: -0.25, bottom: 0.35 };
    let got = find(&World { boards: vec![board], ..World::default() }, NO_FLAWS, 0, &NEAR_ROOM);
    let [obstacle] = &got[..] else { panic!("one board, but {got:?}") };
    let pixel_m = 2.0 / 300.0;
    assert!((obstacle.depth_m - 2.0).abs() < 1e-9, "{obstacle:?}");
    assert!((obstacle.width_m - 0.5).abs() <= pixel_m && (obstacle.height_m - 0.6).abs() <= 4.0 * pixel_m);
    // Its nearest point is its left edge, at the height of the camera.
    assert!((obstacle.bearing_rad - (0.3_f64 / 2.0).atan()).abs() < 1.0 / 300.0);
    assert!((obstacle.range_m - (4.0 + 0.3_f64.powi(2)).sqrt()).abs() < 0.01, "{obstacle:?}");
    // Noise of 75 columns, six of which count as one; what they share; what the outline hides.
    let sigma_px = (0.25 * (6.0_f64 / 75.0).sqrt()).hypot(0.58 * 0.25);
    let sigma_m = (4.0 * sigma_px / 36.0 * obstacle.range_m / 2.0).hypot(0.007 * obstacle.range_m);
    assert!((obstacle.sigma_m / sigma_m - 1.0).abs() < 1e-3, "{obstacle:?}, expected {sigma_m}");
    let bounds = obstacle.bounds;
    assert!((bounds.x as f64 - (161.3 + 45.0)).abs() <= 1.0 && (bounds.width as f64 - 75.0).abs() <= 1.0);
    assert!((bounds.y as f64 - (118.6 - 37.5)).abs() <= 3.0 && (bounds.height as f64 - 90.0).abs() <= 5.0);
    assert_eq!(obstacle.support, 75 * 90, "every pixel of it");
}

#[test]
fn a_receding_wall_is_as_near_as_its_near_end() {
    let world = World { wall: Some((2.0, -0.9)), ..World::default() };
    let got = find(&world, ORDINARY, 3, &ObstacleParams { max_range_m: None, ..NEAR_ROOM });
    let [wall] = &got[..] else { panic!("one wall, but {got:?}") };
    let depth_at = |x: f64| 2.0 / (1.0 + 0.9 * (x - 161.3) / 300.0);
    let nearest_m = depth_at(319.0);
    assert!((nearest_m - 0.01..nearest_m + 0.02).contains(&wall.depth_m), "{wall:?}, nearest {nearest_m} m");
    assert!((depth_at(161.3 + 300.0 * wall.bearing_rad.tan()) - wall.depth_m).abs() < 0.05, "{wall:?}");
}

#[test]
fn an_obstacle_is_told_once_with_all_regions_it_stands_in() {
    let board = Board { z: 2.0, left: -0.2, right: 0.2, top: 0.0, bottom: 0.5 };
    let geometry = geometry();
    let map = disparity_of(&World { boards: vec![board], ..World::default() }, &geometry, NO_FLAWS, 0);
    let bands = paper_regions(WIDTH, HEIGHT).expect("large enough");
    let got = find_obstacles(&map, &geometry, None, &bands, &NEAR_ROOM).expect("parameters");
    let [obstacle] = &got[..] else { panic!("one board, but {got:?}") };
    // Rows 118 to 193.
    let names: Vec<_> = obstacle.regions.iter().map(|name| name.as_ref()).collect();
    assert_eq!(names, ["band_20", "band_30", "band_40", "band_50"]);
    assert_eq!(obstacle.region.as_ref(), "band_20");
    let beside = [Region::new("beside", 0, 0, 100, HEIGHT)];
    assert_eq!(find_obstacles(&map, &geometry, None, &beside, &NEAR_ROOM), Ok(vec![]));
    assert_eq!(find_obstacles(&map, &geometry, None, &[], &NEAR_ROOM), Ok(vec![]));
}

/// The floor of [`geometry`]'s worlds, 0.5 m below a level camera.
fn floor() -> GroundPlane {
    GroundPlane::new(&geometry(), 0.5, 0.0, 0.0)
}

fn find_over_floor(world: &World, flaws: Flaws, seed: u64, params: &ObstacleParams) -> Vec<Obstacle> {
    let geometry = geometry();
    let map = disparity_of(world, &geometry, flaws, seed);
    find_obstacles(&map, &geometry, Some(&floor()), &whole(), params).expect("parameters")
}

#[test]
fn over_a_floor_boxes_poles_and_kerbs_are_found_and_nothing_else() {
    let (mut asked, mut found, mut reports, mut right) = (0, 0, 0, 0);
    let mut errors = Vec::new();
    for seed in 0..60 {
        let mut world = random_world(seed);
        // Every other world has a kerb of 8 cm across a part of its way.
        if seed % 2 == 0 {
            let kerb = Board { z: 1.4, left: -0.3, right: 0.3, top: 0.42, bottom: 0.5 };
            world.boards = vec![kerb];
        }
        let got = find_over_floor(&world, ORDINARY, seed, &NEAR_ROOM);
        asked += world.boards.len();
        found += world.boards.iter().filter(|board| got.iter().any(|o| is(o, board))).count();
        reports += got.len();
        right += got.iter().filter(|o| world.boards.iter().any(|board| is(o, board))).count();
        for obstacle in &got {
            let above_m = obstacle.height_above_ground_m.expect("a ground");
            if let Some(board) = world.boards.iter().find(|board| is(obstacle, board)) {
                errors.push(obstacle.depth_m / board.z - 1.0);
                let limit_m = 3.0 * board.z / 300.0 + 0.02;
                // What the image shows of it.
                let top = board.top.max(-118.6 * board.z / 300.0);
                assert!((above_m - (0.5 - top)).abs() < limit_m, "{obstacle:?} {board:?}");
            }
        }
    }
    let (precision, recall) = (right as f64 / reports as f64, found as f64 / asked as f64);
    assert!(precision >= 0.97 && recall >= 0.95, "precision {precision} recall {recall} of {asked} boards");
    let bias = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(bias.abs() < 0.005, "depth is off by {bias} in the mean");
}

/// Where a floor has little texture, windows give a patch of it one disparity: half of it lies under the ground.
#[test]
fn a_patch_of_floor_at_one_disparity_is_no_kerb() {
    let geometry = geometry();
    let plane_px = |y: usize| (y as f64 - geometry.cy_px) * geometry.baseline_m / 0.5;
    let find = |last_row: usize| {
        let mut map = DisparityMap::new(WIDTH, HEIGHT);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let here_px = if (150..=last_row).contains(&y) && (100..140).contains(&x) {
                    plane_px(158)
                } else {
                    plane_px(y).max(0.0)
                };
                map.values.row_mut(y)[x] = (16.0 * here_px).round() as u16;
                map.validity.row_mut(y)[x] = u8::from(here_px <= 0.0);
            }
        }
        find_obstacles(&map, &geometry, Some(&floor()), &whole(), &NEAR_ROOM).expect("parameters")
    };
    assert_eq!(find(166), []);
    let got = find(158);
    let [kerb] = &got[..] else { panic!("a kerb, but {got:?}") };
    assert!((kerb.depth_m - 36.0 / plane_px(158)).abs() < 0.02, "{kerb:?}");
}

#[test]
fn the_floor_is_no_obstacle_however_high_the_camera() {
    let geometry = geometry();
    for below_m in [0.3, 1.0, 2.0, 3.0] {
        let world = World { floor_m: Some(below_m), ..World::default() };
        let map = disparity_of(&world, &geometry, ORDINARY, 4);
        let ground = GroundPlane::new(&geometry, below_m, 0.0, 0.0);
        assert_eq!(find_obstacles(&map, &geometry, Some(&ground), &whole(), &NEAR_ROOM), Ok(vec![]));
    }
}

#[test]
fn what_hangs_higher_than_the_headroom_can_be_passed_under() {
    // A beam from 1.1 m to 1.4 m over the floor.
    let beam = Board { z: 3.0, left: -1.0, right: 1.0, top: -0.9, bottom: -0.6 };
    let world = World { boards: vec![beam], floor_m: Some(0.5), ..World::default() };
    let count =
        |headroom_m| find_over_floor(&world, NO_FLAWS, 0, &ObstacleParams { headroom_m, ..NEAR_ROOM }).len();
    assert_eq!((count(2.0), count(1.0)), (1, 0));
}

#[test]
fn a_step_that_can_be_driven_over_is_no_obstacle() {
    let kerb = Board { z: 1.4, left: -0.3, right: 0.3, top: 0.42, bottom: 0.5 };
    let world = World { boards: vec![kerb], floor_m: Some(0.5), ..World::default() };
    let count = |step_m| find_over_floor(&world, NO_FLAWS, 0, &ObstacleParams { step_m, ..NEAR_ROOM }).len();
    assert_eq!((count(0.05), count(0.12)), (1, 0));
}

#[test]
fn two_faces_of_a_box_are_one_and_a_box_beside_a_wall_is_not_the_wall() {
    let geometry = geometry();
    // Outlines of disparity over columns, 120 rows high, before nothing.
    let map_of = |outline: &dyn Fn(usize) -> f64| {
        let mut map = DisparityMap::new(WIDTH, HEIGHT);
        for y in 60..180 {
            for x in 0..WIDTH {
                map.values.row_mut(y)[x] = (16.0 * outline(x)).round() as u16;
                map.validity.row_mut(y)[x] = u8::from(outline(x) <= 0.0);
            }
        }
        map
    };
    let find = |outline: &dyn Fn(usize) -> f64| {
        find_obstacles(&map_of(outline), &geometry, None, &whole(), &NEAR_ROOM).expect("parameters")
    };
    // Corner on: 15 px at its edge, column 160, and 0.05 px less per column to both sides.
    let corner_on =
        |x: usize| if (120..200).contains(&x) { 15.0 - 0.05 * x.abs_diff(160) as f64 } else { 0.0 };
    let got = find(&corner_on);
    let [box_] = &got[..] else { panic!("one box, but {got:?}") };
    assert!((box_.depth_m - 36.0 / 15.0).abs() < 0.003 * box_.depth_m, "{box_:?}");
    assert!((box_.bearing_rad - geometry.bearing_rad(160.0)).abs() < 2.0 / 300.0);
    // A wall that recedes to the right until, at column 150, a box stands out of it square on.
    let beside = |x: usize| match x {
        0..150 => 20.0 - 0.08 * x as f64,
        150..200 => 8.0,
        _ => 0.0,
    };
    let got = find(&beside);
    let [wall, box_] = &got[..] else { panic!("a wall and a box, but {got:?}") };
    assert!((wall.depth_m - 36.0 / 20.0).abs() < 0.01, "{wall:?}");
    assert!((box_.depth_m - 36.0 / 8.0).abs() < 0.03 && box_.bounds.x.abs_diff(150) <= 3, "{box_:?}");
}

/// A rail that leads from the camera up to a wall stands before it in every column, and hides it in none.
#[test]
fn what_stands_behind_something_that_leads_to_it_is_found_too() {
    let geometry = geometry();
    let rail_px = |x: usize| 24.0 - 0.08 * (x - 60) as f64;
    let mut map = DisparityMap::new(WIDTH, HEIGHT);
    for x in 60..260 {
        for y in 60..180 {
            let disparity_px = if y < 150 { 8.0 } else { rail_px(x) };
            map.values.row_mut(y)[x] = (16.0 * disparity_px).round() as u16;
            map.validity.row_mut(y)[x] = 0;
        }
    }
    let got = find_obstacles(&map, &geometry, None, &whole(), &NEAR_ROOM).expect("parameters");
    let at = |depth_m: f64| got.iter().find(|o| (o.depth_m / depth_m - 1.0).abs() < 0.02);
    let wall = at(36.0 / 8.0).unwrap_or_else(|| panic!("no wall among {got:?}"));
    assert!(wall.bounds.width > 150, "{wall:?}");
    assert!(at(36.0 / 24.0).is_some(), "no rail among {got:?}");
}

/// A floor 0.5 m below the camera, of which the columns `100..220` are seen with the depths that `depth_m` gives for
/// rows below the horizon, and the others with those of the plane.
fn floor_that(depth_m: impl Fn(f64) -> f64) -> Vec<Obstacle> {
    let geometry = geometry();
    let mut map = DisparityMap::new(WIDTH, HEIGHT);
    for y in 125..HEIGHT {
        let fall = (y as f64 - geometry.cy_px) / geometry.focal_px;
        for x in 0..WIDTH {
            let depth_m = if (100..220).contains(&x) { depth_m(fall) } else { 0.5 / fall };
            map.values.row_mut(y)[x] = (16.0 * 36.0 / depth_m).round() as u16;
            map.validity.row_mut(y)[x] = 0;
        }
    }
    let ground = GroundPlane::new(&geometry, 0.5, 0.0, 0.0);
    find_obstacles(&map, &geometry, Some(&ground), &whole(), &NEAR_ROOM).expect("parameters")
}

#[test]
fn ground_that_slopes_is_no_obstacle_and_a_step_as_high_is() {
    // From 1.5 m on it rises by 4 cm per metre: by 14 cm at 5 m.
    let sloping = |fall: f64| (0.5 / fall).min(0.56 / (fall + 0.04));
    assert_eq!(floor_that(sloping), []);
    // A step of 10 cm at 2.5 m.
    let step = |fall: f64| if 0.5 / fall < 2.5 { 0.5 / fall } else { (0.4 / fall).max(2.5) };
    let got = floor_that(step);
    let Some(kerb) = got.first() else { panic!("no step") };
    assert!((kerb.depth_m - 2.5).abs() < 0.1 && kerb.bounds.width > 100, "{got:?}");
}

#[test]
fn the_papers_method_clusters_what_is_brighter_than_around() {
    let params = ObstacleParams { method: ObstacleMethod::Paper, ..NEAR_ROOM };
    let near = Board { z: 2.0, left: -0.6, right: -0.3, top: -0.3, bottom: 0.3 };
    let far = Board { z: 3.0, left: 0.5, right: 0.9, top: -0.3, bottom: 0.4 };
    let world = World { boards: vec![near, far], wall: Some((6.0, 0.0)), ..World::default() };
    let got = find(&world, NO_FLAWS, 0, &params);
    let [one, other] = &got[..] else { panic!("two boards, but {got:?}") };
    assert!(is(one, &near) && is(other, &far), "{got:?}");
    assert!((one.height_m - 0.6).abs() < 0.03 && (one.width_m - 0.3).abs() < 0.02, "{one:?}");
    assert_eq!(one.height_above_ground_m, None);
    // The wall alone is as bright as its neighbourhood.
    let wall = World { wall: Some((6.0, 0.0)), ..World::default() };
    assert_eq!(find(&wall, NO_FLAWS, 0, &params), []);
}

#[test]
fn a_warm_finder_forgets_the_frame_before() {
    let geometry = geometry();
    let mut finder = ObstacleFinder::default();
    let mut warm = Vec::new();
    for seed in [3, 4, 3] {
        let map = disparity_of(&random_world(seed), &geometry, ORDINARY, seed);
        finder.find(&map, &geometry, None, &whole(), &NEAR_ROOM, &mut warm).expect("parameters");
        assert_eq!(warm, find_obstacles(&map, &geometry, None, &whole(), &NEAR_ROOM).expect("parameters"));
    }
    let empty = DisparityMap::new(WIDTH, HEIGHT);
    finder.find(&empty, &geometry, None, &whole(), &NEAR_ROOM, &mut warm).expect("parameters");
    assert_eq!(warm, []);
}

#[test]
fn bad_parameters_are_named() {
    let geometry = geometry();
    let map = DisparityMap::new(WIDTH, HEIGHT);
    let bad = [
        (ObstacleParams { min_support: 0, ..NEAR_ROOM }, "min_support = 0 px"),
        (ObstacleParams { min_columns: 20_000, ..NEAR_ROOM }, "min_columns = 20000 px"),
        (ObstacleParams { max_range_m: Some(-1.0), ..NEAR_ROOM }, "max_range_m = -1 m"),
        (ObstacleParams { range_gap_m: f64::NAN, ..NEAR_ROOM }, "range_gap_m = NaN m"),
        (ObstacleParams { min_height_m: -0.5, ..NEAR_ROOM }, "min_height_m = -0.5 m"),
        (ObstacleParams { step_m: -0.1, ..NEAR_ROOM }, "step_m = -0.1 m"),
        (ObstacleParams { headroom_m: 0.05, ..NEAR_ROOM }, "headroom_m = 0.05 m"),
        (ObstacleParams { low_pass_sigma: 0.0, ..NEAR_ROOM }, "low_pass_sigma = 0 frequency samples"),
        (ObstacleParams { brighter_px: f64::NAN, ..NEAR_ROOM }, "brighter_px = NaN px"),
        (ObstacleParams { min_pixels: 2_000_000, ..NEAR_ROOM }, "min_pixels = 2000000 px"),
        (ObstacleParams { disparity_sigma_px: -0.1, ..NEAR_ROOM }, "disparity_sigma_px = -0.1 px"),
    ];
    for (params, message) in bad {
        let error = find_obstacles(&map, &geometry, None, &whole(), &params).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
    let outside = [Region::new("out", 0, 0, WIDTH + 1, 3)];
    let error = find_obstacles(&map, &geometry, None, &outside, &NEAR_ROOM).expect_err("outside").to_string();
    assert!(error.contains("'out'"), "{error}");
    let error = find_obstacles(&DisparityMap::new(3, 3), &geometry, None, &[], &NEAR_ROOM)
        .expect_err("size")
        .to_string();
    assert!(error.contains("3x3"), "{error}");
}
