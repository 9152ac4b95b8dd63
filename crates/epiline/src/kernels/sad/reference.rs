//! Eq. 5 by running sums, in plain safe code: what the variants are held to, the fallback where there is none, and
//! the kernel for sums too large for 16 bits.

use super::{AddRow, Choice, Cost, RowShape, SadRow};

/// Lanes are padded so that the compiler can use whole vectors.
pub const LANE_BLOCK: usize = 16;

/// `column_sums[c][k] += |left[c] - right[c + k]|`.
#[inline(always)]
pub fn add_row<C: Cost>(row: &mut AddRow<'_, C>) {
    for (c, sums) in row.column_sums.chunks_exact_mut(row.lanes).enumerate() {
        let left = row.row.left[c];
        for (sum, &right) in sums.iter_mut().zip(&row.row.right[c..]) {
            *sum = sum.slide(C::from_difference(left.abs_diff(right)), C::ZERO);
        }
    }
}

/// Cells of scratch memory: the costs of the whole row.
pub fn scratch_len(shape: &RowShape) -> usize {
    shape.width * shape.lanes
}

/// See [`SadRow`].
#[inline(always)]
pub fn sad_row<C: Cost>(row: &mut SadRow<'_, C>) {
    slide_columns_down(row);
    sum_columns_along(row);
    add_coarse(row);
    block(row);
    let RowShape { lanes, uniqueness_ratio, left_right_reach, .. } = row.shape;
    find_best(row.scratch, lanes, uniqueness_ratio, row.chosen, row.rivals);
    if let Some(reach) = left_right_reach {
        find_right_best(row.scratch, lanes, row.right_best);
        find_nearby(row.scratch, lanes, reach, row.chosen, row.nearby);
    }
}

/// `V[c][k] += |L_in[c] - R_in[c + k]| - |L_out[c] - R_out[c + k]|`.
#[inline(always)]
fn slide_columns_down<C: Cost>(row: &mut SadRow<'_, C>) {
    for (c, sums) in row.column_sums.chunks_exact_mut(row.shape.lanes).enumerate() {
        let (left_in, left_out) = (row.entering.left[c], row.leaving.left[c]);
        let rights = row.entering.right[c..].iter().zip(&row.leaving.right[c..]);
        for (sum, (&right_in, &right_out)) in sums.iter_mut().zip(rights) {
            let entering = C::from_difference(left_in.abs_diff(right_in));
            let leaving = C::from_difference(left_out.abs_diff(right_out));
            *sum = sum.slide(entering, leaving);
        }
    }
}

/// `C[x][k] = Σ_{i = -r..r} V[clamp(x + i)][k]`, each from the one before.
#[inline(always)]
fn sum_columns_along<C: Cost>(row: &mut SadRow<'_, C>) {
    let RowShape { width, lanes, radius, .. } = row.shape;
    let column = |c: usize| &row.column_sums[c * lanes..(c + 1) * lanes];
    let last = width - 1;
    let first_costs = &mut row.scratch[..lanes];
    first_costs.fill(C::ZERO);
    for i in 0..=2 * radius {
        let entering = column(i.saturating_sub(radius).min(last));
        for (cost, &entering) in first_costs.iter_mut().zip(entering) {
            *cost = cost.slide(entering, C::ZERO);
        }
    }
    for x in 1..width {
        let (before, costs) = row.scratch[(x - 1) * lanes..(x + 1) * lanes].split_at_mut(lanes);
        let (entering, leaving) = (column((x + radius).min(last)), column(x.saturating_sub(radius + 1)));
        for (((cost, &before), &entering), &leaving) in
            costs.iter_mut().zip(&*before).zip(entering).zip(leaving)
        {
            *cost = before.slide(entering, leaving);
        }
    }
}

/// Adds what the column's pair has for the lane: cell `k / 2` of the even or of the odd ones.
#[inline(always)]
fn add_coarse<C: Cost>(row: &mut SadRow<'_, C>) {
    let lanes = row.shape.lanes;
    // The last column may be without a companion.
    for (columns, coarse) in row.scratch.chunks_mut(2 * lanes).zip(row.coarse.chunks_exact(lanes)) {
        let (even, odd) = coarse.split_at(lanes / 2);
        for costs in columns.chunks_exact_mut(lanes) {
            let (pairs, _) = costs.as_chunks_mut::<2>();
            for ((pair, &even), &odd) in pairs.iter_mut().zip(even).zip(odd) {
                *pair = [pair[0].slide(C::from_u16(even), C::ZERO), pair[1].slide(C::from_u16(odd), C::ZERO)];
            }
        }
    }
}

