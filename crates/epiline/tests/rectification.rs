//! The aligned views of synthetic rigs against projection written out in double precision.

use epiline::Error;
use epiline::camera::{Brown, CameraModel, KannalaBrandt, Lens, Pose, StereoCalibration};
use epiline::image::{Image, ImageRef};
use epiline::rectification::{Projection, RectifiedGeometry, Rectifier, RectifierOptions, Remap, Scale};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use proptest::prelude::*;

const LENS: Brown = Brown { k1: -0.32, k2: 0.12, p1: 8e-4, p2: -6e-4, k3: 0.0 };

fn camera(width: usize, height: usize, lens: Brown) -> CameraModel {
    let (w, h) = (width as f64, height as f64);
    CameraModel {
        focal_px: [0.83 * w, 0.84 * w],
        center_px: [0.49 * w, 0.52 * h],
        lens: lens.into(),
        width,
        height,
    }
}

/// A 12 cm rig whose right camera is turned by a rotation vector given in degrees.
fn rig(size: [usize; 2], lenses: [Brown; 2], degrees: [f64; 3]) -> StereoCalibration {
    let rotation = Rotation3::from_scaled_axis(Vector3::from(degrees.map(f64::to_radians))).into_inner();
    let mut right = camera(size[0], size[1], lenses[1]);
    right.center_px[1] += 4.0;
    right.focal_px[0] *= 1.01;
    let pose = Pose { rotation, translation_m: rotation * Vector3::new(-0.12, 0.003, -0.002) };
    StereoCalibration::new(camera(size[0], size[1], lenses[0]), right, pose).expect("an ordinary rig")
}

/// Two equal cameras without distortion, side by side: nothing to align.
fn aligned_rig(width: usize, height: usize) -> StereoCalibration {
    let camera = CameraModel {
        focal_px: [100.0, 100.0],
        center_px: [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0],
        lens: Brown::default().into(),
        width,
        height,
    };
    let pose = Pose { rotation: Matrix3::identity(), translation_m: Vector3::new(-0.1, 0.0, 0.0) };
    StereoCalibration::new(camera, camera, pose).expect("an ordinary rig")
}

fn rectified(rectifier: &Rectifier, sources: [&Image<u8>; 2]) -> [Image<u8>; 2] {
    let mut aligned = [Image::default(), Image::default()];
    rectifier.rectify_left(sources[0].view(), &mut aligned[0]).expect("sizes agree");
    rectifier.rectify_right(sources[1].view(), &mut aligned[1]).expect("sizes agree");
    aligned
}

/// Rotations from the aligned frame into both cameras, from the geometry and the rig alone.
fn cameras_from_aligned(calibration: &StereoCalibration, geometry: &RectifiedGeometry) -> [Matrix3<f64>; 2] {
    let left = geometry.aligned_from_left.transpose();
    [left, calibration.right_from_left.rotation * left]
}

/// Where the aligned pixel (x, y) comes from; nowhere beyond the radius² at which the lens model folds.
fn source_px(
    camera: &CameraModel,
    camera_from_aligned: &Matrix3<f64>,
    geometry: &RectifiedGeometry,
    fold_r2: f64,
    [x, y]: [usize; 2],
) -> Option<Vector2<f64>> {
    let ray = Vector3::new(
        (x as f64 - geometry.cx_px) / geometry.focal_px,
        (y as f64 - geometry.cy_px) / geometry.focal_px,
        1.0,
    );
    let ray = camera_from_aligned * ray;
    let unfolded = (ray.xy() / ray.z).norm_squared() < fold_r2;
    (ray.z > 0.0 && unfolded).then(|| camera.project(ray).expect("in front"))
}

/// A dark image with a bright spot, as a Gaussian of 2.2 px, at each position.
fn spots(width: usize, height: usize, positions: &[Vector2<f64>]) -> Image<u8> {
    Image::from_fn(width, height, |x, y| {
        let at = Vector2::new(x as f64, y as f64);
        let level: f64 = positions.iter().map(|p| (-(at - p).norm_squared() / (2.0 * 2.2 * 2.2)).exp()).sum();
        (230.0 * level).round() as u8
    })
}

