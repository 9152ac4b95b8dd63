//! The row kernel over 16-bit vectors, written once for every instruction set.
//!
//! ```text
//! for each column x:
//!     V[x + r] += |L_in - R_in| - |L_out - R_out|       all lanes of a column; V streams through the cache
//!     H        += V[x + r] - V[x - r - 1]               in registers
//!     h         = H, blocked where not a candidate
//!     best      = minimum over the lanes of h;  lane = first lane of h that equals it
//!     R         = min(R, h);  right_best[x] = R[0];  shift R down one lane
//!     ring[x]   = h
//!     read costs beside the best of column x - 8 from the ring
//! ```
//!
//! Where it leaves the reference, and why:
//!
//! 1. Columns slide down and along in one pass, so that a column sum is loaded, updated, used and stored once.
//! 2. Differences are formed in bytes. If none exceeds 127, the difference of two of them fits a signed byte and is
//!    widened once instead of twice (`SMALL`).
//! 3. The costs of a pixel never form a row in memory. What is needed beside the best is read back from a ring of a few
//!    pixels, [`BATCH`] pixels late: a load that straddles recent stores waits until they have left the core.
//! 4. The right image's best match needs no index. Lanes of column `x` belong to consecutive right pixels, one further
//!    per column, so one vector set `R`, shifted a lane per column, collects every right pixel's smallest cost. A left
//!    pixel agrees with the right image if that cost occurs near its own disparity ([`SadRow::nearby`]).
//! 5. The number of vectors is a constant, so that `H` and `R` are registers; [`padded_lanes`](super::padded_lanes)
//!    rounds up to one that exists.

use super::reference::rival_limit;
use super::{Choice, Cost, RowPair, RowShape, SadRow};

/// Pixels whose costs are computed before the first of them are read back.
const BATCH: usize = 8;

/// Cells between the pixels of the ring: they stay blocked, and stand for lanes that do not exist.
fn guard(shape: &RowShape) -> usize {
    shape.left_right_reach.unwrap_or(0).max(1).next_multiple_of(32)
}

/// Pixels in the ring: two batches and, to each side of what is still to be read, the reach. A power of two.
fn ring_len(shape: &RowShape) -> usize {
    (2 * BATCH + 3 * shape.left_right_reach.unwrap_or(0)).next_power_of_two()
}

/// Cells of scratch memory: the ring with a guard before, between and after its pixels.
pub fn scratch_len(shape: &RowShape) -> usize {
    guard(shape) + ring_len(shape) * (shape.lanes + guard(shape))
}

