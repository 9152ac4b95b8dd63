//! The definitions of [`semi_global`](super) in plain safe code: what the variants are held to, and the fallback.

use super::features::{Channel, PixelRow};
use super::{
    CostRow, ExcessRow, HorizontalRow, HorizontalRows, LARGEST_COST, NO_CANDIDATE, SumRow, VerticalRow,
    WindowRow,
};
use crate::kernels::sad::reference::{find_best, find_nearby, find_right_best};

/// Birchfield and Tomasi's difference: how far a value lies outside the other image's values within half a pixel; the
/// smaller of both views of it.
#[inline(always)]
pub(in crate::kernels) fn sampling_insensitive(
    left: Channel<'_>,
    x: usize,
    right: Channel<'_>,
    i: usize,
) -> u8 {
    let outside = |value: u8, low: u8, high: u8| value.saturating_sub(high).max(low.saturating_sub(value));
    outside(left.value[x], right.low[i], right.high[i]).min(outside(
        right.value[i],
        left.low[x],
        left.high[x],
    ))
}

#[inline(always)]
fn pixel_cost(left: &PixelRow<'_>, x: usize, right: &PixelRow<'_>, i: usize) -> u8 {
    sampling_insensitive(left.filtered, x, right.filtered, i)
        + sampling_insensitive(left.grey, x, right.grey, i) / 4
        + hamming(left, x, right, i)
}

/// How many bits of the census differ.
#[inline(always)]
pub(in crate::kernels) fn hamming(left: &PixelRow<'_>, x: usize, right: &PixelRow<'_>, i: usize) -> u8 {
    left.census.iter().zip(&right.census).map(|(l, r)| (l[x] ^ r[i]).count_ones() as u8).sum()
}

/// See [`CostRow`].
pub fn cost_row(row: &mut CostRow<'_>) {
    let columns =
        row.pixel_costs.chunks_exact_mut(row.lanes).zip(row.column_sums.chunks_exact_mut(row.lanes));
    for (x, (costs, sums)) in columns.enumerate() {
        for (k, (cost, sum)) in costs.iter_mut().zip(sums).enumerate() {
            let entering = pixel_cost(&row.left, x, &row.right, x + k);
            *sum = *sum + u16::from(entering) - u16::from(*cost);
            *cost = entering;
        }
    }
}

/// See [`WindowRow`].
pub fn window_row(row: &mut WindowRow<'_>) {
    let (lanes, radius, reciprocal) = (row.lanes, row.radius, u32::from(row.reciprocal()));
    let last = row.blocked_left.len() - 1;
    let column = |x: usize| &row.column_sums[x * lanes..(x + 1) * lanes];
    let mut sums = vec![0_u16; lanes];
    for i in 0..=2 * radius {
        let entering = column(i.saturating_sub(radius).min(last));
        sums.iter_mut().zip(entering).for_each(|(sum, &entering)| *sum += entering);
    }
    for (x, costs) in row.costs.chunks_exact_mut(lanes).enumerate() {
        if x > 0 {
            let (entering, leaving) = (column((x + radius).min(last)), column(x.saturating_sub(radius + 1)));
            for ((sum, &entering), &leaving) in sums.iter_mut().zip(entering).zip(leaving) {
                *sum = sum.wrapping_add(entering).wrapping_sub(leaving);
            }
        }
        for (k, (cost, &sum)) in costs.iter_mut().zip(&sums).enumerate() {
            let mean = (u32::from(sum) * reciprocal) >> 16;
            let blocked = row.blocked_left[x] | row.blocked_right[x + k] | row.blocked_lanes[k];
            *cost = mean.min(LARGEST_COST.into()) as u8 | blocked;
        }
    }
}