/// Centre of mass of the spot near a position.
fn centroid(image: &Image<u8>, near: Vector2<f64>) -> Vector2<f64> {
    let (mut sum, mut mass) = (Vector2::zeros(), 0.0);
    for y in near.y as usize - 9..=near.y as usize + 10 {
        for x in near.x as usize - 9..=near.x as usize + 10 {
            // Without the tail, whose levels of 0 and 1 are mostly rounding.
            let level = f64::from(image.row(y)[x].saturating_sub(20));
            sum += level * Vector2::new(x as f64, y as f64);
            mass += level;
        }
    }
    sum / mass
}

#[test]
fn corners_of_a_board_lie_on_one_row_at_the_disparity_of_their_depth() {
    for degrees in [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -2.0], [-2.0, -2.0, 2.0]] {
        let calibration = rig([640, 480], [LENS, Brown { k1: -0.29, ..LENS }], degrees);
        let rectifier = Rectifier::new(&calibration).expect("an ordinary rig");
        let geometry = rectifier.geometry();
        assert_eq!((geometry.width, geometry.height, geometry.doffs_px), (640, 480, 0.0));
        assert!((geometry.baseline_m - calibration.baseline_m()).abs() < 1e-12);

        // A tilted 6x4 board 0.9 m ahead, in the left camera's frame.
        let tilt = Rotation3::from_euler_angles(0.3, -0.25, 0.1);
        let corners: Vec<Vector3<f64>> = (0..24)
            .map(|i| {
                let on_board = Vector3::new(f64::from(i % 6) - 2.5, f64::from(i / 6) - 1.5, 0.0) * 0.1;
                tilt * on_board + Vector3::new(0.06, 0.01, 0.9)
            })
            .collect();
        let seen = |camera: &CameraModel, pose: &dyn Fn(Vector3<f64>) -> Vector3<f64>| -> Vec<Vector2<f64>> {
            corners.iter().map(|&corner| camera.project(pose(corner)).expect("in front")).collect()
        };
        let left = spots(640, 480, &seen(&calibration.left, &|p| p));
        let right = spots(640, 480, &seen(&calibration.right, &|p| calibration.right_from_left.apply(p)));
        let [left, right] = rectified(&rectifier, [&left, &right]);

        for &corner in &corners {
            let aligned = geometry.aligned_from_left * corner;
            let expected =
                geometry.focal_px * aligned.xy() / aligned.z + Vector2::new(geometry.cx_px, geometry.cy_px);
            let disparity_px = geometry.disparity_px(aligned.z);
            let in_left = centroid(&left, expected);
            let in_right = centroid(&right, expected - Vector2::new(disparity_px, 0.0));
            assert!((in_left.y - in_right.y).abs() < 0.02, "rows {in_left:?} {in_right:?} for {degrees:?}");
            let disparity_error = in_left.x - in_right.x - disparity_px;
            assert!(disparity_error.abs() < 0.03, "off by {disparity_error} px for {degrees:?}");
            assert!((in_left - expected).norm() < 0.03, "{in_left:?} is not {expected:?} for {degrees:?}");
        }
    }
}

#[test]
fn pixels_are_the_source_at_the_mapped_position_and_masks_say_where_there_is_one() {
    let smooth = |at: Vector2<f64>| 127.0 + 60.0 * (at.x / 17.0).sin() + 50.0 * (at.y / 23.0 + 0.4).cos();
    // The radius grows while 1 + 3 k1 r² + 5 k2 r⁴ > 0: to the end with LENS, to r² = 1/(3·0.45) with k1 = -0.45.
    let lenses = [
        ([161, 119], LENS, f64::INFINITY),
        ([160, 120], Brown { k1: -0.45, ..Brown::default() }, 1.0 / 1.35),
        ([97, 140], Brown::default(), f64::INFINITY),
    ];
    for (size, lens, fold_r2) in lenses {
        for degrees in [[2.0, 0.0, 0.0], [0.0, -2.0, 0.0], [0.0, 0.0, 2.0], [-1.5, 1.0, -2.0]] {
            let calibration = rig(size, [lens, lens], degrees);
            // Wider than the cameras, so that all four borders and the fold of the lens are in view.
            let options = RectifierOptions {
                size: Some((size[0] + 61, size[1] + 62)),
                scale: Scale::Focal(0.6 * size[0] as f64),
                ..RectifierOptions::default()
            };
            let rectifier = Rectifier::with_options(&calibration, options).expect("an ordinary rig");
            let geometry = rectifier.geometry();
            let source = Image::from_fn(size[0], size[1], |x, y| {
                smooth(Vector2::new(x as f64, y as f64)).round() as u8
            });
            let aligned = rectified(&rectifier, [&source, &source]);
            let turns = cameras_from_aligned(&calibration, geometry);
            let masks = [rectifier.left_valid(), rectifier.right_valid()];
            for (side, camera) in [&calibration.left, &calibration.right].into_iter().enumerate() {
                let mut without_source = 0;
                for (y, row) in aligned[side].view().rows().enumerate() {
                    for (x, &value) in row.iter().enumerate() {
                        let from = source_px(camera, &turns[side], geometry, fold_r2, [x, y]);
                        let inside = |v: f64, len: usize| {
                            (0.0..=(len - 1) as f64).contains(&((v * 256.0).round() / 256.0))
                        };
                        let from = from.filter(|p| inside(p.x, size[0]) && inside(p.y, size[1]));
                        let mask = if from.is_some() { 255 } else { 0 };
                        assert_eq!(masks[side].at(x, y), mask, "mask {side} at ({x}, {y}) from {from:?}");
                        let expected = from.map_or(0.0, smooth);
                        // Half a level each for storing the source and the result, the rest for straight lines
                        // between pixels of a curve and for 1/256 px.
                        let error = (f64::from(value) - expected).abs();
                        assert!(error < 1.1, "{value} is not {expected} at ({x}, {y})");
                        without_source += usize::from(from.is_none());
                    }
                }
                assert!(without_source > 500, "the test must see a border");
            }
        }
    }
}