/// A vector of `u16` costs of one instruction set.
///
/// # Safety
/// Every function requires that the processor has that instruction set. They are inlined into a function compiled for
/// it, so that the intrinsics are too.
pub(in crate::kernels) trait Lanes: Copy {
    /// Costs per vector. A pair of vectors has a cost for each byte of one vector.
    const COUNT: usize;
    /// [`sad_row`], compiled for the instruction set.
    unsafe fn sad_row<const P: usize, const SMALL: bool, const LEFT_RIGHT: bool>(row: &mut SadRow<'_, u16>);
    unsafe fn splat(value: u16) -> Self;
    unsafe fn load(from: *const u16) -> Self;
    unsafe fn store(self, to: *mut u16);
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn sub(self, other: Self) -> Self;
    unsafe fn min(self, other: Self) -> Self;
    unsafe fn or(self, other: Self) -> Self;
    /// The smallest lane, in every lane.
    unsafe fn splat_min(self) -> Self;
    /// Lane 0.
    unsafe fn first(self) -> u16;
    /// Lane `i` becomes lane `i + 1`; the last becomes the first of `next`.
    unsafe fn shift_down(self, next: Self) -> Self;
    /// Bit `i` of the result tells whether lane `i` of the pair equals that of `other`.
    unsafe fn equal_bits(pair: [Self; 2], other: Self) -> u64;
    /// How many lanes of the pair are at most those of `limit`.
    unsafe fn count_at_most(pair: [Self; 2], limit: Self) -> u32;
    /// `|left_in - right_in[i]| - |left_out - right_out[i]|` for `2 * COUNT` bytes, each difference at most 127.
    unsafe fn small_change(left_in: u8, right_in: *const u8, left_out: u8, right_out: *const u8)
    -> [Self; 2];
    /// Whether [`choice`](Self::choice) exists.
    const PICKS_LANES: bool;
    /// `lane` and the costs at and beside it.
    unsafe fn choice<const P: usize>(costs: &Column<Self, P>, lane: usize) -> Choice<u16>;
    /// The same for any bytes.
    unsafe fn change(left_in: u8, right_in: *const u8, left_out: u8, right_out: *const u8) -> [Self; 2];
}

/// All costs of one column: `P` pairs of vectors.
pub(in crate::kernels) type Column<V, const P: usize> = [[V; 2]; P];

/// `f` of each vector and its position among the lanes.
#[inline(always)]
fn each<V: Lanes, const P: usize>(mut f: impl FnMut(usize, usize, usize)) {
    for p in 0..P {
        for half in 0..2 {
            f(p, half, (2 * p + half) * V::COUNT);
        }
    }
}

/// The row kernel for `P` pairs of vectors.
///
/// # Safety
/// The processor has the instructions of `V`, `row.check` passed, `shape.lanes` is `2 * P * V::COUNT`, and no
/// difference exceeds 127 if `SMALL`.
#[inline(always)]
pub(super) unsafe fn sad_row<V: Lanes, const P: usize, const SMALL: bool, const LEFT_RIGHT: bool>(
    row: &mut SadRow<'_, u16>,
) {
    let RowShape { width, radius, .. } = row.shape;
    let reach = row.shape.left_right_reach.unwrap_or(0);
    let (last, delay) = (width - 1, BATCH.max(reach));
    // Columns, but for the last, whose window lies inside the image and all of whose lanes are candidates.
    let inner = row.shape.blocked_columns.max(radius + 1)..width - radius.clamp(1, width);
    // SAFETY: the caller's promises are passed on. The ring is indexed as `Ring` demands.
    unsafe {
        let mut ring = Ring::new(row.scratch, &row.shape);
        for column in 1..=reach {
            ring.block::<V, P>(0_usize.wrapping_sub(column));
        }
        let mut walk = Walk::<V, P>::start::<SMALL>(row);
        let mut read = 0;
        for batch in (0..width).step_by(BATCH) {
            let end = (batch + BATCH).min(width);
            // A batch never wraps around: the ring's length is a multiple of it.
            let mut cells = ring.column(batch);
            if inner.start <= batch && batch + BATCH <= inner.end {
                for x in batch..batch + BATCH {
                    walk.column::<SMALL, LEFT_RIGHT, false>(row, x, cells);
                    cells = cells.add(ring.stride);
                }
            } else {
                for x in batch..end {
                    walk.column::<SMALL, LEFT_RIGHT, true>(row, x, cells);
                    cells = cells.add(ring.stride);
                }
            }
            if LEFT_RIGHT || !V::PICKS_LANES {
                let until = end.saturating_sub(delay).max(read);
                read_back::<V, LEFT_RIGHT>(row, &ring, read..until);
                read = until;
            }
        }
        if !LEFT_RIGHT && V::PICKS_LANES {
            return;
        }
        for column in width..width + reach {
            ring.block::<V, P>(column);
        }
        read_back::<V, LEFT_RIGHT>(row, &ring, read..width);
        if LEFT_RIGHT {
            // After the last column all lanes are final, not only the first.
            let tail = row.right_best.as_mut_ptr().add(last);
            each::<V, P>(|p, half, at| walk.right[p][half].store(tail.add(at)));
        }
    }
}

/// The state of the walk along a row.
struct Walk<V, const P: usize> {
    /// Window sums of the current column: `H`.
    window: Column<V, P>,
    /// Smallest costs so far of the right pixels opposite the current column: `R`.
    right: Column<V, P>,
}

impl<V: Lanes, const P: usize> Walk<V, P> {
    const LANES: usize = 2 * P * V::COUNT;

