//! The costs of the last few pixels in memory, for what does not find them in registers.

#![expect(
    clippy::needless_range_loop,
    reason = "iterator adaptors do not inherit the instruction set, loops do"
)]

use std::ops::Range;

use super::picked::{BATCH, Picked};
use super::vector::{Column, Lanes};
use super::{Choice, Cost, RowShape, SadRow};

/// Cells after the even and after the odd lanes of a pixel in the ring, half of the lanes that [`SadRow::nearby`] may
/// reach beyond the first or last: they stay blocked.
fn guard(shape: &RowShape) -> usize {
    (shape.left_right_reach.unwrap_or(0) / 2 + 2).next_multiple_of(32)
}

/// Pixels in the ring: two batches and, to each side of what is still to be read, the reach. A power of two.
fn ring_len(shape: &RowShape) -> usize {
    (2 * BATCH + 3 * shape.left_right_reach.unwrap_or(0)).next_power_of_two()
}

/// Cells of scratch memory: the ring with a guard before, between and after its pixels' even and odd lanes.
pub fn scratch_len(shape: &RowShape) -> usize {
    guard(shape) + ring_len(shape) * (shape.lanes + 2 * guard(shape))
}

/// The costs of the last few pixels: of each, first the even lanes, then the odd ones, each followed by a guard.
pub(super) struct Ring {
    /// Lane 0 of the first pixel.
    start: *mut u16,
    /// Cells from an even lane to the odd one after it.
    half: usize,
    /// Cells from pixel to pixel.
    pub(super) stride: usize,
    /// Pixels less one.
    mask: usize,
}

impl Ring {
    pub(super) fn new(scratch: &mut [u16], shape: &RowShape) -> Self {
        let half = shape.lanes / 2 + guard(shape);
        let start = scratch[guard(shape)..].as_mut_ptr();
        Self { start, half, stride: 2 * half, mask: ring_len(shape) - 1 }
    }

    /// Lane 0 of column `x`, or of column `x - 2⁶⁴` left of the image.
    ///
    /// # Safety
    /// The scratch memory is still borrowed.
    #[inline(always)]
    pub(super) unsafe fn column(&self, x: usize) -> *mut u16 {
        // SAFETY: `scratch_len` has room for `mask + 1` pixels of `stride` cells.
        unsafe { self.start.add((x & self.mask) * self.stride) }
    }

    /// A lane of a [`column`](Self::column), or a guard.
    ///
    /// # Safety
    /// As [`column`](Self::column); the lane is no further outside than twice the guard.
    #[inline(always)]
    pub(super) unsafe fn cell(&self, column: *mut u16, lane: isize) -> *mut u16 {
        // SAFETY: `>>` rounds down, `&` gives the remainder, of negative numbers too.
        unsafe { column.add((lane & 1) as usize * self.half).offset(lane >> 1) }
    }

    /// # Safety
    /// As [`column`](Self::column), and the processor has the instructions of `V`; the lanes are those of the ring.
    #[inline(always)]
    pub(super) unsafe fn store<V: Lanes, const P: usize>(&self, cells: *mut u16, costs: &Column<V, P>) {
        // SAFETY: a pixel has room for `P` vectors twice.
        unsafe {
            for p in 0..P {
                costs[p][0].store(cells.add(p * V::COUNT));
                costs[p][1].store(cells.add(self.half + p * V::COUNT));
            }
        }
    }

    /// A column outside the image: no lane is a candidate.
    ///
    /// # Safety
    /// As [`store`](Self::store).
    #[inline(always)]
    pub(super) unsafe fn block<V: Lanes, const P: usize>(&self, x: usize) {
        // SAFETY: the caller's.
        unsafe { self.store(self.column(x), &[[V::splat(u16::BLOCKED); 2]; P]) }
    }

    /// What [`SplitLanes::pick`] would have given for some columns, and if `neighbours`, for those beside them.
    ///
    /// # Safety
    /// The ring holds these columns, and their neighbours if asked for.
    #[inline(always)]
    pub(super) unsafe fn pick(&self, picked: &mut Picked, columns: Range<usize>, neighbours: bool) {
        // SAFETY: what is read lies at most a lane beside a column's, which the guards have room for.
        unsafe {
            for x in columns {
                let slot = x % (2 * BATCH);
                let at = usize::from(picked.at[slot]);
                picked.costs[slot] = self.four(x, at);
                if neighbours {
                    picked.larger[slot] = self.four(x.wrapping_sub(1), at);
                    picked.smaller[slot] = self.four(x + 1, at);
                }
            }
        }
    }

    /// Lanes `2 * at - 1` to `2 * at + 2` of a column.
    ///
    /// # Safety
    /// As [`column`](Self::column), and `at` is a pair of lanes.
    #[inline(always)]
    unsafe fn four(&self, x: usize, at: usize) -> u64 {
        // SAFETY: the caller's; a guard follows the even and the odd lanes.
        unsafe {
            let even = self.column(x).add(at);
            let (odds, evens) = (even.add(self.half).sub(1).cast::<[u16; 2]>(), even.cast::<[u16; 2]>());
            let ([before, odd], [even, after]) = (*odds, *evens);
            u64::from(before) | u64::from(even) << 16 | u64::from(odd) << 32 | u64::from(after) << 48
        }
    }

    /// [`SadRow::nearby`] of some columns.
    ///
    /// # Safety
    /// `row.check` passed, the columns are chosen, and the ring holds those within the reach.
    #[inline(always)]
    pub(super) unsafe fn find_nearby(&self, row: &mut SadRow<'_, u16>, columns: Range<usize>) {
        let reach = row.shape.left_right_reach.unwrap_or(0) as isize;
        // SAFETY: columns are below the width, lanes below `lanes`; what is read lies at most `reach` beside them, which
        // the guards have room for.
        unsafe {
            for x in columns {
                let Choice { best, lane, .. } = *row.chosen.get_unchecked(x);
                let lane = lane as isize;
                let mut nearby = best;
                for j in 1..=reach {
                    let larger = *self.cell(self.column(x.wrapping_add_signed(j)), lane - j);
                    let smaller = *self.cell(self.column(x.wrapping_add_signed(-j)), lane + j);
                    nearby = nearby.min(larger).min(smaller);
                }
                *row.nearby.get_unchecked_mut(x) = nearby;
            }
        }
    }
}
