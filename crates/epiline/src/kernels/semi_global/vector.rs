//! The kernels over vectors of bytes, written once for every instruction set.
//!
//! Where they leave the reference, and why:
//!
//! 1. Lanes of a pixel are read `V::COUNT` at a time; neighbouring lanes come from shifting vectors, not from loads that
//!    straddle what was stored a moment ago.
//! 2. Both horizontal paths advance in one loop, of two rows where there are registers for that: each step waits for the
//!    smallest cost of the step before, and chains that do not know each other fill the wait.
//! 3. Along a path the number of vectors is a constant, so that the pixel before stays in registers.
//! 4. No vector passes through a closure, and no array through an iterator by value: what they expand to is compiled
//!    without the instruction set, and not always inlined.
//! 5. Along a path the smallest cost is subtracted last, since it is known last. `B(d±1) + P1` may then saturate, but only
//!    where it exceeds 255, which `B(d)` does not.
//! 6. The right image's best sums are collected in registers that shift a lane per column, as in [`sad`](super::super::sad).

#![expect(clippy::needless_range_loop, reason = "4. above")]

use super::features::Channel;
use super::{
    CostRow, ExcessRow, HorizontalRow, HorizontalRows, LARGEST_COST, NO_CANDIDATE, SumRow, VerticalRow,
    WindowRow,
};
use crate::kernels::sad::Choice;
use crate::kernels::sad::reference::{choice_at, find_nearby, rival_limit};
use crate::kernels::sad::vector::Lanes;

/// A vector of bytes of one instruction set.
///
/// # Safety
/// As [`Lanes`]: every function requires that the processor has that instruction set.
pub(in crate::kernels) trait Bytes: Copy {
    /// Bytes per vector.
    const COUNT: usize;
    /// Half as many words.
    type Words: Lanes;
    unsafe fn splat(value: u8) -> Self;
    unsafe fn load(from: *const u8) -> Self;
    unsafe fn store(self, to: *mut u8);
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn saturating_add(self, other: Self) -> Self;
    unsafe fn saturating_sub(self, other: Self) -> Self;
    unsafe fn min(self, other: Self) -> Self;
    unsafe fn max(self, other: Self) -> Self;
    unsafe fn or(self, other: Self) -> Self;
    /// A quarter of each byte, rounded down.
    unsafe fn quarter(self) -> Self;
    /// Bits set in each byte of `self ^ other`.
    unsafe fn hamming(self, other: Self) -> Self;
    /// The smallest byte, in every byte.
    unsafe fn splat_min(self) -> Self;
    /// Byte 0.
    unsafe fn first(self) -> u8;
    /// Byte `i` becomes byte `i - 1`; the first becomes the last of `previous`.
    unsafe fn lane_before(self, previous: Self) -> Self;
    /// Byte `i` becomes byte `i + 1`; the last becomes the first of `next`.
    unsafe fn lane_after(self, next: Self) -> Self;
    /// Bytes as words.
    unsafe fn widen(self) -> [Self::Words; 2];
    /// All ones where a byte is 255, else zero.
    unsafe fn widen_is_255(self) -> [Self::Words; 2];
    /// Words that fit bytes as bytes.
    unsafe fn narrow(words: [Self::Words; 2]) -> Self;
    /// The upper halves of products of words.
    unsafe fn high_product(words: Self::Words, other: Self::Words) -> Self::Words;
}

/// How far the values lie outside the interval.
///
/// # Safety
/// As [`Bytes`].
#[inline(always)]
unsafe fn outside<V: Bytes>(value: V, low: V, high: V) -> V {
    // SAFETY: the caller's.
    unsafe { value.saturating_sub(high).max(low.saturating_sub(value)) }
}

/// One left pixel of a [`Channel`] in all lanes.
pub(in crate::kernels) struct Splat<V> {
    value: V,
    low: V,
    high: V,
}

impl<V: Bytes> Splat<V> {
    /// # Safety
    /// As [`Bytes`]; `x` is inside the channel.
    #[inline(always)]
    pub(in crate::kernels) unsafe fn new(channel: Channel<'_>, x: usize) -> Self {
        // SAFETY: the caller's.
        unsafe {
            Self {
                value: V::splat(*channel.value.get_unchecked(x)),
                low: V::splat(*channel.low.get_unchecked(x)),
                high: V::splat(*channel.high.get_unchecked(x)),
            }
        }
    }

