//! Every semi-global kernel of every instruction level against the reference, bit for bit, outputs between guard cells.

mod guarded;

use epiline::kernels::sad::Choice;
use epiline::kernels::semi_global::features::{CENSUS_BYTES, CensusRow, Channel, ExtremesRow, PixelRow};
use epiline::kernels::semi_global::{
    CostRow, ExcessRow, HorizontalRow, HorizontalRows, NO_CANDIDATE, SumRow, VerticalRow, WindowRow,
    reference,
};
use epiline::kernels::{Kernels, Level};
use proptest::prelude::*;

use guarded::Guarded;

/// Repeatable bytes.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u8 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 32) as u8
    }

    fn bytes(&mut self, len: usize, largest: u8, extreme: bool) -> Vec<u8> {
        let byte = |noise: &mut Self| match extreme {
            true => largest * (noise.next() & 1),
            false => (u16::from(noise.next()) * (u16::from(largest) + 1) / 256) as u8,
        };
        (0..len).map(|_| byte(self)).collect()
    }

    fn blocks(&mut self, len: usize) -> Vec<u8> {
        (0..len).map(|_| if self.next() < 40 { NO_CANDIDATE } else { 0 }).collect()
    }
}

#[derive(Debug, Clone)]
struct Case {
    width: usize,
    num_disparities: usize,
    radius: usize,
    p1: u8,
    ratio: u32,
    reach: Option<usize>,
    both: bool,
    extreme: bool,
    seed: u64,
}

/// The kernels of a level, or the reference, which takes any number of lanes.
#[derive(Clone, Copy)]
#[expect(clippy::large_enum_variant, reason = "few exist")]
enum Variant {
    Level(Kernels),
    Reference,
}

/// Calls a kernel of a variant.
macro_rules! call {
    ($variant:expr, $kernel:ident, $reference:ident, $row:expr) => {
        match $variant {
            Variant::Level(kernels) => kernels.$kernel($row),
            Variant::Reference => reference::$reference($row),
        }
    };
}

/// What the kernels leave behind, by name.
type Outcome = Vec<(&'static str, Vec<u16>)>;

fn wide(bytes: Vec<u8>) -> Vec<u16> {
    bytes.into_iter().map(u16::from).collect()
}

fn features(case: &Case, kernels: &Kernels, left: &mut Outcome) {
    let mut noise = Noise(case.seed | 1);
    let value = noise.bytes(case.width, 255, case.extreme);
    let (mut low, mut high) =
        (Guarded::of(&vec![7; case.width], 0xA5), Guarded::of(&vec![7; case.width], 0xA5));
    kernels.extremes(&mut ExtremesRow { value: &value, low: low.inside(), high: high.inside() });
    left.push(("low", wide(low.checked("low"))));
    left.push(("high", wide(high.checked("high"))));
    let rows: Vec<Vec<u8>> = (0..5).map(|_| noise.bytes(case.width + 4, 255, case.extreme)).collect();
    let mut planes: Vec<Guarded<u8>> =
        (0..CENSUS_BYTES).map(|_| Guarded::of(&vec![7; case.width], 0xA5)).collect();
    let [a, b, c] = planes.as_mut_slice() else { unreachable!("three planes") };
    kernels.census(&mut CensusRow {
        rows: std::array::from_fn(|i| &rows[i][..]),
        planes: [a.inside(), b.inside(), c.inside()],
    });
    planes.iter().for_each(|plane| left.push(("census", wide(plane.checked("census")))));
}

/// A row of an image: three planes of a channel each for the filtered and the grey image, and the census.
fn pixels(noise: &mut Noise, len: usize, extreme: bool) -> Vec<Vec<u8>> {
    let channel = |noise: &mut Noise, largest: u8| {
        let [a, b, c] = [(); 3].map(|()| noise.bytes(len, largest, extreme));
        let sorted: Vec<[u8; 3]> = (0..len)
            .map(|i| {
                let mut three = [a[i], b[i], c[i]];
                three.sort_unstable();
                three
            })
            .collect();
        [1, 0, 2].map(|which| sorted.iter().map(|three| three[which]).collect::<Vec<u8>>())
    };
    let (filtered, grey) = (channel(noise, 126), channel(noise, 255));
    let census = [(); CENSUS_BYTES].map(|()| noise.bytes(len, 255, extreme));
    filtered.into_iter().chain(grey).chain(census).collect()
}

fn pixel_row(planes: &[Vec<u8>]) -> PixelRow<'_> {
    let channel = |at: usize| Channel { value: &planes[at], low: &planes[at + 1], high: &planes[at + 2] };
    PixelRow { filtered: channel(0), grey: channel(3), census: std::array::from_fn(|i| &planes[6 + i][..]) }
}

