//! Every kernel of box sums at every instruction level against the reference, bit for bit, outputs between guard cells.

mod guarded;

use epiline::kernels::sad::Choice;
use epiline::kernels::semi_global::features::{CENSUS_BYTES, Channel, PixelRow};
use epiline::kernels::windowed::{
    BestRow, BestWindowsRow, BoxRow, PixelCost, PixelCostRow, largest_pixel_cost, reference,
};
use epiline::kernels::{Kernels, Level};
use proptest::prelude::*;

use guarded::Guarded;

/// Repeatable numbers.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u16 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 32) as u16
    }

    /// Up to `largest`, or only 0 and `largest`.
    fn up_to(&mut self, largest: u16, extreme: bool) -> u16 {
        if extreme {
            largest * (self.next() & 1)
        } else {
            (u32::from(self.next()) % (u32::from(largest) + 1)) as u16
        }
    }

    fn bytes(&mut self, len: usize, largest: u8, extreme: bool) -> Vec<u8> {
        (0..len).map(|_| self.up_to(largest.into(), extreme) as u8).collect()
    }

    fn words(&mut self, len: usize, largest: u16, extreme: bool) -> Vec<u16> {
        (0..len).map(|_| self.up_to(largest, extreme)).collect()
    }

    fn blocks(&mut self, len: usize) -> Vec<u8> {
        (0..len).map(|_| if self.next() < 10_000 { u8::MAX } else { 0 }).collect()
    }
}

#[derive(Debug, Clone)]
struct Case {
    width: usize,
    num_disparities: usize,
    radius: usize,
    cost: PixelCost,
    ratio: u32,
    reach: Option<usize>,
    blocked_columns: usize,
    extreme: bool,
    seed: u64,
}

/// The kernels of a level, or the reference, which takes any number of lanes.
#[expect(clippy::large_enum_variant, reason = "few exist")]
#[derive(Clone, Copy)]
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

/// A row of an image: value, low and high of the filtered and of the grey image, and the census.
fn pixels(noise: &mut Noise, len: usize, extreme: bool) -> Vec<Vec<u8>> {
    let mut planes = Vec::new();
    for largest in [126, 255] {
        let mut sorted: Vec<Vec<u8>> = (0..len).map(|_| noise.bytes(3, largest, extreme)).collect();
        sorted.iter_mut().for_each(|three| three.sort_unstable());
        planes.extend([1, 0, 2].map(|which| sorted.iter().map(|three| three[which]).collect()));
    }
    planes.extend((0..CENSUS_BYTES).map(|_| noise.bytes(len, 255, extreme)));
    planes
}

fn pixel_row(planes: &[Vec<u8>]) -> PixelRow<'_> {
    let channel = |at: usize| Channel { value: &planes[at], low: &planes[at + 1], high: &planes[at + 2] };
    PixelRow { filtered: channel(0), grey: channel(3), census: std::array::from_fn(|i| &planes[6 + i][..]) }
}

fn sums(case: &Case, lanes: usize, variant: Variant) -> Outcome {
    let &Case { width, radius, cost, extreme, .. } = case;
    let (cells, side) = (width * lanes, 2 * radius + 1);
    let mut noise = Noise(case.seed | 1);
    let (left, right) = (pixels(&mut noise, width, extreme), pixels(&mut noise, width + lanes - 1, extreme));
    let largest = largest_pixel_cost(1, side);
    let leaving = noise.bytes(cells, largest, extreme);
    let others = (side as u16 - 1) * u16::from(largest);
    let sums: Vec<u16> = leaving.iter().map(|&cost| u16::from(cost) + noise.up_to(others, extreme)).collect();
    let (mut pixel_costs, mut column_sums) = (Guarded::of(&leaving, 0xA5), Guarded::of(&sums, 0xA5A5));
    let row = &mut PixelCostRow {
        lanes,
        cost,
        largest,
        left: pixel_row(&left),
        right: pixel_row(&right),
        pixel_costs: pixel_costs.inside(),
        column_sums: column_sums.inside(),
    };
    call!(variant, pixel_cost, pixel_cost_row, row);
    let column_sums = column_sums.checked("column_sums");
    let mut boxes = Guarded::of(&vec![7; cells], 0xA5A5);
    let row = &mut BoxRow { lanes, radius, column_sums: &column_sums, boxes: boxes.inside() };
    call!(variant, boxes, box_row, row);
    let pixel_costs = pixel_costs.checked("pixel_costs").into_iter().map(u16::from).collect();
    vec![("pixel_costs", pixel_costs), ("column_sums", column_sums), ("boxes", boxes.checked("boxes"))]
}

