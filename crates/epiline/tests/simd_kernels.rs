//! Every kernel of every instruction level against the reference, bit for bit.
//!
//! Widths cover every tail, lanes every number of vectors there is an instance for, pixels the extremes that make sums
//! as large as they get. Outputs lie between guard cells.

mod guarded;

use epiline::kernels::grey::GreyRow;
use epiline::kernels::islands::BreaksRow;
use epiline::kernels::sad::{AddRow, Choice, Cost, RowPair, RowShape, SadRow, blocked_groups};
use epiline::kernels::select::{SelectRow, Subpixel};
use epiline::kernels::sort::{LANES, SortColumns};
use epiline::kernels::texture::TextureRow;
use epiline::kernels::xsobel::XSobelRow;
use epiline::kernels::{CostKernels, Kernels, Level};
use proptest::prelude::*;

use guarded::Guarded;

fn levels_above_scalar() -> impl Iterator<Item = Kernels> {
    Level::available().filter(|&level| level != Level::SCALAR).map(Kernels::new)
}

/// Repeatable bytes.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u8 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 32) as u8
    }

    fn pixels(&mut self, len: usize, largest: u8, content: Content) -> Vec<u8> {
        let pixel = |noise: &mut Self| match content {
            Content::Noise => (u16::from(noise.next()) * (u16::from(largest) + 1) / 256) as u8,
            Content::Extreme => largest * (noise.next() & 1),
            Content::Ties => noise.next() & 1,
        };
        (0..len).map(|_| pixel(self)).collect()
    }

    fn blocks(&mut self, len: usize) -> Vec<u8> {
        (0..len).map(|_| if self.next() < 60 { 255 } else { 0 }).collect()
    }
}

#[derive(Debug, Clone, Copy)]
enum Content {
    Noise,
    Extreme,
    Ties,
}

#[derive(Debug, Clone)]
struct Case {
    width: usize,
    num_disparities: usize,
    radius: usize,
    largest: u8,
    blocked_columns: usize,
    uniqueness_ratio: u32,
    reach: Option<usize>,
    content: Content,
    seed: u64,
}

/// What a row kernel leaves behind, but for the column sums, whose order is its own.
#[derive(Debug, PartialEq)]
struct Outcome<C> {
    chosen: Vec<Choice<C>>,
    rivals: Vec<u16>,
    nearby: Vec<C>,
    right_best: Vec<C>,
}

/// Runs a few rows, so that sums slide and scratch memory is reused, and returns what the last one left.
fn run<C: CostKernels>(case: &Case, lanes: usize, kernels: &Kernels) -> Outcome<C> {
    let &Case { width, radius, largest, .. } = case;
    let padded = width + lanes - 1;
    let mut noise = Noise(case.seed | 1);
    let window = 2 * radius + 1;
    let rows: Vec<[Vec<u8>; 2]> = (0..window + 3)
        .map(|_| [width, padded].map(|len| noise.pixels(len, largest, case.content)))
        .collect();
    let pair = |y: usize| RowPair { left: &rows[y][0], right: &rows[y][1] };
    // Some columns on the left have blocked candidates, and one somewhere else; in a third of the cases, lanes are idle.
    let near_left = |blocks: Vec<u8>| -> Vec<u8> {
        blocks
            .into_iter()
            .enumerate()
            .map(|(i, block)| if i < case.blocked_columns { block } else { 0 })
            .collect()
    };
    let (mut blocked_left, mut blocked_right) =
        (near_left(noise.blocks(width)), near_left(noise.blocks(padded)));
    blocked_left[case.seed as usize % width] |= 255 * (noise.next() & 1);
    blocked_right[(case.seed >> 9) as usize % padded] |= 255 * (noise.next() & 1);
    let mut groups = Vec::new();
    blocked_groups(&blocked_left, &blocked_right, lanes, &mut groups);
    let blocked_lanes = if case.seed.is_multiple_of(3) { noise.blocks(lanes) } else { vec![0; lanes] };
    // Half the cases have coarse costs, as large as 16 bits have room for.
    let room = (65_534 - usize::from(largest) * window * window).min(255) as u8;
    let cells = if case.seed.is_multiple_of(2) { width.div_ceil(2) * lanes } else { 0 };
    let coarse: Vec<u16> = (0..cells).map(|_| noise.next().min(room).into()).collect();
    let shape = RowShape {
        width,
        lanes,
        radius,
        largest_difference: largest,
        uniqueness_ratio: case.uniqueness_ratio,
        left_right_reach: case.reach,
    };

    let none = Choice { before: C::ZERO, best: C::ZERO, after: C::ZERO, lane: C::BLOCKED };
    let mut column_sums = Guarded::of(&vec![C::ZERO; width * lanes], C::BLOCKED);
    let mut scratch = Guarded::of(&vec![C::BLOCKED; C::scratch_len(kernels, &shape)], C::ZERO);
    let mut chosen = Guarded::of(&vec![none; width], none);
    let mut rivals = Guarded::of(&vec![0; width], 0xA5A5);
    let mut nearby = Guarded::of(&vec![C::ZERO; width], C::BLOCKED);
    let mut right_best = Guarded::of(&vec![C::ZERO; padded], C::BLOCKED);
    for y in 0..window {
        C::add(kernels, &mut AddRow { lanes, row: pair(y), column_sums: column_sums.inside() });
    }
    for y in 0..3 {
        let mut row = SadRow {
            shape,
            entering: pair(y + window),
            leaving: pair(y),
            blocked_left: &blocked_left,
            blocked_right: &blocked_right,
            blocked_groups: &groups,
            blocked_lanes: &blocked_lanes,
            coarse: &coarse,
            column_sums: column_sums.inside(),
            scratch: scratch.inside(),
            chosen: chosen.inside(),
            rivals: rivals.inside(),
            nearby: nearby.inside(),
            right_best: right_best.inside(),
        };
        C::sad(kernels, &mut row);
    }
    scratch.checked("scratch");
    column_sums.checked("column_sums");
    Outcome {
        chosen: chosen.checked("chosen"),
        rivals: rivals.checked("rivals"),
        nearby: nearby.checked("nearby"),
        right_best: right_best.checked("right_best"),
    }
}

