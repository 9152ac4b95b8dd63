//! Stereo calibration on rigs whose truth is known.

use epiline::calibration::{BoardView, BundleOptions, LensModel, Loss, calibrate, tsai};
use epiline::camera::{AlignedFrame, Brown, CameraModel, LensFormula, Pose, StereoCalibration};
use epiline::{Error, Result};
use nalgebra::{Rotation3, Vector2, Vector3};

const SIZE: (usize, usize) = (640, 480);

/// A small generator: tests must repeat themselves.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// Uniform in [-1, 1).
    fn symmetric(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Mean 0, variance 1.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.symmetric()).sum::<f64>() / 2.0
    }
}

fn pose(angles: [f64; 3], translation_m: [f64; 3]) -> Pose {
    Pose {
        rotation: Rotation3::from_scaled_axis(Vector3::from(angles)).into_inner(),
        translation_m: Vector3::from(translation_m),
    }
}

fn camera(focal_px: [f64; 2], center_px: [f64; 2], coefficients: [f64; 5]) -> CameraModel {
    let distortion = Brown::from_array(coefficients);
    CameraModel { focal_px, center_px, lens: distortion.into(), width: SIZE.0, height: SIZE.1 }
}

/// A rig like the one of OpenCV's sample photographs.
fn ordinary_rig() -> StereoCalibration {
    StereoCalibration::new(
        camera([534.0, 533.0], [342.0, 235.0], [-0.28, 0.09, 1.2e-3, -3e-4, 0.0]),
        camera([537.0, 536.5], [327.0, 250.0], [-0.29, 0.10, -5e-4, 4e-4, 0.0]),
        pose([0.006, 0.008, -0.004], [-0.0832, 0.0009, -0.0002]),
    )
    .expect("an ordinary rig")
}

fn board() -> Vec<[f64; 3]> {
    (0..54).map(|i| [f64::from(i % 9) * 0.025, f64::from(i / 9) * 0.025, 0.0]).collect()
}

/// Thirteen boards at a third of a metre, tilted in different directions.
fn board_poses() -> Vec<Pose> {
    let mut random = Random::new(42);
    let mut draw = |center: f64, half: f64| center + half * random.symmetric();
    (0..13)
        .map(|_| {
            let turn = [draw(0.0, 0.5), draw(0.0, 0.5), draw(0.0, 0.2)];
            pose(turn, [draw(-0.08, 0.02), draw(-0.06, 0.02), draw(0.38, 0.04)])
        })
        .collect()
}

fn see(rig: &StereoCalibration, board: &[[f64; 3]], left_from_board: &Pose) -> BoardView {
    let left: Vec<Vector3<f64>> = board.iter().map(|p| left_from_board.apply(Vector3::from(*p))).collect();
    let pixel = |camera: &CameraModel, p: Vector3<f64>| camera.project(p).expect("in front").into();
    BoardView {
        left_px: left.iter().map(|p| pixel(&rig.left, *p)).collect(),
        right_px: left.iter().map(|p| pixel(&rig.right, rig.right_from_left.apply(*p))).collect(),
        board_m: board.to_vec(),
    }
}

fn twin(rig: &StereoCalibration) -> Vec<BoardView> {
    board_poses().iter().map(|pose| see(rig, &board(), pose)).collect()
}

/// Adds Gaussian noise to every coordinate, and up to ±5 px to a share of the corners.
fn disturb(views: &[BoardView], sigma_px: f64, outliers: f64, seed: u64) -> Vec<BoardView> {
    let mut random = Random::new(seed);
    let mut views = views.to_vec();
    for pixel in views.iter_mut().flat_map(|v| v.left_px.iter_mut().chain(&mut v.right_px)) {
        let wild = 0.5 + 0.5 * random.symmetric() < outliers;
        for value in pixel {
            *value += sigma_px * random.normal() + if wild { 5.0 * random.symmetric() } else { 0.0 };
        }
    }
    views
}

fn without_folds(loss: Loss) -> BundleOptions {
    BundleOptions { loss, held_out_folds: 0, ..BundleOptions::default() }
}

/// Depth at which a rig believes to see a point of the true rig's axis at `depth_m`.
fn believed_depth_m(truth: &StereoCalibration, found: &StereoCalibration, depth_m: f64) -> f64 {
    let center = Vector2::new(319.5, 239.5);
    let ray = truth.left.normalised_from_pixel(center).expect("invertible").push(1.0);
    let frame = AlignedFrame::of(&truth.right_from_left).expect("aligned");
    let point = ray * (depth_m / (frame.aligned_from_left * ray).z);
    let right = truth.right.project(truth.right_from_left.apply(point)).expect("in front");
    let frame = AlignedFrame::of(&found.right_from_left).expect("aligned");
    let x_left = frame.align_left(found.left.normalised_from_pixel(center).expect("invertible")).x;
    let x_right = frame.align_right(found.right.normalised_from_pixel(right).expect("invertible")).x;
    frame.baseline_m / (x_left - x_right)
}

