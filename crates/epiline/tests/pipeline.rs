//! The pipeline against its stages called one by one, and how little it allocates once warm.

mod allocations;
mod scene;

use allocations::allocations;
use epiline::camera::{Brown, CameraModel, Pose, StereoCalibration};
use epiline::ground::{GroundParams, find_ground};
use epiline::image::{Image, StereoPair};
use epiline::matching::{DisparityMap, MatcherParams, StereoMatcher};
use epiline::obstacles::{ObstacleParams, find_obstacles};
use epiline::pipeline::{FrameResult, Pipeline, PipelineParams};
use epiline::preprocess::equalize_histogram;
use epiline::range::{RangeImage, to_range};
use epiline::rectification::{AlignmentMeter, AlignmentOptions, RectifiedGeometry, Rectifier};
use epiline::regions::{ProfileParams, Region, paper_regions, profile};
use epiline::scan::{Scan, ScanParams, Scanner};
use epiline::tracking::{Detection, TrackParams, Tracker};
use nalgebra::{Rotation3, Vector3};
use scene::{Board, HEIGHT, Random, WIDTH, World, geometry};

/// A textured view of a world from both cameras, each pixel of the right one looked up in the left one.
fn photograph(world: &World, geometry: &RectifiedGeometry, seed: u64) -> [Image<u8>; 2] {
    let mut random = Random::new(seed);
    let noise = Image::from_fn(WIDTH, HEIGHT, |_, _| random.within(0.0, 256.0) as u8);
    let left = Image::from_fn(WIDTH, HEIGHT, |x, y| {
        let near = |i: usize, limit: usize| i.saturating_sub(1)..=(i + 1).min(limit - 1);
        let around: Vec<u32> = near(y, HEIGHT)
            .flat_map(|j| near(x, WIDTH).map(move |i| (i, j)))
            .map(|(i, j)| u32::from(noise.row(j)[i]))
            .collect();
        (around.iter().sum::<u32>() / around.len() as u32) as u8
    });
    let mut right = noise;
    for y in 0..HEIGHT {
        // From far to near, so that the near hides the far.
        let mut columns: Vec<_> = (0..WIDTH).map(|x| (world.depth_m(geometry, x, y), x)).collect();
        columns.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (depth_m, x) in columns {
            let shift = geometry.disparity_px(depth_m).round() as usize;
            if x >= shift {
                right.row_mut(y)[x - shift] = left.row(y)[x];
            }
        }
    }
    [left, right]
}

fn world() -> World {
    let board = Board { z: 2.0, left: -0.2, right: 0.3, top: -0.2, bottom: 0.5 };
    World { boards: vec![board], floor_m: Some(0.5), wall: Some((6.0, 0.0)) }
}

fn pair(images: &[Image<u8>; 2]) -> StereoPair<'_> {
    StereoPair {
        seq: 17,
        left_stamp_nanos: 1_000,
        right_stamp_nanos: 1_002,
        ..StereoPair::new(images[0].view(), images[1].view()).expect("one size")
    }
}

fn params() -> PipelineParams {
    let matcher = MatcherParams {
        num_disparities: 48,
        block_size: 9,
        uniqueness_ratio: 10,
        left_right_max_diff: Some(1),
        speckle_size: 80,
        threads: Some(1),
        ..MatcherParams::default()
    };
    let obstacles = ObstacleParams { max_range_m: Some(5.0), ..ObstacleParams::default() };
    PipelineParams { matcher, obstacles, disparity_sigma_px: 0.3, ..PipelineParams::for_width(WIDTH) }
}

fn regions() -> Vec<Region> {
    paper_regions(WIDTH, HEIGHT).expect("large enough")
}

/// A rig whose cameras look slightly apart through bent lenses.
fn calibration() -> StereoCalibration {
    let camera = |cx: f64| CameraModel {
        focal_px: [300.0, 301.0],
        center_px: [cx, 119.0],
        lens: Brown { k1: -0.12, k2: 0.03, ..Brown::default() }.into(),
        width: WIDTH,
        height: HEIGHT,
    };
    let pose = Pose {
        rotation: Rotation3::from_scaled_axis(Vector3::new(0.01, -0.008, 0.012)).into_inner(),
        translation_m: Vector3::new(-0.12, 0.002, 0.001),
    };
    StereoCalibration::new(camera(160.0), camera(158.0), pose).expect("a rig")
}

