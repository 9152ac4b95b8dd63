//! 32 costs at a time.

use std::arch::x86_64::*;

use super::vector::{self, Column, Lanes, SplitLanes};
use super::{AddRow, SadRow};

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

/// See [`AddRow`].
///
/// # Safety
/// As [`sad_row`].
pub unsafe fn add_row(row: &mut AddRow<'_, u16>) {
    // SAFETY: the caller's.
    unsafe { U16x32::add_row(row) }
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

/// The most pairs of vectors there are.
const MAX_PAIRS: usize = 32;

/// For each even lane: where it, the odd one after it, and the lanes beside both are, in the order of lanes. A position is
/// 64 times the number of the pair, plus 32 in its odd vector, plus that in the vector. What does not exist is anywhere.
static PICKED_U16X4: [u64; 32 * MAX_PAIRS] = {
    let mut picked = [0; 32 * MAX_PAIRS];
    let mut at = 0;
    while at < picked.len() {
        let mut i = 0;
        while i < 4 {
            let lane = (2 * at + i).saturating_sub(1) as u64;
            let position = lane / 64 * 64 + lane % 2 * 32 + lane % 64 / 2;
            picked[at] |= (position & 0x7FF) << (16 * i);
            i += 1;
        }
        at += 1;
    }
    picked
};

/// Bytes as words: even ones, odd ones.
///
/// # Safety
/// The processor has AVX-512 BW.
#[inline(always)]
unsafe fn widen_i8x64(i8x64: __m512i) -> [U16x32; 2] {
    // SAFETY: the caller's.
    unsafe {
        [
            U16x32(_mm512_maddubs_epi16(_mm512_set1_epi16(0x0001), i8x64)),
            U16x32(_mm512_maddubs_epi16(_mm512_set1_epi16(0x0100), i8x64)),
        ]
    }
}

// SAFETY of every block below: the caller of a function of `Lanes` proves AVX-512 and, for pointers, what they point at.
impl Lanes for U16x32 {
    const COUNT: usize = 32;

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
        unsafe {
            let low = _mm512_cmpeq_epi16_mask(pair[0].0, other.0);
            let high = _mm512_cmpeq_epi16_mask(pair[1].0, other.0);
            u64::from(low) | u64::from(high) << 32
        }
    }

    #[inline(always)]
    unsafe fn count_at_most(pair: [Self; 2], limit: Self) -> u32 {
        // SAFETY: see above.
        unsafe {
            let low = _mm512_cmple_epu16_mask(pair[0].0, limit.0);
            let high = _mm512_cmple_epu16_mask(pair[1].0, limit.0);
            (u64::from(low) | u64::from(high) << 32).count_ones()
        }
    }
}

impl SplitLanes for U16x32 {
    const PICKS: bool = true;

    unsafe fn sad_row<
        const P: usize,
        const SMALL: bool,
        const LEFT_RIGHT: bool,
        const COARSE: bool,
        const IDLE: bool,
    >(
        row: &mut SadRow<'_, u16>,
    ) {
        #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt")]
        unsafe fn compiled<
            const P: usize,
            const SMALL: bool,
            const LEFT_RIGHT: bool,
            const COARSE: bool,
            const IDLE: bool,
        >(
            row: &mut SadRow<'_, u16>,
        ) {
            // SAFETY: the caller's.
            unsafe { vector::sad_row::<U16x32, P, SMALL, LEFT_RIGHT, COARSE, IDLE>(row) }
        }
        // SAFETY: see above.
        unsafe { compiled::<P, SMALL, LEFT_RIGHT, COARSE, IDLE>(row) }
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt")]
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
            let (left_in, left_out) =
                (_mm512_set1_epi8(left_in.cast_signed()), _mm512_set1_epi8(left_out.cast_signed()));
            let (right_in, right_out) =
                (_mm512_loadu_si512(right_in.cast()), _mm512_loadu_si512(right_out.cast()));
            if SMALL {
                let entering = _mm512_abs_epi8(_mm512_sub_epi8(left_in, right_in));
                let leaving = _mm512_abs_epi8(_mm512_sub_epi8(left_out, right_out));
                return widen_i8x64(_mm512_sub_epi8(entering, leaving));
            }
            let entering =
                _mm512_sub_epi8(_mm512_max_epu8(left_in, right_in), _mm512_min_epu8(left_in, right_in));
            let leaving =
                _mm512_sub_epi8(_mm512_max_epu8(left_out, right_out), _mm512_min_epu8(left_out, right_out));
            let even = _mm512_set1_epi16(0xFF);
            [
                Self(_mm512_sub_epi16(_mm512_and_si512(entering, even), _mm512_and_si512(leaving, even))),
                Self(_mm512_sub_epi16(_mm512_srli_epi16::<8>(entering), _mm512_srli_epi16::<8>(leaving))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn blocked(left: u8, right: *const u8, lanes: *const u8) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let (right, lanes) = (_mm512_loadu_si512(right.cast()), _mm512_loadu_si512(lanes.cast()));
            let left = _mm512_set1_epi8(left.cast_signed());
            widen_i8x64(_mm512_or_si512(left, _mm512_or_si512(right, lanes)))
        }
    }

    #[inline(always)]
    unsafe fn first_equal<const P: usize>(vectors: &[Self; P], best: Self) -> usize {
        // SAFETY: see above.
        unsafe {
            if P == 1 {
                return _mm512_cmpeq_epi16_mask(vectors[0].0, best.0).trailing_zeros() as usize;
            }
            // From the last pair of vectors to the first; without a branch, as no one could predict it.
            let mut lane = 0;
            let mut p = P.next_multiple_of(2);
            while p > 0 {
                p -= 2;
                let low = u64::from(_mm512_cmpeq_epi16_mask(vectors[p].0, best.0));
                let high = if p + 1 < P { _mm512_cmpeq_epi16_mask(vectors[p + 1].0, best.0) } else { 0 };
                let bits = low | u64::from(high) << 32;
                let here = 32 * p + bits.trailing_zeros() as usize;
                lane = if bits != 0 { here } else { lane };
            }
            lane
        }
    }

    #[inline(always)]
    unsafe fn pick<const P: usize>(costs: &Column<Self, P>, at: usize) -> u64 {
        // SAFETY: see above; there are `16 * MAX_PAIRS` entries, and `at` is a lane of `P` vectors.
        unsafe {
            // A permutation looks at the low six bits of a number, one of the pair's 64 lanes; the others say which pair.
            let lanes = _mm_cvtsi64_si128(PICKED_U16X4.get_unchecked(at).cast_signed());
            let wide = _mm512_zextsi128_si512(lanes);
            let mut picked = _mm512_permutex2var_epi16(costs[0][0].0, wide, costs[0][1].0);
            for (p, pair) in costs.iter().enumerate().skip(1) {
                let here = _mm_cmpge_epu16_mask(lanes, _mm_set1_epi16(64 * p as i16));
                let of_pair = _mm512_permutex2var_epi16(pair[0].0, wide, pair[1].0);
                picked = _mm512_mask_mov_epi16(picked, here.into(), of_pair);
            }
            _mm_cvtsi128_si64(_mm512_castsi512_si128(picked)).cast_unsigned()
        }
    }
}