fn assert_same_rig(found: &StereoCalibration, truth: &StereoCalibration, tolerance: f64) {
    for (found, truth) in [(&found.left, &truth.left), (&found.right, &truth.right)] {
        for i in 0..2 {
            assert!((found.focal_px[i] / truth.focal_px[i] - 1.0).abs() < tolerance, "{found:?}");
            assert!((found.center_px[i] - truth.center_px[i]).abs() < 1e3 * tolerance, "{found:?}");
        }
    }
    let moved = found.right_from_left.translation_m - truth.right_from_left.translation_m;
    assert!(moved.norm() < tolerance * truth.baseline_m(), "T is off by {moved:?} m");
    let turned = found.right_from_left.rotation - truth.right_from_left.rotation;
    assert!(turned.norm() < tolerance, "R is off by {turned:?}");
}

#[test]
fn clean_corners_give_the_rig_back() {
    let truth = ordinary_rig();
    for loss in [Loss::Squared, Loss::default()] {
        for lens in [LensModel::Brown4, LensModel::Brown5] {
            let options = BundleOptions { lens, loss, ..BundleOptions::default() };
            let found = calibrate(&twin(&truth), SIZE, &options).expect("a good set of views");
            assert_same_rig(&found, &truth, 1e-6);
            assert!(found.rms_px < 1e-6 && found.epipolar_error_px < 1e-6, "{found:?}");
            assert_eq!(found.views.len(), 13);
        }
    }
}

/// A rig and board views of it, from a wide lens with strong barrel distortion to a long one.
fn any_rig(random: &mut Random) -> (StereoCalibration, Vec<BoardView>) {
    let focal = 320.0 * 8.0_f64.powf(0.5 + 0.5 * random.symmetric());
    let barrel = -0.25 * (320.0 / focal) * (1.0 + 0.5 * random.symmetric());
    let mut lens = || {
        let f = focal * (1.0 + 0.03 * random.symmetric());
        let center = [319.5 + 40.0 * random.symmetric(), 239.5 + 30.0 * random.symmetric()];
        let coefficients = [barrel, 0.05, 1e-3 * random.symmetric(), 0.0, 0.0];
        camera([f, f * (1.0 + 0.01 * random.symmetric())], center, coefficients)
    };
    let (left, right) = (lens(), lens());
    let turn = [0; 3].map(|_| 0.1 * random.symmetric());
    let right_from_left = pose(turn, [-0.1, 0.01 * random.symmetric(), 0.01]);
    let rig = StereoCalibration::new(left, right, right_from_left).expect("a rig that exists");
    // Boards that fill about half of the image whatever the lens.
    let distance = focal * 0.2 / 300.0;
    let views = (0..6)
        .map(|_| {
            let turn = [0.6, 0.6, 0.5].map(|half| half * random.symmetric());
            let place = [-0.1, -0.0625, distance * (1.2 + 0.2 * random.symmetric())];
            visible(&see(&rig, &board(), &pose(turn, place)))
        })
        .filter(|view| view.board_m.len() >= 30)
        .collect();
    (rig, views)
}

/// The corners inside both images.
fn visible(view: &BoardView) -> BoardView {
    let inside = |p: &[f64; 2]| (0.0..640.0).contains(&p[0]) && (0.0..480.0).contains(&p[1]);
    let seen: Vec<usize> =
        (0..view.board_m.len()).filter(|&i| inside(&view.left_px[i]) && inside(&view.right_px[i])).collect();
    BoardView {
        left_px: seen.iter().map(|&i| view.left_px[i]).collect(),
        right_px: seen.iter().map(|&i| view.right_px[i]).collect(),
        board_m: seen.iter().map(|&i| view.board_m[i]).collect(),
    }
}

#[test]
fn rigs_of_all_kinds_are_found_from_the_closed_form() {
    let mut random = Random::new(7);
    let mut tried = 0;
    while tried < 40 {
        let (truth, views) = any_rig(&mut random);
        if views.len() < 4 {
            continue;
        }
        let found = calibrate(&views, SIZE, &without_folds(Loss::default()));
        let found = found.unwrap_or_else(|e| panic!("{:?} with {} views: {e}", truth.left, views.len()));
        assert_same_rig(&found, &truth, 1e-5);
        tried += 1;
    }
}

