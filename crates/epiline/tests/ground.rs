//! The ground of worlds whose floors, walls, tables and ramps are known.

mod scene;

use epiline::ground::{GroundEstimator, GroundParams, GroundPlane, Mounting, NoGround, find_ground};
use epiline::matching::{DisparityMap, Validity};
use epiline::rectification::RectifiedGeometry;
use nalgebra::Vector3;
use scene::{HEIGHT, Random, WIDTH, geometry};

type Inside = Box<dyn Fn(&Vector3<f64>) -> bool>;

/// A flat patch: points with `normal·P = offset_m` that satisfy `inside`.
struct Patch {
    normal: Vector3<f64>,
    offset_m: f64,
    inside: Inside,
}

impl Patch {
    fn plane(normal: Vector3<f64>, offset_m: f64) -> Self {
        Self { normal, offset_m, inside: Box::new(|_| true) }
    }
}

/// How a camera stands over a floor.
#[derive(Debug, Clone, Copy)]
struct Stance {
    height_m: f64,
    pitch_rad: f64,
    roll_rad: f64,
}

impl Stance {
    /// Straight down, ahead along the floor, and to the right along it, in the camera's frame.
    fn axes(&self) -> [Vector3<f64>; 3] {
        let (sin_pitch, cos_pitch) = self.pitch_rad.sin_cos();
        let (sin_roll, cos_roll) = self.roll_rad.sin_cos();
        let down = Vector3::new(cos_pitch * sin_roll, cos_pitch * cos_roll, sin_pitch);
        let ahead = (Vector3::z() - down * down.z).normalize();
        [down, ahead, down.cross(&ahead)]
    }

    fn floor(&self) -> Patch {
        Patch::plane(self.axes()[0], self.height_m)
    }

    /// A level patch `up_m` over the floor, within some metres ahead and to the right.
    fn shelf(&self, up_m: f64, ahead_m: (f64, f64), right_m: (f64, f64)) -> Patch {
        let [down, ahead, right] = self.axes();
        let inside = move |point: &Vector3<f64>| {
            let within = |value: f64, (low, high): (f64, f64)| low <= value && value <= high;
            within(ahead.dot(point), ahead_m) && within(right.dot(point), right_m)
        };
        Patch { normal: down, offset_m: self.height_m - up_m, inside: Box::new(inside) }
    }

    /// An upright board of some height across the way, within some metres to the right.
    fn board(&self, ahead_m: f64, right_m: (f64, f64), up_m: f64) -> Patch {
        let [down, ahead, right] = self.axes();
        let height_m = self.height_m;
        let inside = move |point: &Vector3<f64>| {
            let to_the_right = right.dot(point);
            right_m.0 <= to_the_right && to_the_right <= right_m.1 && height_m - down.dot(point) <= up_m
        };
        Patch { normal: ahead, offset_m: ahead_m, inside: Box::new(inside) }
    }
}

/// Sees patches: the nearest along each ray, with noise, gaps and mismatches.
fn see(patches: &[Patch], geometry: &RectifiedGeometry, seed: u64) -> DisparityMap {
    let mut random = Random::new(seed);
    let mut map = DisparityMap::new(WIDTH, HEIGHT);
    (map.min_disparity, map.num_disparities) = (0, 128);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let ray = Vector3::new(
                (x as f64 - geometry.cx_px) / geometry.focal_px,
                (y as f64 - geometry.cy_px) / geometry.focal_px,
                1.0,
            );
            let depth = |patch: &Patch| {
                let depth_m = patch.offset_m / patch.normal.dot(&ray);
                (depth_m > 0.05 && (patch.inside)(&(ray * depth_m))).then_some(depth_m)
            };
            let depth_m = patches.iter().filter_map(depth).fold(f64::INFINITY, f64::min);
            // The sum of six uniform numbers is near enough to normal.
            let noise_px = 0.25 * (0..6).map(|_| random.within(-1.0, 1.0)).sum::<f64>() / 2.0_f64.sqrt();
            let seen_px = geometry.disparity_px(depth_m) + noise_px;
            let disparity_px = if random.uniform() < 0.03 { random.within(1.0, 100.0) } else { seen_px };
            let known = depth_m < 60.0 && random.uniform() > 0.2 && (0.0..127.0).contains(&disparity_px);
            map.values.row_mut(y)[x] = (16.0 * disparity_px.max(0.0)).round() as u16;
            map.validity.row_mut(y)[x] = if known { 0 } else { Validity::LOW_TEXTURE };
        }
    }
    map
}

