//! The kernels behind the alignment residual at every instruction level: the same bits everywhere, outputs between guard
//! cells, and each against its equation written out in other arithmetic.

mod guarded;

use epiline::kernels::alignment::corners::{GradientRow, HalveRow, MaximaRow, RADIUS, StrengthRow, WINDOW};
use epiline::kernels::alignment::patches::{Correlate, PatchSums};
use epiline::kernels::alignment::registration::{
    COLUMNS, Gram, Interpolate, Levels, ModelColumns, Project, ROWS, TAPS,
};
use epiline::kernels::alignment::{LANES, SIDE};
use epiline::kernels::{Kernels, Level};

use guarded::Guarded;

/// Widths with every tail that vectors of 8 to 64 lanes can leave.
const WIDTHS: [usize; 9] = [7, 8, 15, 16, 33, 64, 65, 127, 200];

struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u8 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 40) as u8
    }

    /// Any bytes, or only the extreme ones.
    fn bytes(&mut self, len: usize, extreme: bool) -> Vec<u8> {
        (0..len).map(|_| if extreme { 255 * (self.next() & 1) } else { self.next() }).collect()
    }
}

/// Runs a kernel at every level and hands back what all of them gave.
fn same_everywhere<T: PartialEq + std::fmt::Debug>(name: &str, mut run: impl FnMut(&Kernels) -> T) -> T {
    let expected = run(&Kernels::new(Level::SCALAR));
    for level in Level::available() {
        assert_eq!(run(&Kernels::new(level)), expected, "{name} at {}", level.name());
    }
    expected
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn halves_are_rounded_means_of_four() {
    let mut noise = Noise(1);
    for width in WIDTHS {
        for extreme in [false, true] {
            let rows = [noise.bytes(2 * width, extreme), noise.bytes(2 * width, extreme)];
            let halved = same_everywhere("halve", |kernels| {
                let mut out = Guarded::of(&vec![7; width], 0xa5);
                kernels.halve(&mut HalveRow { upper: &rows[0], lower: &rows[1], halved: out.inside() });
                out.checked("halve")
            });
            for x in 0..width {
                let sum: f64 =
                    rows.iter().flat_map(|row| &row[2 * x..2 * x + 2]).map(|&p| f64::from(p)).sum();
                assert_eq!(f64::from(halved[x]), (sum / 4.0 + 0.5).floor());
            }
        }
    }
}

#[test]
fn strengths_are_smaller_eigenvalues_of_the_window() {
    let mut noise = Noise(2);
    for width in WIDTHS {
        for extreme in [false, true] {
            let height = WINDOW + 6;
            let image: Vec<Vec<u8>> = (0..height).map(|_| noise.bytes(width, extreme)).collect();
            let measured = same_everywhere("gradients and strengths", |kernels| {
                let mut products = vec![[(); 3].map(|()| vec![0f32; width]); WINDOW];
                let mut columns = [(); 3].map(|()| Guarded::of(&vec![0f32; width], -7.0));
                let mut strengths = Vec::new();
                for y in 1..height - 1 {
                    kernels.gradient(&mut GradientRow {
                        above: &image[y - 1],
                        here: &image[y],
                        below: &image[y + 1],
                        products: products[y % WINDOW].each_mut().map(Vec::as_mut_slice),
                        columns: columns.each_mut().map(Guarded::inside),
                    });
                    if y >= WINDOW {
                        let sums = columns.each_ref().map(|column| column.checked("gradient"));
                        let mut strength = Guarded::of(&vec![-1f32; width], -7.0);
                        kernels.strength(&mut StrengthRow {
                            columns: sums.each_ref().map(Vec::as_slice),
                            strength: strength.inside(),
                        });
                        strengths.push(bits(&strength.checked("strength")));
                    }
                }
                strengths
            });
            let gradient = |x: usize, y: usize| {
                if x == 0 || x + 1 == width {
                    return [0.0; 2];
                }
                let level = |x: usize, y: usize| f64::from(image[y][x]);
                [level(x + 1, y) - level(x - 1, y), level(x, y + 1) - level(x, y - 1)]
            };
            for (row, strengths) in measured.iter().enumerate() {
                for (x, &strength) in strengths.iter().enumerate() {
                    let strength = f64::from(f32::from_bits(strength));
                    if x < RADIUS || x + RADIUS >= width {
                        assert_eq!(strength, -1.0, "the edge is left alone");
                        continue;
                    }
                    let y = row + 1 + RADIUS;
                    let mut tensor = nalgebra::Matrix2::<f64>::zeros();
                    for j in y - RADIUS..=y + RADIUS {
                        for i in x - RADIUS..=x + RADIUS {
                            let g = nalgebra::Vector2::from(gradient(i, j));
                            tensor += g * g.transpose();
                        }
                    }
                    let expected = tensor.symmetric_eigenvalues().min();
                    assert!(
                        (strength - expected).abs() < 1.0 + 1e-5 * tensor.trace(),
                        "{strength} {expected}"
                    );
                }
            }
        }
    }
}

#[test]
fn maxima_are_stronger_than_what_comes_before_and_not_weaker_than_what_comes_after() {
    let mut noise = Noise(3);
    for width in WIDTHS {
        // Few values, so that there are ties.
        let rows: [Vec<f32>; 3] = [(); 3].map(|()| (0..width).map(|_| f32::from(noise.next() % 5)).collect());
        let marks = same_everywhere("maxima", |kernels| {
            let mut out = Guarded::of(&vec![9; width], 0xa5);
            let [above, here, below] = rows.each_ref().map(Vec::as_slice);
            kernels.maxima(&mut MaximaRow { above, here, below, least: 1.0, marks: out.inside() });
            out.checked("maxima")
        });
        for x in 0..width {
            let inside = x > 0 && x + 1 < width;
            let expected = inside && {
                let it = rows[1][x];
                let before = rows[0][x - 1..=x + 1].iter().chain(&rows[1][x - 1..x]);
                let after = rows[1][x + 1..=x + 1].iter().chain(&rows[2][x - 1..=x + 1]);
                it > 1.0 && before.into_iter().all(|v| it > *v) && after.into_iter().all(|v| it >= *v)
            };
            assert_eq!(marks[x] != 0, expected, "column {x} of {width}");
        }
    }
}

#[test]
fn patches_sum_and_multiply_exactly() {
    let mut noise = Noise(4);
    for extreme in [false, true] {
        let (stride, height) = (57, 31);
        let [image, other] = [(); 2].map(|()| {
            let mut bytes = noise.bytes(stride * height, extreme);
            // The largest sums there can be.
            bytes[5..5 + SIDE].fill(255);
            (0..SIDE).for_each(|y| bytes[y * stride..y * stride + LANES].fill(255));
            bytes
        });
        let at: Vec<u32> =
            (0..height - SIDE).flat_map(|y| [0, 3, 21].map(|x| (y * stride + x) as u32)).collect();
        let sums = same_everywhere("patch sums", |kernels| {
            let mut out = Guarded::of(&vec![[9; 2]; at.len()], [0xa5; 2]);
            kernels.patch_sums(&mut PatchSums { image: &image, stride, at: &at, sums: out.inside() });
            out.checked("patch sums")
        });
        let pixels = |image: &[u8], at: u32| -> Vec<u64> {
            let rows = (0..SIDE).map(|y| at as usize + y * stride);
            rows.flat_map(|first| image[first..first + SIDE].iter().map(|&p| u64::from(p))).collect()
        };
        for (&at, sums) in at.iter().zip(&sums) {
            let patch = pixels(&image, at);
            assert_eq!(u64::from(sums[0]), patch.iter().sum::<u64>());
            assert_eq!(u64::from(sums[1]), patch.iter().map(|p| p * p).sum::<u64>());
        }
        for &first in &at {
            let products = same_everywhere("correlate", |kernels| {
                let mut out = Guarded::of(&vec![9; at.len()], 0xa5);
                kernels.correlate(&mut Correlate {
                    patch: &image[first as usize..],
                    patch_stride: stride,
                    image: &other,
                    stride,
                    at: &at,
                    products: out.inside(),
                });
                out.checked("correlate")
            });
            let patch = pixels(&image, first);
            for (&second, &product) in at.iter().zip(&products) {
                let expected: u64 = patch.iter().zip(pixels(&other, second)).map(|(a, b)| a * b).sum();
                assert_eq!(u64::from(product), expected);
            }
        }
    }
}

fn close(a: f32, expected: f64, scale: f64) -> bool {
    (f64::from(a) - expected).abs() <= 1e-5 * scale
}

#[test]
fn interpolated_patches_are_weighted_sums() {
    let mut noise = Noise(5);
    let stride = LANES + TAPS + 10;
    for extreme in [false, true] {
        let image = noise.bytes(stride * ROWS, extreme);
        let [across, down] = [(); 2].map(|()| [(); TAPS].map(|()| f32::from(noise.next()) / 128.0 - 1.0));
        let patch = same_everywhere("interpolate", |kernels| {
            let mut patch: Levels = [[f32::NAN; LANES]; SIDE];
            kernels.interpolate(&mut Interpolate { image: &image, stride, across, down, patch: &mut patch });
            patch.map(|row| row.map(f32::to_bits))
        });
        for y in 0..SIDE {
            for x in 0..LANES {
                let mut expected = 0.0;
                for (j, down) in down.iter().enumerate() {
                    for (i, across) in across.iter().enumerate() {
                        let level = f64::from(image[(y + j) * stride + x + i]);
                        expected += f64::from(*down) * f64::from(*across) * level;
                    }
                }
                assert!(close(f32::from_bits(patch[y][x]), expected, 9000.0), "({x}, {y})");
            }
        }
    }
}

#[test]
fn the_columns_of_a_model_are_the_patch_and_its_derivatives() {
    let mut noise = Noise(7);
    let (stride, half) = (LANES + 9, (SIDE / 2) as f64);
    for extreme in [false, true] {
        let image = noise.bytes(stride * (SIDE + 2), extreme);
        let columns = same_everywhere("model columns", |kernels| {
            let mut columns: [Levels; COLUMNS] = [[[f32::NAN; LANES]; SIDE]; COLUMNS];
            kernels.model_columns(&mut ModelColumns { image: &image, stride, columns: &mut columns });
            columns.map(|column| column.map(|row| row.map(f32::to_bits)))
        });
        let level = |x: usize, y: usize| f64::from(image[y * stride + x]);
        let mean =
            (0..SIDE * SIDE).map(|i| level(i % SIDE + 1, i / SIDE + 1)).sum::<f64>() / (SIDE * SIDE) as f64;
        for y in 0..SIDE {
            for x in 0..LANES {
                let (dx, dy) = ((x as f64 - half) / half, (y as f64 - half) / half);
                let along_x = (level(x + 2, y + 1) - level(x, y + 1)) / 2.0;
                let along_y = (level(x + 1, y + 2) - level(x + 1, y)) / 2.0;
                let inside = [along_x, along_y, level(x + 1, y + 1) - mean, 1.0, dx * along_x, dy * along_x];
                for (column, inside) in columns.iter().zip(inside) {
                    let expected = if x < SIDE { inside } else { 0.0 };
                    assert!(close(f32::from_bits(column[y][x]), expected, 255.0), "({x}, {y})");
                }
            }
        }
    }
}

#[test]
fn sums_of_products_count_every_pixel_once() {
    let mut noise = Noise(6);
    let mut levels = |lanes: usize| -> Levels {
        let mut levels = [[0f32; LANES]; SIDE];
        levels.iter_mut().for_each(|row| row[..lanes].fill_with(|| f32::from(noise.next()) - 128.0));
        levels
    };
    let columns: [Levels; COLUMNS] = [(); COLUMNS].map(|()| levels(SIDE));
    let patch = levels(LANES);
    let product = |a: &Levels, b: &Levels| -> f64 {
        let both = a.iter().flatten().zip(b.iter().flatten());
        both.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    };
    let sums = same_everywhere("project", |kernels| {
        let mut call = Project { columns: &columns, patch: &patch, sums: [f32::NAN; COLUMNS] };
        kernels.project(&mut call);
        bits(&call.sums)
    });
    let products = same_everywhere("gram", |kernels| {
        let mut call = Gram { columns: &columns, products: [[f32::NAN; COLUMNS]; COLUMNS] };
        kernels.gram(&mut call);
        call.products.map(|row| bits(&row))
    });
    for i in 0..COLUMNS {
        assert!(close(f32::from_bits(sums[i]), product(&columns[i], &patch), 1e6));
        for j in 0..COLUMNS {
            assert!(
                close(f32::from_bits(products[i][j]), product(&columns[i], &columns[j]), 1e6),
                "{i}, {j}"
            );
        }
    }
}
