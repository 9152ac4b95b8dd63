//! 16 costs at a time.

use std::arch::x86_64::*;

use super::vector::{self, Column, Lanes, SplitLanes};
use super::{AddRow, SadRow};

/// Two vectors of costs.
pub const LANE_BLOCK: usize = 32;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct U16x16(pub(in crate::kernels) __m256i);

/// See [`SadRow`].
///
/// # Safety
/// The processor has what `Level::avx2` proves, and `row.check` passed.
pub unsafe fn sad_row(row: &mut SadRow<'_, u16>) {
    // SAFETY: the caller's.
    unsafe { vector::dispatch::<U16x16>(row) }
}

/// See [`AddRow`].
///
/// # Safety
/// As [`sad_row`].
pub unsafe fn add_row(row: &mut AddRow<'_, u16>) {
    // SAFETY: the caller's.
    unsafe { U16x16::add_row(row) }
}

/// Bytes as words: even ones, odd ones.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn widen_i8x32(i8x32: __m256i) -> [U16x16; 2] {
    // SAFETY: the caller's.
    unsafe {
        [
            U16x16(_mm256_maddubs_epi16(_mm256_set1_epi16(0x0001), i8x32)),
            U16x16(_mm256_maddubs_epi16(_mm256_set1_epi16(0x0100), i8x32)),
        ]
    }
}

// SAFETY of every block below: the caller of a function of `Lanes` proves AVX2 and, for pointers, what they point at.
impl Lanes for U16x16 {
    const COUNT: usize = 16;

    #[inline(always)]
    unsafe fn splat(value: u16) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_set1_epi16(value.cast_signed()) })
    }

    #[inline(always)]
    unsafe fn load(from: *const u16) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_loadu_si256(from.cast()) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut u16) {
        // SAFETY: see above.
        unsafe { _mm256_storeu_si256(to.cast(), self.0) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_add_epi16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_sub_epi16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_min_epu16(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn or(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_or_si256(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn splat_min(self) -> Self {
        // SAFETY: see above.
        unsafe {
            let u16x8 = _mm_min_epu16(_mm256_castsi256_si128(self.0), _mm256_extracti128_si256::<1>(self.0));
            Self(_mm256_broadcastw_epi16(_mm_minpos_epu16(u16x8)))
        }
    }

    #[inline(always)]
    unsafe fn first(self) -> u16 {
        // SAFETY: see above.
        unsafe { _mm256_cvtsi256_si32(self.0) as u16 }
    }

    #[inline(always)]
    unsafe fn shift_down(self, next: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let upper_then_next = _mm256_permute2x128_si256::<0x21>(self.0, next.0);
            Self(_mm256_alignr_epi8::<2>(upper_then_next, self.0))
        }
    }

    #[inline(always)]
    unsafe fn equal_bits(pair: [Self; 2], other: Self) -> u64 {
        // SAFETY: see above.
        unsafe {
            let low = _mm256_cmpeq_epi16(pair[0].0, other.0);
            let high = _mm256_cmpeq_epi16(pair[1].0, other.0);
            // Packing works within halves of a vector; the permutation puts the four quarters in order.
            let in_order = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(low, high));
            u64::from(_mm256_movemask_epi8(in_order).cast_unsigned())
        }
    }

    #[inline(always)]
    unsafe fn count_at_most(pair: [Self; 2], limit: Self) -> u32 {
        // SAFETY: see above.
        unsafe {
            let low = _mm256_cmpeq_epi16(_mm256_min_epu16(pair[0].0, limit.0), pair[0].0);
            let high = _mm256_cmpeq_epi16(_mm256_min_epu16(pair[1].0, limit.0), pair[1].0);
            _mm256_movemask_epi8(_mm256_packs_epi16(low, high)).count_ones()
        }
    }
}

impl SplitLanes for U16x16 {
    // There is no permutation of 16-bit lanes across a whole vector; the ring is as fast as what would replace it.
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
        #[target_feature(enable = "avx2,bmi1,popcnt")]
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
            unsafe { vector::sad_row::<U16x16, P, SMALL, LEFT_RIGHT, COARSE, IDLE>(row) }
        }
        // SAFETY: see above.
        unsafe { compiled::<P, SMALL, LEFT_RIGHT, COARSE, IDLE>(row) }
    }

    #[target_feature(enable = "avx2,bmi1,popcnt")]
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
                (_mm256_set1_epi8(left_in.cast_signed()), _mm256_set1_epi8(left_out.cast_signed()));
            let (right_in, right_out) =
                (_mm256_loadu_si256(right_in.cast()), _mm256_loadu_si256(right_out.cast()));
            if SMALL {
                let entering = _mm256_abs_epi8(_mm256_sub_epi8(left_in, right_in));
                let leaving = _mm256_abs_epi8(_mm256_sub_epi8(left_out, right_out));
                return widen_i8x32(_mm256_sub_epi8(entering, leaving));
            }
            let entering =
                _mm256_sub_epi8(_mm256_max_epu8(left_in, right_in), _mm256_min_epu8(left_in, right_in));
            let leaving =
                _mm256_sub_epi8(_mm256_max_epu8(left_out, right_out), _mm256_min_epu8(left_out, right_out));
            let even = _mm256_set1_epi16(0xFF);
            [
                Self(_mm256_sub_epi16(_mm256_and_si256(entering, even), _mm256_and_si256(leaving, even))),
                Self(_mm256_sub_epi16(_mm256_srli_epi16::<8>(entering), _mm256_srli_epi16::<8>(leaving))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn blocked(left: u8, right: *const u8, lanes: *const u8) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let (right, lanes) = (_mm256_loadu_si256(right.cast()), _mm256_loadu_si256(lanes.cast()));
            let left = _mm256_set1_epi8(left.cast_signed());
            widen_i8x32(_mm256_or_si256(left, _mm256_or_si256(right, lanes)))
        }
    }

    #[inline(always)]
    unsafe fn first_equal<const P: usize>(vectors: &[Self; P], best: Self) -> usize {
        // SAFETY: see above.
        unsafe {
            // Two bits for each lane. From the last pair of vectors to the first; without a branch, as no one could
            // predict it.
            let mut lane = 0;
            let mut p = P.next_multiple_of(2);
            while p > 0 {
                p -= 2;
                let low = _mm256_movemask_epi8(_mm256_cmpeq_epi16(vectors[p].0, best.0)).cast_unsigned();
                let high = if p + 1 < P {
                    _mm256_movemask_epi8(_mm256_cmpeq_epi16(vectors[p + 1].0, best.0)).cast_unsigned()
                } else {
                    0
                };
                let bits = u64::from(low) | u64::from(high) << 32;
                let here = 16 * p + bits.trailing_zeros() as usize / 2;
                lane = if bits != 0 { here } else { lane };
            }
            lane
        }
    }

    #[inline(always)]
    unsafe fn pick<const P: usize>(_: &Column<Self, P>, _: usize) -> u64 {
        unreachable!("PICKS is false")
    }
}