fn ground_of(patches: &[Patch], seed: u64) -> Result<GroundPlane, NoGround> {
    let geometry = geometry();
    find_ground(&see(patches, &geometry, seed), &geometry, &GroundParams::default()).expect("parameters")
}

#[test]
fn poses_are_found_among_clutter_and_their_sigmas_are_honest() {
    let (mut inside, mut looks) = (0, 0);
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let stance = Stance {
            height_m: random.within(0.25, 1.2),
            pitch_rad: random.within(-0.05, 0.5),
            roll_rad: random.within(-0.15, 0.15),
        };
        let mut patches = vec![stance.floor(), stance.board(9.0, (-9.0, 9.0), 3.0)];
        for _ in 0..3 {
            let (ahead_m, left_m) = (random.within(2.0, 5.0), random.within(-2.0, 1.0));
            patches.push(stance.board(ahead_m, (left_m, left_m + 0.8), random.within(0.1, 1.2)));
        }
        let ground = ground_of(&patches, seed).unwrap_or_else(|reason| panic!("{stance:?}: {reason:?}"));
        let errors = [
            (ground.camera_height_m - stance.height_m, ground.camera_height_sigma_m),
            (ground.pitch_rad - stance.pitch_rad, ground.pitch_sigma_rad),
            (ground.roll_rad - stance.roll_rad, ground.roll_sigma_rad),
        ];
        assert!(errors[0].0.abs() < 0.03 * stance.height_m, "{stance:?} {ground:?}");
        assert!(errors[1].0.abs() < 0.012 && errors[2].0.abs() < 0.012, "{stance:?} {ground:?}");
        for (error, sigma) in errors {
            looks += 1;
            inside += usize::from(error.abs() <= 2.0 * sigma);
        }
    }
    assert!(100 * inside >= 85 * looks, "{inside} of {looks} within two sigma");
}

#[test]
fn walls_ceilings_and_nothing_are_no_ground() {
    let wall = |normal: Vector3<f64>| ground_of(&[Patch::plane(normal.normalize(), 2.0)], 1);
    for normal in [
        Vector3::new(0.0, 0.0, 1.0),
        Vector3::new(0.7, 0.0, 1.0),
        Vector3::new(0.3, 0.15, 1.0),
        Vector3::new(1.0, 0.0, 0.3),
    ] {
        assert_eq!(wall(normal), Err(NoGround::NoPlane), "{normal}");
    }
    let ceiling = Patch::plane(Vector3::new(0.0, -1.0, 0.05).normalize(), 1.5);
    assert_eq!(ground_of(&[ceiling], 2), Err(NoGround::NoPlane));
    let nothing = find_ground(&DisparityMap::new(WIDTH, HEIGHT), &geometry(), &GroundParams::default());
    assert_eq!(nothing, Ok(Err(NoGround::TooFewPixels)));
    // The corner of a room, without its floor.
    let walls = [Vector3::new(0.8, 0.0, 1.0), Vector3::new(-0.8, 0.0, 1.0)];
    let corner = walls.map(|normal| Patch::plane(normal.normalize(), 2.0));
    assert_eq!(ground_of(&corner, 3), Err(NoGround::NoPlane));
}

#[test]
fn mismatches_of_a_floor_without_texture_are_no_ground() {
    let geometry = geometry();
    for seed in 0..12 {
        let mut random = Random::new(seed);
        let mut map = DisparityMap::new(WIDTH, HEIGHT);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                // Farther down they can be nearer, as they are where windows see the feet of walls.
                let below_horizon = (y as f64 / HEIGHT as f64 - 0.4).max(0.02);
                map.values.row_mut(y)[x] = (16.0 * random.within(0.2, 1.0) * 60.0 * below_horizon) as u16;
                map.validity.row_mut(y)[x] = if random.uniform() < 0.15 { 0 } else { Validity::LOW_TEXTURE };
            }
        }
        let ground = find_ground(&map, &geometry, &GroundParams::default()).expect("parameters");
        assert!(ground.is_err(), "seed {seed}: {ground:?}");
    }
}

