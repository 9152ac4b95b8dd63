//! Triangulation against the equations, and the range curve against data it must reproduce.

use epiline::Error;
use epiline::camera::DepthVariance;
use epiline::image::Image;
use epiline::matching::{DisparityMap, Validity};
use epiline::range::{
    RangeCurve, RangeImage, Triangulation, disparity_sigma_px, fit_range_curve, fit_range_curve_robustly,
    to_range, useful_depth_m,
};
use epiline::rectification::RectifiedGeometry;

fn geometry() -> RectifiedGeometry {
    let mut geometry = RectifiedGeometry::new(37, 23, 310.5, 17.2, 11.9, 1.25, 0.121).expect("a rig");
    geometry.calibration_variance = DepthVariance { z2: 1e-5, z3: 3e-7, z4: 2e-6 };
    geometry
}

/// Disparities of all sizes, a third of them rejected for one reason or another.
fn map(geometry: &RectifiedGeometry) -> DisparityMap {
    let mut map = DisparityMap::new(geometry.width, geometry.height);
    let mut state = 1_u32;
    for (value, bits) in map.values.as_mut_slice().iter_mut().zip(map.validity.as_mut_slice()) {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *value = (state >> 16) as u16 % 1024;
        *bits = if state.is_multiple_of(3) { 1 << ((state >> 8) % 8) } else { 0 };
    }
    (map.min_disparity, map.num_disparities) = (0, 64);
    map
}

#[test]
fn every_pixel_follows_the_equations() {
    let geometry = geometry();
    let map = map(&geometry);
    let mut range = RangeImage::new(&geometry);
    to_range(&map, &geometry, 0.3, &mut range).expect("sizes agree");
    let mut answered = 0;
    for y in 0..geometry.height {
        for x in 0..geometry.width {
            let got =
                [&range.depth_m, &range.range_m, &range.sigma_m].map(|image| f64::from(image.row(y)[x]));
            let Some(disparity_px) = map.at(x, y) else {
                assert!(got.iter().all(|v| v.is_nan()), "({x}, {y}) has no disparity but {got:?}");
                continue;
            };
            answered += 1;
            let d = f64::from(disparity_px) + 1.25;
            let fb = 310.5 * 0.121;
            let z = fb / d;
            let ray =
                (1.0 + ((x as f64 - 17.2) / 310.5).powi(2) + ((y as f64 - 11.9) / 310.5).powi(2)).sqrt();
            let variance =
                (z * z * 0.3 / fb).powi(2) + 1e-5 * z.powi(2) + 3e-7 * z.powi(3) + 2e-6 * z.powi(4);
            for (got, expected) in got.into_iter().zip([z, z * ray, ray * variance.sqrt()]) {
                assert!((got / expected - 1.0).abs() < 3e-7, "({x}, {y}): {got} instead of {expected}");
            }
        }
    }
    assert!(answered > 500, "the test looked at {answered} pixels only");
    assert_eq!(range.validity, map.validity);
}

#[test]
fn points_are_the_inverse_of_projection() {
    let geometry = geometry();
    let map = map(&geometry);
    let mut range = RangeImage::new(&geometry);
    to_range(&map, &geometry, 0.25, &mut range).expect("sizes agree");
    let mut count = 0;
    for (x, y, [px, py, pz]) in range.points() {
        let back = [310.5 * px / pz + 17.2, 310.5 * py / pz + 11.9].map(f64::from);
        assert!(
            (back[0] - x as f64).abs() < 1e-4 && (back[1] - y as f64).abs() < 1e-4,
            "({x}, {y}): {back:?}"
        );
        let norm = f64::from(px * px + py * py + pz * pz).sqrt();
        assert!((norm / f64::from(range.range_m.row(y)[x]) - 1.0).abs() < 1e-6);
        count += 1;
    }
    assert_eq!(count, map.validity.as_slice().iter().filter(|&&b| Validity::has_value(b)).count());
}

