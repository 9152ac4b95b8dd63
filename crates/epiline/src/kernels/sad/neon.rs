//! 8 costs at a time.

use std::arch::aarch64::*;

use super::vector::{self, Column, Lanes, SplitLanes};
use super::{AddRow, SadRow};

/// Two vectors of costs.
pub const LANE_BLOCK: usize = 16;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct U16x8(pub(in crate::kernels) uint16x8_t);

/// See [`SadRow`].
///
/// # Safety
/// The processor has what `Level::neon` proves, and `row.check` passed.
pub unsafe fn sad_row(row: &mut SadRow<'_, u16>) {
    // SAFETY: the caller's.
    unsafe { vector::dispatch::<U16x8>(row) }
}

/// See [`AddRow`].
///
/// # Safety
/// As [`sad_row`].
pub unsafe fn add_row(row: &mut AddRow<'_, u16>) {
    // SAFETY: the caller's.
    unsafe { U16x8::add_row(row) }
}

/// Bytes as words: even ones, odd ones.
///
/// # Safety
/// The processor has NEON.
#[inline(always)]
unsafe fn widen_s8x16(s8x16: int8x16_t) -> [U16x8; 2] {
    // SAFETY: the caller's.
    unsafe {
        let s16x8 = vreinterpretq_s16_s8(s8x16);
        let (even, odd) = (vshrq_n_s16::<8>(vshlq_n_s16::<8>(s16x8)), vshrq_n_s16::<8>(s16x8));
        [U16x8(vreinterpretq_u16_s16(even)), U16x8(vreinterpretq_u16_s16(odd))]
    }
}

/// Lane numbers.
static LANES_U16X8: [u16; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

/// A bit for each byte of half a vector.
static BITS_U8X16: [u8; 16] = [1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128];

// SAFETY of every block below: the caller of a function of `Lanes` proves NEON and, for pointers, what they point at.
impl Lanes for U16x8 {
    const COUNT: usize = 8;

    #[inline(always)]
    unsafe fn splat(value: u16) -> Self {
        // SAFETY: see above.
        Self(unsafe { vdupq_n_u16(value) })
    }

    #[inline(always)]
    unsafe fn load(from: *const u16) -> Self {
        // SAFETY: see above.
        Self(unsafe { vld1q_u16(from) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut u16) {
        // SAFETY: see above.
        unsafe { vst1q_u16(to, self.0) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vaddq_u16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vsubq_u16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vminq_u16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn or(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vorrq_u16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn splat_min(self) -> Self {
        // SAFETY: see above.
        unsafe { Self::splat(vminvq_u16(self.0)) }
    }

    #[inline(always)]
    unsafe fn first(self) -> u16 {
        // SAFETY: see above.
        unsafe { vgetq_lane_u16::<0>(self.0) }
    }

    #[inline(always)]
    unsafe fn shift_down(self, next: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vextq_u16::<1>(self.0, next.0) })
    }

    #[inline(always)]
    unsafe fn equal_bits(pair: [Self; 2], other: Self) -> u64 {
        // SAFETY: see above.
        unsafe {
            let (low, high) = (vceqq_u16(pair[0].0, other.0), vceqq_u16(pair[1].0, other.0));
            let bytes = vuzp1q_u8(vreinterpretq_u8_u16(low), vreinterpretq_u8_u16(high));
            let bits = vandq_u8(bytes, vld1q_u8(BITS_U8X16.as_ptr()));
            u64::from(vaddv_u8(vget_low_u8(bits))) | u64::from(vaddv_u8(vget_high_u8(bits))) << 8
        }
    }

    #[inline(always)]
    unsafe fn count_at_most(pair: [Self; 2], limit: Self) -> u32 {
        // SAFETY: see above.
        unsafe {
            // All ones is -1.
            let (low, high) = (vcleq_u16(pair[0].0, limit.0), vcleq_u16(pair[1].0, limit.0));
            vaddvq_u16(vaddq_u16(low, high)).wrapping_neg().into()
        }
    }
}

impl SplitLanes for U16x8 {
    const PICKS: bool = false;

    unsafe fn sad_row<
        const P: usize,
        const SMALL: bool,
        const LEFT_RIGHT: bool,
        const COARSE: bool,
        const IDLE: bool,
    >(
        row: &mut SadRow<'_, u16>,
    ) {
        // SAFETY: see above.
        unsafe { vector::sad_row::<Self, P, SMALL, LEFT_RIGHT, COARSE, IDLE>(row) }
    }

    unsafe fn add_row(row: &mut AddRow<'_, u16>) {
        // SAFETY: see above.
        unsafe { vector::add_row::<Self>(row) }
    }

    #[inline(always)]
    unsafe fn change<const SMALL: bool>(
        left_in: u8,
        right_in: *const u8,
        left_out: u8,
        right_out: *const u8,
    ) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let entering = vabdq_u8(vdupq_n_u8(left_in), vld1q_u8(right_in));
            let leaving = vabdq_u8(vdupq_n_u8(left_out), vld1q_u8(right_out));
            if SMALL {
                return widen_s8x16(vreinterpretq_s8_u8(vsubq_u8(entering, leaving)));
            }
            let (entering, leaving) = (vreinterpretq_u16_u8(entering), vreinterpretq_u16_u8(leaving));
            let even = vdupq_n_u16(0xFF);
            [
                Self(vsubq_u16(vandq_u16(entering, even), vandq_u16(leaving, even))),
                Self(vsubq_u16(vshrq_n_u16::<8>(entering), vshrq_n_u16::<8>(leaving))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn blocked(left: u8, right: *const u8, lanes: *const u8) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let blocked = vorrq_u8(vdupq_n_u8(left), vorrq_u8(vld1q_u8(right), vld1q_u8(lanes)));
            widen_s8x16(vreinterpretq_s8_u8(blocked))
        }
    }

    #[inline(always)]
    unsafe fn first_equal<const P: usize>(vectors: &[Self; P], best: Self) -> usize {
        // SAFETY: see above.
        unsafe {
            let (nowhere, mut lanes) = (vdupq_n_u16(u16::MAX), vld1q_u16(LANES_U16X8.as_ptr()));
            let mut first = nowhere;
            for p in 0..P {
                let here = vbslq_u16(vceqq_u16(vectors[p].0, best.0), lanes, nowhere);
                first = vminq_u16(first, here);
                lanes = vaddq_u16(lanes, vdupq_n_u16(8));
            }
            vminvq_u16(first).into()
        }
    }

    #[inline(always)]
    unsafe fn pick<const P: usize>(_: &Column<Self, P>, _: usize) -> u64 {
        unreachable!("PICKS is false")
    }
}
