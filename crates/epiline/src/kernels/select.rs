//! From the costs around the best lane to a disparity in sixteenths of a pixel.

use super::portable;
use super::sad::reference::rival_limit;
use super::sad::{Choice, Cost};

/// How a disparity is refined beyond whole pixels: by a curve through the best cost and those of both neighbours.
///
/// With `c`, the smallest, at the best disparity `d` and `a`, `b` at `d - 1`, `d + 1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Subpixel {
    /// Whole pixels.
    Off,
    /// Two lines of equal and opposite slope, `d + (a - b) / 2(max(a, b) - c)`: the equiangular fit (Shimizu and Okutomi,
    /// ICCV 2001), unbiased for sums of absolute differences, and OpenCV's.
    #[default]
    VFit,
    /// A parabola, `d + (a - b) / 2(a + b - 2c)`: unbiased for sums of squared differences.
    Parabola,
}

/// One row of costs and what becomes of it.
#[derive(Debug)]
pub struct SelectRow<'a, C> {
    /// Best lane per column, as in [`SadRow::chosen`](super::sad::SadRow::chosen).
    pub chosen: &'a [Choice<C>],
    /// Lanes within the uniqueness ratio, as in [`SadRow::rivals`](super::sad::SadRow::rivals).
    pub rivals: &'a [u16],
    /// Disparity of lane 0, px.
    pub first_disparity: u16,
    /// How to refine beyond whole pixels.
    pub subpixel: Subpixel,
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
        let width = self.chosen.len();
        assert!(self.rivals.len() == width, "a row's length");
        assert!(self.values.len() == width && self.bits.len() == width, "a row's length");
    }
}

/// Costs from which a sub-pixel position follows without a rounding error.
trait Vertex: Cost {
    /// `128 difference / curvature`, between -128 and 128, rounded toward zero as OpenCV does: the vertex in 1/256 px
    /// toward the lane before. `difference` is that of the neighbours' costs, after less before, and `curvature` at least
    /// as large and not 0.
    fn vertex(difference: i32, curvature: i32) -> i32;

    /// Choices as four rows of numbers.
    fn unpack(chosen: &[Choice<Self>; CHUNK]) -> Unpacked;
}

/// Costs and lanes. A blocked 32-bit cost becomes -1, a 16-bit one stays larger than any other; only equality is asked of
/// either.
struct Unpacked {
    before: [i32; CHUNK],
    best: [i32; CHUNK],
    after: [i32; CHUNK],
    lane: [i32; CHUNK],
}

/// What the neighbours' difference is divided by: how much the larger of their costs exceeds the best, or both together.
/// It is 0 only if both tie with the best; their difference is then 0 too.
#[inline(always)]
fn curvature(parabola: bool, before: i32, best: i32, after: i32) -> i32 {
    let steeper = before.max(after) - best;
    let other = if parabola { before.min(after) - best } else { 0 };
    (steeper + other).max(1)
}

impl Vertex for u16 {
    /// Single precision is exact: the numerator is below 2²⁴, and a quotient that is not whole is at least
    /// `1/(2·65 535)` from the next whole number while the rounding error of one below 128 is at most `2⁻¹⁸`.
    #[inline(always)]
    fn vertex(difference: i32, curvature: i32) -> i32 {
        let quotient = (difference * 128) as f32 / curvature as f32;
        // SAFETY: finite, and at most 128 in size. (A checked conversion is not vectorised.)
        unsafe { quotient.to_int_unchecked() }
    }

    /// By words of two costs each: half vectors of words are told apart by one instruction, quarters one by one.
    #[inline(always)]
    fn unpack(chosen: &[Choice<Self>; CHUNK]) -> Unpacked {
        // SAFETY: both are four times 16 bits each, in the layout of C.
        let words: [[u32; 2]; CHUNK] = unsafe { std::mem::transmute(*chosen) };
        let (mut before, mut best, mut after, mut lane) = ([0; CHUNK], [0; CHUNK], [0; CHUNK], [0; CHUNK]);
        for i in 0..CHUNK {
            let [costs, rest] = words[i];
            (before[i], best[i]) = halves(costs);
            (after[i], lane[i]) = halves(rest);
        }
        Unpacked { before, best, after, lane }
    }
}

impl Vertex for u32 {
    /// There are no costs above `255·31²`.
    #[inline(always)]
    fn vertex(difference: i32, curvature: i32) -> i32 {
        let quotient = f64::from(difference * 128) / f64::from(curvature);
        // SAFETY: finite, and at most 128 in size.
        unsafe { quotient.to_int_unchecked() }
    }