/// What is not a candidate gets a cost that loses against every candidate's.
#[inline(always)]
fn block<C: Cost>(row: &mut SadRow<'_, C>) {
    for (x, costs) in row.scratch.chunks_exact_mut(row.shape.lanes).enumerate() {
        let blocked = row.blocked_right[x..].iter().zip(row.blocked_lanes);
        for (cost, (&right, &lane)) in costs.iter_mut().zip(blocked) {
            *cost = if row.blocked_left[x] | right | lane == 0 { *cost } else { C::BLOCKED };
        }
    }
}

/// The first lane with the smallest cost, its neighbours' costs, and how many lanes come close.
#[inline(always)]
pub(in crate::kernels) fn find_best<C: Cost>(
    costs: &[C],
    lanes: usize,
    uniqueness_ratio: u32,
    chosen: &mut [Choice<C>],
    rivals: &mut [u16],
) {
    for (x, costs) in costs.chunks_exact(lanes).enumerate() {
        let best = costs.iter().copied().min().unwrap_or(C::BLOCKED);
        let lane = costs.iter().position(|&cost| cost == best).unwrap_or(0);
        chosen[x] = choice_at(costs, lane);
        if uniqueness_ratio > 0 {
            let limit = rival_limit(best.to_u32(), uniqueness_ratio);
            rivals[x] =
                costs.iter().map(|&cost| u16::from(cost < C::BLOCKED && cost.to_u32() <= limit)).sum();
        }
    }
}

/// A lane of a column and its neighbours.
#[inline(always)]
pub(in crate::kernels) fn choice_at<C: Cost>(costs: &[C], lane: usize) -> Choice<C> {
    let at = |lane: Option<usize>| lane.and_then(|k| costs.get(k)).copied().unwrap_or(C::BLOCKED);
    let (before, after) = (at(lane.checked_sub(1)), at(Some(lane + 1)));
    Choice { before, best: costs[lane], after, lane: C::from_lane(lane) }
}

/// The cost up to which a candidate is a rival of the best: `best + best·ratio/100`, rounded down as OpenCV does.
#[inline(always)]
pub(in crate::kernels) fn rival_limit(best: u32, uniqueness_ratio: u32) -> u32 {
    // Wraps only for a blocked best, whose limit no one uses: 255·31²·100 < 2³².
    best.wrapping_add(best.wrapping_mul(uniqueness_ratio) / 100)
}

/// The smallest cost per right pixel, over all left pixels it can belong to.
#[inline(always)]
pub(in crate::kernels) fn find_right_best<C: Cost>(costs: &[C], lanes: usize, right_best: &mut [C]) {
    right_best.fill(C::BLOCKED);
    for (x, costs) in costs.chunks_exact(lanes).enumerate() {
        for (best, &cost) in right_best[x..].iter_mut().zip(costs) {
            *best = (*best).min(cost);
        }
    }
}

/// The smallest of the costs of one right pixel near the best one: disparity `d + j` belongs to column `x + j`.
#[inline(always)]
pub(in crate::kernels) fn find_nearby<C: Cost>(
    costs: &[C],
    lanes: usize,
    reach: usize,
    chosen: &[Choice<C>],
    nearby: &mut [C],
) {
    let width = chosen.len();
    for (x, (choice, nearby)) in chosen.iter().zip(nearby).enumerate() {
        let lane = choice.lane.to_u32() as usize;
        // Lane `lane - j` of column `x + j`, as far as both exist.
        let (to_left, to_right) = (reach.min(x).min(lanes - 1 - lane), reach.min(width - 1 - x).min(lane));
        let cell = x * lanes + lane;
        *nearby = costs[cell];
        for j in 1..=to_left {
            *nearby = (*nearby).min(costs[cell - j * (lanes - 1)]);
        }
        for j in 1..=to_right {
            *nearby = (*nearby).min(costs[cell + j * (lanes - 1)]);
        }
    }
}
