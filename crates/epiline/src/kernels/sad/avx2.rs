//! 16 costs at a time.

use std::arch::x86_64::*;

use super::vector::{self, Column, Lanes};
use super::{Choice, SadRow};

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

/// `|left - right[i]|` for 32 pixels.
///
/// # Safety
/// As [`Lanes`]; `right` is followed by 32 readable bytes.
#[inline(always)]
unsafe fn difference_u8x32(left: u8, right: *const u8) -> __m256i {
    // SAFETY: the caller's.
    unsafe {
        let (left, right) = (_mm256_set1_epi8(left.cast_signed()), _mm256_loadu_si256(right.cast()));
        _mm256_sub_epi8(_mm256_max_epu8(left, right), _mm256_min_epu8(left, right))
    }
}

// SAFETY of every block below: the caller of a function of `Lanes` proves AVX2 and, for pointers, what they point at.
impl Lanes for U16x16 {
    const COUNT: usize = 16;

    unsafe fn sad_row<const P: usize, const SMALL: bool, const LEFT_RIGHT: bool>(row: &mut SadRow<'_, u16>) {
        #[target_feature(enable = "avx2,bmi1,popcnt")]
        unsafe fn compiled<const P: usize, const SMALL: bool, const LEFT_RIGHT: bool>(
            row: &mut SadRow<'_, u16>,
        ) {
            // SAFETY: the caller's.
            unsafe { vector::sad_row::<U16x16, P, SMALL, LEFT_RIGHT>(row) }
        }
        // SAFETY: see above.
        unsafe { compiled::<P, SMALL, LEFT_RIGHT>(row) }
    }

    // There is no permutation of 16-bit lanes across a whole vector; the ring is as fast as what would replace it.
    const PICKS_LANES: bool = false;

    #[inline(always)]
    unsafe fn choice<const P: usize>(_: &Column<Self, P>, _: usize) -> Choice<u16> {
        unreachable!("PICKS_LANES is false")
    }

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
            let [low, high] = pair.map(|lanes| _mm256_cmpeq_epi16(lanes.0, other.0));
            // Packing works within halves of a vector; the permutation puts the four quarters in order.
            let in_order = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(low, high));
            u64::from(_mm256_movemask_epi8(in_order).cast_unsigned())
        }
    }

    #[inline(always)]
    unsafe fn count_at_most(pair: [Self; 2], limit: Self) -> u32 {
        // SAFETY: see above.
        unsafe {
            let [low, high] =
                pair.map(|lanes| _mm256_cmpeq_epi16(_mm256_min_epu16(lanes.0, limit.0), lanes.0));
            _mm256_movemask_epi8(_mm256_packs_epi16(low, high)).count_ones()
        }
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
                (difference_u8x32(left_in, right_in), difference_u8x32(left_out, right_out));
            let i8x32 = _mm256_sub_epi8(entering, leaving);
            [
                Self(_mm256_cvtepi8_epi16(_mm256_castsi256_si128(i8x32))),
                Self(_mm256_cvtepi8_epi16(_mm256_extracti128_si256::<1>(i8x32))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn change(left_in: u8, right_in: *const u8, left_out: u8, right_out: *const u8) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let widen = |u8x32: __m256i| {
                [
                    _mm256_cvtepu8_epi16(_mm256_castsi256_si128(u8x32)),
                    _mm256_cvtepu8_epi16(_mm256_extracti128_si256::<1>(u8x32)),
                ]
            };
            let entering = widen(difference_u8x32(left_in, right_in));
            let leaving = widen(difference_u8x32(left_out, right_out));
            [0, 1].map(|half| Self(_mm256_sub_epi16(entering[half], leaving[half])))
        }
    }
}
