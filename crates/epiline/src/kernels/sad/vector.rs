//! The row kernel over 16-bit vectors, written once for every instruction set.
//!
//! ```text
//! for each column x:
//!     V[x + r] += |L_in - R_in| - |L_out - R_out|       all lanes of a column; V streams through the cache
//!     H        += V[x + r] - V[x - r - 1]               in registers
//!     h         = H, and the coarse costs of x, blocked where not a candidate
//!     best      = minimum over the lanes of h;  lane = first lane of h that equals it
//!     R         = min(R, h);  right_best[x] = R[0];  shift R down one lane
//!     costs beside the best
//! ```
//!
//! Where it leaves the reference, and why:
//!
//! 1. Columns slide down and along in one pass, so that a column sum is loaded, updated, used and stored once.
//! 2. Lanes are *split*: of each pair of vectors, the first holds the even, the second the odd lanes of a vector of
//!    bytes. Bytes become words by one multiplication per vector, `[b0, b1] · [1, 0]`, instead of moves across the
//!    whole vector; the smaller of both vectors narrows the search for the best lane to two; and shifting all lanes by
//!    one moves only every other vector. Column sums are kept in this order too.
//! 3. Differences are formed in bytes. If none exceeds 127, the difference of two of them fits a signed byte (`SMALL`).
//! 4. The costs of a pixel never form a row in memory. Of an even lane, the odd one after it and the two beside them,
//!    four costs are picked from the registers or, where there is no permutation for that (`PICKS`), read back from a
//!    ring of a few pixels. Which of the two is best is decided for many pixels at once, [`BATCH`] pixels late: a load
//!    that straddles recent stores waits until they have left the core.
//! 5. The right image's best match needs no index. Lanes of column `x` belong to consecutive right pixels, one further
//!    per column, so one vector set `R`, shifted a lane per column, collects every right pixel's smallest cost. A left
//!    pixel agrees with the right image if that cost occurs near its own disparity ([`SadRow::nearby`]). Up to a reach
//!    of [`NEAR`], it does so among the same four lanes of the columns to both sides; beyond, the ring has it.
//! 6. The number of vectors is a constant, so that `H` and `R` are registers; [`padded_lanes`](super::padded_lanes)
//!    rounds up to one that exists.
//! 7. No intrinsic is called in a closure: a closure is compiled without the instruction set unless it happens to be
//!    inlined early.

// Iterator adaptors and closures do not inherit the instruction set of the function they are inlined into; loops do.
#![expect(clippy::needless_range_loop)]

use super::picked::{BATCH, Picked, as_choices, put};
use super::ring::Ring;
use super::{AddRow, Cost, RowPair, RowShape, SadRow, first_set};

/// How far the left–right test may reach without the ring.
const NEAR: usize = 1;

/// A vector of `u16` of one instruction set.
///
/// # Safety
/// Every function requires that the processor has that instruction set. They are inlined into a function compiled for
/// it, so that the intrinsics are too.
pub(in crate::kernels) trait Lanes: Copy {
    /// Lanes per vector. A pair of vectors has a lane for each byte of one vector.
    const COUNT: usize;
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
}