#[test]
fn small_turns_keep_the_picture_upright_and_nearly_all_of_it() {
    for axis in 0..3 {
        for angle in [-2.0, 2.0] {
            let mut degrees = [0.0; 3];
            degrees[axis] = angle;
            let calibration = rig([640, 480], [LENS; 2], degrees);
            let rectifier = Rectifier::new(&calibration).expect("an ordinary rig");
            let upright = rectifier.geometry().aligned_from_left.diagonal();
            assert!(upright.iter().all(|&d| d > 0.99), "turned over: {upright:?}");
            assert_eq!(rectifier.geometry().focal_px, 0.84 * 640.0);
            for mask in [rectifier.left_valid(), rectifier.right_valid()] {
                let valid = mask.rows().flatten().filter(|&&v| v != 0).count();
                assert!(valid > 640 * 480 * 95 / 100, "{valid} px valid for {degrees:?}");
            }
        }
    }
}

#[test]
fn cameras_that_need_nothing_come_through_unchanged() {
    for (width, height) in [(1, 1), (1, 7), (6, 1), (2, 2), (31, 17)] {
        let rectifier = Rectifier::new(&aligned_rig(width, height)).expect("an ordinary rig");
        let source = Image::from_fn(width, height, |x, y| (x * 37 + y * 101 + 13) as u8);
        assert_eq!(rectified(&rectifier, [&source, &source]), [source.clone(), source]);
        assert!(rectifier.left_valid().rows().flatten().all(|&v| v == 255), "{width}x{height}");
    }
}

#[test]
fn cameras_of_two_sizes_and_rows_of_a_wider_buffer() {
    let mut calibration = aligned_rig(40, 30);
    calibration.right = CameraModel { width: 60, height: 50, center_px: [29.5, 24.5], ..calibration.right };
    let rectifier = Rectifier::new(&calibration).expect("an ordinary rig");
    let buffer: Vec<u8> = (0..70 * 50u32).map(|i| (i * i / 7) as u8).collect();
    let wide = ImageRef::with_stride("right", &buffer, 60, 50, 70).expect("fits");
    let mut aligned = Image::default();
    rectifier.rectify_right(wide, &mut aligned).expect("its own size");
    // Same focal length, principal points 10 px apart: the middle of the larger image.
    let middle = Image::from_fn(40, 30, |x, y| wide.at(x + 10, y + 10));
    assert_eq!(aligned, middle);
    let message =
        rectifier.rectify_left(wide, &mut aligned).expect_err("the other camera's size").to_string();
    assert!(message.contains("left image is 60x50 px") && message.contains("40x30 px"), "{message}");
}