fn costs(case: &Case, lanes: usize, variant: Variant, out: &mut Outcome) {
    let &Case { width, radius, .. } = case;
    let (cells, padded) = (width * lanes, width + lanes - 1);
    let mut noise = Noise(case.seed | 1);
    let (left, right) = (pixels(&mut noise, width, case.extreme), pixels(&mut noise, padded, case.extreme));
    let leaving = noise.bytes(cells, 213, case.extreme);
    let others = (2 * radius as u16) * 213;
    let sums: Vec<u16> =
        leaving.iter().map(|&cost| u16::from(cost) + others * u16::from(noise.next() & 1)).collect();
    let (mut pixel_costs, mut column_sums) = (Guarded::of(&leaving, 0xA5), Guarded::of(&sums, 0xA5A5));
    call!(
        variant,
        cost,
        cost_row,
        &mut CostRow {
            lanes,
            left: pixel_row(&left),
            right: pixel_row(&right),
            pixel_costs: pixel_costs.inside(),
            column_sums: column_sums.inside(),
        }
    );
    let sums = column_sums.checked("column_sums");
    let (blocked_left, blocked_right, blocked_lanes) =
        (noise.blocks(width), noise.blocks(padded), noise.blocks(lanes));
    let mut window = Guarded::of(&vec![7; cells], 0xA5);
    call!(
        variant,
        window,
        window_row,
        &mut WindowRow {
            lanes,
            radius,
            column_sums: &sums,
            blocked_left: &blocked_left,
            blocked_right: &blocked_right,
            blocked_lanes: &blocked_lanes,
            costs: window.inside(),
        }
    );
    out.push(("pixel_costs", wide(pixel_costs.checked("pixel_costs"))));
    out.push(("column_sums", sums));
    out.push(("costs", wide(window.checked("costs"))));
}

/// Matching costs: up to 127, or no candidate.
fn matching_costs(noise: &mut Noise, case: &Case, cells: usize) -> Vec<u8> {
    let blocks = noise.blocks(cells);
    noise.bytes(cells, 127, case.extreme).iter().zip(blocks).map(|(&cost, blocked)| cost | blocked).collect()
}

