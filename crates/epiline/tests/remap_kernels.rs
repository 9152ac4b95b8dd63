//! Resampling at every instruction level: the same bits as eq. 4 written out, values between guard cells.

mod guarded;

use epiline::kernels::remap::{ONE, RemapRow, Table, Tap};
use epiline::kernels::{Kernels, Level};
use proptest::prelude::*;

use guarded::Guarded;

#[derive(Debug, Clone)]
struct Case {
    width: usize,
    height: usize,
    source: (usize, usize),
    /// Elements between the source's rows beyond its width.
    gap: usize,
    /// Source position of pixel (x, y): `from + x·across + y·along`, in 1/256 px.
    from: [i64; 2],
    across: [i64; 2],
    along: [i64; 2],
    /// Positions that are moved by so much at random.
    jitter: i64,
    extreme: bool,
    seed: u64,
}

fn case() -> impl Strategy<Value = Case> {
    // Steps about one pixel, and now and then what no window holds.
    let step = || prop_oneof![6 => 200..320i64, 1 => -600..600i64];
    let slope = || prop_oneof![6 => -30..30i64, 1 => -600..600i64];
    let side = || prop_oneof![1 => 1..4usize, 1 => 15..18usize, 6 => 1..90usize];
    (
        (1..100usize, 1..6usize, (side(), side()), 0..40usize),
        ([-2000..6000i64, -1500..4000i64], [step(), slope()], [slope(), step()]),
        (prop_oneof![3 => Just(0i64), 1 => 1..3000i64], any::<bool>(), any::<u64>()),
    )
        .prop_map(|((width, height, source, gap), (from, across, along), (jitter, extreme, seed))| {
            Case { width, height, source, gap, from, across, along, jitter, extreme, seed }
        })
}

fn noise(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state >> 16
    }
}

/// A position in 1/256 px as a tap's first pixel and weight; on the last pixel all of the one before it.
fn split(position: i64, len: usize) -> Option<(u16, u16)> {
    let one = i64::from(ONE);
    let last = (len as i64 - 1) * one;
    if !(0..=last).contains(&position) {
        return None;
    }
    let first = (position / one).min((len as i64 - 2).max(0));
    Some((first as u16, (position - first * one) as u16))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn every_level_combines_four_pixels_as_the_equation_says(case in case()) {
        let mut random = noise(case.seed);
        let (source_width, source_height) = case.source;
        let stride = source_width + case.gap;
        let source: Vec<u8> = (0..(source_height - 1) * stride + source_width)
            .map(|_| if case.extreme { 255 * (random() & 1) as u8 } else { random() as u8 })
            .collect();
        let mut positions = Vec::new();
        for y in 0..case.height as i64 {
            for x in 0..case.width as i64 {
                let jitter = if case.jitter > 0 { (random() % case.jitter as u64) as i64 } else { 0 };
                positions.push([0, 1].map(|i| case.from[i] + x * case.across[i] + y * case.along[i] + jitter));
            }
        }
        let taps: Vec<Option<Tap>> = positions
            .iter()
            .map(|&[u, v]| {
                let ((x, right), (y, down)) = (split(u, source_width)?, split(v, source_height)?);
                Some(Tap { x, y, right, down })
            })
            .collect();
        let table = Table::new(&taps, case.width, case.source);
        for level in Level::available() {
            let kernels = Kernels::new(level);
            for y in 0..case.height {
                let mut values = Guarded::of(&vec![7; case.width], 0xa5);
                kernels.remap(&mut RemapRow { table: &table, y, source: &source, stride, values: values.inside() });
                let values = values.checked(level.name());
                for x in 0..case.width {
                    let [u, v] = positions[y * case.width + x];
                    let expected = taps[y * case.width + x].map_or(0.0, |_| {
                        // In floating point, where all of it is exact.
                        let (u, v) = (u as f64 / 256.0, v as f64 / 256.0);
                        let level = |i: f64, j: f64| {
                            let weight = (1.0 - (u - i).abs()).max(0.0) * (1.0 - (v - j).abs()).max(0.0);
                            if weight == 0.0 { 0.0 } else {
                                weight * f64::from(source[j as usize * stride + i as usize])
                            }
                        };
                        let (i, j) = (u.floor(), v.floor());
                        let sum = level(i, j) + level(i + 1.0, j) + level(i, j + 1.0) + level(i + 1.0, j + 1.0);
                        (sum + 0.5).floor()
                    });
                    prop_assert_eq!(
                        f64::from(values[x]), expected, "{} at ({}, {}) from ({}, {})", level.name(), x, y, u, v
                    );
                }
            }
        }
    }
}

#[test]
fn a_table_reads_nothing_outside_its_source() {
    let bad = |tap| {
        std::panic::catch_unwind(|| Table::new(&[Some(tap)], 1, (20, 10))).expect_err("must be refused");
    };
    let tap = Tap { x: 3, y: 4, right: 5, down: 6 };
    Table::new(&[Some(tap)], 1, (20, 10));
    bad(Tap { x: 19, ..tap });
    bad(Tap { y: 9, ..tap });
    bad(Tap { right: 257, ..tap });
    bad(Tap { down: 257, ..tap });
    let table = Table::new(&[Some(tap)], 1, (20, 10));
    for (len, stride) in [(199, 20), (200, 19)] {
        let source = vec![0; len];
        let row = || {
            let mut values = [0];
            let mut row = RemapRow { table: &table, y: 0, source: &source, stride, values: &mut values };
            Kernels::new(Level::SCALAR).remap(&mut row);
        };
        std::panic::catch_unwind(row).expect_err("must be refused");
    }
}
