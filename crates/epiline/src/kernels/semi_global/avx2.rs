//! 32 costs at a time.

use std::arch::x86_64::*;

use super::vector::{self, Bytes};
use super::{CostRow, ExcessRow, HorizontalRows, SumRow, VerticalRow, WindowRow};
use crate::kernels::sad::avx2::U16x16;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct U8x32(__m256i);

vector::entries!(U8x32, "avx2,bmi1,popcnt");

// SAFETY of every block below: the caller of a function of `Bytes` proves the instructions and, for pointers, what they
// point at.
impl Bytes for U8x32 {
    const COUNT: usize = 32;
    type Words = U16x16;

    #[inline(always)]
    unsafe fn splat(value: u8) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_set1_epi8(value.cast_signed())) }
    }

    #[inline(always)]
    unsafe fn load(from: *const u8) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_loadu_si256(from.cast())) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut u8) {
        // SAFETY: see above.
        unsafe {
            _mm256_storeu_si256(to.cast(), self.0);
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_add_epi8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn saturating_add(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_adds_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn saturating_sub(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_subs_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_min_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_max_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn or(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_or_si256(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn quarter(self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_and_si256(_mm256_srli_epi16::<2>(self.0), Self::splat(0x3f).0)) }
    }

    #[inline(always)]
    unsafe fn hamming(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            // Bits set in 0 to 15, looked up for both halves of a byte.
            let set =
                _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
            let low_half = Self::splat(0x0f).0;
            let differing = _mm256_xor_si256(self.0, other.0);
            let low = _mm256_and_si256(differing, low_half);
            let high = _mm256_and_si256(_mm256_srli_epi16::<4>(differing), low_half);
            Self(_mm256_add_epi8(_mm256_shuffle_epi8(set, low), _mm256_shuffle_epi8(set, high)))
        }
    }

    #[inline(always)]
    unsafe fn splat_min(self) -> Self {
        // SAFETY: see above.
        unsafe {
            let u8x16 = _mm_min_epu8(_mm256_castsi256_si128(self.0), _mm256_extracti128_si256::<1>(self.0));
            let u16x8 = _mm_min_epu8(u8x16, _mm_srli_epi16::<8>(u8x16));
            Self(_mm256_broadcastb_epi8(_mm_minpos_epu16(u16x8)))
        }
    }

    #[inline(always)]
    unsafe fn first(self) -> u8 {
        // SAFETY: see above.
        unsafe { _mm256_cvtsi256_si32(self.0) as u8 }
    }

    #[inline(always)]
    unsafe fn lane_before(self, previous: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let halves = _mm256_permute2x128_si256::<0x21>(previous.0, self.0);
            Self(_mm256_alignr_epi8::<15>(self.0, halves))
        }
    }

    #[inline(always)]
    unsafe fn lane_after(self, next: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let halves = _mm256_permute2x128_si256::<0x21>(self.0, next.0);
            Self(_mm256_alignr_epi8::<1>(halves, self.0))
        }
    }

    #[inline(always)]
    unsafe fn widen(self) -> [U16x16; 2] {
        // SAFETY: see above.
        unsafe {
            [
                U16x16(_mm256_cvtepu8_epi16(_mm256_castsi256_si128(self.0))),
                U16x16(_mm256_cvtepu8_epi16(_mm256_extracti128_si256::<1>(self.0))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn widen_is_255(self) -> [U16x16; 2] {
        // SAFETY: see above.
        unsafe {
            let is_255 = _mm256_cmpeq_epi8(self.0, Self::splat(u8::MAX).0);
            [
                U16x16(_mm256_cvtepi8_epi16(_mm256_castsi256_si128(is_255))),
                U16x16(_mm256_cvtepi8_epi16(_mm256_extracti128_si256::<1>(is_255))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn narrow(words: [U16x16; 2]) -> Self {
        // SAFETY: see above.
        unsafe {
            // Packing interleaves the halves of both.
            let packed = _mm256_packus_epi16(words[0].0, words[1].0);
            Self(_mm256_permute4x64_epi64::<0b11_01_10_00>(packed))
        }
    }

    #[inline(always)]
    unsafe fn high_product(words: U16x16, other: U16x16) -> U16x16 {
        // SAFETY: see above.
        unsafe { U16x16(_mm256_mulhi_epu16(words.0, other.0)) }
    }
}