    /// At column 0, before [`column`](Self::column).
    ///
    /// # Safety
    /// As [`sad_row`].
    #[inline(always)]
    unsafe fn start<const SMALL: bool>(row: &mut SadRow<'_, u16>) -> Self {
        let RowShape { width, radius, .. } = row.shape;
        let sums = row.column_sums.as_mut_ptr();
        // SAFETY: columns are clamped to the image's.
        unsafe {
            let mut window = [[V::splat(0); 2]; P];
            for i in 0..=radius {
                let column = i.min(width - 1);
                if i == column {
                    slide_down::<V, P, SMALL>(row.entering, row.leaving, column, sums);
                }
                // The first column stands for itself and for the `radius` columns left of the image.
                for _ in 0..if i == 0 { radius + 1 } else { 1 } {
                    each::<V, P>(|p, half, at| {
                        window[p][half] = window[p][half].add(V::load(sums.add(column * Self::LANES + at)));
                    });
                }
            }
            Self { window, right: [[V::splat(u16::BLOCKED); 2]; P] }
        }
    }

    /// Moves the window to column `x`, the next one, and writes what is known of it; its costs go to `cells`.
    ///
    /// # Safety
    /// As [`sad_row`]; `cells` is the column's place in the ring. If not `EDGE`, the window around `x` and the one
    /// before lie inside the image, no lane is blocked, and a column follows.
    #[inline(always)]
    unsafe fn column<const SMALL: bool, const LEFT_RIGHT: bool, const EDGE: bool>(
        &mut self,
        row: &mut SadRow<'_, u16>,
        x: usize,
        cells: *mut u16,
    ) {
        let RowShape { width, radius, blocked_columns, uniqueness_ratio, .. } = row.shape;
        let (sums, last) = (row.column_sums.as_mut_ptr(), width - 1);
        // SAFETY: column `c <= last` has its sums at `c * LANES`, its right pixels and their blocks at
        // `c..c + LANES`; `check` made the slices that long.
        unsafe {
            if !EDGE || x > 0 {
                let left = if EDGE { x.saturating_sub(radius + 1) } else { x - radius - 1 };
                let leaving = sums.add(left * Self::LANES);
                let entering = if !EDGE || x + radius <= last {
                    slide_down::<V, P, SMALL>(row.entering, row.leaving, x + radius, sums)
                } else {
                    load::<V, P>(sums.add(last * Self::LANES))
                };
                each::<V, P>(|p, half, at| {
                    let change = entering[p][half].sub(V::load(leaving.add(at)));
                    self.window[p][half] = self.window[p][half].add(change);
                });
            }

            let mut costs = self.window;
            if EDGE && x < blocked_columns {
                let left = V::splat(*row.blocked_left.get_unchecked(x));
                let (rights, lanes) = (row.blocked_right.as_ptr().add(x), row.blocked_lanes.as_ptr());
                each::<V, P>(|p, half, at| {
                    let blocked = left.or(V::load(rights.add(at))).or(V::load(lanes.add(at)));
                    costs[p][half] = costs[p][half].or(blocked);
                });
            }

            let mut least = costs[0][0].min(costs[0][1]);
            for pair in &costs[1..] {
                least = least.min(pair[0].min(pair[1]));
            }
            let best = least.splat_min();
            let lane = first_equal(&costs, best);
            let chosen = row.chosen.get_unchecked_mut(x);
            if V::PICKS_LANES {
                *chosen = V::choice(&costs, lane);
            } else {
                chosen.lane = lane as u16;
            }
            if LEFT_RIGHT || !V::PICKS_LANES {
                each::<V, P>(|p, half, at| costs[p][half].store(cells.add(at)));
            }
            if uniqueness_ratio > 0 {
                let limit =
                    rival_limit(best.first().into(), uniqueness_ratio).min(u32::from(u16::BLOCKED) - 1);
                let limit = V::splat(limit as u16);
                let rivals: u32 = costs.iter().map(|&pair| V::count_at_most(pair, limit)).sum();
                *row.rivals.get_unchecked_mut(x) = rivals as u16;
            }
            if LEFT_RIGHT {
                each::<V, P>(|p, half, _| self.right[p][half] = self.right[p][half].min(costs[p][half]));
                *row.right_best.get_unchecked_mut(x) = self.right[0][0].first();
                if !EDGE || x < last {
                    shift_down(&mut self.right);
                }
            }
        }
    }
}

/// All lanes from memory.
///
/// # Safety
/// The processor has the instructions of `V`; a column's cells follow `from`.
#[inline(always)]
unsafe fn load<V: Lanes, const P: usize>(from: *const u16) -> Column<V, P> {
    // SAFETY: the caller's.
    unsafe {
        let mut column = [[V::splat(0); 2]; P];
        each::<V, P>(|p, half, at| column[p][half] = V::load(from.add(at)));
        column
    }
}

/// Slides the sums of one column down a row and returns them.
///
/// # Safety
/// As [`sad_row`]; `column` is one of the image's.
#[inline(always)]
unsafe fn slide_down<V: Lanes, const P: usize, const SMALL: bool>(
    entering: RowPair<'_>,
    leaving: RowPair<'_>,
    column: usize,
    sums: *mut u16,
) -> Column<V, P> {
    // SAFETY: a row holds `lanes` right pixels from each of its columns on, and `sums` as many sums for each.
    unsafe {
        let (left_in, left_out) = (*entering.left.get_unchecked(column), *leaving.left.get_unchecked(column));
        let (right_in, right_out) = (entering.right.as_ptr().add(column), leaving.right.as_ptr().add(column));
        let sums = sums.add(column * 2 * P * V::COUNT);
        let mut slid = [[V::splat(0); 2]; P];
        for (p, pair) in slid.iter_mut().enumerate() {
            let at = 2 * p * V::COUNT;
            let change = if SMALL {
                V::small_change(left_in, right_in.add(at), left_out, right_out.add(at))
            } else {
                V::change(left_in, right_in.add(at), left_out, right_out.add(at))
            };
            for half in 0..2 {
                let sum = sums.add(at + half * V::COUNT);
                pair[half] = V::load(sum).add(change[half]);
                pair[half].store(sum);
            }
        }
        slid
    }
}

/// The first lane that equals `best`.
///
/// # Safety
/// The processor has the instructions of `V`.
#[inline(always)]
unsafe fn first_equal<V: Lanes, const P: usize>(costs: &Column<V, P>, best: V) -> usize {
    // SAFETY: the caller proves the instructions.
    let bits = |p: usize| unsafe { V::equal_bits(costs[p], best) };
    // From the last pair, which has it if no other does, to the first; without a branch, as no one could predict it.
    let mut lane = 2 * (P - 1) * V::COUNT + bits(P - 1).trailing_zeros() as usize;
    for p in (0..P - 1).rev() {
        let bits = bits(p);
        let here = 2 * p * V::COUNT + bits.trailing_zeros() as usize;
        lane = if bits != 0 { here } else { lane };
    }
    lane
}

/// Each lane takes the one after it; a blocked cost enters at the end.
///
/// # Safety
/// The processor has the instructions of `V`.
#[inline(always)]
unsafe fn shift_down<V: Lanes, const P: usize>(column: &mut Column<V, P>) {
    // SAFETY: the caller proves the instructions.
    unsafe {
        for p in 0..P {
            column[p][0] = column[p][0].shift_down(column[p][1]);
            let next = if p + 1 < P { column[p + 1][0] } else { V::splat(u16::BLOCKED) };
            column[p][1] = column[p][1].shift_down(next);
        }
    }
}

/// The costs of the last few pixels.
struct Ring {
    /// Lane 0 of the first pixel.
    start: *mut u16,
    /// Cells from pixel to pixel.
    stride: usize,
    /// Pixels less one.
    mask: usize,
}

impl Ring {
    fn new(scratch: &mut [u16], shape: &RowShape) -> Self {
        let start = scratch[guard(shape)..].as_mut_ptr();
        Self { start, stride: shape.lanes + guard(shape), mask: ring_len(shape) - 1 }
    }