#[test]
fn infinity_has_no_range() {
    let geometry = RectifiedGeometry::new(3, 1, 300.0, 1.0, 0.0, -2.0, 0.1).expect("a rig");
    let mut map = DisparityMap::new(3, 1);
    map.validity.fill(0);
    map.values.as_mut_slice().copy_from_slice(&[0, 32, 33]);
    let mut range = RangeImage::new(&geometry);
    to_range(&map, &geometry, 0.25, &mut range).expect("sizes agree");
    let depth = range.depth_m.as_slice();
    assert!(depth[0].is_nan() && depth[1].is_nan(), "behind and at infinity: {depth:?}");
    assert!((depth[2] - 480.0).abs() < 1e-3, "d + doffs = 1/16 px: {depth:?}");
}

#[test]
fn a_triangulation_serves_maps_of_any_span() {
    let geometry = geometry();
    let mut triangulation = Triangulation::new(&geometry, 0.25).expect("parameters");
    let (mut warm, mut fresh) = (RangeImage::new(&geometry), RangeImage::new(&geometry));
    let mut map = map(&geometry);
    for factor in [1, 0, 17, 3] {
        for value in map.values.as_mut_slice() {
            *value = value.wrapping_mul(factor);
        }
        triangulation.apply(&map, &mut warm).expect("sizes agree");
        to_range(&map, &geometry, 0.25, &mut fresh).expect("sizes agree");
        let bits =
            |image: &RangeImage| image.sigma_m.as_slice().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&warm), bits(&fresh));
    }
}

#[test]
fn bad_input_is_named() {
    let geometry = geometry();
    let error = Triangulation::new(&geometry, f64::NAN).expect_err("NaN").to_string();
    assert!(error.contains("disparity_sigma_px = NaN px"), "{error}");
    let mut range = RangeImage::new(&geometry);
    let error =
        to_range(&DisparityMap::new(36, 23), &geometry, 0.25, &mut range).expect_err("size").to_string();
    assert!(error.contains("36x23") && error.contains("37x23"), "{error}");
}

fn at(curve: [f64; 4], x: f64) -> f64 {
    curve[0] * (curve[1] * x).exp() + curve[2] * (curve[3] * x).exp()
}

fn assert_reproduces(curve: &RangeCurve, x: &[f64], y: &[f64], tolerance_m: f64) {
    for (&x, &y) in x.iter().zip(y) {
        let error = (curve.predict(x) - y).abs();
        assert!(error <= tolerance_m, "{error} m off at {x} px: {curve:?}");
    }
}

#[test]
fn exact_data_give_back_their_constants() {
    let truth = [6.5, -0.21, 1.8, -0.012];
    let x: Vec<f64> = (0..18).map(|i| 2.0 + 2.3 * f64::from(i)).collect();
    let y: Vec<f64> = x.iter().map(|&x| at(truth, x)).collect();
    let curve = fit_range_curve(&x, &y).expect("well posed");
    for (got, expected) in [curve.a, curve.b, curve.c, curve.d].into_iter().zip(truth) {
        assert!((got / expected - 1.0).abs() < 1e-6, "{curve:?}");
    }
    assert!(curve.rmse_m < 1e-9 && curve.r_squared > 1.0 - 1e-12);
    assert_eq!((curve.span_px, curve.samples), ((2.0, x[17]), 18));
}

#[test]
fn one_exponential_and_a_double_rate_are_reproduced() {
    let x: Vec<f64> = (0..15).map(|i| 4.0 + 2.0 * f64::from(i)).collect();
    let single: Vec<f64> = x.iter().map(|x| 5.0 * (-0.07 * x).exp()).collect();
    let double: Vec<f64> = x.iter().map(|x| (5.0 + 0.4 * x) * (-0.11 * x).exp()).collect();
    let constant = vec![2.5; 15];
    assert_reproduces(&fit_range_curve(&x, &single).expect("answers"), &x, &single, 1e-7);
    assert_reproduces(&fit_range_curve(&x, &double).expect("answers"), &x, &double, 1e-7);
    assert_reproduces(&fit_range_curve(&x, &constant).expect("answers"), &x, &constant, 1e-7);
}

