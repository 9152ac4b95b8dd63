//! From costs at half the resolution to what is added to window sums at the full one.

use super::portable;

/// A coarse row, and what it adds to the costs of the two rows it stands for: `(factor · 2 C(d / 2)) >> 16`.
///
/// Disparity `d` is `d / 2` at half the resolution; of an odd one, the cost is the mean of both neighbours'. Lanes run
/// downward in disparity, as in [`sad`](super::sad), hence the means are those of cells that follow each other.
#[derive(Debug)]
pub struct RefineRow<'a> {
    /// Lanes per coarse column.
    pub coarse_lanes: usize,
    /// The lanes among them that are disparities asked for. Cells before and after repeat the first and the last.
    pub first_lane: usize,
    /// One more than the last of them.
    pub end_lane: usize,
    /// The coarse lane of the cell that [`added`](Self::added) begins with; it may lie before the first.
    pub start: isize,
    /// Whether it begins with an odd disparity, that is, with a mean.
    pub starts_odd: bool,
    /// What costs count, in units of `2⁻¹⁷`.
    pub factor: u32,
    /// `columns * coarse_lanes` costs.
    pub costs: &'a [u8],
    /// Lanes per column, an even number, at most [`MAX_LANES`].
    pub lanes: usize,
    /// Out: `columns * lanes`, of each column first the even lanes, then the odd ones.
    pub added: &'a mut [u16],
}

/// Lanes of 1024 disparities.
pub const MAX_LANES: usize = 1024;
/// The largest factor: `510·factor < 2³²`.
pub const MAX_FACTOR: u32 = u32::MAX / 510;

impl RefineRow<'_> {
    pub(super) fn check(&self) {
        let Self { coarse_lanes, first_lane, end_lane, lanes, .. } = *self;
        assert!(first_lane < end_lane && end_lane <= coarse_lanes, "lanes asked for");
        assert!(lanes > 0 && lanes.is_multiple_of(2) && lanes <= MAX_LANES, "{lanes} lanes");
        assert!(self.factor <= MAX_FACTOR, "factor");
        assert!(self.costs.len().is_multiple_of(coarse_lanes), "costs");
        assert!(self.added.len() == self.costs.len() / coarse_lanes * lanes, "added");
    }
}

/// A cost, doubled so that means are whole.
#[inline(always)]
fn weigh(doubled: u32, factor: u32) -> u16 {
    ((doubled * factor) >> 16) as u16
}

#[inline(always)]
pub(super) fn refine_row(row: &mut RefineRow<'_>) {
    let RefineRow { coarse_lanes, first_lane, end_lane, start, factor, lanes, .. } = *row;
    let mut cells = [0_u8; MAX_LANES / 2 + 1];
    let cells = &mut cells[..lanes / 2 + 1];
    // Cell `i` is lane `start + i`, so these are the cells before the first lane and up to the last.
    let inside = |lane: usize| lane.saturating_add_signed(-start).min(cells.len());
    let (before, until) = (inside(first_lane), inside(end_lane));
    let from = before.saturating_add_signed(start);
    let columns = row.costs.chunks_exact(coarse_lanes).zip(row.added.chunks_exact_mut(lanes));
    for (costs, added) in columns {
        cells[..before].fill(costs[first_lane]);
        cells[before..until].copy_from_slice(&costs[from..from + until - before]);
        cells[until..].fill(costs[end_lane - 1]);
        let (even, odd) = added.split_at_mut(lanes / 2);
        let means = if row.starts_odd { &mut *even } else { &mut *odd };
        for (mean, (&larger, &smaller)) in means.iter_mut().zip(cells.iter().zip(&cells[1..])) {
            *mean = weigh(u32::from(larger) + u32::from(smaller), factor);
        }
        let (others, whole) = if row.starts_odd { (odd, &cells[1..]) } else { (even, &*cells) };
        for (other, &cost) in others.iter_mut().zip(whole) {
            *other = weigh(2 * u32::from(cost), factor);
        }
    }
}

portable!(row, refine_row, RefineRow<'_>);