/// `L(d) = C(d) + min(B(d), B(d±1) + P1, min_k B(k) + P2) - min_k B(k)` from the path costs `B` of the pixel before;
/// returns `min_k L(k)`.
#[inline(always)]
fn step(before: &[u8], smallest: u8, costs: &[u8], p1: u8, p2: u8, after: &mut [u8]) -> u8 {
    // A lane that does not exist is no candidate.
    let above = |lane: Option<usize>| lane.and_then(|k| before.get(k)).unwrap_or(&NO_CANDIDATE) - smallest;
    for k in 0..costs.len() {
        let beside = above(k.checked_sub(1)).min(above(Some(k + 1))).saturating_add(p1);
        after[k] = costs[k].saturating_add(above(Some(k)).min(beside).min(p2));
    }
    after.iter().copied().min().unwrap_or(NO_CANDIDATE)
}

/// See [`HorizontalRows`].
pub fn horizontal_rows(rows: &mut HorizontalRows<'_>) {
    let (lanes, p1) = (rows.lanes, rows.p1);
    rows.rows.iter_mut().for_each(|row| horizontal_row(row, lanes, p1));
}

fn horizontal_row(row: &mut HorizontalRow<'_>, lanes: usize, p1: u8) {
    let width = row.p2.len();
    let at = |x: usize| x * lanes..(x + 1) * lanes;
    let start = vec![0; lanes];
    let mut smallest = 0;
    for x in 0..width {
        let (before, after) = row.from_left.split_at_mut(x * lanes);
        let before = if x > 0 { &before[at(x - 1)] } else { &start };
        smallest = step(before, smallest, &row.costs[at(x)], p1, row.p2[x], &mut after[..lanes]);
    }
    smallest = 0;
    for x in (0..width).rev() {
        let (after, before) = row.from_right.split_at_mut((x + 1) * lanes);
        let (before, p2) = if x + 1 < width { (&before[..lanes], row.p2[x + 1]) } else { (&start[..], 0) };
        smallest = step(before, smallest, &row.costs[at(x)], p1, p2, &mut after[at(x)]);
    }
}

/// See [`VerticalRow`].
pub fn vertical_row(row: &mut VerticalRow<'_>) {
    for (x, smallest) in row.smallest.iter_mut().enumerate() {
        let at = x * row.lanes..(x + 1) * row.lanes;
        let (before, costs) = (&row.before[at.clone()], &row.costs[at.clone()]);
        *smallest = step(before, *smallest, costs, row.p1, row.p2[x], &mut row.after[at]);
    }
}

/// See [`SumRow`].
pub fn sum_row(row: &mut SumRow<'_>) {
    let paths = row.from_left.iter().zip(row.from_right).zip(row.from_above).enumerate();
    for (sum, (i, ((&left, &right), &above))) in row.sums.iter_mut().zip(paths) {
        let below = row.from_below.get(i).copied().unwrap_or(0);
        let total: u16 = [left, right, above, below].map(u16::from).iter().sum();
        *sum = if left == NO_CANDIDATE { u16::MAX } else { total };
    }
    find_best(row.sums, row.lanes, row.uniqueness_ratio, row.chosen, row.rivals);
    if let Some(reach) = row.left_right_reach {
        find_right_best(row.sums, row.lanes, row.right_best);
        find_nearby(row.sums, row.lanes, reach, row.chosen, row.nearby);
    }
}

/// See [`ExcessRow`].
pub fn excess_row(row: &mut ExcessRow<'_>) {
    let ExcessRow { lanes, from_left, from_right, from_above, .. } = *row;
    let sum = |i: usize| match from_left[i] {
        NO_CANDIDATE => u16::MAX,
        left => [left, from_right[i], from_above[i]].map(u16::from).iter().sum(),
    };
    for (x, excess) in row.excess.chunks_exact_mut(lanes).enumerate() {
        let best = (x * lanes..(x + 1) * lanes).map(sum).fold(u16::MAX, u16::min);
        for (k, excess) in excess.iter_mut().enumerate() {
            *excess = (sum(x * lanes + k) - best).min(u8::MAX.into()) as u8;
        }
    }
}