#[test]
fn order_and_repetition_do_not_matter() {
    let x = [30.0, 4.0, 9.0, 4.0, 15.0, 22.0, 9.0, 41.0];
    let y = [1.21, 8.9, 4.1, 9.1, 2.4, 1.66, 3.9, 0.88];
    let forward = fit_range_curve(&x, &y).expect("answers");
    let reversed: (Vec<f64>, Vec<f64>) = x.iter().copied().zip(y).rev().unzip();
    assert_eq!(forward, fit_range_curve(&reversed.0, &reversed.1).expect("answers"));
}

#[test]
fn tables_that_cannot_be_fitted_say_why() {
    let five = [1.0, 2.0, 3.0, 4.0, 5.0];
    let not_finite = fit_range_curve(&[1.0, 2.0, f64::NAN, 4.0, 5.0], &five).expect_err("NaN").to_string();
    assert!(not_finite.contains("disparity_px = NaN") && not_finite.contains("entry 2"), "{not_finite}");
    let few = fit_range_curve(&five[..4], &five[..4]).expect_err("too few");
    assert!(matches!(few, Error::NotEnoughData { actual: 4, needed: 5, .. }), "{few}");
    let lengths = fit_range_curve(&five, &five[..4]).expect_err("lengths").to_string();
    assert!(lengths.contains("4 values"), "{lengths}");
    for x in [[3.0; 5], [3.0, 3.0, 4.0, 5.0, 5.0]] {
        let degenerate = fit_range_curve(&x, &five).expect_err("fewer than four disparities");
        assert!(matches!(degenerate, Error::Degenerate { .. }), "{degenerate}");
    }
}

#[test]
fn intervals_contain_the_stated_share_of_new_measurements() {
    // 300 tables; each predicts one new measurement between its own.
    let truth = [7.0, -0.12, 1.5, -0.01];
    let mut state = 7_u64;
    let mut uniform = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut normal = move || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
    let x: Vec<f64> = (0..12).map(|i| 3.0 + 4.0 * f64::from(i)).collect();
    let mut inside = 0;
    for _ in 0..300 {
        let y: Vec<f64> = x.iter().map(|&x| at(truth, x) + 0.03 * normal()).collect();
        let curve = fit_range_curve(&x, &y).expect("well posed");
        let (low, high) = curve.predict_interval(17.0, 0.9).expect("a confidence");
        inside += i32::from((low..high).contains(&(at(truth, 17.0) + 0.03 * normal())));
    }
    // 270 ± 5.2 expected; four sigma.
    assert!((249..=291).contains(&inside), "{inside} of 300 within the 90 % interval");
    let curve = fit_range_curve(&x, &x.iter().map(|&x| at(truth, x)).collect::<Vec<_>>()).expect("exact");
    let error = curve.predict_interval(17.0, 1.0).expect_err("certainty").to_string();
    assert!(error.contains("confidence = 1"), "{error}");
}

