//! The kernels over vectors, written once for every instruction set.
//!
//! Where they leave the reference, and why:
//!
//! 1. The two smallest of four are both upper corners, both lower ones, or the smaller of each two: the smallest of three
//!    sums, without sorting.
//! 2. The number of vectors of [`best_row`] is a constant, so that a pixel's costs stay in registers; the right image's
//!    best costs are collected in registers that shift a lane per column, as in [`sad`](super::super::sad).
//! 3. Costs are written back only where some are blocked.
//! 4. No vector passes through a closure: it is compiled without the instruction set, and not always inlined.

// Iterator adaptors and closures do not inherit the instruction set of the function they are inlined into; loops do.
#![expect(clippy::needless_range_loop)]

use super::{BestRow, BestWindowsRow, BoxRow, PixelCost, PixelCostRow};
use crate::kernels::sad::reference::{choice_at, find_nearby, rival_limit};
use crate::kernels::sad::vector::Lanes;
use crate::kernels::sad::{Choice, Cost};
use crate::kernels::semi_global::vector::{Bytes, Splat, dispatch};

/// The difference of one left pixel from many right ones.
trait Difference<V: Bytes> {
    /// For the pixel in column `x`.
    ///
    /// # Safety
    /// As [`Bytes`]; `x` is inside the row.
    unsafe fn of(row: &PixelCostRow<'_>, x: usize) -> Self;

    /// From the right pixels `i` to `i + V::COUNT - 1`.
    ///
    /// # Safety
    /// As [`Bytes`]; they are inside the row.
    unsafe fn against(&self, row: &PixelCostRow<'_>, i: usize) -> V;
}

struct Absolute<V>(V);

impl<V: Bytes> Difference<V> for Absolute<V> {
    #[inline(always)]
    unsafe fn of(row: &PixelCostRow<'_>, x: usize) -> Self {
        // SAFETY: the caller's; so too below.
        unsafe { Self(V::splat(*row.left.filtered.value.get_unchecked(x))) }
    }

    #[inline(always)]
    unsafe fn against(&self, row: &PixelCostRow<'_>, i: usize) -> V {
        // SAFETY: see above.
        unsafe {
            let right = V::load(row.right.filtered.value.as_ptr().add(i));
            self.0.saturating_sub(right).or(right.saturating_sub(self.0))
        }
    }
}

struct Census<V>([V; 3]);

impl<V: Bytes> Difference<V> for Census<V> {
    #[inline(always)]
    unsafe fn of(row: &PixelCostRow<'_>, x: usize) -> Self {
        let [a, b, c] = row.left.census;
        // SAFETY: see above.
        unsafe {
            Self([
                V::splat(*a.get_unchecked(x)),
                V::splat(*b.get_unchecked(x)),
                V::splat(*c.get_unchecked(x)),
            ])
        }
    }

    #[inline(always)]
    unsafe fn against(&self, row: &PixelCostRow<'_>, i: usize) -> V {
        let [a, b, c] = row.right.census;
        // SAFETY: see above.
        unsafe {
            let first = self.0[0].hamming(V::load(a.as_ptr().add(i)));
            let second = self.0[1].hamming(V::load(b.as_ptr().add(i)));
            first.add(second).add(self.0[2].hamming(V::load(c.as_ptr().add(i))))
        }
    }
}

struct SamplingInsensitive<V> {
    filtered: Splat<V>,
    grey: Splat<V>,
}

impl<V: Bytes> Difference<V> for SamplingInsensitive<V> {
    #[inline(always)]
    unsafe fn of(row: &PixelCostRow<'_>, x: usize) -> Self {
        // SAFETY: see above.
        unsafe { Self { filtered: Splat::new(row.left.filtered, x), grey: Splat::new(row.left.grey, x) } }
    }

    #[inline(always)]
    unsafe fn against(&self, row: &PixelCostRow<'_>, i: usize) -> V {
        // SAFETY: see above.
        unsafe {
            let grey = self.grey.sampling_insensitive(row.right.grey, i).quarter();
            self.filtered.sampling_insensitive(row.right.filtered, i).add(grey)
        }
    }
}

/// See [`PixelCostRow`].
///
/// # Safety
/// As [`Bytes`], `row.check` passed, and the lanes are a multiple of `V::COUNT`; so too below.
#[inline(always)]
unsafe fn pixel_cost_row<V: Bytes>(row: &mut PixelCostRow<'_>) {
    // SAFETY: the caller's.
    unsafe {
        match row.cost {
            PixelCost::Absolute => replace_costs::<V, Absolute<V>>(row),
            PixelCost::Census => replace_costs::<V, Census<V>>(row),
            PixelCost::SamplingInsensitive => replace_costs::<V, SamplingInsensitive<V>>(row),
        }
    }
}

/// # Safety
/// As above.
#[inline(always)]
unsafe fn replace_costs<V: Bytes, D: Difference<V>>(row: &mut PixelCostRow<'_>) {
    // SAFETY: column `x` has `lanes` cells from `x * lanes` on, and right pixels `x` to `x + lanes - 1`.
    unsafe {
        let largest = V::splat(row.largest);
        for x in 0..row.left.grey.value.len() {
            let difference = D::of(row, x);
            for k in (0..row.lanes).step_by(V::COUNT) {
                let entering = difference.against(row, x + k).min(largest);
                let cost = row.pixel_costs.as_mut_ptr().add(x * row.lanes + k);
                let (plus, minus) = (entering.widen(), V::load(cost).widen());
                entering.store(cost);
                for half in 0..2 {
                    let sum = row.column_sums.as_mut_ptr().add(x * row.lanes + k + half * V::Words::COUNT);
                    V::Words::load(sum).add(plus[half].sub(minus[half])).store(sum);
                }
            }
        }
    }
}

/// See [`BoxRow`].
///
/// # Safety
/// As above.
#[inline(always)]
unsafe fn box_row<V: Lanes>(row: &mut BoxRow<'_>) {
    let (lanes, radius) = (row.lanes, row.radius);
    let last = row.boxes.len() / lanes - 1;
    // SAFETY: columns are clamped to the row; `k` steps through the lanes of one.
    unsafe {
        let (columns, boxes) = (row.column_sums.as_ptr(), row.boxes.as_mut_ptr());
        for k in (0..lanes).step_by(V::COUNT) {
            let mut sum = V::splat(0);
            for i in 0..=2 * radius {
                sum = sum.add(V::load(columns.add(i.saturating_sub(radius).min(last) * lanes + k)));
            }
            sum.store(boxes.add(k));
            for x in 1..=last {
                let entering = V::load(columns.add((x + radius).min(last) * lanes + k));
                let leaving = V::load(columns.add(x.saturating_sub(radius + 1) * lanes + k));
                sum = sum.add(entering.sub(leaving));
                sum.store(boxes.add(x * lanes + k));
            }
        }
    }
}

/// See [`BestWindowsRow`].
///
/// # Safety
/// As above.
#[inline(always)]
unsafe fn best_windows_row<V: Lanes>(row: &mut BestWindowsRow<'_>) {
    let (lanes, radius) = (row.lanes, row.radius);
    let last = row.costs.len() / lanes - 1;
    // SAFETY: columns are clamped to the row; `k` steps through the lanes of one.
    unsafe {
        let (above, below) = (row.above.as_ptr(), row.below.as_ptr());
        for x in 0..=last {
            let (left, right) = (x.saturating_sub(radius) * lanes, (x + radius).min(last) * lanes);
            for k in (0..lanes).step_by(V::COUNT) {
                let (a, b) = (V::load(above.add(left + k)), V::load(above.add(right + k)));
                let (c, d) = (V::load(below.add(left + k)), V::load(below.add(right + k)));
                let best = a.add(b).min(c.add(d)).min(a.min(b).add(c.min(d)));
                let cell = x * lanes + k;
                V::load(row.middle.as_ptr().add(cell)).add(best).store(row.costs.as_mut_ptr().add(cell));
            }
        }
    }
}

/// See [`BestRow`].
///
/// # Safety
/// As above, with exactly `N` vectors of lanes; `LEFT_RIGHT` tells whether `left_right_reach` is set.
#[inline(always)]
unsafe fn best_row<V: Bytes, const N: usize, const LEFT_RIGHT: bool>(row: &mut BestRow<'_>) {
    let lanes = N * V::COUNT;
    let width = row.chosen.len();
    // SAFETY: every column has `lanes` cells from `x * lanes` on; words are half as many to a vector.
    unsafe {
        let blocked = V::Words::splat(u16::BLOCKED);
        let mut right_best = [[blocked; 2]; N];
        for x in 0..width {
            let mut costs = [[blocked; 2]; N];
            let mut smallest = blocked;
            for i in 0..N {
                let cells = row.costs.as_mut_ptr().add(x * lanes + i * V::COUNT);
                costs[i] = [V::Words::load(cells), V::Words::load(cells.add(V::Words::COUNT))];
                if x < row.blocked_columns {
                    let is_blocked = V::splat(*row.blocked_left.get_unchecked(x))
                        .or(V::load(row.blocked_right.as_ptr().add(x + i * V::COUNT)))
                        .or(V::load(row.blocked_lanes.as_ptr().add(i * V::COUNT)))
                        .widen_is_255();
                    costs[i] = [costs[i][0].or(is_blocked[0]), costs[i][1].or(is_blocked[1])];
                    costs[i][0].store(cells);
                    costs[i][1].store(cells.add(V::Words::COUNT));
                }
                smallest = smallest.min(costs[i][0].min(costs[i][1]));
            }
            let best = smallest.splat_min();
            let mut lane = 0;
            for i in (0..N).rev() {
                let equal = V::Words::equal_bits(costs[i], best);
                lane = if equal != 0 { i * V::COUNT + equal.trailing_zeros() as usize } else { lane };
            }
            // Its surroundings are read once the row is complete.
            row.chosen.get_unchecked_mut(x).lane = lane as u16;
            if row.uniqueness_ratio > 0 {
                let limit = rival_limit(best.first().into(), row.uniqueness_ratio);
                let limit = V::Words::splat(limit.min(u32::from(u16::BLOCKED) - 1) as u16);
                let mut count = 0;
                for pair in &costs {
                    count += V::Words::count_at_most(*pair, limit);
                }
                *row.rivals.get_unchecked_mut(x) = count as u16;
            }
            if LEFT_RIGHT {
                for i in 0..N {
                    let [low, high] = right_best[i];
                    right_best[i] = [low.min(costs[i][0]), high.min(costs[i][1])];
                }
                *row.right_best.get_unchecked_mut(x) = right_best[0][0].first();
                for i in 0..N {
                    let next = if i + 1 < N { right_best[i + 1][0] } else { blocked };
                    let [low, high] = right_best[i];
                    right_best[i] = [low.shift_down(high), high.shift_down(next)];
                }
            }
        }
        if LEFT_RIGHT {
            // What remains belongs to right columns from `width` on: all lanes but the last, which was shifted in.
            let mut rest = [0_u16; 64];
            for (i, pair) in right_best.iter().enumerate() {
                pair[0].store(rest.as_mut_ptr());
                pair[1].store(rest.as_mut_ptr().add(V::Words::COUNT));
                let from = width + i * V::COUNT;
                let count = V::COUNT.min(row.right_best.len() - from);
                row.right_best[from..from + count].copy_from_slice(&rest[..count]);
            }
        }
    }
    for (choice, costs) in row.chosen.iter_mut().zip(row.costs.chunks_exact(lanes)) {
        let Choice { lane, .. } = *choice;
        *choice = choice_at(costs, lane.into());
    }
    if let Some(reach) = row.left_right_reach {
        find_nearby(row.costs, lanes, reach, row.chosen, row.nearby);
    }
}

/// The entry points of an instruction set.
macro_rules! entries {
    ($set:ident, $vector:path, $features:literal) => {
        pub(in crate::kernels) mod $set {
            use $vector as Vector;

            use super::{BestRow, BestWindowsRow, BoxRow, Bytes, PixelCostRow, dispatch};

            /// See [`PixelCostRow`].
            ///
            /// # Safety
            /// The processor has what the level proves, `row.check` passed and the lanes come from `padded_lanes`; so
            /// too below.
            #[target_feature(enable = $features)]
            pub unsafe fn pixel_cost_row(row: &mut PixelCostRow<'_>) {
                // SAFETY: the caller's; so too below.
                unsafe { super::pixel_cost_row::<Vector>(row) }
            }

            /// See [`BoxRow`].
            ///
            /// # Safety
            /// As above.
            #[target_feature(enable = $features)]
            pub unsafe fn box_row(row: &mut BoxRow<'_>) {
                // SAFETY: see above.
                unsafe { super::box_row::<<Vector as Bytes>::Words>(row) }
            }

            /// See [`BestWindowsRow`].
            ///
            /// # Safety
            /// As above.
            #[target_feature(enable = $features)]
            pub unsafe fn best_windows_row(row: &mut BestWindowsRow<'_>) {
                // SAFETY: see above.
                unsafe { super::best_windows_row::<<Vector as Bytes>::Words>(row) }
            }

            /// # Safety
            /// As that of the vectors' kernel.
            #[target_feature(enable = $features)]
            unsafe fn best_instance<const N: usize, const LEFT_RIGHT: bool>(row: &mut BestRow<'_>) {
                // SAFETY: see above.
                unsafe { super::best_row::<Vector, N, LEFT_RIGHT>(row) }
            }

            /// See [`BestRow`].
            ///
            /// # Safety
            /// As above.
            #[target_feature(enable = $features)]
            pub unsafe fn best_row(row: &mut BestRow<'_>) {
                if row.left_right_reach.is_some() {
                    dispatch!(best_instance, row, <Vector as Bytes>::COUNT, true);
                } else {
                    dispatch!(best_instance, row, <Vector as Bytes>::COUNT, false);
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
entries!(avx2, crate::kernels::semi_global::avx2::U8x32, "avx2,bmi1,popcnt");
#[cfg(target_arch = "x86_64")]
entries!(avx512, crate::kernels::semi_global::avx512::U8x64, "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt");
#[cfg(target_arch = "aarch64")]
entries!(neon, crate::kernels::semi_global::neon::U8x16, "neon");