#[test]
fn misplaced_corners_do_no_harm_under_huber() {
    const TRIALS: u64 = 12;
    let truth = ordinary_rig();
    let views = twin(&truth);
    let rms = |loss: Loss, outliers: f64| {
        let squares = (1..=TRIALS).map(|seed| {
            let views = disturb(&views, 0.15, outliers, seed);
            let found = calibrate(&views, SIZE, &without_folds(loss)).expect("a good set of views");
            (believed_depth_m(&truth, &found, 1.0) - 1.0).powi(2)
        });
        (squares.sum::<f64>() / TRIALS as f64).sqrt()
    };
    let (clean, robust) = (rms(Loss::default(), 0.0), rms(Loss::default(), 0.02));
    let fragile = rms(Loss::Squared, 0.02);
    assert!(robust < 1.3 * clean, "2 % outliers raise the depth error from {clean} to {robust} m");
    assert!(fragile > 1.5 * robust, "least squares should have suffered: {fragile} against {robust} m");
}

#[test]
fn predicted_sigmas_match_the_spread_of_repeated_calibrations() {
    const TRIALS: u64 = 60;
    let truth = ordinary_rig();
    let views = twin(&truth);
    let spread = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
    };
    type Of<'a> = &'a dyn Fn(&StereoCalibration) -> f64;
    for loss in [Loss::Squared, Loss::default()] {
        let found: Vec<StereoCalibration> = (1..=TRIALS)
            .map(|seed| calibrate(&disturb(&views, 0.15, 0.0, seed), SIZE, &without_folds(loss)))
            .collect::<Result<_>>()
            .expect("a good set of views");
        let believed =
            |depth_m: f64| move |c: &StereoCalibration| believed_depth_m(&ordinary_rig(), c, depth_m);
        let checks: [(&str, Of<'_>, Of<'_>); 5] = [
            ("left fx", &|c| c.sigma("left_fx").expect("known"), &|c| c.left.focal_px[0]),
            ("right k1", &|c| c.sigma("right_k1").expect("known"), &|c| c.right.lens.coefficients()[0]),
            ("baseline", &|c| c.baseline_sigma_m(), &|c| c.baseline_m()),
            ("depth at 1 m", &|c| c.range_sigma_m(1.0), &believed(1.0)),
            ("depth at 3 m", &|c| c.range_sigma_m(3.0), &believed(3.0)),
        ];
        for (name, sigma, value) in checks {
            let predicted = found.iter().map(sigma).sum::<f64>() / TRIALS as f64;
            let observed = spread(&found.iter().map(value).collect::<Vec<_>>());
            let ratio = predicted / observed;
            assert!(
                (0.75..1.25).contains(&ratio),
                "{loss:?} {name}: predicted {predicted}, observed {observed}"
            );
        }
    }
}

#[test]
fn fixed_parameters_have_no_variance() {
    let views = disturb(&twin(&ordinary_rig()), 0.1, 0.0, 3);
    let found = calibrate(&views, SIZE, &without_folds(Loss::default())).expect("a good set of views");
    assert_eq!(found.left.lens.coefficients()[4], 0.0);
    assert_eq!(found.sigma("left_k3"), Some(0.0));
    assert!(found.sigma("left_k2") > Some(0.0));
}

#[test]
fn too_few_views_leave_the_held_out_error_unknown() {
    let views = disturb(&twin(&ordinary_rig()), 0.1, 0.0, 3);
    let found = calibrate(&views[..2], SIZE, &BundleOptions::default()).expect("two views are enough to fit");
    assert!(found.epipolar_error_px.is_nan());
    let found = calibrate(&views[..5], SIZE, &BundleOptions::default()).expect("a good set of views");
    assert!((0.0..1.0).contains(&found.epipolar_error_px), "leave-one-out: {}", found.epipolar_error_px);
}

#[test]
fn tsai_gives_a_rig_that_rectifies() {
    // Tsai's lens has one radial coefficient and no tangential one: a rig of that kind.
    let truth = StereoCalibration::new(
        camera([534.0, 533.0], [335.0, 235.0], [-0.2, 0.04, 0.0, 0.0, 0.0]),
        camera([537.0, 536.5], [322.0, 247.0], [-0.2, 0.04, 0.0, 0.0, 0.0]),
        pose([0.006, 0.008, -0.004], [-0.0832, 0.0009, -0.0002]),
    )
    .expect("an ordinary rig");
    let views = disturb(&twin(&truth), 0.1, 0.0, 5);
    let found = tsai::calibrate_rig(&views, SIZE, &BundleOptions::default()).expect("a good set of views");
    assert!(found.epipolar_error_px < 0.2, "held-out error {} px", found.epipolar_error_px);
    assert!(
        (found.baseline_m() / truth.baseline_m() - 1.0).abs() < 0.01,
        "baseline {} m",
        found.baseline_m()
    );
    assert!((found.left.focal_px[0] / 534.0 - 1.0).abs() < 0.01, "{:?}", found.left);
    assert!(found.sigma("left_fx") > Some(0.0) && found.range_sigma_m(1.0) > 0.0);
}

