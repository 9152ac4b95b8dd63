//! From the costs around the best lane to a disparity in sixteenths of a pixel.

use super::portable;
use super::sad::{Cost, reference::rival_limit};

/// One row of costs and what becomes of it.
#[derive(Debug)]
pub struct SelectRow<'a, C> {
    /// Best lane per column.
    pub best_lane: &'a [u16],
    /// Costs before, at and after the best lane, as in [`SadRow::costs`](super::sad::SadRow::costs).
    pub costs: &'a [[C; 4]],
    /// Lanes within the uniqueness ratio, as in [`SadRow::rivals`](super::sad::SadRow::rivals).
    pub rivals: &'a [u16],
    /// Disparity of lane 0, px.
    pub first_disparity: u16,
    /// Whether to refine beyond whole pixels.
    pub subpixel: bool,
    /// Percent; 0 is off.
    pub uniqueness_ratio: u32,
    /// The bit for columns without any candidate.
    pub no_candidate: u8,
    /// The bit for columns whose best candidate has a rival that is not its neighbour.
    pub not_unique: u8,
    /// Out: disparity, 1/16 px; 0 without a candidate.
    pub values: &'a mut [u16],
    /// Out: 0 or the bits above.
    pub bits: &'a mut [u8],
}

impl<C> SelectRow<'_, C> {
    pub(super) fn check(&self) {
        let width = self.best_lane.len();
        assert!(self.costs.len() == width && self.rivals.len() == width, "a row's length");
        assert!(self.values.len() == width && self.bits.len() == width, "a row's length");
    }
}

/// The vertex of two lines of equal and opposite slope through three costs, in 1/256 px toward the lane before.
///
/// `(after - before) / (2 (max(before, after) - best))`, between -1/2 and 1/2, rounded toward zero as OpenCV does. Single
/// precision is exact for 16-bit costs: the numerator is below 2²⁴, and a quotient that is not whole is at least
/// `1/(2·65 535)` from the next whole number while the rounding error of one below 128 is at most `2⁻¹⁸`.
#[inline(always)]
fn vertex_f32(before: u32, best: u32, after: u32) -> i32 {
    let steepest = before.max(after) - best;
    let numerator = (after as i32 - before as i32) * 256;
    // Steepest is 0 only if both neighbours tie with the best; the numerator is then 0 too.
    (numerator as f32 / (2 * steepest).max(1) as f32) as i32
}

/// The same for costs of any size.
#[inline(always)]
fn vertex_f64(before: u32, best: u32, after: u32) -> i32 {
    let steepest = f64::from(before.max(after) - best);
    let numerator = (f64::from(after) - f64::from(before)) * 256.0;
    (numerator / (2.0 * steepest).max(1.0)) as i32
}

#[inline(always)]
fn select_row<C: Cost>(row: &mut SelectRow<'_, C>, vertex: impl Fn(u32, u32, u32) -> i32) {
    let blocked = C::BLOCKED.to_u32();
    let first = i32::from(row.first_disparity) * 256;
    let inputs = row.best_lane.iter().zip(row.costs).zip(row.rivals);
    let outputs = row.values.iter_mut().zip(&mut *row.bits);
    for (((&lane, costs), &rivals), (value, bits)) in inputs.zip(outputs) {
        let [before, best, after, _] = costs.map(C::to_u32);
        let answered = best < blocked;
        let between_candidates = row.subpixel & (before < blocked) & (after < blocked);
        // A blocked neighbour stands in as a tie, so that the arithmetic below is harmless.
        let (before_cost, after_cost) = if between_candidates { (before, after) } else { (best, best) };
        // Lanes run downward in disparity.
        let disparity_256 = first - i32::from(lane) * 256 + vertex(before_cost, best, after_cost);
        *value = if answered { ((disparity_256 + 15) >> 4) as u16 } else { 0 };
        let limit = rival_limit(best, row.uniqueness_ratio);
        let own =
            1 + u16::from(before < blocked && before <= limit) + u16::from(after < blocked && after <= limit);
        let rivalled = (row.uniqueness_ratio > 0) & (rivals != own);
        *bits = if !answered {
            row.no_candidate
        } else if rivalled {
            row.not_unique
        } else {
            0
        };
    }
}

#[inline(always)]
pub(super) fn narrow(row: &mut SelectRow<'_, u16>) {
    select_row(row, vertex_f32);
}

#[inline(always)]
pub(super) fn wide(row: &mut SelectRow<'_, u32>) {
    select_row(row, vertex_f64);
}

portable!(select_u16, narrow, SelectRow<'_, u16>);
portable!(select_u32, wide, SelectRow<'_, u32>);