fn best(case: &Case, lanes: usize, variant: Variant) -> Outcome {
    let &Case { width, radius, extreme, .. } = case;
    let (cells, padded) = (width * lanes, width + lanes - 1);
    let mut noise = Noise(case.seed | 1);
    // Three of the largest fit, with nothing to spare.
    let [above, middle, below] = [(); 3].map(|()| noise.words(cells, 65_534 / 3, extreme));
    let (blocked_left, blocked_right, blocked_lanes) =
        (noise.blocks(width), noise.blocks(padded), noise.blocks(lanes));
    let none = Choice { before: 0, best: 0, after: 0, lane: 0xA5A5 };
    let mut costs = Guarded::of(&vec![7; cells], 0xA5A5);
    let (mut chosen, mut rivals) =
        (Guarded::of(&vec![none; width], none), Guarded::of(&vec![7; width], 0xA5A5));
    let (mut nearby, mut right_best) =
        (Guarded::of(&vec![7; width], 0xA5A5), Guarded::of(&vec![7; padded], 0xA5A5));
    let row = &mut BestWindowsRow {
        lanes,
        radius,
        above: &above,
        middle: &middle,
        below: &below,
        costs: costs.inside(),
    };
    call!(variant, best_windows, best_windows_row, row);
    let before = costs.checked("costs");
    let row = &mut BestRow {
        lanes,
        blocked_columns: case.blocked_columns.min(width),
        blocked_left: &blocked_left,
        blocked_right: &blocked_right,
        blocked_lanes: &blocked_lanes,
        uniqueness_ratio: case.ratio,
        left_right_reach: case.reach,
        costs: costs.inside(),
        chosen: chosen.inside(),
        rivals: rivals.inside(),
        nearby: nearby.inside(),
        right_best: right_best.inside(),
    };
    call!(variant, best, best_row, row);
    let chosen = chosen.checked("chosen").iter().flat_map(|c| [c.before, c.best, c.after, c.lane]).collect();
    vec![
        ("best windows", before),
        ("costs", costs.checked("costs")),
        ("chosen", chosen),
        ("rivals", rivals.checked("rivals")),
        ("nearby", nearby.checked("nearby")),
        ("right_best", right_best.checked("right_best")),
    ]
}

fn assert_levels_agree(case: &Case) {
    for kernels in Level::available().map(Kernels::new) {
        let lanes = kernels.lanes(case.num_disparities);
        for kernel in [sums, best] {
            let actual = kernel(case, lanes, Variant::Level(kernels));
            let expected = kernel(case, lanes, Variant::Reference);
            for (actual, expected) in actual.into_iter().zip(expected) {
                assert_eq!(actual, expected, "{} {lanes} lanes {case:?}", kernels.level().name());
            }
        }
    }
}

const COSTS: [PixelCost; 3] = [PixelCost::Absolute, PixelCost::Census, PixelCost::SamplingInsensitive];

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn kernels_agree(
        (width, num_disparities) in (1..=90_usize, 1..=200_usize),
        radius in 0..=15_usize,
        cost in prop::sample::select(COSTS.to_vec()),
        ratio in prop::sample::select(vec![0_u32, 10, 100]),
        reach in prop::sample::select(vec![None, Some(0_usize), Some(1), Some(9)]),
        blocked_columns in 0..=90_usize,
        extreme in any::<bool>(),
        seed in any::<u64>(),
    ) {
        assert_levels_agree(&Case {
            width, num_disparities, radius, cost, ratio, reach, blocked_columns, extreme, seed,
        });
    }
}

#[test]
fn kernels_agree_for_every_number_of_vectors() {
    for num_disparities in [1, 16, 32, 33, 48, 64, 96, 128, 129, 192, 256, 384, 512, 1024] {
        for (i, (width, reach)) in
            [(1, Some(1)), (2, None), (19, Some(1)), (33, None)].into_iter().enumerate()
        {
            assert_levels_agree(&Case {
                width,
                num_disparities,
                radius: 1,
                cost: COSTS[i % 3],
                ratio: 10,
                reach,
                blocked_columns: width / 2,
                extreme: false,
                seed: (num_disparities * width) as u64,
            });
        }
    }
}