#[test]
fn the_useful_depth_is_where_sigma_first_exceeds_its_share() {
    let plain = RectifiedGeometry::new(640, 480, 500.0, 320.0, 240.0, 0.0, 0.12).expect("a rig");
    let variances = [
        DepthVariance::default(),
        DepthVariance { z2: 1e-4, z3: 2e-5, z4: 1e-6 },
        // A rig that is better at some distance than nearer.
        DepthVariance { z2: 4e-4, z3: -1e-4, z4: 1e-5 },
        DepthVariance { z2: 1e-4, z3: 1e-5, z4: 0.0 },
    ];
    for calibration_variance in variances {
        let geometry = RectifiedGeometry { calibration_variance, ..plain };
        for (disparity_sigma_px, share) in [(0.25, 0.1), (0.1, 0.03), (1.0, 0.2)] {
            let sigma_share = |z: f64| {
                let matching_m = z * z * disparity_sigma_px / 60.0;
                (matching_m * matching_m + calibration_variance.at(z)).sqrt() / z
            };
            let end_m = useful_depth_m(&geometry, disparity_sigma_px, share).expect("legal");
            assert!((sigma_share(end_m) / share - 1.0).abs() < 1e-9, "{calibration_variance:?}");
            assert!((1..100).all(|i| sigma_share(end_m * f64::from(i) / 100.0) < share));
        }
    }
    let geometry =
        RectifiedGeometry { calibration_variance: DepthVariance { z2: 0.02, z3: 0.0, z4: 0.0 }, ..plain };
    assert_eq!(useful_depth_m(&geometry, 0.25, 0.1), Ok(0.0), "the baseline alone is 14 % uncertain");
    assert_eq!(useful_depth_m(&plain, 0.0, 0.1), Ok(f64::INFINITY));
}

#[test]
fn sigma_by_confidence_adds_the_calibrations_part() {
    let mut geometry = geometry();
    let map = map(&geometry);
    let confidence = map.confidence();
    geometry.calibration_variance = DepthVariance { z2: 1e-4, z3: 2e-5, z4: 1e-6 };
    let mut image = RangeImage::new(&geometry);
    Triangulation::new(&geometry, 0.0)
        .expect("legal")
        .apply_by_confidence(&map, &confidence, &mut image)
        .expect("sizes");
    let mut seen = 0;
    for y in 0..map.height() {
        for x in 0..map.width() {
            let z = f64::from(image.depth_m.row(y)[x]);
            if z.is_nan() {
                assert!(image.sigma_m.row(y)[x].is_nan());
                continue;
            }
            let sigma_px = f64::from(disparity_sigma_px(confidence.row(y)[x]));
            let matching_m = z * z * sigma_px / (geometry.focal_px * geometry.baseline_m);
            let of_depth_m = (matching_m * matching_m + geometry.calibration_variance.at(z)).sqrt();
            let expected_m = of_depth_m * geometry.range_per_depth(x as f64, y as f64);
            assert!((f64::from(image.sigma_m.row(y)[x]) / expected_m - 1.0).abs() < 1e-5);
            seen += 1;
        }
    }
    assert!(seen > 100, "only {seen} pixels");
    let small = Image::<u8>::new(2, 2);
    let refused =
        Triangulation::new(&geometry, 0.0).expect("legal").apply_by_confidence(&map, &small, &mut image);
    assert!(refused.expect_err("another size").to_string().contains("confidence is 2x2 px"));
}

#[test]
fn a_robust_fit_leaves_out_what_is_wrong() {
    let x: Vec<f64> = (0..20).map(|i| 4.0 + 2.0 * f64::from(i)).collect();
    let wiggle = |i: usize| 0.01 * ((i * 7919 % 13) as f64 / 6.0 - 1.0);
    let mut y: Vec<f64> =
        x.iter().enumerate().map(|(i, &x)| at([6.0, -0.12, 1.5, -0.01], x) + wiggle(i)).collect();
    let clean = fit_range_curve_robustly(&x, &y).expect("enough pairs");
    assert!(clean.outliers.is_empty());
    assert_eq!(clean, fit_range_curve(&x, &y).expect("enough pairs"));
    (y[6], y[12]) = (y[6] + 0.8, y[12] - 0.5);
    let robust = fit_range_curve_robustly(&x, &y).expect("enough pairs");
    assert_eq!(robust.outliers, [6, 12]);
    assert_eq!(robust.samples, 18);
    assert!(x.iter().all(|&x| (robust.predict(x) - clean.predict(x)).abs() < 0.02));
    assert!(fit_range_curve_robustly(&x[..4], &y[..4]).is_err());
}