    #[inline(always)]
    fn unpack(chosen: &[Choice<Self>; CHUNK]) -> Unpacked {
        let (mut before, mut best, mut after, mut lane) = ([0; CHUNK], [0; CHUNK], [0; CHUNK], [0; CHUNK]);
        for i in 0..CHUNK {
            let choice = chosen[i];
            (before[i], best[i]) = (choice.before.cast_signed(), choice.best.cast_signed());
            (after[i], lane[i]) = (choice.after.cast_signed(), choice.lane.cast_signed());
        }
        Unpacked { before, best, after, lane }
    }
}

/// The 16-bit numbers at the first and the second place of a word in memory.
#[inline(always)]
fn halves(word: u32) -> (i32, i32) {
    let (low, high) = ((word & 0xFFFF).cast_signed(), (word >> 16).cast_signed());
    if cfg!(target_endian = "little") { (low, high) } else { (high, low) }
}

/// Columns at a time: what is done with local arrays of a constant size is vectorised at every level. No closures: they
/// are compiled without the instruction set unless they happen to be inlined early.
const CHUNK: usize = 16;

#[inline(always)]
fn select_row<C: Vertex>(row: &mut SelectRow<'_, C>) {
    let (chosen, chosen_rest) = row.chosen.as_chunks::<CHUNK>();
    let (rivals, rivals_rest) = row.rivals.as_chunks::<CHUNK>();
    let rule = Rule::of(row);
    let (values, values_rest) = row.values.as_chunks_mut::<CHUNK>();
    let (bits, bits_rest) = row.bits.as_chunks_mut::<CHUNK>();
    for (((chosen, rivals), values), bits) in chosen.iter().zip(rivals).zip(values).zip(bits) {
        rule.select(chosen, rivals, values, bits);
    }
    let rest = chosen_rest.len();
    let mut chosen = [Choice::NONE; CHUNK];
    let mut rivals = [0; CHUNK];
    chosen[..rest].copy_from_slice(chosen_rest);
    rivals[..rest].copy_from_slice(rivals_rest);
    let (mut values, mut bits) = ([0; CHUNK], [0; CHUNK]);
    rule.select(&chosen, &rivals, &mut values, &mut bits);
    values_rest.copy_from_slice(&values[..rest]);
    bits_rest.copy_from_slice(&bits[..rest]);
}

/// What does not change along a row.
struct Rule {
    first_disparity_256: i32,
    subpixel: Subpixel,
    uniqueness_ratio: u32,
    no_candidate: u8,
    not_unique: u8,
}

impl Rule {
    fn of<C>(row: &SelectRow<'_, C>) -> Self {
        Self {
            first_disparity_256: i32::from(row.first_disparity) * 256,
            subpixel: row.subpixel,
            uniqueness_ratio: row.uniqueness_ratio,
            no_candidate: row.no_candidate,
            not_unique: row.not_unique,
        }
    }

    #[inline(always)]
    fn select<C: Vertex>(
        &self,
        chosen: &[Choice<C>; CHUNK],
        rivals: &[u16; CHUNK],
        values: &mut [u16; CHUNK],
        bits: &mut [u8; CHUNK],
    ) {
        let blocked = C::BLOCKED.to_u32().cast_signed();
        let Unpacked { before, best, after, lane } = C::unpack(chosen);
        let (refine, parabola) = (self.subpixel != Subpixel::Off, self.subpixel == Subpixel::Parabola);
        for i in 0..CHUNK {
            let refined = refine & (before[i] != blocked) & (after[i] != blocked);
            // A blocked neighbour stands in as a tie, so that the arithmetic is harmless.
            let before = if refined { before[i] } else { best[i] };
            let after = if refined { after[i] } else { best[i] };
            let vertex = C::vertex(after - before, curvature(parabola, before, best[i], after));
            // Lanes run downward in disparity.
            let disparity_256 = self.first_disparity_256 - 256 * lane[i] + vertex;
            values[i] = if best[i] == blocked { 0 } else { ((disparity_256 + 15) >> 4) as u16 };
            bits[i] = if best[i] == blocked { self.no_candidate } else { 0 };
        }
        if self.uniqueness_ratio > 0 {
            for i in 0..CHUNK {
                let limit = rival_limit(best[i].cast_unsigned(), self.uniqueness_ratio).cast_signed();
                let before = (before[i] != blocked) & (before[i] <= limit);
                let after = (after[i] != blocked) & (after[i] <= limit);
                let own = 1 + i32::from(before) + i32::from(after);
                let rivalled = (best[i] != blocked) & (i32::from(rivals[i]) != own);
                bits[i] |= if rivalled { self.not_unique } else { 0 };
            }
        }
    }
}

#[inline(always)]
pub(super) fn narrow(row: &mut SelectRow<'_, u16>) {
    select_row(row);
}

#[inline(always)]
pub(super) fn wide(row: &mut SelectRow<'_, u32>) {
    select_row(row);
}

portable!(select_u16, narrow, SelectRow<'_, u16>);
portable!(select_u32, wide, SelectRow<'_, u32>);
