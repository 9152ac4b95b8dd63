//! Colour to grey, one row.
//!
//! ```text
//! spread   four pixels over each quarter of a register, twice: blue and green, red and nothing, 16 bits each
//! sum      products of neighbours, which are 32 bits wide: B·blue + G·green, R·red
//! round    and shift
//! ```

// BT.601 weights in 1/32768, as OpenCV rounds them; they add up to one, so that white stays white.
const SHIFT: u32 = 15;
const BLUE: u32 = 3_735;
const GREEN: u32 = 19_235;
const RED: u32 = 9_798;

/// `grey = 0.299 R + 0.587 G + 0.114 B`, rounded to nearest.
#[derive(Debug)]
pub struct GreyRow<'a> {
    /// Blue, green, red of each pixel.
    pub bgr: &'a [[u8; 3]],
    /// Out: as many.
    pub grey: &'a mut [u8],
}

impl GreyRow<'_> {
    pub(super) fn check(&self) {
        assert!(self.bgr.len() == self.grey.len(), "a grey level for each pixel");
    }
}

fn grey_of([blue, green, red]: [u8; 3]) -> u8 {
    let sum = BLUE * u32::from(blue) + GREEN * u32::from(green) + RED * u32::from(red);
    ((sum + (1 << (SHIFT - 1))) >> SHIFT) as u8
}

/// The plain one, from pixel `x` on.
fn plain(row: &mut GreyRow<'_>, x: usize) {
    for (grey, &pixel) in row.grey[x..].iter_mut().zip(&row.bgr[x..]) {
        *grey = grey_of(pixel);
    }
}

/// The plain one.
pub(super) fn grey_row(row: &mut GreyRow<'_>) {
    plain(row, 0);
}

/// Bytes of four pixels as blue and green of 16 bits each; the highest bit makes a zero.
#[cfg(target_arch = "x86_64")]
const BLUE_GREEN: [i8; 16] = [0, -1, 1, -1, 3, -1, 4, -1, 6, -1, 7, -1, 9, -1, 10, -1];
/// Likewise as red and nothing.
#[cfg(target_arch = "x86_64")]
const RED_NONE: [i8; 16] = [2, -1, -1, -1, 5, -1, -1, -1, 8, -1, -1, -1, 11, -1, -1, -1];

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2 {
    use std::arch::x86_64::*;

    use super::{BLUE, BLUE_GREEN, GREEN, GreyRow, RED, RED_NONE, SHIFT, plain};

    /// Pixels of a register.
    const PIXELS: usize = 8;
    /// Pixels that the 32 bytes of a register reach into.
    const REACH: usize = 32_usize.div_ceil(3);

    /// See [`GreyRow`].
    ///
    /// # Safety
    /// The processor has what the level proves, and `row.check` passed.
    #[target_feature(enable = "avx2")]
    pub unsafe fn grey_row(row: &mut GreyRow<'_>) {
        let mut x = 0;
        // SAFETY: at least `REACH` pixels are left to read, and `PIXELS` to write.
        unsafe {
            let both =
                |quarter: [i8; 16]| _mm256_broadcastsi128_si256(_mm_loadu_si128(quarter.as_ptr().cast()));
            let (blue_green, red_none) = (both(BLUE_GREEN), both(RED_NONE));
            let weights = _mm256_set1_epi32((GREEN << 16 | BLUE) as i32);
            let red_weight = _mm256_set1_epi32(RED as i32);
            let half = _mm256_set1_epi32(1 << (SHIFT - 1));
            // Twelve bytes, four pixels, for each half.
            let spread = _mm256_setr_epi32(0, 1, 2, 3, 3, 4, 5, 6);
            while row.bgr.len() - x >= REACH {
                let bytes = _mm256_loadu_si256(row.bgr.as_ptr().add(x).cast());
                let quarters = _mm256_permutevar8x32_epi32(bytes, spread);
                let sum = _mm256_add_epi32(
                    _mm256_madd_epi16(_mm256_shuffle_epi8(quarters, blue_green), weights),
                    _mm256_madd_epi16(_mm256_shuffle_epi8(quarters, red_none), red_weight),
                );
                let level = _mm256_srli_epi32::<{ SHIFT as i32 }>(_mm256_add_epi32(sum, half));
                let (first, second) = (_mm256_castsi256_si128(level), _mm256_extracti128_si256::<1>(level));
                let words = _mm_packus_epi32(first, second);
                _mm_storel_epi64(row.grey.as_mut_ptr().add(x).cast(), _mm_packus_epi16(words, words));
                x += PIXELS;
            }
        }
        plain(row, x);
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod avx512 {
    use std::arch::x86_64::*;

    use super::{BLUE, BLUE_GREEN, GREEN, GreyRow, RED, RED_NONE, SHIFT, plain};

    /// Pixels of a register.
    const PIXELS: usize = 16;
    /// Pixels that the 64 bytes of a register reach into.
    const REACH: usize = 64_usize.div_ceil(3);

    /// See [`GreyRow`].
    ///
    /// # Safety
    /// The processor has what the level proves, and `row.check` passed.
    #[target_feature(enable = "avx512f,avx512bw")]
    pub unsafe fn grey_row(row: &mut GreyRow<'_>) {
        let mut x = 0;
        // SAFETY: at least `REACH` pixels are left to read, and `PIXELS` to write.
        unsafe {
            let all = |quarter: [i8; 16]| _mm512_broadcast_i32x4(_mm_loadu_si128(quarter.as_ptr().cast()));
            let (blue_green, red_none) = (all(BLUE_GREEN), all(RED_NONE));
            let weights = _mm512_set1_epi32((GREEN << 16 | BLUE) as i32);
            let red_weight = _mm512_set1_epi32(RED as i32);
            let half = _mm512_set1_epi32(1 << (SHIFT - 1));
            // Twelve bytes, four pixels, for each quarter.
            let spread = _mm512_setr_epi32(0, 1, 2, 3, 3, 4, 5, 6, 6, 7, 8, 9, 9, 10, 11, 12);
            while row.bgr.len() - x >= REACH {
                let bytes = _mm512_loadu_si512(row.bgr.as_ptr().add(x).cast());
                let quarters = _mm512_permutexvar_epi32(spread, bytes);
                let sum = _mm512_add_epi32(
                    _mm512_madd_epi16(_mm512_shuffle_epi8(quarters, blue_green), weights),
                    _mm512_madd_epi16(_mm512_shuffle_epi8(quarters, red_none), red_weight),
                );
                let level = _mm512_srli_epi32::<{ SHIFT }>(_mm512_add_epi32(sum, half));
                _mm_storeu_si128(row.grey.as_mut_ptr().add(x).cast(), _mm512_cvtepi32_epi8(level));
                x += PIXELS;
            }
        }
        plain(row, x);
    }
}
