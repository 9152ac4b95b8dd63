//! From costs at half the resolution to what is added to window sums at the full one.

use super::portable;

/// A coarse row, and what it adds to the costs of the two rows it stands for: `weight · C(d / 2) / 256`, rounded down.
///
/// Disparity `d` is `d / 2` at half the resolution; of an odd one, the cost is the mean of both neighbours', rounded up, or
/// that of the smaller one where the larger is not asked for. Lanes run downward in disparity, as in [`sad`](super::sad), hence
/// the means are those of cells that follow each other.
#[derive(Debug)]
pub struct RefineRow<'a> {
    /// Lanes per coarse column.
    pub coarse_lanes: usize,
    /// What costs count, in units of 1/256.
    pub weight: u16,
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
        let cells = self.costs.len() - padding(coarse_lanes, lanes);
        assert!(cells.is_multiple_of(coarse_lanes), "costs");
        assert!(self.added.len() == cells / coarse_lanes * lanes, "added");
    }
}

/// `cost * weight / 256`, by the halves of the weight: both products fit words.
#[inline(always)]
fn weigh(cost: u16, [low, high]: [u16; 2]) -> u16 {
    cost * high + ((cost * low) >> 8)
}

#[inline(always)]
pub(super) fn refine_row(row: &mut RefineRow<'_>) {
    if row.lanes.is_multiple_of(64) {
        refine::<32>(row);
    } else {
        refine::<8>(row);
    }
}

/// So many cells at a time, a constant number: they are vectors then. Loops over numbers, not over zipped slices, whose
/// `next` would be called instead of inlined here.
#[inline(always)]
fn refine<const CHUNK: usize>(row: &mut RefineRow<'_>) {
    let RefineRow { coarse_lanes, weight, lanes, num_disparities, starts_odd, .. } = *row;
    let first = lanes - num_disparities;
    let weight = [weight & 0xFF, weight >> 8];
    let ends_with_mean = first.is_multiple_of(2) == starts_odd;
    let first_end = padding(coarse_lanes, lanes) + coarse_lanes;
    for column in 0..row.added.len() / lanes {
        // Costs of a column end with the smallest disparity, at either resolution.
        let end = first_end + column * coarse_lanes;
        let cells = &row.costs[end - lanes / 2 - 1..end];
        let (larger, smaller) = (&cells[..lanes / 2], &cells[1..]);
        let of_whole = if starts_odd { smaller } else { larger };
        let (even, odd) = row.added[column * lanes..(column + 1) * lanes].split_at_mut(lanes / 2);
        let (means, whole) = if starts_odd { (even, odd) } else { (odd, even) };
        for at in (0..lanes / 2).step_by(CHUNK) {
            let (larger, smaller) = (&larger[at..at + CHUNK], &smaller[at..at + CHUNK]);
            let of_whole = &of_whole[at..at + CHUNK];
            let (mut of_means, mut own) = ([0; CHUNK], [0; CHUNK]);
            for i in 0..CHUNK {
                let mean = (u16::from(larger[i]) + u16::from(smaller[i]) + 1) >> 1;
                of_means[i] = weigh(mean, weight);
                own[i] = weigh(of_whole[i].into(), weight);
            }
            means[at..at + CHUNK].copy_from_slice(&of_means);
            whole[at..at + CHUNK].copy_from_slice(&own);
        }
        if ends_with_mean {
            means[first / 2] = weigh(smaller[first / 2].into(), weight);
        }
    }
}

portable!(row, refine_row, RefineRow<'_>);