fn assert_levels_agree<C: CostKernels>(case: &Case) {
    let reference = Kernels::new(Level::SCALAR);
    for kernels in levels_above_scalar() {
        let lanes = kernels.lanes(case.num_disparities);
        let (actual, expected) = (run::<C>(case, lanes, &kernels), run::<C>(case, lanes, &reference));
        assert_eq!(actual, expected, "{} {case:?}", kernels.level().name());
    }
}

fn case() -> impl Strategy<Value = Case> {
    let content = prop::sample::select(vec![Content::Noise, Content::Extreme, Content::Ties]);
    let sizes = (1..=90_usize, 1..=200_usize, 0..=7_usize, 0..=100_usize);
    let reach = prop::sample::select(vec![None, None, Some(0_usize), Some(1), Some(2), Some(9), Some(40)]);
    let ratio = prop::sample::select(vec![0_u32, 10, 100]);
    let largest = prop::sample::select(vec![1_u8, 62, 126, 127, 128, 255]);
    (sizes, reach, ratio, largest, content, any::<u64>()).prop_map(
        |(
            (width, num_disparities, radius, blocked_columns),
            reach,
            uniqueness_ratio,
            largest,
            content,
            seed,
        )| Case {
            width,
            num_disparities,
            radius,
            largest,
            blocked_columns,
            uniqueness_ratio,
            reach,
            content,
            seed,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn window_sums_agree(case in case()) {
        assert_levels_agree::<u16>(&case);
    }

    #[test]
    fn wide_window_sums_agree(case in case()) {
        assert_levels_agree::<u32>(&case);
    }
}

#[test]
fn window_sums_agree_for_every_number_of_vectors_and_every_tail() {
    for num_disparities in [1, 31, 32, 33, 48, 64, 65, 96, 128, 129, 192, 256, 384, 512, 1024] {
        for width in (1..=20).chain([37, 64, 71]) {
            for reach in [None, Some(1)] {
                assert_levels_agree::<u16>(&Case {
                    width,
                    num_disparities,
                    radius: width % 8,
                    largest: 62,
                    blocked_columns: width / 2,
                    uniqueness_ratio: 15,
                    reach,
                    content: Content::Noise,
                    seed: (num_disparities * width) as u64,
                });
            }
        }
    }
}

#[test]
fn the_largest_sums_of_sixteen_bits_agree() {
    // The bounds of `fits_u16`: differences of 62 in windows of 31, of 126 in 21, of 255 in 15.
    for (largest, radius) in [(62, 15), (126, 10), (255, 7)] {
        let case = Case {
            width: 50,
            num_disparities: 40,
            radius,
            largest,
            blocked_columns: 0,
            uniqueness_ratio: 100,
            reach: Some(1),
            content: Content::Extreme,
            seed: 5,
        };
        assert_levels_agree::<u16>(&case);
    }
}

fn choices<C: Cost>(
    width: usize,
    largest: u32,
    noise: &mut Noise,
    from: impl Fn(u32) -> C,
) -> Vec<Choice<C>> {
    let cost = |noise: &mut Noise| {
        let bytes = std::array::from_fn(|_| noise.next());
        u32::from_le_bytes(bytes) % (largest + 1)
    };
    (0..width)
        .map(|_| {
            let best = cost(noise) / 2;
            let mut beside = || match noise.next() {
                0..40 => C::BLOCKED,
                40..80 => from(best),
                80..120 => from(largest),
                _ => from(best + cost(noise) % (largest - best + 1)),
            };
            let (before, after) = (beside(), beside());
            let best = if noise.next() < 30 { C::BLOCKED } else { from(best) };
            Choice { before, best, after, lane: C::from_lane(noise.next().into()) }
        })
        .collect()
}

/// Sub-pixel position and verdict by the definition, in exact arithmetic.
fn expected_choice<C: Cost>(choice: Choice<C>, rivals: u16, subpixel: Subpixel, ratio: u32) -> (u16, u8) {
    let [before, best, after] =
        [choice.before, choice.best, choice.after].map(|c| (c != C::BLOCKED).then(|| i64::from(c.to_u32())));
    let Some(best) = best else { return (0, 2) };
    let whole = (1000 - i64::from(choice.lane.to_u32())) * 256;
    let offset = match (before, after) {
        (Some(before), Some(after)) if before.max(after) > best => match subpixel {
            Subpixel::Off => 0,
            Subpixel::VFit => (after - before) * 256 / (2 * (before.max(after) - best)),
            Subpixel::Parabola => (after - before) * 256 / (2 * (before + after - 2 * best)),
        },
        _ => 0,
    };
    let limit = best + best * i64::from(ratio) / 100;
    let beside = [before, after].into_iter().flatten().filter(|&cost| cost <= limit).count();
    let unique = ratio == 0 || usize::from(rivals) == 1 + beside;
    (((whole + offset + 15) >> 4) as u16, if unique { 0 } else { 4 })
}

fn check_select<C: CostKernels>(width: usize, largest: u32, seed: u64, ratio: u32, from: impl Fn(u32) -> C) {
    let mut noise = Noise(seed | 1);
    let chosen = choices(width, largest, &mut noise, from);
    let rivals: Vec<u16> = (0..width).map(|_| u16::from(noise.next() % 5)).collect();
    for subpixel in [Subpixel::Off, Subpixel::VFit, Subpixel::Parabola] {
        for kernels in Level::available().map(Kernels::new) {
            let mut values = Guarded::of(&vec![7; width], 0xA5A5);
            let mut bits = Guarded::of(&vec![7; width], 0xA5);
            C::select(
                &kernels,
                &mut SelectRow {
                    chosen: &chosen,
                    rivals: &rivals,
                    first_disparity: 1000,
                    subpixel,
                    uniqueness_ratio: ratio,
                    no_candidate: 2,
                    not_unique: 4,
                    values: values.inside(),
                    bits: bits.inside(),
                },
            );
            let (values, bits) = (values.checked("values"), bits.checked("bits"));
            for x in 0..width {
                let expected = expected_choice(chosen[x], rivals[x], subpixel, ratio);
                let level = kernels.level().name();
                assert_eq!((values[x], bits[x]), expected, "{level} {:?} {}", chosen[x], rivals[x]);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn selection_is_exact(width in 1..100_usize, seed in any::<u64>(), ratio in prop::sample::select(vec![0_u32, 1, 15, 100])) {
        check_select::<u16>(width, 65_534, seed, ratio, |cost| cost as u16);
        check_select::<u32>(width, 255 * 31 * 31, seed, ratio, |cost| cost);
    }

    #[test]
    fn texture_agrees(
        width in 1..200_usize,
        radius in 0..=15_usize,
        threshold in 0..3000_u32,
        seed in any::<u64>(),
    ) {
        let mut noise = Noise(seed | 1);
        let columns: Vec<u16> = (0..width).map(|_| u16::from(noise.next()) * 7).collect();
        let before = noise.pixels(width, 3, Content::Noise);
        for kernels in Level::available().map(Kernels::new) {
            let mut padded = Guarded::of(&vec![9; width + 2 * radius], 0xA5A5);
            padded.inside()[radius..radius + width].copy_from_slice(&columns);
            let mut bits = Guarded::of(&vec![0; width], 0xA5);
            bits.inside().copy_from_slice(&before);
            let (columns_out, row) = (padded.inside(), bits.inside());
            kernels.texture(&mut TextureRow {
                columns: columns_out,
                radius,
                threshold,
                bit: 16,
                except: 2,
                bits: row,
            });
            padded.checked("columns");
            for (x, &bits) in bits.checked("bits").iter().enumerate() {
                let window = x as isize - radius as isize..=(x + radius) as isize;
                let sum: u32 =
                    window.map(|i| u32::from(columns[i.clamp(0, width as isize - 1) as usize])).sum();
                let marked = if sum < threshold && before[x] & 2 == 0 { 16 } else { 0 };
                prop_assert_eq!(bits, before[x] | marked, "{} x = {}", kernels.level().name(), x);
            }
        }
    }

    #[test]
    fn breaks_agree(width in 1..200_usize, range in 0..40_u16, seed in any::<u64>()) {
        let mut noise = Noise(seed | 1);
        let values: Vec<u16> = (0..width).map(|_| u16::from(noise.next()) / 3).collect();
        let bits: Vec<u8> = (0..width).map(|_| [0, 0, 0, 128, 4, 132][usize::from(noise.next()) % 6]).collect();
        for kernels in Level::available().map(Kernels::new) {
            let mut breaks = Guarded::of(&vec![7; width], 0xA5);
            kernels.breaks(&mut BreaksRow {
                values: &values,
                bits: &bits,
                except: 127,
                range,
                breaks: breaks.inside(),
            });
            for (x, &actual) in breaks.checked("breaks").iter().enumerate() {
                let has = |x: usize| bits[x] & 127 == 0;
                let is_break = x > 0
                    && (has(x - 1) != has(x) || has(x) && values[x - 1].abs_diff(values[x]) > range);
                prop_assert_eq!(actual, u8::from(is_break), "{} x = {}", kernels.level().name(), x);
            }
        }
    }

    #[test]
    fn xsobel_agrees(width in 1..150_usize, cap in 1..=63_u8, seed in any::<u64>(), extreme in any::<bool>()) {
        let mut noise = Noise(seed | 1);
        let content = if extreme { Content::Extreme } else { Content::Noise };
        let [above, middle, below] = [(); 3].map(|()| noise.pixels(width, 255, content));
        for kernels in Level::available().map(Kernels::new) {
            let mut filtered = Guarded::of(&vec![0; width], 0xA5);
            kernels.xsobel(&mut XSobelRow {
                above: &above,
                middle: &middle,
                below: &below,
                cap,
                filtered: filtered.inside(),
            });
            let filtered = filtered.checked("filtered");
            for (x, &filtered) in filtered.iter().enumerate() {
                let step = |row: &[u8]| match (x.checked_sub(1), row.get(x + 1)) {
                    (Some(left), Some(&right)) => i32::from(right) - i32::from(row[left]),
                    _ => 0,
                };
                let derivative = step(&above) + 2 * step(&middle) + step(&below);
                let cap = i32::from(cap);
                prop_assert_eq!(i32::from(filtered), derivative.clamp(-cap, cap) + cap, "{} x = {}", kernels.level().name(), x);
            }
        }
    }
}

#[test]
fn columns_are_sorted_each_by_itself() {
    let mut noise = Noise(29);
    for count in (0..70).chain([127, 128, 129, 720]) {
        // Few values in odd lanes, so that many are equal; all ones stand for no value.
        let row = |_| {
            std::array::from_fn(|lane| match (noise.next(), noise.next()) {
                (0..60, _) => u16::MAX,
                (_, low) if lane % 2 == 1 => u16::from(low % 5),
                (high, low) => u16::from_le_bytes([low, high]),
            })
        };
        let unsorted: Vec<[u16; LANES]> = (0..count).map(row).collect();
        for kernels in Level::available().map(Kernels::new) {
            let mut rows = unsorted.clone();
            kernels.sort(&mut SortColumns { rows: &mut rows });
            for lane in 0..LANES {
                let mut expected: Vec<u16> = unsorted.iter().map(|row| row[lane]).collect();
                expected.sort_unstable();
                let sorted: Vec<u16> = rows.iter().map(|row| row[lane]).collect();
                assert_eq!(sorted, expected, "{count} rows, lane {lane}, {}", kernels.level().name());
            }
        }
    }
}

#[test]
fn grey_is_the_weighted_sum_rounded() {
    let mut noise = Noise(31);
    for width in (0..70).chain([640]) {
        let bgr: Vec<[u8; 3]> = (0..width)
            .map(|x| if x % 7 == 0 { [255; 3] } else { [noise.next(), noise.next(), noise.next()] })
            .collect();
        let expected = bgr.iter().map(|&[b, g, r]| {
            // The weights as 1/32768, as OpenCV has them.
            let weighted = 3_735.0 * f64::from(b) + 19_235.0 * f64::from(g) + 9_798.0 * f64::from(r);
            (weighted / 32_768.0 + 0.5).floor() as u8
        });
        let expected: Vec<u8> = expected.collect();
        for kernels in Level::available().map(Kernels::new) {
            let mut grey = Guarded::of(&vec![0_u8; width], 77);
            kernels.grey(&mut GreyRow { bgr: &bgr, grey: grey.inside() });
            let name = kernels.level().name();
            assert_eq!(grey.checked(name), expected, "{width} px, {name}");
        }
    }
}
