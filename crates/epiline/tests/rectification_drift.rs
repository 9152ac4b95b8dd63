//! Drift of rigs whose right camera was turned by a known angle: exact projections, not the linear model.

use epiline::camera::{Brown, CameraModel, Pose, StereoCalibration};
use epiline::rectification::{
    Drift, DriftAxis, DriftMeter, PointMatch, Projection, RectifiedGeometry, Rectifier, RectifierOptions,
    realign,
};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};

fn rig(rotation: Matrix3<f64>) -> StereoCalibration {
    let camera = |f: f64, cx: f64| CameraModel {
        focal_px: [f, f],
        center_px: [cx, 243.0],
        lens: Brown { k1: -0.2, k2: 0.05, ..Default::default() }.into(),
        width: 640,
        height: 480,
    };
    let center = Vector3::new(0.12, 0.002, -0.001);
    let pose = Pose { rotation, translation_m: -(rotation * center) };
    StereoCalibration::new(camera(520.0, 318.0), camera(524.0, 322.0), pose).expect("an ordinary rig")
}

fn turn(rotation: [f64; 3]) -> Matrix3<f64> {
    Rotation3::from_scaled_axis(Vector3::from(rotation)).into_inner()
}

/// Points of the scene, reproducibly scattered, metres in the left camera's frame.
fn scene(count: usize, seed: u64) -> Vec<Vector3<f64>> {
    let mut state = seed;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..count)
        .map(|_| {
            let z = 1.0 + 9.0 * uniform();
            Vector3::new(1.1 * (uniform() - 0.5) * z, 0.8 * (uniform() - 0.5) * z, z)
        })
        .collect()
}

/// Where `truth` sees the scene, aligned by `believed` on a plane or a cylinder; one match in ten is wrong.
fn matches_on(
    geometry: &RectifiedGeometry,
    truth: &StereoCalibration,
    believed: &StereoCalibration,
    seed: u64,
) -> Vec<PointMatch> {
    let frame = epiline::camera::AlignedFrame::of(&believed.right_from_left).expect("alignable");
    let aligned = |camera: &CameraModel, turn: &Matrix3<f64>, pixel: Vector2<f64>| {
        let ray = turn * camera.normalised_from_pixel(pixel)?.push(1.0);
        let flat = match geometry.projection {
            Projection::Pinhole => ray.xy() / ray.z,
            Projection::Cylindrical => Vector2::new(ray.x.atan2(ray.y.hypot(ray.z)), ray.y.atan2(ray.z)),
        };
        Some([geometry.cx_px + geometry.focal_px * flat.x, geometry.cy_px + geometry.focal_px * flat.y])
    };
    let see = |(i, point): (usize, Vector3<f64>)| {
        let left_px = truth.left.project(point)?;
        let right_px = truth.right.project(truth.right_from_left.apply(point))?;
        let mut right_px = aligned(&believed.right, &frame.aligned_from_right, right_px)?;
        if i % 10 == 0 {
            right_px[1] += 2.5;
        }
        let left_px = aligned(&believed.left, &frame.aligned_from_left, left_px)?;
        Some(PointMatch { left_px, right_px })
    };
    scene(150, seed).into_iter().enumerate().filter_map(see).collect()
}

fn drift_of(truth: &StereoCalibration, believed: &StereoCalibration) -> Drift {
    let rectifier = Rectifier::new(believed).expect("alignable");
    let mut meter = DriftMeter::for_calibration(rectifier.geometry(), believed).expect("alignable");
    assert_eq!(meter.drift(), Drift::UNKNOWN);
    for seed in 1..=10 {
        meter.add(&matches_on(rectifier.geometry(), truth, believed, seed));
    }
    meter.drift()
}

