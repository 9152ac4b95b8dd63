//! The floor's kernel at every level against its definition, element by element.

mod guarded;

use epiline::kernels::floor::{FloorRow, Linear};
use epiline::kernels::{Kernels, Level};
use guarded::Guarded;
use proptest::prelude::*;

const LARGEST_AHEAD: f32 = 900.0;

/// One element by the definition: the state before, and what is out.
fn by_definition(row: &FloorRow<'_>, i: usize, state: [f32; 3]) -> ([f32; 3], i32) {
    let at = |linear: Linear| linear.at_first + linear.per_place * i as f32;
    let (ground, noise) = (at(row.ground), row.noise_raw);
    let [last_row, last_raw, next_row] = state;
    if row.bits[i] != 0 {
        return (state, -1);
    }
    let seen = f32::from(row.raws[i]) + row.doffs_raw;
    let stands_out = ground * row.low - ground >= noise;
    let lowest = (ground * row.below).min(ground - noise);
    let state = if stands_out && seen >= lowest && seen < ground * row.low && row.row >= next_row {
        [row.row, seen.max(ground), row.row - at(row.hidden)]
    } else {
        [last_row, last_raw, next_row]
    };
    let ahead = seen * at(row.per_forward);
    let matters = seen >= ground * row.low && seen >= ground + noise;
    let within = seen >= at(row.least) && seen <= at(row.most) && seen > 0.0 && ahead <= LARGEST_AHEAD;
    (state, if matters && within { (ahead + 0.5) as i32 } else { -1 })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]
    #[test]
    fn floor_agrees(
        pixels in proptest::collection::vec((0..1000_u16, 0..4_u8, 0.0..40.0_f32), 1..150),
        ground in -200.0..900.0_f32,
        per_place in -1.0..1.0_f32,
        low in 1.0..1.5_f32,
        noise_raw in 0.0..20.0_f32,
        row in 0.0..40.0_f32,
        headroom in prop_oneof![Just(f32::INFINITY), 0.0..900.0_f32],
        doffs_raw in -50.0..50.0_f32,
    ) {
        let raws: Vec<u16> = pixels.iter().map(|pixel| pixel.0).collect();
        let bits: Vec<u8> = pixels.iter().map(|pixel| pixel.1 / 3 * 16).collect();
        let next: Vec<f32> = pixels.iter().map(|pixel| pixel.2).collect();
        let places: Vec<f32> = (0..raws.len()).map(|i| i as f32).collect();
        for kernels in Level::available().map(Kernels::new) {
            let name = kernels.level().name();
            let [mut last_row, mut last_raw] = [(); 2].map(|()| Guarded::of(&vec![3.5_f32; raws.len()], -7.0));
            let mut next_row = Guarded::of(&next, -7.0);
            let mut ahead = Guarded::of(&vec![5; raws.len()], -77);
            let mut of_kernel = FloorRow {
                raws: &raws,
                bits: &bits,
                places: &places,
                doffs_raw,
                ground: Linear { at_first: ground, per_place },
                low,
                below: 2.0 - low,
                noise_raw,
                least: Linear { at_first: 2.0, per_place: 0.1 },
                most: Linear::constant(headroom),
                per_forward: Linear { at_first: 0.8, per_place: 0.002 },
                largest_ahead: LARGEST_AHEAD,
                row,
                hidden: Linear { at_first: 4.0, per_place: -0.01 },
                last_row: last_row.inside(),
                last_raw: last_raw.inside(),
                next_row: next_row.inside(),
                ahead: ahead.inside(),
            };
            let expected: Vec<_> =
                (0..raws.len()).map(|i| by_definition(&of_kernel, i, [3.5, 3.5, next[i]])).collect();
            kernels.floor(&mut of_kernel);
            let (last_row, last_raw) = (last_row.checked("last_row"), last_raw.checked("last_raw"));
            let (next_row, ahead) = (next_row.checked("next_row"), ahead.checked("ahead"));
            for (i, (state, obstacle)) in expected.into_iter().enumerate() {
                let actual = [last_row[i], last_raw[i], next_row[i]];
                prop_assert_eq!(actual.map(f32::to_bits), state.map(f32::to_bits), "{} {}", name, i);
                prop_assert_eq!(ahead[i], obstacle, "{} {}", name, i);
            }
        }
    }
}
