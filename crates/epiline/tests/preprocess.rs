//! Grey, equalisation and the low-pass filter against their definitions, written out slowly.

use std::f64::consts::TAU;

use epiline::image::{Image, ImageRef};
use epiline::kernels::lookup::LookupRow;
use epiline::kernels::magnitude::MagnitudeRow;
use epiline::kernels::transpose::Transpose;
use epiline::kernels::weighted::{Group, SUMS, WeightedRows};
use epiline::kernels::{Kernels, Level};
use epiline::preprocess::{GaussianLowPass, equalize_histogram, grey_from_bgr};
use proptest::prelude::*;

/// Pseudo-random numbers in [0, 1): a linear congruence is random enough for pixels.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Eq. 7 from the definition: the discrete Fourier transform as a sum over all pixels, H by the distance from the
/// centre of the shifted spectrum, and the sum back.
fn low_pass_by_definition(image: &Image<f32>, sigma: f64) -> Image<f64> {
    let (width, height) = (image.width(), image.height());
    let spectrum: Vec<(f64, f64)> = (0..width * height)
        .map(|i| {
            // Column and row of the shifted spectrum, and the frequency there.
            let (column, row) = (i % width, i / width);
            let u = column as f64 - (width / 2) as f64;
            let v = row as f64 - (height / 2) as f64;
            let h = (-(u * u + v * v) / (2.0 * sigma * sigma)).exp();
            let (mut re, mut im) = (0.0, 0.0);
            for y in 0..height {
                for x in 0..width {
                    let phase = -TAU * (u * x as f64 / width as f64 + v * y as f64 / height as f64);
                    re += f64::from(image.row(y)[x]) * phase.cos();
                    im += f64::from(image.row(y)[x]) * phase.sin();
                }
            }
            (h * re, h * im)
        })
        .collect();
    Image::from_fn(width, height, |x, y| {
        let sum: f64 = (spectrum.iter().enumerate())
            .map(|(i, (re, im))| {
                let u = (i % width) as f64 - (width / 2) as f64;
                let v = (i / width) as f64 - (height / 2) as f64;
                let phase = TAU * (u * x as f64 / width as f64 + v * y as f64 / height as f64);
                re * phase.cos() - im * phase.sin()
            })
            .sum();
        sum / (width * height) as f64
    })
}

#[test]
fn low_pass_is_the_definition_at_every_parity() {
    let mut random = noise(7);
    for (width, height) in [(1, 1), (1, 9), (8, 1), (7, 5), (8, 6), (9, 8), (6, 11)] {
        for sigma in [0.3, 1.5, 40.0] {
            let image = Image::from_fn(width, height, |_, _| (random() * 255.0) as f32);
            let mut filtered = Image::default();
            let mut filter = GaussianLowPass::in_frequency_domain(width, height, sigma).expect("legal");
            filter.apply(image.view(), &mut filtered).expect("sizes agree");
            let expected = low_pass_by_definition(&image, sigma);
            for (got, want) in filtered.as_slice().iter().zip(expected.as_slice()) {
                let error = (f64::from(*got) - want).abs();
                assert!(
                    error < 255.0 * 4.0 * f64::from(f32::EPSILON),
                    "{width}x{height} sigma {sigma}: {got} is not {want}"
                );
            }
        }
    }
}

/// Images that are hard to blur right: all frequencies, none but the highest, edges, single points.
fn hard_images(width: usize, height: usize) -> Vec<Image<f32>> {
    let mut random = noise(width as u64);
    let corner = |x: usize, y: usize| x == 0 && y == height - 1;
    vec![
        Image::from_fn(width, height, |_, _| if random() < 0.5 { -255.0 } else { 255.0 }),
        Image::from_fn(width, height, |x, y| if (x + y) % 2 == 0 { -255.0 } else { 255.0 }),
        Image::from_fn(width, height, |x, y| if x / 7 % 2 == y / 5 % 2 { 0.0 } else { 255.0 }),
        Image::from_fn(width, height, |x, y| if corner(x, y) { 255.0 } else { 0.0 }),
        Image::from_fn(width, height, |_, _| 255.0),
        // What leaving out samples folds most easily: the frequency of every second, third, fourth … sample.
        Image::from_fn(width, height, |x, y| 255.0 * (x as f32 * 2.0).cos() * (y as f32 * 1.5).cos()),
    ]
}