fn paths(case: &Case, lanes: usize, variant: Variant, out: &mut Outcome) {
    let &Case { width, p1, .. } = case;
    let cells = width * lanes;
    let mut noise = Noise(case.seed | 1);
    let costs = matching_costs(&mut noise, case, cells);
    let p2: Vec<u8> = noise.bytes(width, 127, case.extreme).into_iter().map(|p2| p2.max(p1)).collect();
    // Rows are led through in pairs; one is left over.
    let others: Vec<_> = (0..case.seed as usize % 4)
        .map(|_| {
            let costs = matching_costs(&mut noise, case, cells);
            (
                costs,
                noise.bytes(width, 127, case.extreme).into_iter().map(|p2| p2.max(p1)).collect::<Vec<_>>(),
            )
        })
        .collect();
    let mut guarded: Vec<[Guarded<u8>; 2]> =
        (0..=others.len()).map(|_| [0, 1].map(|_| Guarded::of(&vec![7; cells], 0xA5))).collect();
    let inputs = std::iter::once((&costs, &p2)).chain(others.iter().map(|(costs, p2)| (costs, p2)));
    let mut rows: Vec<HorizontalRow<'_>> = inputs
        .zip(&mut guarded)
        .map(|((costs, p2), [left, right])| HorizontalRow {
            costs,
            p2,
            from_left: left.inside(),
            from_right: right.inside(),
        })
        .collect();
    call!(variant, horizontal, horizontal_rows, &mut HorizontalRows { lanes, p1, rows: &mut rows });
    let mut paths =
        guarded.into_iter().map(|[left, right]| (left.checked("from_left"), right.checked("from_right")));
    let (left, right) = paths.next().expect("the first row");
    for (left, right) in paths {
        out.push(("from_left", wide(left)));
        out.push(("from_right", wide(right)));
    }
    let smallest_of = |paths: &[u8]| -> Vec<u8> {
        paths.chunks(lanes).map(|lanes| *lanes.iter().min().expect("not empty")).collect()
    };
    let mut smallest = Guarded::of(&smallest_of(&left), 0xA5);
    let mut above = Guarded::of(&vec![7; cells], 0xA5);
    call!(
        variant,
        vertical,
        vertical_row,
        &mut VerticalRow {
            lanes,
            costs: &costs,
            p1,
            p2: &p2,
            before: &left,
            smallest: smallest.inside(),
            after: above.inside(),
        }
    );
    let above = above.checked("after");
    let none = Choice { before: 0, best: 0, after: 0, lane: 0xA5A5 };
    let (mut sums, mut chosen) =
        (Guarded::of(&vec![7; cells], 0xA5A5), Guarded::of(&vec![none; width], none));
    let (mut rivals, mut nearby) =
        (Guarded::of(&vec![7; width], 0xA5A5), Guarded::of(&vec![7; width], 0xA5A5));
    let mut right_best = Guarded::of(&vec![7; width + lanes - 1], 0xA5A5);
    call!(
        variant,
        sum,
        sum_row,
        &mut SumRow {
            lanes,
            from_left: &left,
            from_right: &right,
            from_above: &above,
            from_below: if case.both { &right } else { &[] },
            uniqueness_ratio: case.ratio,
            left_right_reach: case.reach,
            sums: sums.inside(),
            chosen: chosen.inside(),
            rivals: rivals.inside(),
            nearby: nearby.inside(),
            right_best: right_best.inside(),
        }
    );
    let mut excess = Guarded::of(&vec![7; cells], 0xA5);
    call!(
        variant,
        excess,
        excess_row,
        &mut ExcessRow {
            lanes,
            from_left: &left,
            from_right: &right,
            from_above: &above,
            excess: excess.inside(),
        }
    );
    out.push(("excess", wide(excess.checked("excess"))));
    let chosen = chosen.checked("chosen").iter().flat_map(|c| [c.before, c.best, c.after, c.lane]).collect();
    out.extend([("from_left", wide(left)), ("from_right", wide(right)), ("above", wide(above))]);
    out.extend([("smallest", wide(smallest.checked("smallest"))), ("sums", sums.checked("sums"))]);
    out.extend([("chosen", chosen), ("rivals", rivals.checked("rivals"))]);
    out.extend([("nearby", nearby.checked("nearby")), ("right_best", right_best.checked("right_best"))]);
}

fn run(case: &Case, lanes: usize, variant: Variant) -> Outcome {
    let mut outcome = Outcome::new();
    let kernels = if let Variant::Level(kernels) = variant { kernels } else { Kernels::new(Level::SCALAR) };
    features(case, &kernels, &mut outcome);
    costs(case, lanes, variant, &mut outcome);
    paths(case, lanes, variant, &mut outcome);
    outcome
}

fn assert_levels_agree(case: &Case) {
    for kernels in Level::available().map(Kernels::new) {
        let lanes = kernels.lanes(case.num_disparities);
        let (actual, expected) =
            (run(case, lanes, Variant::Level(kernels)), run(case, lanes, Variant::Reference));
        for (actual, expected) in actual.into_iter().zip(expected) {
            assert_eq!(actual, expected, "{} {lanes} lanes {case:?}", kernels.level().name());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn kernels_agree(
        width in 1..=90_usize,
        num_disparities in 1..=200_usize,
        radius in 0..=7_usize,
        p1 in 0..=127_u8,
        ratio in prop::sample::select(vec![0_u32, 10, 100]),
        reach in prop::sample::select(vec![None, Some(0_usize), Some(1), Some(9)]),
        both in any::<bool>(),
        extreme in any::<bool>(),
        seed in any::<u64>(),
    ) {
        assert_levels_agree(&Case { width, num_disparities, radius, p1, ratio, reach, both, extreme, seed });
    }
}

#[test]
fn kernels_agree_for_every_number_of_vectors() {
    for num_disparities in [1, 16, 32, 33, 48, 64, 96, 128, 129, 192, 256, 384, 512, 1024] {
        for (width, reach) in [(1, Some(1)), (2, None), (19, Some(1)), (33, None)] {
            assert_levels_agree(&Case {
                width,
                num_disparities,
                radius: 1,
                p1: 10,
                ratio: 10,
                reach,
                both: width % 2 == 1,
                extreme: false,
                seed: (num_disparities * width) as u64,
            });
        }
    }
}
