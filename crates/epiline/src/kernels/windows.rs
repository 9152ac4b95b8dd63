//! From how often disparities occur in columns to each column's nearest window of disparity.

use super::portable;

/// Columns on either side that count with a column.
pub const REACH: usize = 5;

/// `sums[x] = counts[x] + … + counts[x + 2·REACH]`.
#[derive(Debug)]
pub struct SumColumns<'a> {
    /// `2·REACH` more than `sums`.
    pub counts: &'a [u16],
    /// Out.
    pub sums: &'a mut [u32],
}

impl SumColumns<'_> {
    pub(super) fn check(&self) {
        assert!(self.counts.len() == self.sums.len() + 2 * REACH, "lengths");
    }
}

#[inline(always)]
pub(super) fn sum_columns(row: &mut SumColumns<'_>) {
    let width = row.sums.len();
    row.sums.fill(0);
    for shift in 0..=2 * REACH {
        let counts = &row.counts[shift..shift + width];
        for (sum, &count) in row.sums.iter_mut().zip(counts) {
            *sum += u32::from(count);
        }
    }
}

/// Offers each column the window of a bin and the next farther one, while bins are visited from near to far.
///
/// ```text
/// full  = pixels[1] + pixels[2], the bin itself and the next farther one
/// taken if full >= support, and if it is the first, or one bin farther than the one taken before, at most two farther than
///       the first, and clearly fuller: the first to qualify may hold only the near tail of a surface's scatter
/// mean  = bin + (pixels[0] - pixels[2] - 2·pixels[3]) / (pixels[0] + … + pixels[3])
/// ```
#[derive(Debug)]
pub struct OfferBin<'a> {
    /// Of the next nearer bin, the bin itself, and the next two farther ones.
    pub pixels: [&'a [u32]; 4],
    /// Number of the bin.
    pub bin: u32,
    /// At least 1.
    pub support: u32,
    /// Bin of the first window taken; in and out, as the next three.
    pub first: &'a mut [u32],
    /// Bin of the window taken.
    pub taken: &'a mut [u32],
    /// How full that is; 0 before one is taken.
    pub full: &'a mut [u32],
    /// Its mean bin.
    pub mean: &'a mut [f32],
}

impl OfferBin<'_> {
    pub(super) fn check(&self) {
        let width = self.first.len();
        let lengths = [self.taken.len(), self.full.len(), self.mean.len()];
        let pixels = self.pixels.map(<[u32]>::len);
        assert!(lengths.iter().chain(&pixels).all(|&length| length == width), "lengths");
    }
}

#[inline(always)]
pub(super) fn offer_bin(row: &mut OfferBin<'_>) {
    let width = row.first.len();
    // One length for all lets the compiler leave bounds checks out.
    let [nearer, here, farther, farthest] = row.pixels;
    let (nearer, here, farther, farthest) =
        (&nearer[..width], &here[..width], &farther[..width], &farthest[..width]);
    let (first, taken) = (&mut row.first[..width], &mut row.taken[..width]);
    let (full, mean) = (&mut row.full[..width], &mut row.mean[..width]);
    for x in 0..width {
        let offered = here[x] + farther[x];
        let is_first = full[x] == 0;
        let is_fuller =
            (taken[x] == row.bin + 1) & (first[x].wrapping_sub(row.bin) <= 2) & (4 * offered > 5 * full[x]);
        let takes = (offered >= row.support) & (is_first | is_fuller);
        let all = nearer[x] + offered + farthest[x];
        let moment = nearer[x] as f32 - (farther[x] + 2 * farthest[x]) as f32;
        first[x] = if takes & is_first { row.bin } else { first[x] };
        taken[x] = if takes { row.bin } else { taken[x] };
        full[x] = if takes { offered } else { full[x] };
        mean[x] = if takes { row.bin as f32 + moment / all as f32 } else { mean[x] };
    }
}

portable!(summed, sum_columns, SumColumns<'_>);
portable!(offered, offer_bin, OfferBin<'_>);