    /// # Safety
    /// As [`Bytes`]; the channel has `V::COUNT` pixels from `i` on.
    #[inline(always)]
    pub(in crate::kernels) unsafe fn sampling_insensitive(&self, right: Channel<'_>, i: usize) -> V {
        // SAFETY: the caller's.
        unsafe {
            let (value, low, high) = (
                V::load(right.value.as_ptr().add(i)),
                V::load(right.low.as_ptr().add(i)),
                V::load(right.high.as_ptr().add(i)),
            );
            outside(self.value, low, high).min(outside(value, self.low, self.high))
        }
    }
}

/// See [`CostRow`].
///
/// # Safety
/// As [`Bytes`], `row.check` passed, and the lanes are a multiple of `V::COUNT`.
#[inline(always)]
pub(super) unsafe fn cost_row<V: Bytes>(row: &mut CostRow<'_>) {
    let (left, right) = (&row.left, &row.right);
    // SAFETY: column `x` has `lanes` cells from `x * lanes` on, and right pixels `x` to `x + lanes - 1`.
    unsafe {
        for x in 0..left.grey.value.len() {
            let filtered = Splat::<V>::new(left.filtered, x);
            let grey = Splat::<V>::new(left.grey, x);
            let [a, b, c] = left.census;
            let census =
                [V::splat(*a.get_unchecked(x)), V::splat(*b.get_unchecked(x)), V::splat(*c.get_unchecked(x))];
            for k in (0..row.lanes).step_by(V::COUNT) {
                let mut entering = filtered
                    .sampling_insensitive(right.filtered, x + k)
                    .add(grey.sampling_insensitive(right.grey, x + k).quarter());
                for (left, right) in census.iter().zip(&right.census) {
                    entering = entering.add(left.hamming(V::load(right.as_ptr().add(x + k))));
                }
                let cost = row.pixel_costs.as_mut_ptr().add(x * row.lanes + k);
                let (plus, minus) = (entering.widen(), V::load(cost).widen());
                entering.store(cost);
                for half in 0..2 {
                    let sum = row.column_sums.as_mut_ptr().add(x * row.lanes + k + half * V::Words::COUNT);
                    V::Words::load(sum).add(plus[half]).sub(minus[half]).store(sum);
                }
            }
        }
    }
}

/// Column sums from a cell on.
///
/// # Safety
/// As [`Bytes`]; `V::COUNT` cells from it.
#[inline(always)]
unsafe fn words<V: Bytes>(row: &WindowRow<'_>, cell: usize) -> [V::Words; 2] {
    // SAFETY: the caller's.
    unsafe {
        let from = row.column_sums.as_ptr().add(cell);
        [V::Words::load(from), V::Words::load(from.add(V::Words::COUNT))]
    }
}

/// See [`WindowRow`].
///
/// # Safety
/// As [`cost_row`].
#[inline(always)]
pub(super) unsafe fn window_row<V: Bytes>(row: &mut WindowRow<'_>) {
    let (lanes, radius, width) = (row.lanes, row.radius, row.blocked_left.len());
    let last = width - 1;
    // SAFETY: columns are clamped to the row; `k` steps through the lanes of one.
    unsafe {
        let reciprocal = V::Words::splat(row.reciprocal());
        let largest = V::Words::splat(LARGEST_COST.into());
        for k in (0..lanes).step_by(V::COUNT) {
            let blocked_lanes = V::load(row.blocked_lanes.as_ptr().add(k));
            let mut sums = [V::Words::splat(0); 2];
            for i in 0..=2 * radius {
                let [low, high] = words::<V>(row, i.saturating_sub(radius).min(last) * lanes + k);
                sums = [sums[0].add(low), sums[1].add(high)];
            }
            for x in 0..width {
                if x > 0 {
                    let entering = words::<V>(row, (x + radius).min(last) * lanes + k);
                    let leaving = words::<V>(row, x.saturating_sub(radius + 1) * lanes + k);
                    sums =
                        [sums[0].add(entering[0]).sub(leaving[0]), sums[1].add(entering[1]).sub(leaving[1])];
                }
                let mean = V::narrow([
                    V::high_product(sums[0], reciprocal).min(largest),
                    V::high_product(sums[1], reciprocal).min(largest),
                ]);
                let blocked = V::splat(*row.blocked_left.get_unchecked(x))
                    .or(V::load(row.blocked_right.as_ptr().add(x + k)))
                    .or(blocked_lanes);
                mean.or(blocked).store(row.costs.as_mut_ptr().add(x * lanes + k));
            }
        }
    }
}

/// The path costs of one pixel, and their minimum in every lane.
#[derive(Clone, Copy)]
struct Path<V, const N: usize> {
    costs: [V; N],
    smallest: V,
}

