//! From costs at half the resolution to what is added to window sums at the full one.

use super::portable;

/// A coarse row, and what it adds to the costs of the two rows it stands for: `(factor · 2 C(d / 2)) >> 16`.
///
/// Disparity `d` is `d / 2` at half the resolution; of an odd one, the cost is the mean of both neighbours', or that of
/// the smaller one where the larger is not asked for. Lanes run downward in disparity, as in [`sad`](super::sad), hence
/// the means are those of cells that follow each other.
#[derive(Debug)]
pub struct RefineRow<'a> {
    /// Lanes per coarse column.
    pub coarse_lanes: usize,
    /// What costs count, in units of `2⁻¹⁷`.
    pub factor: u32,
    /// [`padding`] cells of any value, then `columns * coarse_lanes` costs.
    pub costs: &'a [u8],
    /// Lanes per column, a multiple of 16.
    pub lanes: usize,
    /// So many of them, the last ones, are disparities asked for; the others get any value that costs have.
    pub num_disparities: usize,
    /// Whether the first lane is an odd disparity, that is, a mean.
    pub starts_odd: bool,
    /// Out: `columns * lanes`, of each column first the even lanes, then the odd ones.
    pub added: &'a mut [u16],
}

/// The largest factor: `510·factor < 2³²`.
pub const MAX_FACTOR: u32 = u32::MAX / 510;

/// How many cells a column reads before its first: one for the mean with the next larger disparity, and those of lanes
/// that are not asked for.
pub fn padding(coarse_lanes: usize, lanes: usize) -> usize {
    (lanes / 2 + 1).saturating_sub(coarse_lanes)
}

impl RefineRow<'_> {
    pub(super) fn check(&self) {
        let Self { coarse_lanes, lanes, num_disparities, .. } = *self;
        assert!(lanes > 0 && lanes.is_multiple_of(16), "{lanes} lanes");
        assert!((1..=lanes).contains(&num_disparities), "{num_disparities} disparities in {lanes} lanes");
        assert!(self.factor <= MAX_FACTOR, "factor");
        let cells = self.costs.len() - padding(coarse_lanes, lanes);
        assert!(cells.is_multiple_of(coarse_lanes), "costs");
        assert!(self.added.len() == cells / coarse_lanes * lanes, "added");
    }
}

/// `(doubled * factor) >> 16` of a cost, doubled so that means are whole: by the factor's halves, in words.
#[inline(always)]
fn weigh(doubled: u16, factor: u32) -> u16 {
    let (high, low) = ((factor >> 16) as u16, factor as u16);
    doubled * high + ((u32::from(doubled) * u32::from(low)) >> 16) as u16
}

#[inline(always)]
pub(super) fn refine_row(row: &mut RefineRow<'_>) {
    if row.lanes.is_multiple_of(64) {
        refine::<32>(row);
    } else {
        refine::<8>(row);
    }
}

/// So many cells at a time, a constant number: they are vectors then.
#[inline(always)]
fn refine<const CHUNK: usize>(row: &mut RefineRow<'_>) {
    let RefineRow { coarse_lanes, factor, lanes, num_disparities, starts_odd, .. } = *row;
    let first = lanes - num_disparities;
    let ends_with_mean = first.is_multiple_of(2) == starts_odd;
    // Costs of a column end with the smallest disparity, at either resolution.
    let ends = (padding(coarse_lanes, lanes)..=row.costs.len()).step_by(coarse_lanes).skip(1);
    for (added, end) in row.added.chunks_exact_mut(lanes).zip(ends) {
        let cells = &row.costs[end - lanes / 2 - 1..end];
        let (even, odd) = added.split_at_mut(lanes / 2);
        let (means, whole) = if starts_odd { (even, odd) } else { (odd, even) };
        let (larger, smaller) = (&cells[..lanes / 2], &cells[1..]);
        let of_whole = if starts_odd { smaller } else { larger };
        let chunks = larger.as_chunks::<CHUNK>().0.iter().zip(smaller.as_chunks::<CHUNK>().0);
        for (mean, (larger, smaller)) in means.as_chunks_mut::<CHUNK>().0.iter_mut().zip(chunks) {
            for i in 0..CHUNK {
                mean[i] = weigh(u16::from(larger[i]) + u16::from(smaller[i]), factor);
            }
        }
        let chunks = of_whole.as_chunks::<CHUNK>().0;
        for (whole, cost) in whole.as_chunks_mut::<CHUNK>().0.iter_mut().zip(chunks) {
            for i in 0..CHUNK {
                whole[i] = weigh(2 * u16::from(cost[i]), factor);
            }
        }
        if ends_with_mean {
            means[first / 2] = weigh(2 * u16::from(smaller[first / 2]), factor);
        }
    }
}

portable!(row, refine_row, RefineRow<'_>);
