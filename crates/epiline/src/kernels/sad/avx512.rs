//! 32 costs at a time.

use std::arch::x86_64::*;

use super::vector::{self, Column, Lanes};
use super::{Choice, Cost, SadRow};

/// Two vectors of costs.
pub const LANE_BLOCK: usize = 64;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct U16x32(pub(in crate::kernels) __m512i);

/// See [`SadRow`].
///
/// # Safety
/// The processor has what `Level::avx512` proves, and `row.check` passed.
pub unsafe fn sad_row(row: &mut SadRow<'_, u16>) {
    // SAFETY: the caller's.
    unsafe { vector::dispatch::<U16x32>(row) }
}

/// `|left - right[i]|` for 64 pixels.
///
/// # Safety
/// As [`Lanes`]; `right` is followed by 64 readable bytes.
#[inline(always)]
unsafe fn difference_u8x64(left: u8, right: *const u8) -> __m512i {
    // SAFETY: the caller's.
    unsafe {
        let (left, right) = (_mm512_set1_epi8(left.cast_signed()), _mm512_loadu_si512(right.cast()));
        _mm512_sub_epi8(_mm512_max_epu8(left, right), _mm512_min_epu8(left, right))
    }
}

/// Lane numbers 1 to 32: of two vectors side by side, all but the first lane.
const FROM_SECOND_U16X32: [u16; 32] = {
    let mut lanes = [0; 32];
    let mut i = 0;
    while i < 32 {
        lanes[i] = i as u16 + 1;
        i += 1;
    }
    lanes
};

// SAFETY of every block below: the caller of a function of `Lanes` proves AVX-512 and, for pointers, what they point at.
impl Lanes for U16x32 {
    const COUNT: usize = 32;

    unsafe fn sad_row<const P: usize, const SMALL: bool, const LEFT_RIGHT: bool>(row: &mut SadRow<'_, u16>) {
        #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt")]
        unsafe fn compiled<const P: usize, const SMALL: bool, const LEFT_RIGHT: bool>(
            row: &mut SadRow<'_, u16>,
        ) {
            // SAFETY: the caller's.
            unsafe { vector::sad_row::<U16x32, P, SMALL, LEFT_RIGHT>(row) }
        }
        // SAFETY: see above.
        unsafe { compiled::<P, SMALL, LEFT_RIGHT>(row) }
    }

    const PICKS_LANES: bool = true;

    #[inline(always)]
    unsafe fn choice<const P: usize>(costs: &Column<Self, P>, lane: usize) -> Choice<u16> {
        // SAFETY: see above.
        unsafe {
            let lanes = _mm512_add_epi16(
                Self::splat(lane as u16).0,
                _mm512_zextsi128_si512(_mm_setr_epi16(-1, 0, 1, 0, 0, 0, 0, 0)),
            );
            // A permutation looks at the low six bits of a lane number, one of the pair's 64; the others say which pair.
            let mut picked = _mm512_permutex2var_epi16(costs[0][0].0, lanes, costs[0][1].0);
            for (p, pair) in costs.iter().enumerate().skip(1) {
                let from = Self::splat(64 * p as u16).0;
                let here = _mm512_cmpge_epu16_mask(lanes, from);
                let of_pair = _mm512_permutex2var_epi16(pair[0].0, lanes, pair[1].0);
                picked = _mm512_mask_mov_epi16(picked, here, of_pair);
            }
            let outside = _mm512_cmpge_epu16_mask(lanes, Self::splat(64 * P as u16).0);
            picked = _mm512_mask_mov_epi16(picked, outside, Self::splat(u16::BLOCKED).0);
            // The fourth of them is the lane itself.
            let choice = _mm512_mask_mov_epi16(picked, 0b1000, lanes);
            // SAFETY: four 16-bit numbers in the order of `Choice`, whose layout is C's.
            std::mem::transmute(_mm_cvtsi128_si64(_mm512_castsi512_si128(choice)))
        }
    }

    #[inline(always)]
    unsafe fn splat(value: u16) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_set1_epi16(value.cast_signed()) })
    }

    #[inline(always)]
    unsafe fn load(from: *const u16) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_loadu_si512(from.cast()) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut u16) {
        // SAFETY: see above.
        unsafe { _mm512_storeu_si512(to.cast(), self.0) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_add_epi16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_sub_epi16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_min_epu16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn or(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_or_si512(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn splat_min(self) -> Self {
        // SAFETY: see above.
        unsafe {
            let u16x16 =
                _mm256_min_epu16(_mm512_castsi512_si256(self.0), _mm512_extracti64x4_epi64::<1>(self.0));
            let u16x8 = _mm_min_epu16(_mm256_castsi256_si128(u16x16), _mm256_extracti128_si256::<1>(u16x16));
            Self(_mm512_broadcastw_epi16(_mm_minpos_epu16(u16x8)))
        }
    }

    #[inline(always)]
    unsafe fn first(self) -> u16 {
        // SAFETY: see above.
        unsafe { _mm512_cvtsi512_si32(self.0) as u16 }
    }

    #[inline(always)]
    unsafe fn shift_down(self, next: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let from_second = _mm512_loadu_si512(FROM_SECOND_U16X32.as_ptr().cast());
            Self(_mm512_permutex2var_epi16(self.0, from_second, next.0))
        }
    }

    #[inline(always)]
    unsafe fn equal_bits(pair: [Self; 2], other: Self) -> u64 {
        // SAFETY: see above.
        let [low, high] = pair.map(|lanes| u64::from(unsafe { _mm512_cmpeq_epi16_mask(lanes.0, other.0) }));
        low | high << 32
    }

    #[inline(always)]
    unsafe fn count_at_most(pair: [Self; 2], limit: Self) -> u32 {
        // SAFETY: see above.
        let [low, high] = pair.map(|lanes| u64::from(unsafe { _mm512_cmple_epu16_mask(lanes.0, limit.0) }));
        (low | high << 32).count_ones()
    }

    #[inline(always)]
    unsafe fn small_change(
        left_in: u8,
        right_in: *const u8,
        left_out: u8,
        right_out: *const u8,
    ) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let (entering, leaving) =
                (difference_u8x64(left_in, right_in), difference_u8x64(left_out, right_out));
            let i8x64 = _mm512_sub_epi8(entering, leaving);
            [
                Self(_mm512_cvtepi8_epi16(_mm512_castsi512_si256(i8x64))),
                Self(_mm512_cvtepi8_epi16(_mm512_extracti64x4_epi64::<1>(i8x64))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn change(left_in: u8, right_in: *const u8, left_out: u8, right_out: *const u8) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let widen = |u8x64: __m512i| {
                [
                    _mm512_cvtepu8_epi16(_mm512_castsi512_si256(u8x64)),
                    _mm512_cvtepu8_epi16(_mm512_extracti64x4_epi64::<1>(u8x64)),
                ]
            };
            let entering = widen(difference_u8x64(left_in, right_in));
            let leaving = widen(difference_u8x64(left_out, right_out));
            [0, 1].map(|half| Self(_mm512_sub_epi16(entering[half], leaving[half])))
        }
    }
}