impl<V: Bytes, const N: usize> Path<V, N> {
    /// Before the first pixel.
    ///
    /// # Safety
    /// As [`Bytes`].
    #[inline(always)]
    unsafe fn start() -> Self {
        // SAFETY: the caller's.
        unsafe { Self { costs: [V::splat(0); N], smallest: V::splat(0) } }
    }

    /// The next pixel; see the reference's `step`.
    ///
    /// # Safety
    /// As [`Bytes`]; `N` vectors of costs and of results from the pointers on.
    #[inline(always)]
    unsafe fn step(&mut self, costs: *const u8, p1: V, p2: u8, after: *mut u8) {
        // SAFETY: the caller's.
        unsafe {
            let p2 = V::splat(p2);
            let none = V::splat(NO_CANDIDATE);
            let before = self.costs;
            let mut smallest = none;
            for i in 0..N {
                let larger = before[i].lane_before(if i > 0 { before[i - 1] } else { none });
                let smaller = before[i].lane_after(if i + 1 < N { before[i + 1] } else { none });
                let cheapest = before[i].min(larger.min(smaller).saturating_add(p1));
                let cheapest = cheapest.saturating_sub(self.smallest).min(p2);
                self.costs[i] = V::load(costs.add(i * V::COUNT)).saturating_add(cheapest);
                self.costs[i].store(after.add(i * V::COUNT));
                smallest = smallest.min(self.costs[i]);
            }
            self.smallest = smallest.splat_min();
        }
    }
}

/// See [`HorizontalRows`].
///
/// # Safety
/// As [`cost_row`], with exactly `N` vectors of lanes.
#[inline(always)]
pub(super) unsafe fn horizontal_rows<V: Bytes, const N: usize>(rows: &mut HorizontalRows<'_>) {
    // SAFETY: the caller's.
    unsafe {
        let p1 = V::splat(rows.p1);
        // Two rows of more vectors do not fit the registers.
        let (pairs, rest) =
            if N <= 2 { rows.rows.as_chunks_mut::<2>() } else { (&mut [][..], &mut *rows.rows) };
        for pair in pairs {
            walk_along::<V, N, 2>(pair, p1);
        }
        for row in rest.as_chunks_mut::<1>().0 {
            walk_along::<V, N, 1>(row, p1);
        }
    }
}