    /// Lane 0 of column `x`, or of column `x - 2⁶⁴` left of the image.
    ///
    /// # Safety
    /// The scratch memory is still borrowed.
    #[inline(always)]
    unsafe fn column(&self, x: usize) -> *mut u16 {
        // SAFETY: `scratch_len` has room for `mask + 1` pixels of `stride` cells.
        unsafe { self.start.add((x & self.mask) * self.stride) }
    }

    /// A column outside the image: no lane is a candidate.
    ///
    /// # Safety
    /// As [`column`](Self::column), and the processor has the instructions of `V`.
    #[inline(always)]
    unsafe fn block<V: Lanes, const P: usize>(&mut self, x: usize) {
        // SAFETY: a pixel has `lanes` cells, which is what `P` pairs of vectors fill.
        unsafe {
            let cells = self.column(x);
            each::<V, P>(|_, _, at| V::splat(u16::BLOCKED).store(cells.add(at)));
        }
    }
}

/// Reads the costs beside the best of some columns from the ring.
///
/// # Safety
/// `row.check` passed and the ring holds the columns from `columns.start - reach` to `columns.end - 1 + reach`.
#[inline(always)]
unsafe fn read_back<V: Lanes, const LEFT_RIGHT: bool>(
    row: &mut SadRow<'_, u16>,
    ring: &Ring,
    columns: std::ops::Range<usize>,
) {
    let reach = row.shape.left_right_reach.unwrap_or(0);
    for x in columns {
        // SAFETY: columns are below the width. A lane is below `lanes`; what is read lies at most `reach` (at least
        // 1), or 2 after it, beside it, which the guards have room for.
        unsafe {
            let chosen = row.chosen.get_unchecked_mut(x);
            let lane = usize::from(chosen.lane);
            if !V::PICKS_LANES {
                let cells = ring.column(x).add(lane);
                let [before, best, after] = [*cells.sub(1), *cells, *cells.add(1)];
                *chosen = Choice { before, best, after, lane: chosen.lane };
            }
            if LEFT_RIGHT {
                let mut nearby = chosen.best;
                for j in 1..=reach {
                    let larger = *ring.column(x + j).add(lane).sub(j);
                    let smaller = *ring.column(x.wrapping_sub(j)).add(lane + j);
                    nearby = nearby.min(larger).min(smaller);
                }
                *row.nearby.get_unchecked_mut(x) = nearby;
            }
        }
    }
}

/// Calls the instance of [`sad_row`] for the row's lanes and settings.
///
/// # Safety
/// The processor has the instructions of `V`, and `row.check` passed.
pub(super) unsafe fn dispatch<V: Lanes>(row: &mut SadRow<'_, u16>) {
    // SAFETY: the caller's; no difference exceeds 127 where `SMALL` is chosen.
    unsafe {
        match (row.shape.largest_difference <= 127, row.shape.left_right_reach.is_some()) {
            (true, false) => dispatch_lanes::<V, true, false>(row),
            (true, true) => dispatch_lanes::<V, true, true>(row),
            (false, false) => dispatch_lanes::<V, false, false>(row),
            (false, true) => dispatch_lanes::<V, false, true>(row),
        }
    }
}

/// # Safety
/// As [`dispatch`], and no difference exceeds 127 if `SMALL`.
unsafe fn dispatch_lanes<V: Lanes, const SMALL: bool, const LEFT_RIGHT: bool>(row: &mut SadRow<'_, u16>) {
    // SAFETY: the caller's; the number of lanes is that of the instance.
    unsafe {
        match row.shape.lanes / (2 * V::COUNT) {
            1 => V::sad_row::<1, SMALL, LEFT_RIGHT>(row),
            2 => V::sad_row::<2, SMALL, LEFT_RIGHT>(row),
            3 => V::sad_row::<3, SMALL, LEFT_RIGHT>(row),
            4 => V::sad_row::<4, SMALL, LEFT_RIGHT>(row),
            6 => V::sad_row::<6, SMALL, LEFT_RIGHT>(row),
            8 => V::sad_row::<8, SMALL, LEFT_RIGHT>(row),
            16 => V::sad_row::<16, SMALL, LEFT_RIGHT>(row),
            32 => V::sad_row::<32, SMALL, LEFT_RIGHT>(row),
            pairs => unreachable!("padded_lanes gives no {pairs} pairs of vectors"),
        }
    }
}