#[test]
fn impossible_rigs_are_refused_with_the_reason() {
    let good = aligned_rig(40, 30);
    let refused = |change: &dyn Fn(&mut StereoCalibration)| {
        let mut bad = good.clone();
        change(&mut bad);
        Rectifier::new(&bad).expect_err("must be refused").to_string()
    };
    for side in [0, 16_385, usize::MAX] {
        let message = refused(&|rig| rig.left.width = side);
        assert!(message.contains(&format!("{side}x30 px")), "{message}");
        let message = refused(&|rig| rig.right.height = side);
        assert!(message.contains(&format!("40x{side} px")), "{message}");
    }
    assert!(refused(&|rig| rig.left.center_px[0] = f64::NAN).contains("cx = NaN"));
    assert!(refused(&|rig| rig.right_from_left.translation_m.x = 0.1).contains("swapped"));
    assert!(refused(&|rig| rig.right_from_left.translation_m.z = 0.5).contains("viewing direction"));
    let crossed = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.9).into_inner();
    assert!(refused(&|rig| rig.right_from_left.rotation = crossed).contains("look past each other sideways"));
    assert!(
        refused(&|rig| rig.right.lens = Brown { k1: -1e300, ..Brown::default() }.into())
            .starts_with("rectification: ")
    );

    let with = |options| Rectifier::with_options(&good, options);
    for focal_px in [0.0, -5.0, f64::NAN, f64::INFINITY] {
        let options = RectifierOptions { scale: Scale::Focal(focal_px), ..RectifierOptions::default() };
        let error = with(options).expect_err("must be refused");
        assert!(matches!(error, Error::InvalidParameter { name: "focal_px", .. }), "{error}");
    }
    for size in [(0, 5), (5, 0), (usize::MAX, 1)] {
        assert!(with(RectifierOptions { size: Some(size), ..RectifierOptions::default() }).is_err());
    }
}

/// Points in front of a rig land on one row of its aligned images, at the disparity that gives them back.
fn check_points(calibration: &StereoCalibration, options: RectifierOptions, points: &[Vector3<f64>]) {
    let rectifier = Rectifier::with_options(calibration, options).expect("an ordinary rig");
    let geometry = rectifier.geometry();
    let masks = [rectifier.left_valid(), rectifier.right_valid()];
    let mut seen = 0;
    for &point in points {
        let aligned = geometry.aligned_from_left * point;
        let [x, y, d] = geometry.pixel_of(&aligned).expect("in front of both");
        assert!(d > 0.0);
        let back = geometry.point_m(x, y, d).expect("rays that meet");
        assert!((back - aligned).norm() < 1e-9 * aligned.norm(), "{back:?} is not {aligned:?}");
        let inside = |x: f64, y: f64| {
            (1.0..geometry.width as f64 - 2.0).contains(&x)
                && (1.0..geometry.height as f64 - 2.0).contains(&y)
        };
        if !(inside(x, y) && inside(x - d, y)) {
            continue;
        }
        // A spot where each camera sees the point must come out on that row, at those columns.
        let left = calibration.left.project(point).expect("in view");
        let right = calibration.right.project(calibration.right_from_left.apply(point)).expect("in view");
        let [left, right] = rectified(
            &rectifier,
            [
                &spots(calibration.left.width, calibration.left.height, &[left]),
                &spots(calibration.right.width, calibration.right.height, &[right]),
            ],
        );
        for (image, mask, x) in [(&left, masks[0], x), (&right, masks[1], x - d)] {
            if mask.at(x.round() as usize, y.round() as usize) == 0 || x < 12.0 || y < 12.0 {
                continue;
            }
            if x > geometry.width as f64 - 13.0 || y > geometry.height as f64 - 13.0 {
                continue;
            }
            let at = centroid(image, Vector2::new(x, y));
            assert!((at - Vector2::new(x, y)).norm() < 0.15, "{at:?} is not ({x}, {y})");
            seen += 1;
        }
    }
    assert!(seen >= points.len(), "only {seen} spots of {} points are in view", points.len());
}

fn points_around(reach: f64) -> Vec<Vector3<f64>> {
    (0..12)
        .map(|i| {
            let angle = f64::from(i) * 0.9;
            let out = reach * f64::from(i) / 12.0;
            Vector3::new(out.sin() * angle.cos(), out.sin() * angle.sin(), out.cos())
                * (1.0 + 0.2 * f64::from(i))
        })
        .collect()
}