/// What the window sums need beyond [`Lanes`]: pairs of vectors for the even and the odd bytes of one vector.
///
/// # Safety
/// As [`Lanes`]; a pointer to bytes is followed by `2 * COUNT` readable ones.
pub(in crate::kernels) trait SplitLanes: Lanes {
    /// Whether [`pick`](Self::pick) exists.
    const PICKS: bool;
    /// [`sad_row`], compiled for the instruction set.
    unsafe fn sad_row<
        const P: usize,
        const SMALL: bool,
        const LEFT_RIGHT: bool,
        const COARSE: bool,
        const IDLE: bool,
    >(
        row: &mut SadRow<'_, u16>,
    );
    /// [`add_row`], compiled for the instruction set.
    unsafe fn add_row(row: &mut AddRow<'_, u16>);
    /// `|left_in - right_in[i]| - |left_out - right_out[i]|`; if `SMALL`, no difference exceeds 127.
    unsafe fn change<const SMALL: bool>(
        left_in: u8,
        right_in: *const u8,
        left_out: u8,
        right_out: *const u8,
    ) -> [Self; 2];
    /// `left | right[i] | lanes[i]`, each 0 or 255, as 0 or 65535.
    unsafe fn blocked(left: u8, right: *const u8, lanes: *const u8) -> [Self; 2];
    /// The first lane of all vectors that equals `best`, which one does.
    unsafe fn first_equal<const P: usize>(vectors: &[Self; P], best: Self) -> usize;
    /// Lanes `2 * at - 1` to `2 * at + 2`, from the lowest bits of the result to the highest; anything for lanes that
    /// do not exist.
    unsafe fn pick<const P: usize>(costs: &Column<Self, P>, at: usize) -> u64;
}

/// All costs of one column: `P` pairs of vectors, even lanes and odd ones.
pub(in crate::kernels) type Column<V, const P: usize> = [[V; 2]; P];

/// The row kernel for `P` pairs of vectors.
///
/// # Safety
/// The processor has the instructions of `V`, `row.check` passed, `shape.lanes` is `2 * P * V::COUNT`, no difference
/// exceeds 127 if `SMALL`, `LEFT_RIGHT` tells whether `left_right_reach` is set, `COARSE` whether there are coarse
/// costs, and `IDLE` whether some lane is blocked.
#[inline(always)]
pub(super) unsafe fn sad_row<
    V: SplitLanes,
    const P: usize,
    const SMALL: bool,
    const LEFT_RIGHT: bool,
    const COARSE: bool,
    const IDLE: bool,
>(
    row: &mut SadRow<'_, u16>,
) {
    let RowShape { width, radius, lanes, .. } = row.shape;
    let reach = row.shape.left_right_reach.unwrap_or(0);
    let last = width - 1;
    // Columns, but for the last, whose window and that before lie inside the image.
    let inner = radius + 1..width - radius.clamp(1, width);
    // SAFETY: the caller's promises are passed on. The ring is indexed as `Ring` demands.
    unsafe {
        let ring = Ring::new(row.scratch, &row.shape);
        if LEFT_RIGHT {
            for column in 1..=reach {
                ring.block::<V, P>(0_usize.wrapping_sub(column));
            }
        }
        let mut walk = Walk::<V, P, IDLE>::start::<SMALL>(row);
        let mut picked = Picked::default();
        let mut read = 0;
        for batch in (0..width).step_by(BATCH) {
            let end = (batch + BATCH).min(width);
            // A batch never wraps around: the ring's length is a multiple of it.
            let mut cells = ring.column(batch);
            let blocked = *row.blocked_groups.get_unchecked(batch / BATCH) != 0;
            if inner.start <= batch && batch + BATCH <= inner.end && !blocked {
                for x in batch..batch + BATCH {
                    walk.column::<SMALL, LEFT_RIGHT, COARSE, false>(row, x, &ring, cells, &mut picked);
                    cells = cells.add(ring.stride);
                }
            } else {
                for x in batch..end {
                    walk.column::<SMALL, LEFT_RIGHT, COARSE, true>(row, x, &ring, cells, &mut picked);
                    cells = cells.add(ring.stride);
                }
            }
            if batch > 0 {
                finish::<V, LEFT_RIGHT>(row, &ring, &mut picked, batch - BATCH..batch);
            }
            if LEFT_RIGHT && reach > NEAR {
                let until = end.saturating_sub(reach).min(batch).max(read);
                ring.find_nearby(row, read..until);
                read = until;
            }
        }
        if LEFT_RIGHT {
            for column in width..width + reach {
                ring.block::<V, P>(column);
            }
        }
        picked.smaller[last % (2 * BATCH)] = u64::MAX;
        finish::<V, LEFT_RIGHT>(row, &ring, &mut picked, last / BATCH * BATCH..width);
        if LEFT_RIGHT {
            if reach > NEAR {
                ring.find_nearby(row, read..width);
            }
            // After the last column all lanes are final, not only the first. The ring has room for them.
            ring.store(ring.column(0), &walk.right);
            for lane in 0..lanes {
                *row.right_best.get_unchecked_mut(last + lane) = *ring.cell(ring.column(0), lane as isize);
            }
        }
    }
}

/// See [`AddRow`]; the sums are split.
///
/// # Safety
/// The processor has the instructions of `V`, `row.check` passed, and the lanes are a multiple of `2 * V::COUNT`.
#[inline(always)]
pub(super) unsafe fn add_row<V: SplitLanes>(row: &mut AddRow<'_, u16>) {
    // No row leaves: nothing differs from nothing.
    static NOTHING: [u8; 64] = [0; 64];
    // SAFETY: a row holds `lanes` right pixels from each of its columns on, and `column_sums` as many sums for each.
    unsafe {
        for (c, &left) in row.row.left.iter().enumerate() {
            for at in (0..row.lanes).step_by(2 * V::COUNT) {
                let right = row.row.right.as_ptr().add(c + at);
                let sums = row.column_sums.as_mut_ptr().add(c * row.lanes + at);
                let [even, odd] = V::change::<false>(left, right, 0, NOTHING.as_ptr());
                V::load(sums).add(even).store(sums);
                let sums = sums.add(V::COUNT);
                V::load(sums).add(odd).store(sums);
            }
        }
    }
}

/// Completes a batch, or what there is of it.
///
/// # Safety
/// `row.check` passed; the batch's columns, and one to each side, were computed or blocked.
#[inline(always)]
unsafe fn finish<V: SplitLanes, const LEFT_RIGHT: bool>(
    row: &mut SadRow<'_, u16>,
    ring: &Ring,
    picked: &mut Picked,
    batch: std::ops::Range<usize>,
) {
    let RowShape { lanes, left_right_reach, .. } = row.shape;
    let reach = left_right_reach.unwrap_or(0);
    // SAFETY: columns are below the width.
    unsafe {
        if !V::PICKS {
            ring.pick(picked, batch.clone(), LEFT_RIGHT && reach == NEAR);
        }
        let choices = picked.choose(lanes, batch.start);
        if LEFT_RIGHT && reach <= NEAR {
            let nearby = picked.nearby(lanes, batch.start, reach, &choices);
            put(&nearby, row.nearby.get_unchecked_mut(batch.clone()));
        }
        put(&as_choices(choices), row.chosen.get_unchecked_mut(batch));
    }
}

/// The rows that enter and leave the window.
#[derive(Clone, Copy)]
struct Pixels {
    left_in: *const u8,
    right_in: *const u8,
    left_out: *const u8,
    right_out: *const u8,
}

impl Pixels {
    fn new(entering: RowPair<'_>, leaving: RowPair<'_>) -> Self {
        Self {
            left_in: entering.left.as_ptr(),
            right_in: entering.right.as_ptr(),
            left_out: leaving.left.as_ptr(),
            right_out: leaving.right.as_ptr(),
        }
    }
}

/// The state of the walk along a row. Pointers are held here, where they can stay in registers.
struct Walk<V, const P: usize, const IDLE: bool> {
    pixels: Pixels,
    sums: *mut u16,
    shape: RowShape,
    /// Window sums of the current column: `H`.
    window: Column<V, P>,
    /// Smallest costs so far of the right pixels opposite the current column: `R`.
    right: Column<V, P>,
    /// Costs of the column before, and what was returned for it.
    before: Column<V, P>,
    at_before: usize,
    /// [`rival_factor`] of the uniqueness ratio.
    rival_factor: u64,
    /// All ones in lanes that are not asked for; read only if `IDLE`, which costs an operation per vector.
    idle: Column<V, P>,
}

/// `ceil(ratio / 100 · 2²³)`: see [`rival_limit`].
fn rival_factor(uniqueness_ratio: u32) -> u64 {
    (u64::from(uniqueness_ratio) << 23).div_ceil(100)
}

/// `best + best · ratio / 100`, rounded down, and below a blocked cost.
///
/// The factor exceeds `ratio / 100 · 2²³` by less than 1, so the product exceeds the exact one by less than
/// `2¹⁶ / 2²³ < 1/100`: never enough to reach the next whole number, as fractions are hundredths.
#[inline(always)]
fn rival_limit(best: u16, factor: u64) -> u16 {
    let limit = u64::from(best) + ((u64::from(best) * factor) >> 23);
    limit.min(u64::from(u16::BLOCKED) - 1) as u16
}

impl<V: SplitLanes, const P: usize, const IDLE: bool> Walk<V, P, IDLE> {
    const LANES: usize = 2 * P * V::COUNT;