#[test]
fn a_table_top_is_not_taken_for_the_ground() {
    let stance = Stance { height_m: 1.3, pitch_rad: 0.35, roll_rad: 0.0 };
    // It takes the most of the view, but the floor is seen around it.
    for half_m in [0.3, 0.4, 0.6] {
        let table = stance.shelf(0.75, (0.8, 2.2), (-half_m, half_m));
        let patches = [stance.floor(), table, stance.board(6.0, (-5.0, 5.0), 2.5)];
        match ground_of(&patches, 5) {
            Ok(ground) => assert!((ground.camera_height_m - 1.3).abs() < 0.05, "{ground:?}"),
            Err(reason) => assert!(half_m > 0.5, "a table of {half_m} m to each side: {reason:?}"),
        }
    }
}

#[test]
fn a_ramp_ahead_is_ground_and_what_stands_on_it_is_over_it() {
    let stance = Stance { height_m: 0.6, pitch_rad: 0.05, roll_rad: 0.02 };
    let [down, ahead, _] = stance.axes();
    // From 2.5 m on it rises 1 in 12.
    let slope = 1.0_f64 / 12.0;
    let normal = down + ahead * slope;
    let foot_m = 2.5;
    let ramp = Patch {
        normal,
        offset_m: stance.height_m + slope * foot_m,
        inside: Box::new(move |point| ahead.dot(point) >= foot_m),
    };
    let floor = Patch { inside: Box::new(move |point| ahead.dot(point) < foot_m), ..stance.floor() };
    let ground = ground_of(&[floor, ramp], 6).expect("a floor");
    assert!((ground.camera_height_m - 0.6).abs() < 0.03, "{ground:?}");
    let geometry = geometry();
    for z in [1.5, 3.0, 4.0, 5.0] {
        // A point on the ground at that depth, straight ahead.
        let point = |up_m: f64| {
            let ahead_of_camera = ahead * z - down * ((z - foot_m).max(0.0) * slope + up_m - stance.height_m);
            geometry.pixel_of(&ahead_of_camera).expect("in front")
        };
        for up_m in [0.0, 0.3] {
            let [x, y, disparity_px] = point(up_m);
            let got = ground.height_m(x, y, disparity_px);
            assert!((got - up_m).abs() < 0.035, "{up_m} m up at {z} m is {got} m up");
        }
    }
}

#[test]
fn a_frame_that_disagrees_is_passed_over_and_a_new_pose_is_followed() {
    let geometry = geometry();
    let mut estimator = GroundEstimator::new(GroundParams::default()).expect("parameters");
    let mut look = |stance: Option<Stance>, seed: u64| {
        let map = match stance {
            Some(stance) => see(&[stance.floor(), stance.board(8.0, (-9.0, 9.0), 3.0)], &geometry, seed),
            None => DisparityMap::new(WIDTH, HEIGHT),
        };
        estimator.estimate(&map, &geometry).expect("sizes")
    };
    let level = Stance { height_m: 0.6, pitch_rad: 0.1, roll_rad: 0.0 };
    for seed in 0..5 {
        let ground = look(Some(level), seed).expect("a floor");
        assert!((ground.pitch_rad - 0.1).abs() < 0.005, "{ground:?}");
    }
    // Nothing is seen for a while: the last plane is carried on, ever less sure, and then given up.
    let mut sigma_rad = 0.0;
    for seed in 5..10 {
        let ground = look(None, seed).expect("carried on");
        assert!(ground.pitch_sigma_rad > sigma_rad && ground.support_share == 0.0, "{ground:?}");
        sigma_rad = ground.pitch_sigma_rad;
    }
    assert_eq!(look(None, 10), Err(NoGround::TooFewPixels));
    // A camera that nods by 1 degree a frame is followed at once.
    for seed in 0..8 {
        let pitch_rad = 0.1 + 0.0175 * seed as f64;
        let ground = look(Some(Stance { pitch_rad, ..level }), seed).expect("a floor");
        assert!((ground.pitch_rad - pitch_rad).abs() < 0.006, "{ground:?}, {pitch_rad}");
    }
}