#[test]
fn rolled_rigs_come_out_level_and_unmirrored() {
    for degrees in [0.0_f64, 30.0, -30.0, 60.0, 90.0, -90.0] {
        // The whole rig turned about its viewing direction: one camera above the other at 90 degrees.
        let mut calibration = rig([320, 240], [LENS; 2], [0.5, -0.7, 0.4]);
        let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), degrees.to_radians()).into_inner();
        let pose = calibration.right_from_left;
        calibration.right_from_left = Pose {
            rotation: roll * pose.rotation * roll.transpose(),
            translation_m: roll * pose.translation_m,
        };
        let rectifier = Rectifier::new(&calibration).expect("a rolled rig");
        let geometry = *rectifier.geometry();
        assert!(geometry.focal_px > 0.0);
        let expected = if degrees.abs() > 45.0 { (240, 320) } else { (320, 240) };
        assert_eq!((geometry.width, geometry.height), expected);
        // No more than the roll: in particular never a half turn, and never a mirror image.
        assert!((geometry.aligned_from_left.determinant() - 1.0).abs() < 1e-9);
        let turn = Rotation3::from_matrix_unchecked(geometry.aligned_from_left).angle().to_degrees();
        assert!((turn - degrees.abs()).abs() < 4.0, "turned by {turn} for a roll of {degrees}");
        check_points(&calibration, RectifierOptions::default(), &points_around(0.3));
    }
    // At 180 degrees a rolled rig and swapped cameras are the same thing, and said to be.
    let mut upside_down = aligned_rig(40, 30);
    upside_down.right_from_left.translation_m.x *= -1.0;
    let message = Rectifier::new(&upside_down).expect_err("ambiguous").to_string();
    assert!(message.contains("swapped, or mounted upside down"), "{message}");
}

/// Two fisheyes of 190 degrees, side by side, a little askew.
fn fisheye_rig() -> StereoCalibration {
    let lens = KannalaBrandt { k1: -0.01, k2: 0.002, ..KannalaBrandt::default() };
    let camera = CameraModel {
        focal_px: [145.0, 145.0],
        center_px: [239.5, 239.5],
        lens: Lens::KannalaBrandt(lens),
        width: 480,
        height: 480,
    };
    let rotation = Rotation3::from_euler_angles(0.02, -0.03, 0.01).into_inner();
    StereoCalibration::new(camera, camera, Pose { rotation, translation_m: Vector3::new(-0.1, 0.002, 0.003) })
        .expect("an ordinary rig")
}

#[test]
fn fisheyes_on_a_cylinder() {
    let calibration = fisheye_rig();
    let options = RectifierOptions {
        size: Some((520, 520)),
        scale: Scale::FieldOfView(175_f64.to_radians()),
        projection: Projection::Cylindrical,
    };
    let rectifier = Rectifier::with_options(&calibration, options).expect("a fisheye rig");
    let geometry = rectifier.geometry();
    assert!((geometry.focal_px - 520.0 / 175_f64.to_radians()).abs() < 1e-9);
    let valid = rectifier.left_valid().rows().flatten().filter(|&&v| v != 0).count();
    assert!(valid > 520 * 520 * 7 / 10, "{valid} px valid");
    check_points(&calibration, options, &points_around(1.3));

    // The law of sines: where the rays at 60 degrees to the right meet, 2 m off.
    let angle = 60_f64.to_radians();
    let point = Vector3::new(angle.sin(), 0.0, angle.cos()) * 2.0;
    let right = (point.x - geometry.baseline_m).atan2(point.z);
    let [x, _, d] = geometry.pixel_of(&point).expect("in view");
    assert!((x - geometry.cx_px - geometry.focal_px * angle).abs() < 1e-9);
    assert!((d - geometry.focal_px * (angle - right)).abs() < 1e-9);
    assert_eq!(geometry.point_m(x, 10.0, 0.0), None, "parallel rays");
    assert_eq!(geometry.point_m(x, 10.0, -3.0), None, "rays that part");
    assert!((geometry.depth_m(geometry.disparity_px(3.0)) - 3.0).abs() < 1e-12);
    let message = geometry.require_pinhole("to_range").expect_err("a cylinder").to_string();
    assert!(message.contains("to_range needs a pinhole pair"), "{message}");
}