    /// At column 0, before [`column`](Self::column).
    ///
    /// # Safety
    /// As [`sad_row`].
    #[inline(always)]
    unsafe fn start<const SMALL: bool>(row: &mut SadRow<'_, u16>) -> Self {
        let RowShape { width, radius, uniqueness_ratio, .. } = row.shape;
        let pixels = Pixels::new(row.entering, row.leaving);
        let sums = row.column_sums.as_mut_ptr();
        // SAFETY: columns are clamped to the image's.
        unsafe {
            let mut window = [[V::splat(0); 2]; P];
            for i in 0..=radius {
                let column = i.min(width - 1);
                let sums = if i == column {
                    slide_down::<V, P, SMALL>(pixels, column, sums)
                } else {
                    load::<V, P>(sums.add(column * Self::LANES))
                };
                // The first column stands for itself and for the `radius` columns left of the image.
                for _ in 0..if i == 0 { radius + 1 } else { 1 } {
                    for p in 0..P {
                        for half in 0..2 {
                            window[p][half] = window[p][half].add(sums[p][half]);
                        }
                    }
                }
            }
            let blocked = [[V::splat(u16::BLOCKED); 2]; P];
            let mut idle = blocked;
            for p in 0..P {
                let lanes = row.blocked_lanes.as_ptr().add(2 * p * V::COUNT);
                idle[p] = V::blocked(0, lanes, lanes);
            }
            Self {
                pixels,
                sums,
                shape: row.shape,
                window,
                right: blocked,
                before: blocked,
                at_before: 0,
                rival_factor: rival_factor(uniqueness_ratio),
                idle,
            }
        }
    }

