//! 64 costs at a time.

use std::arch::x86_64::*;

use super::vector::{self, Bytes};
use super::{CostRow, ExcessRow, HorizontalRows, SumRow, VerticalRow, WindowRow};
use crate::kernels::sad::avx512::U16x32;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct U8x64(__m512i);

vector::entries!(U8x64, "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt");

// SAFETY of every block below: the caller of a function of `Bytes` proves the instructions and, for pointers, what they
// point at.
impl Bytes for U8x64 {
    const COUNT: usize = 64;
    type Words = U16x32;

    #[inline(always)]
    unsafe fn splat(value: u8) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_set1_epi8(value.cast_signed())) }
    }

    #[inline(always)]
    unsafe fn load(from: *const u8) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_loadu_si512(from.cast())) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut u8) {
        // SAFETY: see above.
        unsafe {
            _mm512_storeu_si512(to.cast(), self.0);
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_add_epi8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn saturating_add(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_adds_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn saturating_sub(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_subs_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_min_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_max_epu8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn or(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_or_si512(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn quarter(self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_and_si512(_mm512_srli_epi16::<2>(self.0), Self::splat(0x3f).0)) }
    }

    #[inline(always)]
    unsafe fn hamming(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            // Bits set in 0 to 15, looked up for both halves of a byte.
            let set = _mm512_broadcast_i32x4(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
            let low_half = Self::splat(0x0f).0;
            let differing = _mm512_xor_si512(self.0, other.0);
            let low = _mm512_and_si512(differing, low_half);
            let high = _mm512_and_si512(_mm512_srli_epi16::<4>(differing), low_half);
            Self(_mm512_add_epi8(_mm512_shuffle_epi8(set, low), _mm512_shuffle_epi8(set, high)))
        }
    }

    #[inline(always)]
    unsafe fn splat_min(self) -> Self {
        // SAFETY: see above.
        unsafe {
            let u8x32 =
                _mm256_min_epu8(_mm512_castsi512_si256(self.0), _mm512_extracti64x4_epi64::<1>(self.0));
            let u8x16 = _mm_min_epu8(_mm256_castsi256_si128(u8x32), _mm256_extracti128_si256::<1>(u8x32));
            let u16x8 = _mm_min_epu8(u8x16, _mm_srli_epi16::<8>(u8x16));
            Self(_mm512_broadcastb_epi8(_mm_minpos_epu16(u16x8)))
        }
    }

    #[inline(always)]
    unsafe fn first(self) -> u8 {
        // SAFETY: see above.
        unsafe { _mm512_cvtsi512_si32(self.0) as u8 }
    }

    #[inline(always)]
    unsafe fn lane_before(self, previous: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let blocks = _mm512_alignr_epi64::<6>(self.0, previous.0);
            Self(_mm512_alignr_epi8::<15>(self.0, blocks))
        }
    }

    #[inline(always)]
    unsafe fn lane_after(self, next: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let blocks = _mm512_alignr_epi64::<2>(next.0, self.0);
            Self(_mm512_alignr_epi8::<1>(blocks, self.0))
        }
    }

    #[inline(always)]
    unsafe fn widen(self) -> [U16x32; 2] {
        // SAFETY: see above.
        unsafe {
            [
                U16x32(_mm512_cvtepu8_epi16(_mm512_castsi512_si256(self.0))),
                U16x32(_mm512_cvtepu8_epi16(_mm512_extracti64x4_epi64::<1>(self.0))),
            ]
        }
    }

    #[inline(always)]
    unsafe fn widen_is_255(self) -> [U16x32; 2] {
        // SAFETY: see above.
        unsafe {
            let is_255 = _mm512_cmpeq_epi8_mask(self.0, Self::splat(u8::MAX).0);
            [U16x32(_mm512_movm_epi16(is_255 as u32)), U16x32(_mm512_movm_epi16((is_255 >> 32) as u32))]
        }
    }

    #[inline(always)]
    unsafe fn narrow(words: [U16x32; 2]) -> Self {
        // SAFETY: see above.
        unsafe {
            let (low, high) = (_mm512_cvtepi16_epi8(words[0].0), _mm512_cvtepi16_epi8(words[1].0));
            Self(_mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high))
        }
    }

    #[inline(always)]
    unsafe fn high_product(words: U16x32, other: U16x32) -> U16x32 {
        // SAFETY: see above.
        unsafe { U16x32(_mm512_mulhi_epu16(words.0, other.0)) }
    }
}
