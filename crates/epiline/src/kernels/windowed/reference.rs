//! The definitions of [`windowed`](super) in plain safe code: what the variants are held to, and the fallback.

use super::{BestRow, BestWindowsRow, BoxRow, PixelCost, PixelCostRow};
use crate::kernels::sad::Cost;
use crate::kernels::sad::reference::{find_best, find_nearby, find_right_best};
use crate::kernels::semi_global::reference::{hamming, sampling_insensitive};

/// See [`PixelCostRow`].
pub fn pixel_cost_row(row: &mut PixelCostRow<'_>) {
    let (left, right) = (&row.left, &row.right);
    let columns =
        row.pixel_costs.chunks_exact_mut(row.lanes).zip(row.column_sums.chunks_exact_mut(row.lanes));
    for (x, (costs, sums)) in columns.enumerate() {
        for (k, (cost, sum)) in costs.iter_mut().zip(sums).enumerate() {
            let i = x + k;
            let entering = match row.cost {
                PixelCost::Absolute => left.filtered.value[x].abs_diff(right.filtered.value[i]),
                PixelCost::Census => hamming(left, x, right, i),
                PixelCost::SamplingInsensitive => {
                    sampling_insensitive(left.filtered, x, right.filtered, i)
                        + sampling_insensitive(left.grey, x, right.grey, i) / 4
                }
            };
            let entering = entering.min(row.largest);
            *sum = *sum + u16::from(entering) - u16::from(*cost);
            *cost = entering;
        }
    }
}

/// See [`BoxRow`]: each from the one before.
pub fn box_row(row: &mut BoxRow<'_>) {
    let (lanes, radius) = (row.lanes, row.radius);
    let last = row.boxes.len() / lanes - 1;
    let column = |x: usize| &row.column_sums[x * lanes..(x + 1) * lanes];
    let mut sums = vec![0_u16; lanes];
    for i in 0..=2 * radius {
        let entering = column(i.saturating_sub(radius).min(last));
        sums.iter_mut().zip(entering).for_each(|(sum, &entering)| *sum += entering);
    }
    for (x, boxes) in row.boxes.chunks_exact_mut(lanes).enumerate() {
        if x > 0 {
            let (entering, leaving) = (column((x + radius).min(last)), column(x.saturating_sub(radius + 1)));
            for ((sum, &entering), &leaving) in sums.iter_mut().zip(entering).zip(leaving) {
                *sum = sum.slide(entering, leaving);
            }
        }
        boxes.copy_from_slice(&sums);
    }
}

/// See [`BestWindowsRow`].
pub fn best_windows_row(row: &mut BestWindowsRow<'_>) {
    let (lanes, radius) = (row.lanes, row.radius);
    let last = row.costs.len() / lanes - 1;
    for (x, costs) in row.costs.chunks_exact_mut(lanes).enumerate() {
        let (left, right) = (x.saturating_sub(radius) * lanes, (x + radius).min(last) * lanes);
        for (k, cost) in costs.iter_mut().enumerate() {
            let mut corners =
                [row.above[left + k], row.above[right + k], row.below[left + k], row.below[right + k]];
            corners.sort_unstable();
            *cost = row.middle[x * lanes + k] + corners[0] + corners[1];
        }
    }
}

/// See [`BestRow`].
pub fn best_row(row: &mut BestRow<'_>) {
    let lanes = row.lanes;
    for (x, costs) in row.costs.chunks_exact_mut(lanes).take(row.blocked_columns).enumerate() {
        for (k, cost) in costs.iter_mut().enumerate() {
            let blocked = row.blocked_left[x] | row.blocked_right[x + k] | row.blocked_lanes[k];
            *cost = if blocked == 0 { *cost } else { u16::BLOCKED };
        }
    }
    find_best(row.costs, lanes, row.uniqueness_ratio, row.chosen, row.rivals);
    if let Some(reach) = row.left_right_reach {
        find_right_best(row.costs, lanes, row.right_best);
        find_nearby(row.costs, lanes, reach, row.chosen, row.nearby);
    }
}
