//! The vertical residual of synthetic pairs whose residual is known.

use epiline::image::Image;
use epiline::rectification::{AlignmentError, AlignmentMeter, AlignmentOptions, alignment_error};

/// A smooth texture without repetition, about 128 grey levels wide: value at a real position, and its noise.
struct Texture {
    waves: Vec<[f64; 4]>,
}

impl Texture {
    fn new(seed: u64) -> Self {
        let mut random = uniform(seed);
        let waves = (0..60)
            .map(|_| {
                // Periods of 3 to 30 px in all directions.
                let (frequency, angle) = (1.0 / (3.0 + 27.0 * random()), std::f64::consts::TAU * random());
                let turns = std::f64::consts::TAU * frequency;
                [turns * angle.cos(), turns * angle.sin(), std::f64::consts::TAU * random(), 9.0]
            })
            .collect();
        Self { waves }
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        128.0
            + self.waves.iter().map(|[u, v, phase, level]| level * (u * x + v * y + phase).sin()).sum::<f64>()
    }
}

fn uniform(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A pair of which the left pixel (x, y) appears in the right image at (x - disparity, y + dy(x)); the right camera
/// is darker by a fifth, and both are noisy.
fn pair(width: usize, height: usize, disparity: f64, dy: impl Fn(f64) -> f64) -> [Image<u8>; 2] {
    let texture = Texture::new(3);
    let mut random = uniform(11);
    let mut pixel = |level: f64| {
        let noise = 2.0 * (random() + random() + random() - 1.5);
        (level + noise).round().clamp(0.0, 255.0) as u8
    };
    let left = Image::from_fn(width, height, |x, y| pixel(texture.at(x as f64, y as f64)));
    let right = Image::from_fn(width, height, |x, y| {
        let x = x as f64 + disparity;
        pixel(0.8 * texture.at(x, y as f64 - dy(x)) + 5.0)
    });
    [left, right]
}

fn measure([left, right]: &[Image<u8>; 2], options: AlignmentOptions) -> AlignmentError {
    alignment_error(left.view(), right.view(), &options).expect("legal")
}

#[test]
fn sub_pixel_shifts_are_measured_without_bias() {
    for dy in [-6.3, -1.0, -0.5, -0.25, 0.0, 0.1, 0.37, 0.5, 0.75, 2.6] {
        let disparity = 21.4 + dy;
        let result = measure(&pair(320, 240, disparity, |_| dy), AlignmentOptions::default());
        assert!(result.matches.len() > 80, "{} matches at {dy} px", result.matches.len());
        assert!((result.signed_median_px - dy).abs() < 0.01, "{} is not {dy} px", result.signed_median_px);
        assert!(result.spread_px < 0.1, "spread {} at {dy} px", result.spread_px);
        if dy != 0.0 {
            assert!((result.median_px - dy.abs()).abs() < 0.05, "{} is not {dy} px", result.median_px);
        }
        let mut disparities: Vec<f64> = result.matches.iter().map(|m| m.left_px[0] - m.right_px[0]).collect();
        disparities.sort_by(f64::total_cmp);
        let median = disparities[disparities.len() / 2];
        assert!((median - disparity).abs() < 0.01, "disparity {median} is not {disparity}");
    }
}

#[test]
fn an_error_that_varies_shows_in_the_spread_and_not_in_the_signed_median() {
    // A right camera rolled by a little: dy from -1.5 on the left to 1.5 on the right.
    let result = measure(&pair(320, 240, 10.0, |x| 3.0 * (x / 320.0 - 0.5)), AlignmentOptions::default());
    // Uniform on ±1.5: both medians of distances are 0.75.
    assert!(result.signed_median_px.abs() < 0.2, "{}", result.signed_median_px);
    assert!((result.median_px - 0.75).abs() < 0.15, "{}", result.median_px);
    assert!((result.spread_px - 1.4826 * 0.75).abs() < 0.2, "{}", result.spread_px);
}

#[test]
fn masked_pixels_take_no_part() {
    // The right-hand half is off by two pixels; the masks leave the left-hand half and a black border.
    let [mut left, mut right] = pair(320, 240, 4.0, |x| if x < 160.0 { 0.25 } else { 2.0 });
    let mut valid = Image::<u8>::new(320, 240);
    for y in 0..240 {
        for x in 0..320 {
            let inside = (20..150).contains(&x) && y > 15;
            valid.row_mut(y)[x] = if inside { 255 } else { 0 };
            if x < 20 || y <= 15 {
                (left.row_mut(y)[x], right.row_mut(y)[x]) = (0, 0);
            }
        }
    }
    let mut meter = AlignmentMeter::new(AlignmentOptions::default()).expect("legal");
    let masked = Some(valid.view());
    let result = meter.measure(left.view(), right.view(), masked, masked).expect("one size").clone();
    assert!(result.matches.len() > 40);
    assert!(result.matches.iter().all(|m| (m.vertical_px() - 0.25).abs() < 0.6), "a masked pixel took part");
    assert!((result.signed_median_px - 0.25).abs() < 0.04, "{}", result.signed_median_px);
    for m in &result.matches {
        assert!(valid.row(m.left_px[1] as usize)[m.left_px[0] as usize] == 255);
    }

    let unmasked = meter.measure(left.view(), right.view(), None, None).expect("one size");
    assert!(unmasked.matches.iter().any(|m| m.vertical_px() > 1.9), "the test must have something to mask");
}

#[test]
fn nothing_is_said_without_matches() {
    let flat = Image::from_fn(320, 240, |_, _| 90u8);
    let textured = pair(320, 240, 40.0, |_| 0.0);
    let tiny = [Image::<u8>::new(1, 1), Image::new(1, 1)];
    let narrow = AlignmentOptions { num_disparities: 16, max_offset_px: 8 };
    let near = AlignmentOptions { num_disparities: 192, max_offset_px: 3 };
    for (pair, options) in [
        (&[flat.clone(), flat], AlignmentOptions::default()),
        (&tiny, AlignmentOptions::default()),
        (&textured, narrow),
        (&pair(320, 240, 20.0, |_| 4.4), near),
    ] {
        let result = measure(pair, options);
        assert!(result.matches.len() < 12, "{} matches", result.matches.len());
        assert!(result.median_px.is_nan() && result.signed_median_px.is_nan() && result.spread_px.is_nan());
    }
    assert!(measure(&textured, AlignmentOptions::default()).matches.len() > 100);
}

#[test]
fn bad_options_and_sizes_are_named() {
    let option = |num_disparities, max_offset_px| AlignmentOptions { num_disparities, max_offset_px };
    for (options, text) in [
        (option(0, 8), "num_disparities = 0 px"),
        (option(4097, 8), "num_disparities = 4097 px"),
        (option(64, 0), "max_offset_px = 0 px"),
        (option(64, 65), "max_offset_px = 65 px"),
        (option(usize::MAX, usize::MAX), "num_disparities"),
    ] {
        let message = AlignmentMeter::new(options).expect_err("must be refused").to_string();
        assert!(message.starts_with(text), "{message}");
    }
    let (a, b) = (Image::<u8>::new(30, 20), Image::<u8>::new(30, 21));
    let mut meter = AlignmentMeter::new(AlignmentOptions::default()).expect("legal");
    for (right, left_valid, right_valid) in
        [(&b, None, None), (&a, Some(b.view()), None), (&a, None, Some(b.view()))]
    {
        let error = meter.measure(a.view(), right.view(), left_valid, right_valid);
        let message = error.expect_err("must be refused").to_string();
        assert!(message.contains("30x20 px") && message.contains("30x21 px"), "{message}");
    }
}