#[test]
fn every_axis_is_recognised_with_its_sign_and_amount() {
    let parallel = rig(Matrix3::identity());
    // A yaw shows weakly, and a rig of unknown uncertainty is granted some.
    for (axis, index, size) in
        [(DriftAxis::Pitch, 0, 0.15_f64), (DriftAxis::Yaw, 1, 0.4), (DriftAxis::Roll, 2, 0.15)]
    {
        for degrees in [size, -size] {
            let mut angles = [0.0; 3];
            angles[index] = degrees.to_radians();
            // A camera turned by ω about its own axes sees points turned by -ω.
            let truth = rig(turn(angles).transpose());
            let drift = drift_of(&truth, &parallel);
            let error = (drift.values[index] - degrees.to_radians()).abs();
            assert!(error < 0.02 * size.to_radians(), "{axis:?} {degrees}: {drift:?}");
            assert_eq!(drift.axis(), Some(axis), "{drift:?}");
            assert!(drift.frames == 10 && drift.matches > 500);
        }
    }
    let mut zoomed = parallel.clone();
    zoomed.right.focal_px = zoomed.right.focal_px.map(|f| 1.003 * f);
    let drift = drift_of(&zoomed, &parallel);
    assert!((drift.values[3] - 0.003).abs() < 3e-4, "{drift:?}");
    assert_eq!(drift.axis(), Some(DriftAxis::Zoom));
    assert_eq!(drift_of(&parallel, &parallel).axis(), None);
}

#[test]
fn realigning_recovers_the_true_pose() {
    let believed = rig(turn([0.01, -0.02, 0.005]));
    let truth = rig(turn([-0.004, 0.0, 0.003]) * believed.right_from_left.rotation);
    let before = drift_of(&truth, &believed);
    let corrected = realign(&believed, &before).expect("seen");
    let off = |rig: &StereoCalibration| {
        let between = rig.right_from_left.rotation * truth.right_from_left.rotation.transpose();
        Rotation3::from_matrix_unchecked(between).angle()
    };
    assert!(off(&corrected) < 0.05 * off(&believed), "{} of {}", off(&corrected), off(&believed));
    // The right camera has turned, not moved.
    let center = |rig: &StereoCalibration| {
        -(rig.right_from_left.rotation.transpose() * rig.right_from_left.translation_m)
    };
    assert!((center(&corrected) - center(&believed)).norm() < 1e-12);
    assert_eq!(drift_of(&truth, &corrected).axis(), None);
}

#[test]
fn a_correction_carries_its_uncertainty_and_needs_pairs() {
    let mut believed = rig(Matrix3::identity());
    believed.covariance = Some(nalgebra::DMatrix::zeros(24, 24));
    let message = realign(&believed, &Drift::UNKNOWN).expect_err("nothing seen").to_string();
    assert!(message.contains("no pair"), "{message}");
    let drift = drift_of(&rig(turn([-0.004, 0.0, 0.0])), &believed);
    let corrected = realign(&believed, &drift).expect("seen");
    let covariance = corrected.covariance.expect("kept");
    for (i, noise) in drift.noise.iter().take(3).enumerate() {
        // Angles about the right camera's axes, which are nearly the aligned ones.
        let sigma = covariance[(18 + i, 18 + i)].sqrt();
        assert!(sigma > 0.0 && (sigma / noise - 1.0).abs() < 0.2, "{i}: {sigma} {noise}");
    }
}

#[test]
fn what_the_calibration_leaves_uncertain_is_no_drift() {
    let mut believed = rig(Matrix3::identity());
    let truth = rig(turn([-0.0015, 0.0, 0.0]));
    assert_eq!(drift_of(&truth, &believed).axis(), Some(DriftAxis::Pitch));
    let mut covariance = nalgebra::DMatrix::zeros(24, 24);
    covariance[(18, 18)] = 0.001_f64.powi(2);
    believed.covariance = Some(covariance);
    let drift = drift_of(&truth, &believed);
    assert_eq!(drift.axis(), None, "{drift:?}");
    assert!((drift.sigma[0] / 0.001 - 1.0).abs() < 0.1, "{drift:?}");
}

#[test]
fn a_reference_cancels_what_the_calibration_has_of_its_own() {
    let believed = rig(Matrix3::identity());
    let held = rig(turn([-0.003, 0.0, 0.002]));
    let moved = rig(turn([-0.003, 0.0, 0.0005]));
    let rectifier = Rectifier::new(&believed).expect("alignable");
    let mut meter = DriftMeter::new(rectifier.geometry());
    for seed in 1..=5 {
        meter.add(&matches_on(rectifier.geometry(), &held, &believed, seed));
    }
    meter.set_reference(meter.drift());
    for seed in 6..=10 {
        meter.add(&matches_on(rectifier.geometry(), &moved, &believed, seed));
    }
    let drift = meter.drift();
    assert_eq!(drift.axis(), Some(DriftAxis::Roll), "{drift:?}");
    assert!((drift.values[2] - 0.0015).abs() < 1e-4 && drift.values[0].abs() < 1e-4, "{drift:?}");
}