#[test]
fn alpha_goes_from_only_valid_pixels_to_all_of_them() {
    for projection in [Projection::Pinhole, Projection::Cylindrical] {
        for degrees in [[0.0, 0.0, 0.0], [1.5, -1.0, 2.0]] {
            let calibration = rig([320, 240], [LENS; 2], degrees);
            let at = |alpha| {
                let options = RectifierOptions {
                    scale: Scale::Alpha(alpha),
                    projection,
                    ..RectifierOptions::default()
                };
                Rectifier::with_options(&calibration, options).expect("an ordinary rig")
            };
            let [tight, half, all] = [0.0, 0.5, 1.0].map(at);
            for mask in [tight.left_valid(), tight.right_valid()] {
                assert!(mask.rows().flatten().all(|&v| v == 255), "alpha 0 shows only valid pixels");
            }
            let focal = |r: &Rectifier| r.geometry().focal_px;
            assert!(focal(&tight) > focal(&half) && focal(&half) > focal(&all));
            // Corners of both cameras' pictures are inside the view.
            let geometry = all.geometry();
            let turns = cameras_from_aligned(&calibration, geometry);
            for (camera, turn) in [&calibration.left, &calibration.right].into_iter().zip(turns) {
                for corner in [[0.0, 0.0], [319.0, 0.0], [0.0, 239.0], [319.0, 239.0]] {
                    let ray = turn.transpose() * camera.direction(Vector2::from(corner)).expect("in view");
                    // A point so far away that the cameras are in one place.
                    let [x, y, _] = geometry.pixel_of(&(ray * 1e9)).expect("in front");
                    let inside = (-0.6..319.6).contains(&x) && (-0.6..239.6).contains(&y);
                    assert!(inside, "{corner:?} lies at ({x}, {y})");
                }
            }
        }
    }
    let narrower = |scale| {
        Rectifier::with_options(
            &rig([320, 240], [LENS; 2], [0.0; 3]),
            RectifierOptions { scale, ..RectifierOptions::default() },
        )
    };
    for alpha in [-0.1, 1.1, f64::NAN] {
        assert!(narrower(Scale::Alpha(alpha)).expect_err("out of range").to_string().contains("alpha"));
    }
    for fov in [0.0, 3.2, f64::NAN] {
        assert!(narrower(Scale::FieldOfView(fov)).expect_err("out of range").to_string().contains("fov_deg"));
    }
    let geometry = *narrower(Scale::FieldOfView(1.0)).expect("a narrow view").geometry();
    assert!((2.0 * (160.0 / geometry.focal_px).atan() - 1.0).abs() < 1e-12);
}

proptest! {
    /// Eq. 4 with real weights; the table's promise is half a level of rounding and 1/512 px of position.
    #[test]
    fn resampling_keeps_its_promise_on_noise(
        width in 1usize..20,
        height in 1usize..20,
        positions in prop::collection::vec((-1.0f64..20.0, -1.0f64..20.0), 1..60),
        seed: u64,
    ) {
        let source = Image::from_fn(width, height, |x, y| {
            ((seed | 1).wrapping_mul((x * 31 + y * 17 + 1) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8
        });
        let table = Remap::from_fn((positions.len(), 1), (width, height), |x, _| {
            Some([positions[x].0, positions[x].1])
        }).expect("legal");
        let mut resampled = Image::default();
        table.apply("image", source.view(), &mut resampled).expect("sizes agree");
        for (i, &(u, v)) in positions.iter().enumerate() {
            let (last_x, last_y) = ((width - 1) as f64, (height - 1) as f64);
            let outside = |p: f64, last: f64| p < -1.0 / 512.0 || p > last + 1.0 / 512.0;
            if outside(u, last_x) || outside(v, last_y) {
                prop_assert_eq!((table.valid().at(i, 0), resampled.row(0)[i]), (0, 0));
                continue;
            }
            if outside(u, last_x - 2.0 / 512.0) || outside(v, last_y - 2.0 / 512.0) || u < 0.002 || v < 0.002 {
                continue; // within rounding of the border, where either answer is right
            }
            prop_assert_eq!(table.valid().at(i, 0), 255);
            let (x, y) = (u.floor() as usize, v.floor() as usize);
            let (a, b) = (u - u.floor(), v - v.floor());
            let level = |dx: usize, dy: usize| f64::from(source.row(y + dy)[x + dx]);
            let expected = (1.0 - a) * (1.0 - b) * level(0, 0)
                + a * (1.0 - b) * level(1, 0)
                + (1.0 - a) * b * level(0, 1)
                + a * b * level(1, 1);
            let gx = (level(1, 0) - level(0, 0)).abs().max((level(1, 1) - level(0, 1)).abs());
            let gy = (level(0, 1) - level(0, 0)).abs().max((level(1, 1) - level(1, 0)).abs());
            let error = (f64::from(resampled.row(0)[i]) - expected).abs();
            prop_assert!(error <= 0.5 + (gx + gy) / 512.0 + 1e-9, "{} is not {}", resampled.row(0)[i], expected);
        }
    }
}