#[test]
fn a_ramp_ahead_does_not_tilt_the_plane_under_the_camera() {
    let stance = Stance { height_m: 0.6, pitch_rad: 0.08, roll_rad: -0.02 };
    let [down, ahead, _] = stance.axes();
    for (seed, foot_m) in [2.2, 2.6, 3.0].into_iter().enumerate() {
        for slope in [0.0, 1.0 / 12.0, -1.0 / 12.0] {
            let ramp = Patch {
                normal: down + ahead * slope,
                offset_m: stance.height_m + slope * foot_m,
                inside: Box::new(move |point| ahead.dot(point) >= foot_m),
            };
            let floor = Patch { inside: Box::new(move |point| ahead.dot(point) < foot_m), ..stance.floor() };
            let ground = ground_of(&[floor, ramp], 20 + seed as u64);
            let ground = ground.unwrap_or_else(|reason| panic!("{foot_m} m, {slope}: {reason:?}"));
            let pitch_off_rad = (ground.pitch_rad - stance.pitch_rad).abs();
            assert!(pitch_off_rad < 0.004, "{foot_m} m, {slope}: off by {pitch_off_rad}");
            assert!((ground.camera_height_m - 0.6).abs() < 0.006, "{foot_m} m, {slope}: {ground:?}");
        }
    }
}

/// Frames of one sight after those of another, and what the estimator says of the last.
fn after(sights: [&[Patch]; 2], frames: [u64; 2]) -> [Result<GroundPlane, NoGround>; 2] {
    let geometry = geometry();
    let mut estimator = GroundEstimator::new(GroundParams::default()).expect("parameters");
    let mut seed = 0;
    [0, 1].map(|i| {
        let mut last = Err(NoGround::NotAsked);
        for _ in 0..frames[i] {
            last = estimator.estimate(&see(sights[i], &geometry, seed), &geometry).expect("sizes");
            seed += 1;
        }
        last
    })
}

#[test]
fn a_plane_that_is_followed_is_given_up_for_what_is_there_now() {
    let stance = Stance { height_m: 0.6, pitch_rad: 0.1, roll_rad: 0.0 };
    let floor = [stance.floor(), stance.board(8.0, (-9.0, 9.0), 3.0)];
    let height_m = |ground: &Result<GroundPlane, NoGround>| ground.expect("a floor").camera_height_m;

    // The rig turns to a wall: after the frames a plane is carried on for there is no ground.
    let wall = [Patch::plane(Vector3::new(0.2, 0.0, 1.0).normalize(), 1.5)];
    let [before, now] = after([&floor, &wall], [10, 6]);
    assert!((height_m(&before) - 0.6).abs() < 0.02);
    assert_eq!(now, Err(NoGround::NoPlane));

    // It is lifted: seen at once.
    let lifted = Stance { height_m: 1.2, ..stance };
    let [_, now] = after([&floor, &[lifted.floor()]], [10, 1]);
    assert!((height_m(&now) - 1.2).abs() < 0.04, "{now:?}");

    // It drives onto a ramp of 1 in 12, until it stands on it: ahead it is level again, as seen from there.
    let [_, now] = after([&floor, &[Stance { pitch_rad: 0.1 - 1.0 / 12.0, ..stance }.floor()]], [10, 1]);
    assert!((now.expect("a ramp").pitch_rad - (0.1 - 1.0 / 12.0)).abs() < 0.006, "{now:?}");

    // What it followed was a platform that filled the view, and the floor below it comes in sight.
    let platform = stance.shelf(0.2, (0.0, 60.0), (-60.0, 60.0));
    let beside = stance.shelf(0.2, (0.0, 3.0), (-60.0, -0.3));
    let [before, now] = after([&[platform], &[beside, stance.floor()]], [10, 2]);
    assert!((height_m(&before) - 0.4).abs() < 0.02, "{before:?}");
    assert!((height_m(&now) - 0.6).abs() < 0.03, "{now:?}");
}