    /// Moves the window to column `x`, the next one, and notes half of the best lane and, if `V` picks, the costs around.
    ///
    /// # Safety
    /// As [`sad_row`]; `cells` is the column's place in the ring. If not `EDGE`, the window around `x` and the one
    /// before lie inside the image, no pixel blocks a candidate, and a column follows.
    #[inline(always)]
    unsafe fn column<const SMALL: bool, const LEFT_RIGHT: bool, const COARSE: bool, const EDGE: bool>(
        &mut self,
        row: &mut SadRow<'_, u16>,
        x: usize,
        ring: &Ring,
        cells: *mut u16,
        picked: &mut Picked,
    ) {
        let RowShape { width, radius, uniqueness_ratio, left_right_reach, .. } = self.shape;
        let (sums, last) = (self.sums, width - 1);
        // SAFETY: column `c <= last` has its sums at `c * LANES`, its right pixels and their blocks at
        // `c..c + LANES`; `check` made the slices that long.
        unsafe {
            if !EDGE || x > 0 {
                let left = if EDGE { x.saturating_sub(radius + 1) } else { x - radius - 1 };
                let leaving = sums.add(left * Self::LANES);
                let entering = if !EDGE || x + radius <= last {
                    slide_down::<V, P, SMALL>(self.pixels, x + radius, self.sums)
                } else {
                    load::<V, P>(sums.add(last * Self::LANES))
                };
                for p in 0..P {
                    for half in 0..2 {
                        let leaving = V::load(leaving.add((2 * p + half) * V::COUNT));
                        self.window[p][half] = self.window[p][half].add(entering[p][half].sub(leaving));
                    }
                }
            }

            let mut costs = self.window;
            if COARSE {
                let even = row.coarse.as_ptr().add(x / 2 * Self::LANES);
                let odd = even.add(Self::LANES / 2);
                for p in 0..P {
                    costs[p][0] = costs[p][0].add(V::load(even.add(p * V::COUNT)));
                    costs[p][1] = costs[p][1].add(V::load(odd.add(p * V::COUNT)));
                }
            }
            if IDLE && !EDGE {
                for p in 0..P {
                    costs[p] = [costs[p][0].or(self.idle[p][0]), costs[p][1].or(self.idle[p][1])];
                }
            }
            if EDGE {
                let left = *row.blocked_left.get_unchecked(x);
                let (rights, lanes) = (row.blocked_right.as_ptr().add(x), row.blocked_lanes.as_ptr());
                for p in 0..P {
                    let at = 2 * p * V::COUNT;
                    let [even, odd] = V::blocked(left, rights.add(at), lanes.add(at));
                    costs[p] = [costs[p][0].or(even), costs[p][1].or(odd)];
                }
            }

            let mut least = [costs[0][0]; P];
            for p in 0..P {
                least[p] = costs[p][0].min(costs[p][1]);
            }
            let mut smallest = least[0];
            for p in 1..P {
                smallest = smallest.min(least[p]);
            }
            let best = smallest.splat_min();
            let at = V::first_equal(&least, best);
            let slot = x % (2 * BATCH);
            picked.at[slot] = at as u16;
            if V::PICKS {
                picked.costs[slot] = V::pick(&costs, at);
            }
            let reach = left_right_reach.unwrap_or(0);
            if !V::PICKS || LEFT_RIGHT && reach > NEAR {
                ring.store(cells, &costs);
            } else if LEFT_RIGHT {
                picked.larger[slot] = V::pick(&self.before, at);
                let slot_before = (x + 2 * BATCH - 1) % (2 * BATCH);
                picked.smaller[slot_before] = V::pick(&costs, self.at_before);
                (self.before, self.at_before) = (costs, at);
            }
            if uniqueness_ratio > 0 {
                let limit = V::splat(rival_limit(best.first(), self.rival_factor));
                let mut rivals = 0;
                for p in 0..P {
                    rivals += V::count_at_most(costs[p], limit);
                }
                *row.rivals.get_unchecked_mut(x) = rivals as u16;
            }
            if LEFT_RIGHT {
                for p in 0..P {
                    for half in 0..2 {
                        self.right[p][half] = self.right[p][half].min(costs[p][half]);
                    }
                }
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
        for p in 0..P {
            for half in 0..2 {
                column[p][half] = V::load(from.add((2 * p + half) * V::COUNT));
            }
        }
        column
    }
}

/// Slides the sums of one column down a row and returns them.
///
/// # Safety
/// As [`sad_row`]; `column` is one of the image's.
#[inline(always)]
unsafe fn slide_down<V: SplitLanes, const P: usize, const SMALL: bool>(
    pixels: Pixels,
    column: usize,
    sums: *mut u16,
) -> Column<V, P> {
    // SAFETY: a row holds `lanes` right pixels from each of its columns on, and `sums` as many sums for each.
    unsafe {
        let (left_in, left_out) = (*pixels.left_in.add(column), *pixels.left_out.add(column));
        let (right_in, right_out) = (pixels.right_in.add(column), pixels.right_out.add(column));
        let sums = sums.add(column * 2 * P * V::COUNT);
        let mut slid = [[V::splat(0); 2]; P];
        for p in 0..P {
            let at = 2 * p * V::COUNT;
            let change = V::change::<SMALL>(left_in, right_in.add(at), left_out, right_out.add(at));
            for half in 0..2 {
                let sum = sums.add(at + half * V::COUNT);
                slid[p][half] = V::load(sum).add(change[half]);
                slid[p][half].store(sum);
            }
        }
        slid
    }
}

/// Each lane takes the one after it; a blocked cost enters at the end. Odd lanes become even ones as they are.
///
/// # Safety
/// The processor has the instructions of `V`.
#[inline(always)]
unsafe fn shift_down<V: Lanes, const P: usize>(column: &mut Column<V, P>) {
    // SAFETY: the caller proves the instructions.
    unsafe {
        for p in 0..P {
            let next = if p + 1 < P { column[p + 1][0] } else { V::splat(u16::BLOCKED) };
            let [even, odd] = column[p];
            column[p] = [odd, even.shift_down(next)];
        }
    }
}

/// Calls the instance of [`sad_row`] for the row's lanes and settings.
///
/// # Safety
/// The processor has the instructions of `V`, and `row.check` passed.
pub(super) unsafe fn dispatch<V: SplitLanes>(row: &mut SadRow<'_, u16>) {
    // SAFETY: the caller's; no lane is blocked where `IDLE` is not chosen.
    unsafe {
        if first_set(row.blocked_lanes, 0) < row.shape.lanes {
            dispatch_settings::<V, true>(row);
        } else {
            dispatch_settings::<V, false>(row);
        }
    }
}

/// # Safety
/// As [`dispatch`], and `IDLE` tells whether some lane is blocked.
unsafe fn dispatch_settings<V: SplitLanes, const IDLE: bool>(row: &mut SadRow<'_, u16>) {
    // SAFETY: the caller's; no difference exceeds 127 where `SMALL` is chosen.
    unsafe {
        let left_right = row.shape.left_right_reach.is_some();
        match (row.shape.largest_difference <= 127, left_right, !row.coarse.is_empty()) {
            (true, false, false) => dispatch_lanes::<V, true, false, false, IDLE>(row),
            (true, false, true) => dispatch_lanes::<V, true, false, true, IDLE>(row),
            (true, true, false) => dispatch_lanes::<V, true, true, false, IDLE>(row),
            (true, true, true) => dispatch_lanes::<V, true, true, true, IDLE>(row),
            (false, false, false) => dispatch_lanes::<V, false, false, false, IDLE>(row),
            (false, false, true) => dispatch_lanes::<V, false, false, true, IDLE>(row),
            (false, true, false) => dispatch_lanes::<V, false, true, false, IDLE>(row),
            (false, true, true) => dispatch_lanes::<V, false, true, true, IDLE>(row),
        }
    }
}

/// # Safety
/// As [`dispatch_settings`], and no difference exceeds 127 if `SMALL`.
unsafe fn dispatch_lanes<
    V: SplitLanes,
    const SMALL: bool,
    const LEFT_RIGHT: bool,
    const COARSE: bool,
    const IDLE: bool,
>(
    row: &mut SadRow<'_, u16>,
) {
    // SAFETY: the caller's; the number of lanes is that of the instance.
    unsafe {
        match row.shape.lanes / (2 * V::COUNT) {
            1 => V::sad_row::<1, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            2 => V::sad_row::<2, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            3 => V::sad_row::<3, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            4 => V::sad_row::<4, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            6 => V::sad_row::<6, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            8 => V::sad_row::<8, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            16 => V::sad_row::<16, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            32 => V::sad_row::<32, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            #[cfg(target_arch = "aarch64")]
            64 => V::sad_row::<64, SMALL, LEFT_RIGHT, COARSE, IDLE>(row),
            pairs => unreachable!("padded_lanes gives no {pairs} pairs of vectors"),
        }
    }
}