#[test]
fn sums_over_neighbours_are_the_frequency_domains_to_a_ten_thousandth() {
    let mut spatial = 0;
    for (width, height) in [(320, 240), (640, 48), (97, 96), (257, 1), (1, 83), (2, 2), (361, 211)] {
        for sigma in [1e-9, 0.3, 1.0, 2.5, 5.0, 8.0, 13.0, 20.0, 34.0, 60.0, 110.0, 400.0] {
            let mut fast = GaussianLowPass::new(width, height, sigma).expect("legal");
            let mut reference = GaussianLowPass::in_frequency_domain(width, height, sigma).expect("legal");
            assert!(!reference.is_spatial());
            spatial += usize::from(fast.is_spatial());
            let (mut filtered, mut expected) = (Image::default(), Image::default());
            for (i, image) in hard_images(width, height).iter().enumerate() {
                fast.apply(image.view(), &mut filtered).expect("sizes agree");
                reference.apply(image.view(), &mut expected).expect("sizes agree");
                let off = filtered.as_slice().iter().zip(expected.as_slice()).map(|(a, b)| (a - b).abs());
                let worst = off.fold(0.0, f32::max);
                assert!(worst <= 1e-4 * 255.0, "{width}x{height} sigma {sigma}, image {i}: off by {worst}");
            }
        }
    }
    assert!(spatial > 25, "only {spatial} filters were sums over neighbours");
    for sigma in [1e-3, 2.0, 5.0, 10.0, 20.0, 40.0, 60.0] {
        assert!(GaussianLowPass::new(640, 480, sigma).expect("legal").is_spatial(), "sigma {sigma}");
    }
}

#[test]
fn weighted_sums_are_the_definition_at_every_level() {
    let mut random = noise(3);
    for width in [1, 7, 8, 15, 16, 33, 64, 100, 150, 321, 400] {
        for sums in [1_usize, 3, 4, 9] {
            let pixels: Vec<f32> = (0..1000).map(|_| (510.0 * random() - 255.0) as f32).collect();
            let starts: Vec<usize> = (0..30).map(|_| (random() * (1001 - width) as f64) as usize).collect();
            let groups: Vec<Group> = (0..sums.div_ceil(SUMS))
                .map(|_| Group {
                    first: (random() * 20.0) as usize,
                    weights: (0..1 + (random() * 10.0) as usize)
                        .map(|_| std::array::from_fn(|_| (random() - 0.3) as f32))
                        .collect(),
                })
                .collect();
            let (stride, guard) = (width + 5, 20);
            let cells = (sums - 1) * stride + width;
            let mut expected = vec![7.5_f32; cells + 2 * guard];
            for i in 0..sums {
                let Group { first, weights } = &groups[i / SUMS];
                for x in 0..width {
                    let mut sum = 0.0_f32;
                    for (k, weights) in weights.iter().enumerate() {
                        sum += weights[i % SUMS] * pixels[starts[first + k] + x];
                    }
                    expected[guard + i * stride + x] = sum;
                }
            }
            for kernels in Level::available().map(Kernels::new) {
                // Cells around the sums, and between them, keep what they hold.
                let mut guarded = vec![7.5_f32; cells + 2 * guard];
                let out = &mut guarded[guard..guard + cells];
                let (pixels, starts, groups) = (&pixels, &starts, &groups);
                kernels.weighted(&mut WeightedRows { pixels, starts, groups, width, out, stride });
                assert!(guarded == expected, "{}, {sums} sums of {width} pixels", kernels.level().name());
            }
        }
    }
}

#[test]
#[should_panic(expected = "rows inside the pixels")]
fn weighted_sums_of_pixels_beyond_the_last_are_refused() {
    let groups = [Group { first: 0, weights: vec![[1.0; SUMS]] }];
    let mut out = [0.0; 4];
    Kernels::new(Level::best()).weighted(&mut WeightedRows {
        pixels: &[0.0; 4],
        starts: &[1],
        groups: &groups,
        width: 4,
        out: &mut out,
        stride: 4,
    });
}

#[test]
fn rows_become_columns_at_every_level() {
    for (width, height) in [(1, 1), (5, 3), (8, 8), (16, 16), (17, 33), (40, 9), (31, 47), (64, 32)] {
        let (rows_stride, columns_stride) = (width + 3, height + 2);
        let rows: Vec<f32> = (0..rows_stride * height).map(|i| i as f32).collect();
        for kernels in Level::available().map(Kernels::new) {
            let mut columns = vec![-1.0_f32; columns_stride * width + 1];
            let columns_out = &mut columns;
            let call = &mut Transpose {
                rows: &rows,
                rows_stride,
                columns: columns_out,
                columns_stride,
                width,
                height,
            };
            kernels.transpose(call);
            for (i, &value) in columns.iter().enumerate() {
                let (x, y) = (i / columns_stride, i % columns_stride);
                let expected = if x < width && y < height { (y * rows_stride + x) as f32 } else { -1.0 };
                assert!(value == expected, "{}, {width}x{height}: ({x}, {y})", kernels.level().name());
            }
        }
    }
}

#[test]
fn the_largest_magnitude_is_found_at_every_level() {
    let mut random = noise(5);
    for length in [1, 15, 16, 70, 300] {
        for special in [None, Some(-400.0), Some(f32::INFINITY), Some(f32::NAN), Some(-f32::NAN)] {
            let mut pixels: Vec<f32> = (0..length).map(|_| (510.0 * random() - 255.0) as f32).collect();
            if let Some(special) = special {
                pixels[(random() * length as f64) as usize] = special;
            }
            let expected = pixels.iter().map(|pixel| pixel.abs()).max_by(f32::total_cmp).expect("some");
            for kernels in Level::available().map(Kernels::new) {
                let mut row = MagnitudeRow { pixels: &pixels, largest: 1 };
                kernels.magnitude(&mut row);
                assert_eq!(row.largest, expected.to_bits(), "{}, {length} pixels", kernels.level().name());
            }
        }
    }
}

