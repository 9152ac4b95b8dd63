//! Tsai's method on synthetic points with known truth.

use nalgebra::{Rotation3, SVector, Vector3};

use super::lens::{TsaiLens, brown_from_tsai};
use super::*;
use crate::calibration::lens::tests::check_derivatives;
use crate::camera::distorted_radius;

const SENSOR: Sensor = Sensor { dpx_mm: 0.02, dpy_mm: 0.018, cx: 320.0, cy: 236.0, sx: 1.0 };

fn camera(tilt_degrees: f64, translation_mm: [f64; 3]) -> TsaiCamera {
    let tilt = Rotation3::from_scaled_axis(Vector3::new(0.6, 0.8, 0.0) * tilt_degrees.to_radians());
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.3);
    TsaiCamera {
        f_mm: 8.0,
        kappa1: 2e-3,
        sensor: SENSOR,
        camera_from_world: Pose {
            rotation: (turn * tilt).into_inner(),
            translation_m: Vector3::from(translation_mm) * M_PER_MM,
        },
    }
}

/// A 10x10 grid of 200 mm, lifted in steps if it is to have depth.
fn world(step_mm: f64) -> Vec<[f64; 3]> {
    let at = |i: i32| f64::from(i) * 200.0 / 9.0 - 100.0;
    (0..100).map(|i| [at(i % 10), at(i / 10), f64::from(i % 3) * step_mm]).collect()
}

fn see(camera: &TsaiCamera, world: &[[f64; 3]]) -> Vec<[f64; 2]> {
    world.iter().map(|p| camera.project(*p).expect("in view")).collect()
}