/// Both paths through each of some rows, step by step.
///
/// # Safety
/// As [`horizontal_rows`].
#[inline(always)]
unsafe fn walk_along<V: Bytes, const N: usize, const ROWS: usize>(
    rows: &mut [HorizontalRow<'_>; ROWS],
    p1: V,
) {
    let (lanes, width) = (N * V::COUNT, rows[0].p2.len());
    // SAFETY: every column has `lanes` cells from `x * lanes` on, in rows of one width.
    unsafe {
        let (mut from_left, mut from_right) = ([Path::<V, N>::start(); ROWS], [Path::<V, N>::start(); ROWS]);
        for x in 0..width {
            let mirrored = width - 1 - x;
            for i in 0..ROWS {
                let row = &mut rows[i];
                let (costs, p2) = (row.costs.as_ptr(), *row.p2.get_unchecked(x));
                let after = row.from_left.as_mut_ptr().add(x * lanes);
                from_left[i].step(costs.add(x * lanes), p1, p2, after);
                let p2 = row.p2.get(mirrored + 1).copied().unwrap_or(0);
                let after = row.from_right.as_mut_ptr().add(mirrored * lanes);
                from_right[i].step(costs.add(mirrored * lanes), p1, p2, after);
            }
        }
    }
}

/// See [`VerticalRow`].
///
/// # Safety
/// As [`horizontal_rows`].
#[inline(always)]
pub(super) unsafe fn vertical_row<V: Bytes, const N: usize>(row: &mut VerticalRow<'_>) {
    let lanes = N * V::COUNT;
    // SAFETY: every column has `lanes` cells from `x * lanes` on.
    unsafe {
        let p1 = V::splat(row.p1);
        for (x, &p2) in row.p2.iter().enumerate() {
            let smallest = row.smallest.get_unchecked_mut(x);
            let before = row.before.as_ptr().add(x * lanes);
            let mut path = Path::<V, N> { costs: [V::splat(0); N], smallest: V::splat(*smallest) };
            for (i, costs) in path.costs.iter_mut().enumerate() {
                *costs = V::load(before.add(i * V::COUNT));
            }
            path.step(row.costs.as_ptr().add(x * lanes), p1, p2, row.after.as_mut_ptr().add(x * lanes));
            *smallest = path.smallest.first();
        }
    }
}

/// See [`SumRow`].
///
/// # Safety
/// As [`horizontal_rows`]; `LEFT_RIGHT` tells whether `left_right_reach` is set.
#[inline(always)]
pub(super) unsafe fn sum_row<V: Bytes, const N: usize, const LEFT_RIGHT: bool>(row: &mut SumRow<'_>) {
    let lanes = N * V::COUNT;
    let width = row.chosen.len();
    // SAFETY: every column has `lanes` cells from `x * lanes` on; words are half as many to a vector.
    unsafe {
        let blocked = V::Words::splat(u16::MAX);
        let mut right_best = [[blocked; 2]; N];
        for x in 0..width {
            let mut sums = [[blocked; 2]; N];
            let mut smallest = blocked;
            for (i, sums) in sums.iter_mut().enumerate() {
                let cell = x * lanes + i * V::COUNT;
                let from_left = V::load(row.from_left.as_ptr().add(cell));
                let paths = [from_left.widen(), V::load(row.from_right.as_ptr().add(cell)).widen()];
                let vertical = [
                    V::load(row.from_above.as_ptr().add(cell)).widen(),
                    if row.from_below.is_empty() {
                        [V::Words::splat(0); 2]
                    } else {
                        V::load(row.from_below.as_ptr().add(cell)).widen()
                    },
                ];
                let is_blocked = from_left.widen_is_255();
                for half in 0..2 {
                    let horizontal = paths[0][half].add(paths[1][half]);
                    let total = horizontal.add(vertical[0][half].add(vertical[1][half])).or(is_blocked[half]);
                    total.store(row.sums.as_mut_ptr().add(cell + half * V::Words::COUNT));
                    smallest = smallest.min(total);
                    sums[half] = total;
                }
            }
            let best = smallest.splat_min();
            let mut lane = 0;
            for i in (0..N).rev() {
                let equal = V::Words::equal_bits(sums[i], best);
                lane = if equal != 0 { i * V::COUNT + equal.trailing_zeros() as usize } else { lane };
            }
            // Its surroundings are read once the row is complete.
            row.chosen.get_unchecked_mut(x).lane = lane as u16;
            if row.uniqueness_ratio > 0 {
                let limit =
                    rival_limit(best.first().into(), row.uniqueness_ratio).min(u32::from(u16::MAX) - 1);
                let limit = V::Words::splat(limit as u16);
                let mut count = 0;
                for pair in &sums {
                    count += V::Words::count_at_most(*pair, limit);
                }
                *row.rivals.get_unchecked_mut(x) = count as u16;
            }
            if LEFT_RIGHT {
                for i in 0..N {
                    let [low, high] = right_best[i];
                    right_best[i] = [low.min(sums[i][0]), high.min(sums[i][1])];
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
    for (choice, sums) in row.chosen.iter_mut().zip(row.sums.chunks_exact(lanes)) {
        let Choice { lane, .. } = *choice;
        *choice = choice_at(sums, lane.into());
    }
    if let Some(reach) = row.left_right_reach {
        find_nearby(row.sums, lanes, reach, row.chosen, row.nearby);
    }
}

/// See [`ExcessRow`].
///
/// # Safety
/// As [`horizontal_rows`].
#[inline(always)]
pub(super) unsafe fn excess_row<V: Bytes, const N: usize>(row: &mut ExcessRow<'_>) {
    let lanes = N * V::COUNT;
    // SAFETY: every column has `lanes` cells from `x * lanes` on.
    unsafe {
        let largest = V::Words::splat(u8::MAX.into());
        for column in 0..row.excess.len() / lanes {
            let mut sums = [[V::Words::splat(0); 2]; N];
            let mut smallest = V::Words::splat(u16::MAX);
            for i in 0..N {
                let cell = column * lanes + i * V::COUNT;
                let from_left = V::load(row.from_left.as_ptr().add(cell));
                let from_right = V::load(row.from_right.as_ptr().add(cell)).widen();
                let from_above = V::load(row.from_above.as_ptr().add(cell)).widen();
                let (left, is_blocked) = (from_left.widen(), from_left.widen_is_255());
                for half in 0..2 {
                    let sum = left[half].add(from_right[half]).add(from_above[half]).or(is_blocked[half]);
                    smallest = smallest.min(sum);
                    sums[i][half] = sum;
                }
            }
            let best = smallest.splat_min();
            for i in 0..N {
                let [low, high] = sums[i];
                V::narrow([low.sub(best).min(largest), high.sub(best).min(largest)])
                    .store(row.excess.as_mut_ptr().add(column * lanes + i * V::COUNT));
            }
        }
    }
}

/// Calls the instance of a path kernel for the row's lanes. Each is a function of its own: inlined into one, they compete
/// for its registers.
macro_rules! dispatch {
    ($instance:ident, $row:ident, $count:expr $(, $flag:literal)?) => {
        // SAFETY: the enclosing function has the instructions; its caller vouches for the row; the match chooses the
        // instance.
        unsafe {
            match $row.lanes / $count {
                1 => $instance::<1 $(, $flag)?>($row),
                2 => $instance::<2 $(, $flag)?>($row),
                3 => $instance::<3 $(, $flag)?>($row),
                4 => $instance::<4 $(, $flag)?>($row),
                6 => $instance::<6 $(, $flag)?>($row),
                8 => $instance::<8 $(, $flag)?>($row),
                16 => $instance::<16 $(, $flag)?>($row),
                32 => $instance::<32 $(, $flag)?>($row),
                #[cfg(target_arch = "aarch64")]
                64 => $instance::<64 $(, $flag)?>($row),
                vectors => unreachable!("padded_lanes gives no {vectors} vectors"),
            }
        }
    };
}
pub(in crate::kernels) use dispatch;

/// The entry points of an instruction set.
macro_rules! entries {
    ($vector:ty, $features:literal) => {
        /// See [`CostRow`].
        ///
        /// # Safety
        /// The processor has what the level proves, and `row.check` passed; so too below.
        #[target_feature(enable = $features)]
        pub unsafe fn cost_row(row: &mut CostRow<'_>) {
            // SAFETY: the caller's; lanes come from `padded_lanes`.
            unsafe { vector::cost_row::<$vector>(row) }
        }

        /// See [`WindowRow`].
        ///
        /// # Safety
        /// As above.
        #[target_feature(enable = $features)]
        pub unsafe fn window_row(row: &mut WindowRow<'_>) {
            // SAFETY: as above.
            unsafe { vector::window_row::<$vector>(row) }
        }

        /// # Safety
        /// As that of the vectors' kernel.
        #[target_feature(enable = $features)]
        unsafe fn horizontal_instance<const N: usize>(rows: &mut HorizontalRows<'_>) {
            // SAFETY: the caller's.
            unsafe { vector::horizontal_rows::<$vector, N>(rows) }
        }

        /// See [`HorizontalRows`].
        ///
        /// # Safety
        /// As above.
        #[target_feature(enable = $features)]
        pub unsafe fn horizontal_rows(rows: &mut HorizontalRows<'_>) {
            vector::dispatch!(horizontal_instance, rows, <$vector as Bytes>::COUNT);
        }

        /// # Safety
        /// As that of the vectors' kernel.
        #[target_feature(enable = $features)]
        unsafe fn vertical_instance<const N: usize>(row: &mut VerticalRow<'_>) {
            // SAFETY: the caller's.
            unsafe { vector::vertical_row::<$vector, N>(row) }
        }

        /// See [`VerticalRow`].
        ///
        /// # Safety
        /// As above.
        #[target_feature(enable = $features)]
        pub unsafe fn vertical_row(row: &mut VerticalRow<'_>) {
            vector::dispatch!(vertical_instance, row, <$vector as Bytes>::COUNT);
        }

        /// # Safety
        /// As that of the vectors' kernel.
        #[target_feature(enable = $features)]
        unsafe fn excess_instance<const N: usize>(row: &mut ExcessRow<'_>) {
            // SAFETY: the caller's.
            unsafe { vector::excess_row::<$vector, N>(row) }
        }

        /// See [`ExcessRow`].
        ///
        /// # Safety
        /// As above.
        #[target_feature(enable = $features)]
        pub unsafe fn excess_row(row: &mut ExcessRow<'_>) {
            vector::dispatch!(excess_instance, row, <$vector as Bytes>::COUNT);
        }

        /// # Safety
        /// As that of the vectors' kernel.
        #[target_feature(enable = $features)]
        unsafe fn sum_instance<const N: usize, const LEFT_RIGHT: bool>(row: &mut SumRow<'_>) {
            // SAFETY: the caller's.
            unsafe { vector::sum_row::<$vector, N, LEFT_RIGHT>(row) }
        }

        /// See [`SumRow`].
        ///
        /// # Safety
        /// As above.
        #[target_feature(enable = $features)]
        pub unsafe fn sum_row(row: &mut SumRow<'_>) {
            if row.left_right_reach.is_some() {
                vector::dispatch!(sum_instance, row, <$vector as Bytes>::COUNT, true);
            } else {
                vector::dispatch!(sum_instance, row, <$vector as Bytes>::COUNT, false);
            }
        }
    };
}
pub(super) use entries;