#[test]
fn levels_are_looked_up_at_every_level() {
    let mut random = noise(6);
    let table: [u8; 256] = std::array::from_fn(|_| (256.0 * random()) as u8);
    for length in [0, 1, 31, 32, 63, 64, 65, 200, 1000] {
        let levels: Vec<u8> = (0..length).map(|i| (i * 37 + length) as u8).collect();
        for kernels in Level::available().map(Kernels::new) {
            let mut guarded = vec![9; length + 2];
            kernels.lookup(&mut LookupRow { table: &table, levels: &levels, out: &mut guarded[1..=length] });
            let expected: Vec<u8> = levels.iter().map(|&level| table[usize::from(level)]).collect();
            assert_eq!(guarded[1..=length], expected, "{}, {length} pixels", kernels.level().name());
            assert_eq!((guarded[0], guarded[length + 1]), (9, 9));
        }
    }
}

#[test]
fn low_pass_refuses_what_it_cannot_filter() {
    for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let message = GaussianLowPass::new(4, 4, sigma).err().expect("must be refused").to_string();
        assert!(message.starts_with(&format!("sigma = {sigma} frequency samples")), "{message}");
    }
    for (width, height) in [(0, 4), (4, 0), (usize::MAX, 4), (16_385, 1)] {
        assert!(GaussianLowPass::new(width, height, 1.0).is_err());
    }
    let mut filter = GaussianLowPass::new(4, 3, 1.0).expect("legal");
    let mut filtered = Image::default();
    let other = Image::<f32>::new(3, 4);
    let message = filter.apply(other.view(), &mut filtered).expect_err("another size").to_string();
    assert!(message.contains("3x4 px") && message.contains("4x3 px"), "{message}");
    let message =
        filter.apply_to(Image::new(4, 3).view(), &mut [0.0; 11]).expect_err("too small").to_string();
    assert!(message.contains("12 elements") && message.contains("11"), "{message}");
    for bad in [f32::NAN, f32::INFINITY, 1e31] {
        let mut image = Image::<f32>::new(4, 3);
        image.row_mut(2)[1] = bad;
        let message = filter.apply(image.view(), &mut filtered).expect_err("not finite").to_string();
        assert!(message.contains("(1, 2)"), "{message}");
    }
    let mut image = Image::<f32>::new(4, 3);
    image.fill(1e30);
    filter.apply(image.view(), &mut filtered).expect("the largest legal value");
    assert!(filtered.as_slice().iter().all(|value| value.is_finite()));
}

/// Eq. 3 with the pixels counted one by one for every level.
fn equalized_by_definition(image: &Image<u8>, w: u8) -> f64 {
    let not_brighter = image.as_slice().iter().filter(|&&r| r <= w).count();
    255.0 * not_brighter as f64 / image.as_slice().len() as f64
}

proptest! {
    #[test]
    fn equalisation_is_the_definition(
        width in 1usize..40,
        height in 1usize..20,
        levels in 1u32..=256,
        seed: u64,
    ) {
        let mut random = noise(seed);
        let image = Image::from_fn(width, height, |_, _| (random() * f64::from(levels)) as u8);
        let mut equalized = Image::default();
        equalize_histogram(image.view(), &mut equalized);
        for (&w, &q) in image.as_slice().iter().zip(equalized.as_slice()) {
            // Nearest, halves upward.
            prop_assert_eq!(f64::from(q), (equalized_by_definition(&image, w) + 0.5).floor());
        }
    }
}

#[test]
fn equalisation_of_one_level_is_white_and_of_a_ramp_is_the_ramp() {
    let flat = Image::from_fn(5, 3, |_, _| 90u8);
    let mut equalized = Image::default();
    equalize_histogram(flat.view(), &mut equalized);
    assert!(equalized.as_slice().iter().all(|&q| q == 255));

    let ramp = Image::from_fn(256, 2, |x, _| x as u8);
    equalize_histogram(ramp.view(), &mut equalized);
    // T(w) = 255 (w + 1) / 256 lies between w and w + 1, half-way at w = 127, which rounds upward.
    for (w, &q) in equalized.row(1).iter().enumerate() {
        assert_eq!(q as usize, if w <= 127 { w + 1 } else { w });
    }
}

#[test]
fn rows_of_a_wider_buffer_are_read_as_rows() {
    let buffer: Vec<[u8; 3]> = (0..30u8).map(|i| [i, 2 * i, 3 * i]).collect();
    let view = ImageRef::with_stride("image", &buffer, 4, 3, 10).expect("fits");
    let mut grey = Image::default();
    grey_from_bgr(view, &mut grey);
    assert_eq!((grey.width(), grey.height()), (4, 3));
    for y in 0..3 {
        for x in 0..4 {
            let i = (y * 10 + x) as f64;
            let expected = 0.114 * i + 0.587 * 2.0 * i + 0.299 * 3.0 * i;
            assert!((f64::from(grey.row(y)[x]) - expected).abs() <= 0.51, "({x}, {y})");
        }
    }
}
