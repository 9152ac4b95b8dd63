//! 16 costs at a time.

use std::arch::aarch64::*;

use super::vector::{self, Bytes};
use super::{CostRow, ExcessRow, HorizontalRows, SumRow, VerticalRow, WindowRow};
use crate::kernels::sad::neon::U16x8;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct U8x16(uint8x16_t);

vector::entries!(U8x16, "neon");

// SAFETY of every block below: the caller of a function of `Bytes` proves NEON and, for pointers, what they point at.
impl Bytes for U8x16 {
    const COUNT: usize = 16;
    type Words = U16x8;

    #[inline(always)]
    unsafe fn splat(value: u8) -> Self {
        // SAFETY: see above.
        unsafe { Self(vdupq_n_u8(value)) }
    }

    #[inline(always)]
    unsafe fn load(from: *const u8) -> Self {
        // SAFETY: see above.
        unsafe { Self(vld1q_u8(from)) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut u8) {
        // SAFETY: see above.
        unsafe { vst1q_u8(to, self.0) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vaddq_u8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn saturating_add(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vqaddq_u8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn saturating_sub(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vqsubq_u8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vminq_u8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vmaxq_u8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn or(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vorrq_u8(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn quarter(self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vshrq_n_u8::<2>(self.0)) }
    }

    #[inline(always)]
    unsafe fn hamming(self, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vcntq_u8(veorq_u8(self.0, other.0))) }
    }

    #[inline(always)]
    unsafe fn splat_min(self) -> Self {
        // SAFETY: see above.
        unsafe { Self::splat(vminvq_u8(self.0)) }
    }

    #[inline(always)]
    unsafe fn first(self) -> u8 {
        // SAFETY: see above.
        unsafe { vgetq_lane_u8::<0>(self.0) }
    }

    #[inline(always)]
    unsafe fn lane_before(self, previous: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vextq_u8::<15>(previous.0, self.0)) }
    }

    #[inline(always)]
    unsafe fn lane_after(self, next: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(vextq_u8::<1>(self.0, next.0)) }
    }

    #[inline(always)]
    unsafe fn widen(self) -> [U16x8; 2] {
        // SAFETY: see above.
        unsafe { [U16x8(vmovl_u8(vget_low_u8(self.0))), U16x8(vmovl_high_u8(self.0))] }
    }

    #[inline(always)]
    unsafe fn widen_is_255(self) -> [U16x8; 2] {
        // SAFETY: see above.
        unsafe {
            let is_255 = vreinterpretq_s8_u8(vceqq_u8(self.0, vdupq_n_u8(u8::MAX)));
            let (low, high) = (vmovl_s8(vget_low_s8(is_255)), vmovl_high_s8(is_255));
            [U16x8(vreinterpretq_u16_s16(low)), U16x8(vreinterpretq_u16_s16(high))]
        }
    }

    #[inline(always)]
    unsafe fn narrow(words: [U16x8; 2]) -> Self {
        // SAFETY: see above.
        unsafe { Self(vmovn_high_u16(vmovn_u16(words[0].0), words[1].0)) }
    }

    #[inline(always)]
    unsafe fn high_product(words: U16x8, other: U16x8) -> U16x8 {
        // SAFETY: see above.
        unsafe {
            let low = vmull_u16(vget_low_u16(words.0), vget_low_u16(other.0));
            let high = vmull_high_u16(words.0, other.0);
            // The odd words of both are the upper halves of the products.
            U16x8(vuzp2q_u16(vreinterpretq_u16_u32(low), vreinterpretq_u16_u32(high)))
        }
    }
}