/// Everything in a result but the times, as text: NaN equals itself there.
fn content(result: &FrameResult) -> String {
    let FrameResult { seq, left, right, disparity, range, profiles, ground, obstacles, tracks, scan, .. } =
        result;
    let alignment = &result.alignment;
    format!(
        "{seq} {left:?} {right:?} {disparity:?} {range:?} {profiles:?} {ground:?} {obstacles:?} {tracks:?} {scan:?} {alignment:?}"
    )
}

#[test]
fn aligned_pairs_pass_through_every_stage() {
    let geometry = geometry();
    let images = photograph(&world(), &geometry, 1);
    let params = params();
    let mut pipeline = Pipeline::for_aligned(geometry, regions(), params).expect("parameters");
    let got = pipeline.process(pair(&images)).expect("sizes agree");

    let (left, right) = (images[0].view(), images[1].view());
    let mut disparity = DisparityMap::default();
    StereoMatcher::new(params.matcher)
        .and_then(|mut m| m.compute(left, right, &mut disparity))
        .expect("matches");
    let mut range = RangeImage::new(&geometry);
    to_range(&disparity, &geometry, 0.3, &mut range).expect("one size");
    let reading = ProfileParams { disparity_sigma_px: 0.3, ..params.profile };
    let profiles = profile(&disparity, &regions(), Some(&geometry), &reading).expect("inside");
    let finding = ObstacleParams { disparity_sigma_px: 0.3, ..params.obstacles };
    let looking = GroundParams { disparity_sigma_px: 0.3, ..GroundParams::default() };
    let ground = find_ground(&disparity, &geometry, &looking).expect("parameters");
    let plane = ground.as_ref().ok();
    let obstacles = find_obstacles(&disparity, &geometry, plane, &regions(), &finding).expect("parameters");
    let mut tracks = Vec::new();
    Tracker::new(TrackParams::default())
        .and_then(|mut t| t.update(obstacles.iter().map(Detection::from), 1_000, None, &mut tracks))
        .expect("parameters");
    let mut scan = Scan::default();
    let scanning = ScanParams { disparity_sigma_px: 0.3, ..ScanParams::default() };
    Scanner::default().scan(&disparity, &geometry, plane, None, &scanning, &mut scan).expect("parameters");
    let options = AlignmentOptions { num_disparities: 48, ..AlignmentOptions::default() };
    let mut meter = AlignmentMeter::new(options).expect("options");
    let alignment = meter.measure(left, right, None, None).expect("one size").clone();
    assert!(obstacles.iter().any(|o| (o.depth_m - 2.0).abs() < 0.05), "the board: {obstacles:?}");
    assert!((plane.expect("the floor").camera_height_m - 0.5).abs() < 0.02, "{ground:?}");
    assert!(!tracks.is_empty() && !scan.is_empty());
    assert!(alignment.median_px < 0.1, "{alignment:?}");
    let expected = FrameResult {
        seq: 17,
        left_stamp_nanos: 1_000,
        right_stamp_nanos: 1_002,
        left: images[0].clone(),
        right: images[1].clone(),
        disparity,
        range,
        profiles,
        ground,
        obstacles,
        tracks,
        scan,
        alignment: Some(alignment),
        ..got.clone()
    };
    assert_eq!((got.seq, got.left_stamp_nanos, got.right_stamp_nanos), (17, 1_000, 1_002));
    assert!(content(got) == content(&expected), "the pipeline's stages differ from the stages");
    assert!(got.times.total >= got.times.matching);
}

#[test]
fn raw_pairs_are_equalised_and_rectified_first() {
    let images = photograph(&world(), &geometry(), 2);
    let calibration = calibration();
    let params = PipelineParams { equalize: true, alignment: false, ..params() };
    let mut pipeline = Pipeline::for_cameras(&calibration, regions(), params).expect("parameters");
    let got = pipeline.process(pair(&images)).expect("sizes agree").clone();

    let rectifier = Rectifier::new(&calibration).expect("a rig");
    let [mut left, mut right, mut equalized] = [Image::default(), Image::default(), Image::default()];
    equalize_histogram(images[0].view(), &mut equalized);
    rectifier.rectify_left(equalized.view(), &mut left).expect("size");
    equalize_histogram(images[1].view(), &mut equalized);
    rectifier.rectify_right(equalized.view(), &mut right).expect("size");
    let mut disparity = DisparityMap::default();
    let (left_valid, right_valid) = (Some(rectifier.left_valid()), Some(rectifier.right_valid()));
    StereoMatcher::new(params.matcher)
        .and_then(|mut m| {
            m.compute_masked(left.view(), right.view(), left_valid, right_valid, &mut disparity)
        })
        .expect("matches");
    assert_eq!((&got.left, &got.right, &got.disparity), (&left, &right, &disparity));
    assert_eq!(
        got.valid[0].view().rows().flatten().collect::<Vec<_>>(),
        rectifier.left_valid().rows().flatten().collect::<Vec<_>>()
    );
    assert_eq!(got.alignment, None);
    assert_eq!(pipeline.geometry(), rectifier.geometry());
}