#[test]
fn bad_input_is_refused_in_words() {
    let views = twin(&ordinary_rig());
    let refusal = |views: &[BoardView], size| {
        calibrate(views, size, &BundleOptions::default()).expect_err("must be refused").to_string()
    };
    let changed = |change: &dyn Fn(&mut Vec<BoardView>)| {
        let mut views = views.clone();
        change(&mut views);
        refusal(&views, SIZE)
    };
    let says =
        |message: String, words: &str| assert!(message.contains(words), "'{words}' is not in: {message}");
    says(refusal(&views[..1], SIZE), "at least 2 needed");
    says(refusal(&[], SIZE), "0 given");
    says(refusal(&views, (0, 480)), "image_size");
    // Width and height exchanged.
    says(refusal(&views, (480, 640)), "outside the 480x640 px image");
    says(changed(&|v| v[2].left_px[5][1] = f64::NAN), "view 2, corner 5");
    says(changed(&|v| v[3].board_m[1][0] = f64::INFINITY), "view 3, corner 1");
    says(changed(&|v| v[4].right_px.truncate(10)), "10 corners in view 4");
    says(changed(&|v| v[0].board_m[0][2] = 0.1), "z = 0");
    let few = |v: &mut Vec<BoardView>| {
        v[1].left_px.truncate(5);
        v[1].right_px.truncate(5);
        v[1].board_m.truncate(5);
    };
    says(changed(&few), "at least 6");
    says(changed(&|v| v[1].right_px.fill([100.0, 100.0])), "right corners of view 1");
    let millimetres = |v: &mut Vec<BoardView>| {
        for point in v.iter_mut().flat_map(|v| &mut v.board_m) {
            *point = point.map(|c| 1e3 * c);
        }
    };
    says(changed(&millimetres), "millimetres");
    let options = BundleOptions {
        loss: Loss::Huber { sigmas: f64::NAN, outlier_sigmas: 4.5 },
        ..BundleOptions::default()
    };
    says(calibrate(&views, SIZE, &options).expect_err("NaN").to_string(), "sigmas");
}

#[test]
fn swapped_cameras_are_recognised() {
    let mut views = twin(&ordinary_rig());
    for view in &mut views {
        std::mem::swap(&mut view.left_px, &mut view.right_px);
    }
    for refused in [
        calibrate(&views, SIZE, &BundleOptions::default()),
        tsai::calibrate_rig(&views, SIZE, &BundleOptions::default()),
    ] {
        let message = refused.expect_err("swapped").to_string();
        assert!(message.contains("the two are swapped"), "{message}");
    }
}

#[test]
fn a_view_listed_from_the_other_end_is_named() {
    let mut views = twin(&ordinary_rig());
    let refusal = |views: &[BoardView]| {
        calibrate(views, SIZE, &BundleOptions::default()).expect_err("flipped").to_string()
    };
    views[6].right_px.reverse();
    let message = refusal(&views);
    assert!(message.contains("view 6") && message.contains("other end"), "{message}");
    // All of them: a rig with one camera upside down.
    for view in &mut views {
        view.right_px.reverse();
    }
    views[6].right_px.reverse();
    let message = refusal(&views);
    assert!(message.contains("other end"), "{message}");
}

#[test]
fn boards_parallel_to_the_image_are_refused_with_noise_and_without() {
    let truth = ordinary_rig();
    let flat: Vec<BoardView> = (0..8)
        .map(|i| {
            let place = [
                -0.08 + 0.01 * f64::from(i % 3),
                -0.06 + 0.01 * f64::from(i / 3),
                0.4 + 0.02 * f64::from(i % 4),
            ];
            see(&truth, &board(), &pose([0.0, 0.0, 0.03 * f64::from(i)], place))
        })
        .collect();
    for (seed, sigma_px) in [(1, 0.0), (2, 0.1), (3, 0.1), (4, 0.3)] {
        let result = calibrate(&disturb(&flat, sigma_px, 0.0, seed), SIZE, &BundleOptions::default());
        let message = result.expect_err("degenerate").to_string();
        assert!(message.contains("tilt the board"), "noise {sigma_px} px: {message}");
    }
}

#[test]
fn unrelated_corners_are_not_a_calibration() {
    let mut random = Random::new(11);
    let mut views = twin(&ordinary_rig());
    for pixel in views.iter_mut().flat_map(|v| v.left_px.iter_mut().chain(&mut v.right_px)) {
        *pixel = [319.5 + 300.0 * random.symmetric(), 239.5 + 200.0 * random.symmetric()];
    }
    assert!(matches!(calibrate(&views, SIZE, &BundleOptions::default()), Err(Error::Degenerate { .. })));
}
