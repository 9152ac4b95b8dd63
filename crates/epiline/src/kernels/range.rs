//! A row of disparities to metres.

use super::portable;

/// What a table has for each disparity: depth, and the standard deviation of depth, metres.
pub type Metres = [f32; 2];
/// A table has an entry for each number of 16 bits: nothing is out of it.
pub const ENTRIES: usize = 1 << 16;

/// Looks up depths and their standard deviations, and lays them along the rays.
///
/// ```text
/// entry  = table[raw + 1] where bits & !harmless is 0, else table[0]
/// depth  = entry[0],  range = entry[0]·ray,  sigma = entry[1]·ray,  ray = sqrt(column_term + row_term)
/// ```
#[derive(Debug)]
pub struct RangeRow<'a> {
    /// Disparities as stored; the largest number is none.
    pub raws: &'a [u16],
    /// Why a pixel has no disparity.
    pub bits: &'a [u8],
    /// Bits that do not make a pixel one without a disparity.
    pub harmless: u8,
    /// By one more than the disparity.
    pub table: &'a [Metres; ENTRIES],
    /// `1 + u²` of each column.
    pub column_terms: &'a [f32],
    /// `v²` of the row.
    pub row_term: f32,
    /// Out, as the next two.
    pub depth: &'a mut [f32],
    /// See above.
    pub range: &'a mut [f32],
    /// See above.
    pub sigma: &'a mut [f32],
}

impl RangeRow<'_> {
    pub(super) fn check(&self) {
        let width = self.raws.len();
        let lengths = [self.column_terms.len(), self.depth.len(), self.range.len(), self.sigma.len()];
        assert!(self.bits.len() == width && lengths.iter().all(|&length| length == width), "lengths");
    }
}

/// Pixels at a time: what was looked up is still in the nearest memory when it is laid along the rays.
const BLOCK: usize = 64;

#[inline(always)]
pub(super) fn range_row(row: &mut RangeRow<'_>) {
    let width = row.raws.len();
    for from in (0..width).step_by(BLOCK) {
        if width - from >= BLOCK {
            block(row, from, BLOCK);
        } else {
            block(row, from, width - from);
        }
    }
}

/// One block. The look-up cannot use vectors, so it stands apart from what can.
#[inline(always)]
fn block(row: &mut RangeRow<'_>, from: usize, length: usize) {
    let (mut entries, mut found) = ([0_u16; BLOCK], [[0.0_f32; 2]; BLOCK]);
    let (raws, bits) = (&row.raws[from..][..length], &row.bits[from..][..length]);
    for i in 0..length {
        let has_value = u16::from(bits[i] & !row.harmless == 0);
        // One more than the largest number is 0, the entry of none.
        entries[i] = raws[i].wrapping_add(1) & 0_u16.wrapping_sub(has_value);
    }
    for i in 0..length {
        found[i] = row.table[usize::from(entries[i])];
    }
    let column_terms = &row.column_terms[from..][..length];
    let (depth, range) = (&mut row.depth[from..][..length], &mut row.range[from..][..length]);
    let sigma = &mut row.sigma[from..][..length];
    for i in 0..length {
        let ray = (column_terms[i] + row.row_term).sqrt();
        depth[i] = found[i][0];
        range[i] = found[i][0] * ray;
        sigma[i] = found[i][1] * ray;
    }
}

portable!(row, range_row, RangeRow<'_>);