#[test]
fn a_turn_shows_on_a_cylinder_too() {
    let believed = rig(Matrix3::identity());
    let options = RectifierOptions { projection: Projection::Cylindrical, ..Default::default() };
    let rectifier = Rectifier::with_options(&believed, options).expect("alignable");
    for (axis, degrees) in [(DriftAxis::Pitch, 0.15), (DriftAxis::Yaw, -0.4), (DriftAxis::Roll, 0.15)] {
        let mut angles = [0.0; 3];
        angles[axis as usize] = f64::to_radians(degrees);
        let truth = rig(turn(angles).transpose());
        let mut meter = DriftMeter::for_calibration(rectifier.geometry(), &believed).expect("alignable");
        for seed in 1..=10 {
            meter.add(&matches_on(rectifier.geometry(), &truth, &believed, seed));
        }
        let drift = meter.drift();
        let error = (drift.values[axis as usize].to_degrees() - degrees).abs();
        assert!(error < 0.03 * degrees.abs(), "{axis:?}: {drift:?}");
        assert_eq!(drift.axis(), Some(axis), "{drift:?}");
    }
}

/// Rows of a rig that holds but for what a lens model and shutters that are apart leave: no drift.
#[test]
fn a_field_that_calibration_left_is_not_taken_for_a_turn() {
    let believed = rig(Matrix3::identity());
    let rectifier = Rectifier::new(&believed).expect("alignable");
    let seen = |seed: u64, extra: &dyn Fn(&PointMatch) -> f64| -> Vec<PointMatch> {
        let mut found = matches_on(rectifier.geometry(), &believed, &believed, seed);
        for m in &mut found {
            m.right_px[1] += extra(m);
        }
        found
    };
    let disparity = |m: &PointMatch| m.left_px[0] - m.right_px[0];
    let row = |m: &PointMatch| (m.right_px[1] - 240.0) / 240.0;
    let column = |m: &PointMatch| (m.right_px[0] - 320.0) / 320.0;
    for (name, extra) in [
        (
            "the right camera forward",
            &(|m: &PointMatch| 0.02 * disparity(m) * row(m)) as &dyn Fn(&PointMatch) -> f64,
        ),
        ("the right camera lower", &|m: &PointMatch| 0.01 * disparity(m)),
        ("third order", &|m: &PointMatch| 0.3 * row(m) * column(m).powi(2)),
    ] {
        let mut meter = DriftMeter::new(rectifier.geometry());
        for seed in 1..=10 {
            meter.add(&seen(seed, extra));
        }
        let drift = meter.drift();
        let [u, v] = [320.0, 240.0].map(|half| half / rectifier.geometry().focal_px);
        for (value, reach) in drift.values.iter().zip([1.0, u * v, u, v]) {
            let at_edge_px = value * reach * rectifier.geometry().focal_px;
            assert!(at_edge_px.abs() < 0.02, "{name}: {at_edge_px} px, {drift:?}");
        }
    }
}

#[test]
fn a_small_yaw_is_left_open() {
    // A twentieth of a degree: a tenth of a pixel in the corners, which shutters and lenses make as well.
    let believed = rig(Matrix3::identity());
    let truth = rig(turn([0.0, f64::to_radians(0.05), 0.0]).transpose());
    let rectifier = Rectifier::new(&believed).expect("alignable");
    let mut meter = DriftMeter::new(rectifier.geometry());
    for seed in 1..=5 {
        meter.add(&matches_on(rectifier.geometry(), &believed, &believed, seed));
    }
    meter.set_reference(meter.drift());
    for seed in 6..=10 {
        meter.add(&matches_on(rectifier.geometry(), &truth, &believed, seed));
    }
    let drift = meter.drift();
    assert_eq!(drift.axis(), None, "{drift:?}");
    let error = (drift.values[1].to_degrees() - 0.05).abs();
    assert!(error < 2.0 * drift.sigma[1].to_degrees(), "{drift:?}");
}