#[test]
fn frames_do_not_remember_each_other() {
    let geometry = geometry();
    // The ground and tracks are meant to remember.
    let params = || PipelineParams { ground: None, tracks: None, ..params() };
    let mut warm = Pipeline::for_aligned(geometry, regions(), params()).expect("parameters");
    for seed in [1, 2, 1] {
        let images = photograph(&world(), &geometry, seed);
        let mut fresh = Pipeline::for_aligned(geometry, regions(), params()).expect("parameters");
        let expected = content(fresh.process(pair(&images)).expect("sizes agree"));
        assert!(
            content(warm.process(pair(&images)).expect("sizes agree")) == expected,
            "frame of seed {seed}"
        );
    }
}

#[test]
fn a_warm_pipeline_does_not_allocate() {
    let geometry = geometry();
    let images = photograph(&world(), &geometry, 1);
    let raw = Pipeline::for_cameras(&calibration(), regions(), PipelineParams { equalize: true, ..params() });
    for mut pipeline in
        [Pipeline::for_aligned(geometry, regions(), params()), raw].map(|p| p.expect("parameters"))
    {
        for _ in 0..2 {
            pipeline.process(pair(&images)).expect("sizes agree");
        }
        let warm = || {
            pipeline.process(pair(&images)).expect("sizes agree");
        };
        assert_eq!(allocations(warm), 0, "allocations in a warm frame");
    }
}

#[test]
fn only_regions_are_matched_where_nothing_else_is_asked_for() {
    let geometry = geometry();
    let images = photograph(&world(), &geometry, 1);
    let all = vec![Region::new("middle", 60, 90, 200, 60)];
    let process = |only_regions| {
        let params = PipelineParams { only_regions, ..params() };
        let mut pipeline = Pipeline::for_aligned(geometry, all.clone(), params).expect("parameters");
        pipeline.process(pair(&images)).expect("sizes agree").clone()
    };
    let (whole, only) = (process(false), process(true));
    assert_eq!(format!("{:?}", only.profiles), format!("{:?}", whole.profiles));
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let inside = (60..260).contains(&x) && (90..150).contains(&y);
            assert_eq!(only.disparity.at(x, y), whole.disparity.at(x, y).filter(|_| inside), "({x}, {y})");
        }
    }
    let nowhere = PipelineParams { only_regions: true, ..params() };
    let error = Pipeline::for_aligned(geometry, vec![], nowhere).expect_err("no region").to_string();
    assert!(error.contains("only_regions = true"), "{error}");
}

#[test]
fn a_refused_pair_does_not_spoil_the_next() {
    let geometry = geometry();
    let images = photograph(&world(), &geometry, 1);
    let mut pipeline = Pipeline::for_aligned(geometry, regions(), params()).expect("parameters");
    let small = Image::new(100, 50);
    let refused = StereoPair::new(small.view(), small.view()).expect("one size");
    let error = pipeline.process(refused).expect_err("another size").to_string();
    assert!(error.contains("100x50") && error.contains("320x240"), "{error}");
    assert!(!pipeline.process(pair(&images)).expect("sizes agree").obstacles.is_empty());
}

#[test]
fn bad_parameters_are_refused_at_once() {
    let geometry = geometry();
    let refuse = |regions, params, message: &str| {
        let error = Pipeline::for_aligned(geometry, regions, params).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    };
    refuse(vec![Region::new("low", 0, 230, 320, 11)], params(), "'low'");
    refuse(vec![], PipelineParams { disparity_sigma_px: -1.0, ..params() }, "disparity_sigma_px = -1 px");
    let profile = ProfileParams { min_support: 0, ..ProfileParams::default() };
    refuse(vec![], PipelineParams { profile, ..params() }, "min_support");
}
