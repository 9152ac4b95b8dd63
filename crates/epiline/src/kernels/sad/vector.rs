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
use super::{Cost, RowPair, RowShape, SadRow};

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
pub(super) trait Lanes: Copy {
    /// Costs per vector. One vector of as many bytes as `u16x(2 * COUNT)` has would hold a pair's pixels.
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
    /// `|left_in - right_in[i]| - |left_out - right_out[i]|` for `2 * COUNT` bytes, each difference at most 127.
    unsafe fn small_change(left_in: u8, right_in: *const u8, left_out: u8, right_out: *const u8)
    -> [Self; 2];
    /// The same for any bytes.
    unsafe fn change(left_in: u8, right_in: *const u8, left_out: u8, right_out: *const u8) -> [Self; 2];
}

/// All costs of one column: `P` pairs of vectors.
type Column<V, const P: usize> = [[V; 2]; P];

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
    let RowShape { width, radius, blocked_columns, uniqueness_ratio, .. } = row.shape;
    let lanes = 2 * P * V::COUNT;
    let reach = row.shape.left_right_reach.unwrap_or(0);
    let (last, delay) = (width - 1, BATCH.max(reach));
    // SAFETY: the caller proves the instructions. Column `c <= last` has its sums at `c * lanes`, its right pixels and
    // their blocks at `c..c + lanes`; `check` made the slices that long. The ring is indexed in `Ring`.
    unsafe {
        let sums = row.column_sums.as_mut_ptr();
        let mut ring = Ring::new(row.scratch, &row.shape);
        for column in 1..=reach {
            ring.block::<V, P>(0_usize.wrapping_sub(column));
        }

        let mut h: Column<V, P> = [[V::splat(0); 2]; P];
        for i in 0..=radius {
            if i <= last {
                slide_down::<V, P, SMALL>(row.entering, row.leaving, i, sums);
            }
            // The first column stands for itself and for the `radius` columns left of the image.
            for _ in 0..if i == 0 { radius + 1 } else { 1 } {
                each::<V, P>(|p, half, at| {
                    h[p][half] = h[p][half].add(V::load(sums.add(i.min(last) * lanes + at)))
                });
            }
        }

        let mut right: Column<V, P> = [[V::splat(u16::BLOCKED); 2]; P];
        let mut read = 0;
        for batch in (0..width).step_by(BATCH) {
            let end = (batch + BATCH).min(width);
            for x in batch..end {
                if x > 0 {
                    let leaving = sums.add(x.saturating_sub(radius + 1) * lanes);
                    let column = x + radius;
                    if column <= last {
                        let entering = slide_down::<V, P, SMALL>(row.entering, row.leaving, column, sums);
                        each::<V, P>(|p, half, at| {
                            h[p][half] = h[p][half].add(entering[p][half].sub(V::load(leaving.add(at))));
                        });
                    } else {
                        let entering = sums.add(last * lanes);
                        each::<V, P>(|p, half, at| {
                            let change = V::load(entering.add(at)).sub(V::load(leaving.add(at)));
                            h[p][half] = h[p][half].add(change);
                        });
                    }
                }

                let mut costs = h;
                if x < blocked_columns {
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
                *row.best_lane.get_unchecked_mut(x) = first_equal(&costs, best) as u16;
                if uniqueness_ratio > 0 {
                    let limit =
                        rival_limit(best.first().into(), uniqueness_ratio).min(u32::from(u16::BLOCKED) - 1);
                    let limit = V::splat(limit as u16);
                    let rivals: u32 = costs.iter().map(|&pair| V::count_at_most(pair, limit)).sum();
                    *row.rivals.get_unchecked_mut(x) = rivals as u16;
                }
                if LEFT_RIGHT {
                    each::<V, P>(|p, half, _| right[p][half] = right[p][half].min(costs[p][half]));
                    *row.right_best.get_unchecked_mut(x) = right[0][0].first();
                    if x < last {
                        shift_down(&mut right);
                    }
                }
                ring.put(x, &costs);
            }
            let until = end.saturating_sub(delay);
            read_back::<LEFT_RIGHT>(row, &ring, read..until.max(read));
            read = until.max(read);
        }
        for column in width..width + reach {
            ring.block::<V, P>(column);
        }
        read_back::<LEFT_RIGHT>(row, &ring, read..width);
        if LEFT_RIGHT {
            let tail = row.right_best.as_mut_ptr().add(last);
            each::<V, P>(|p, half, at| right[p][half].store(tail.add(at)));
        }
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
    let mut lane = 0;
    // From the last pair to the first without a branch: which pair it is cannot be predicted.
    for (p, &pair) in costs.iter().enumerate().rev() {
        // SAFETY: the caller proves the instructions.
        let bits = unsafe { V::equal_bits(pair, best) };
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

    /// # Safety
    /// As [`column`](Self::column), and the processor has the instructions of `V`.
    #[inline(always)]
    unsafe fn put<V: Lanes, const P: usize>(&mut self, x: usize, costs: &Column<V, P>) {
        // SAFETY: a pixel has `lanes` cells, which is what a column of vectors fills.
        unsafe {
            let cells = self.column(x);
            each::<V, P>(|p, half, at| costs[p][half].store(cells.add(at)));
        }
    }

    /// A column outside the image: no lane is a candidate.
    ///
    /// # Safety
    /// As [`put`](Self::put).
    #[inline(always)]
    unsafe fn block<V: Lanes, const P: usize>(&mut self, x: usize) {
        // SAFETY: the caller's.
        unsafe { self.put::<V, P>(x, &[[V::splat(u16::BLOCKED); 2]; P]) }
    }
}

/// Reads the costs beside the best of some columns from the ring.
///
/// # Safety
/// `row.check` passed and the ring holds the columns from `columns.start - reach` to `columns.end - 1 + reach`.
#[inline(always)]
unsafe fn read_back<const LEFT_RIGHT: bool>(
    row: &mut SadRow<'_, u16>,
    ring: &Ring,
    columns: std::ops::Range<usize>,
) {
    let reach = row.shape.left_right_reach.unwrap_or(0);
    for x in columns {
        // SAFETY: columns are below the width. A lane is below `lanes`; what is read lies at most `reach` (at least
        // 1), or 2 after it, beside it, which the guards have room for.
        unsafe {
            let lane = usize::from(*row.best_lane.get_unchecked(x));
            let before = ring.column(x).add(lane).sub(1).cast::<[u16; 4]>();
            let costs = before.read_unaligned();
            *row.costs.get_unchecked_mut(x) = costs;
            if LEFT_RIGHT {
                let mut nearby = costs[1];
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
macro_rules! dispatch {
    ($lanes:ty, $row:expr) => {{
        let row = $row;
        macro_rules! instance {
            ($pairs:literal) => {
                // SAFETY: the enclosing function has the instructions; its caller vouches for the row; the match and
                // the conditions below choose the instance.
                match (row.shape.largest_difference <= 127, row.shape.left_right_reach.is_some()) {
                    (true, false) => unsafe { vector::sad_row::<$lanes, $pairs, true, false>(row) },
                    (true, true) => unsafe { vector::sad_row::<$lanes, $pairs, true, true>(row) },
                    (false, false) => unsafe { vector::sad_row::<$lanes, $pairs, false, false>(row) },
                    (false, true) => unsafe { vector::sad_row::<$lanes, $pairs, false, true>(row) },
                }
            };
        }
        match row.shape.lanes / LANE_BLOCK {
            1 => instance!(1),
            2 => instance!(2),
            3 => instance!(3),
            4 => instance!(4),
            6 => instance!(6),
            8 => instance!(8),
            12 => instance!(12),
            16 => instance!(16),
            24 => instance!(24),
            32 => instance!(32),
            blocks => unreachable!("padded_lanes gives no {blocks} blocks of {LANE_BLOCK} lanes"),
        }
    }};
}
pub(super) use dispatch;