/// Deterministic noise of unit variance: the sum of twelve uniform numbers.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        (0..12)
            .map(|_| {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                (state >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    }
}

fn noisy(pixels: &[[f64; 2]], sigma_px: f64, seed: u64) -> Vec<[f64; 2]> {
    let mut draw = noise(seed);
    pixels.iter().map(|p| p.map(|v| v + sigma_px * draw())).collect()
}

#[test]
fn derivatives_match_central_differences() {
    let lens = TsaiLens { dpx_mm: 0.02, dpy_mm: 0.018 };
    for kappa1 in [2e-3, -2e-3, 0.0] {
        check_derivatives(
            &lens,
            SVector::from([8.0, kappa1, 320.0, 236.0, 1.02]),
            Vector3::new(0.11, -0.08, 0.4),
        );
    }
}

#[test]
fn both_cases_recover_the_truth_from_clean_points() {
    for (step_mm, coplanar) in [(0.0, true), (30.0, false)] {
        let truth = camera(30.0, [12.0, -20.0, 500.0]);
        let points = world(step_mm);
        let pixels = see(&truth, &points);
        for full in [false, true] {
            let found = calibrate(&points, &pixels, &SENSOR, full).expect("a good set of points");
            assert_eq!(found.coplanar, coplanar);
            assert!((found.camera.f_mm / 8.0 - 1.0).abs() < 1e-6, "f = {}", found.camera.f_mm);
            assert!((found.camera.kappa1 / 2e-3 - 1.0).abs() < 1e-5, "kappa1 = {}", found.camera.kappa1);
            let moved = found.camera.camera_from_world.translation_m - truth.camera_from_world.translation_m;
            assert!(moved.norm() < 1e-6, "T is off by {moved:?} m");
            assert!(found.sse_px2 < 1e-8, "SSE = {}", found.sse_px2);
        }
    }
}

#[test]
fn sx_is_estimated_from_points_in_space() {
    let mut truth = camera(20.0, [12.0, -20.0, 500.0]);
    truth.sensor.sx = 1.03;
    let points = world(30.0);
    let found = calibrate(&points, &see(&truth, &points), &SENSOR, false).expect("a good set of points");
    assert!((found.camera.sensor.sx - 1.03).abs() < 1e-9, "sx = {}", found.camera.sensor.sx);
}

#[test]
fn a_plane_may_lie_anywhere_in_the_world() {
    let truth = camera(25.0, [12.0, -20.0, 500.0]);
    let flat = world(0.0);
    let pixels = see(&truth, &flat);
    // The same plane in coordinates turned and moved: the camera sees the same.
    let turn = Rotation3::from_scaled_axis(Vector3::new(0.7, -0.4, 0.3));
    let shift = Vector3::new(40.0, -300.0, 120.0);
    let moved: Vec<[f64; 3]> = flat.iter().map(|p| (turn * Vector3::from(*p) + shift).into()).collect();
    let found = calibrate(&moved, &pixels, &SENSOR, false).expect("a plane");
    assert!(found.coplanar);
    assert!((found.camera.f_mm / 8.0 - 1.0).abs() < 1e-6, "f = {}", found.camera.f_mm);
    assert!(found.sse_px2 < 1e-8, "SSE = {}", found.sse_px2);
}

#[test]
fn an_origin_on_the_axis_is_moved() {
    // Ty = 0: the unknowns of stage 1 are ratios to it.
    let truth = camera(30.0, [0.0, 0.0, 500.0]);
    let points = world(0.0);
    let pixels = noisy(&see(&truth, &points), 0.1, 7);
    let found = calibrate(&points, &pixels, &SENSOR, false).expect("the origin can be moved");
    assert!((found.camera.f_mm / 8.0 - 1.0).abs() < 0.01, "f = {}", found.camera.f_mm);
    assert!(found.condition < 50.0, "condition = {}", found.condition);
}

#[test]
fn a_plane_parallel_to_the_image_is_refused_with_noise_and_without() {
    for seed in 0..60 {
        let truth = camera(0.0, [12.0, -20.0, 500.0]);
        let points = world(0.0);
        let pixels = noisy(&see(&truth, &points), if seed == 0 { 0.0 } else { 0.1 }, seed);
        let message = calibrate(&points, &pixels, &SENSOR, true).expect_err("parallel").to_string();
        assert!(message.contains("parallel to the image"), "seed {seed}: {message}");
    }
}

#[test]
fn degenerate_points_are_refused_in_words() {
    let truth = camera(30.0, [12.0, -20.0, 500.0]);
    let points = world(0.0);
    let pixels = see(&truth, &points);
    let refusal = |points: &[[f64; 3]], pixels: &[[f64; 2]], full| {
        calibrate(points, pixels, &SENSOR, full).expect_err("refused").to_string()
    };
    assert!(refusal(&points[..4], &pixels[..4], false).contains("line"));
    let scattered = [0, 9, 44, 90];
    let few: Vec<_> = scattered.iter().map(|&i| points[i]).collect();
    let few_pixels: Vec<_> = scattered.iter().map(|&i| pixels[i]).collect();
    assert!(refusal(&few, &few_pixels, false).contains("at least 5"));
    assert!(refusal(&points[..10], &pixels[..10], false).contains("line"));
    let mirrored: Vec<_> = points.iter().map(|[x, y, z]| [*x, *y, -z]).collect();
    assert_eq!(mirrored, points, "a plane has no handedness");
    let deep = world(30.0);
    let left_handed: Vec<_> = deep.iter().map(|[x, y, z]| [*x, *y, -z]).collect();
    assert!(refusal(&left_handed, &see(&truth, &deep), false).contains("left-handed"));
    let mut broken = pixels.clone();
    broken[3][1] = f64::NAN;
    assert!(refusal(&points, &broken, false).contains("point 3"));
}

#[test]
fn sigmas_match_the_spread_of_repeated_trials() {
    const TRIALS: u64 = 60;
    let truth = camera(30.0, [12.0, -20.0, 500.0]);
    let points = world(0.0);
    let clean = see(&truth, &points);
    let (mut f, mut tz, mut rx) = (Vec::new(), Vec::new(), Vec::new());
    let mut last = None;
    for seed in 1..=TRIALS {
        let found =
            calibrate(&points, &noisy(&clean, 0.1, seed), &SENSOR, true).expect("a good set of points");
        f.push(found.camera.f_mm);
        tz.push(found.camera.camera_from_world.translation_m.z / M_PER_MM);
        rx.push(found.camera.angles()[0]);
        last = found.sigma;
    }
    let sigma = last.expect("full optimisation gives sigmas");
    let spread = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
    };
    for (name, predicted, observed) in [
        ("f", sigma.f_mm, spread(&f)),
        ("Tz", sigma.translation_mm[2], spread(&tz)),
        ("Rx", sigma.angles[0], spread(&rx)),
    ] {
        assert!(
            (predicted / observed - 1.0).abs() < 0.3,
            "{name}: predicted {predicted}, observed {observed}"
        );
    }
}

#[test]
fn brown_coefficients_do_what_kappa1_does() {
    for kappa1_f2 in [0.3, -0.2, 0.02] {
        let lens = brown_from_tsai(kappa1_f2, 0.6).expect("within the barrel limit");
        assert!((lens.k1 + kappa1_f2).abs() < 0.3 * kappa1_f2.abs(), "to first order k1 = -kappa1 f²");
        for i in 0..=20 {
            let distorted = 0.6 * f64::from(i) / 20.0;
            let undistorted = distorted * (1.0 + kappa1_f2 * distorted * distorted);
            let brown = lens.apply(Vector2::new(undistorted, 0.0)).x;
            // 500 px focal length: 0.05 px.
            assert!((brown - distorted).abs() < 1e-4, "kappa1 f² = {kappa1_f2} at {distorted}: {brown}");
        }
    }
    assert_eq!(brown_from_tsai(-1.0, 0.6), None, "beyond the barrel limit of 0.577");
    assert_eq!(distorted_radius(0.5, -1.0), None);
}