#[test]
fn following_is_no_worse_than_looking_afresh() {
    let geometry = geometry();
    let mut estimator = GroundEstimator::new(GroundParams::default()).expect("parameters");
    for seed in 0..30 {
        // It sways by a degree and more.
        let sway = (seed as f64 * 0.7).sin();
        let stance =
            Stance { height_m: 0.6 + 0.01 * sway, pitch_rad: 0.15 + 0.02 * sway, roll_rad: 0.02 * sway };
        let box_m = 2.0 + 0.05 * seed as f64;
        let patches = [
            stance.floor(),
            stance.board(box_m, (-1.2, -0.2), 0.6),
            stance.board(box_m + 1.0, (0.3, 1.0), 0.3),
        ];
        let map = see(&patches, &geometry, seed);
        let followed = estimator.estimate(&map, &geometry).expect("sizes").expect("a floor");
        let afresh = find_ground(&map, &geometry, &GroundParams::default()).expect("parameters");
        let afresh = afresh.expect("a floor");
        assert!((followed.camera_height_m - afresh.camera_height_m).abs() < 0.006, "frame {seed}");
        assert!((followed.pitch_rad - afresh.pitch_rad).abs() < 0.004, "frame {seed}");
        assert!((followed.pitch_rad - stance.pitch_rad).abs() < 0.006, "frame {seed}");
    }
}

#[test]
fn images_of_any_size_are_looked_at() {
    for (width, height) in [(1, 1), (2, 9), (5, 4), (63, 65), (65, 63), (700, 3)] {
        let geometry = RectifiedGeometry::new(width, height, 300.0, 2.0, 1.0, 0.0, 0.12).expect("a rig");
        let mut map = DisparityMap::new(width, height);
        for y in 0..height {
            map.values.row_mut(y).fill(16 * (y as u16 + 1));
            map.validity.row_mut(y).fill(0);
        }
        let mut estimator = GroundEstimator::new(GroundParams::default()).expect("parameters");
        for _ in 0..3 {
            let ground = estimator.estimate(&map, &geometry).expect("sizes");
            assert!(ground.is_err() || width * height > 1000, "{width}x{height}: {ground:?}");
        }
    }
}

#[test]
fn a_mounting_rules_out_other_planes() {
    let stance = Stance { height_m: 0.6, pitch_rad: 0.1, roll_rad: 0.0 };
    let geometry = geometry();
    let map = see(&[stance.floor()], &geometry, 3);
    let with = |camera_height_m| {
        let mounting = Mounting {
            camera_height_m,
            pitch_rad: 0.1,
            roll_rad: 0.0,
            camera_height_sigma_m: 0.02,
            pitch_sigma_rad: 0.02,
            roll_sigma_rad: 0.02,
        };
        let params = GroundParams { mounting: Some(mounting), ..GroundParams::default() };
        find_ground(&map, &geometry, &params).expect("parameters")
    };
    assert!((with(0.61).expect("the floor").camera_height_m - 0.6).abs() < 0.01);
    assert_eq!(with(1.2), Err(NoGround::NoPlane));
}

#[test]
fn bad_parameters_are_named() {
    let good = GroundParams::default();
    let mounting = Mounting {
        camera_height_m: 0.5,
        pitch_rad: 0.0,
        roll_rad: 0.0,
        camera_height_sigma_m: 0.05,
        pitch_sigma_rad: 0.0,
        roll_sigma_rad: 0.02,
    };
    for (params, message) in [
        (GroundParams { camera_height_m: (0.0, 1.0), ..good }, "camera_height_m = (0, 1) m"),
        (GroundParams { pitch_rad: (0.2, -0.2), ..good }, "pitch_rad = (0.2, -0.2) rad"),
        (GroundParams { max_roll_rad: f64::NAN, ..good }, "max_roll_rad = NaN rad"),
        (GroundParams { disparity_sigma_px: -1.0, ..good }, "disparity_sigma_px = -1 px"),
        (GroundParams { mounting: Some(mounting), ..good }, "mounting.pitch_sigma_rad = 0 rad"),
    ] {
        let error = GroundEstimator::new(params).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
    let error = find_ground(&DisparityMap::new(3, 3), &geometry(), &good).expect_err("size").to_string();
    assert!(error.contains("3x3"), "{error}");
}
