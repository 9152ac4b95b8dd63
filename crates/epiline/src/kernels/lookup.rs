//! Grey levels replaced through a table.
//!
//! A vector cannot be an index into 256 levels, but its bytes can be indices into sixteen:
//!
//! ```text
//! for every sixteen levels of the table
//!     look up the low four bits of every pixel; keep what belongs to pixels with these high four
//! ```

/// `out[x] = table[levels[x]]`.
#[derive(Debug)]
pub struct LookupRow<'a> {
    /// The new level for each.
    pub table: &'a [u8; 256],
    /// The pixels.
    pub levels: &'a [u8],
    /// Out: as many.
    pub out: &'a mut [u8],
}

impl LookupRow<'_> {
    pub(super) fn check(&self) {
        assert!(self.levels.len() == self.out.len(), "a new level for each");
    }

    fn from(&mut self, x: usize) {
        for (out, &level) in self.out[x..].iter_mut().zip(&self.levels[x..]) {
            *out = self.table[usize::from(level)];
        }
    }
}

/// The plain one.
pub(super) fn lookup_row(row: &mut LookupRow<'_>) {
    row.from(0);
}

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2 {
    use std::arch::x86_64::*;

    use super::LookupRow;

    const LANES: usize = 32;

    /// See [`LookupRow`].
    ///
    /// # Safety
    /// The processor has what the level proves, and `row.check` passed.
    #[target_feature(enable = "avx2")]
    pub unsafe fn lookup_row(row: &mut LookupRow<'_>) {
        let end = row.levels.len() / LANES * LANES;
        // SAFETY: sixteenths of the table, and whole registers of both slices.
        unsafe {
            let mut sixteenths = [_mm256_setzero_si256(); 16];
            for (i, sixteenth) in sixteenths.iter_mut().enumerate() {
                *sixteenth =
                    _mm256_broadcastsi128_si256(_mm_loadu_si128(row.table.as_ptr().add(16 * i).cast()));
            }
            for x in (0..end).step_by(LANES) {
                // Above the sixteenth that is looked up; below it the subtraction goes around.
                let mut above = _mm256_loadu_si256(row.levels.as_ptr().add(x).cast());
                let mut found = _mm256_setzero_si256();
                for sixteenth in sixteenths {
                    // 0x70 to 0x7f inside the sixteenth; else the highest bit is set, which finds zero.
                    let index = _mm256_adds_epu8(above, _mm256_set1_epi8(0x70));
                    found = _mm256_or_si256(found, _mm256_shuffle_epi8(sixteenth, index));
                    above = _mm256_sub_epi8(above, _mm256_set1_epi8(16));
                }
                _mm256_storeu_si256(row.out.as_mut_ptr().add(x).cast(), found);
            }
        }
        row.from(end);
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod avx512 {
    use std::arch::x86_64::*;

    use super::LookupRow;

    const LANES: usize = 64;

    /// See [`LookupRow`].
    ///
    /// # Safety
    /// The processor has what the level proves, and `row.check` passed.
    #[target_feature(enable = "avx512f,avx512bw")]
    pub unsafe fn lookup_row(row: &mut LookupRow<'_>) {
        let end = row.levels.len() / LANES * LANES;
        // SAFETY: sixteenths of the table, and whole registers of both slices.
        unsafe {
            let mut sixteenths = [_mm512_setzero_si512(); 16];
            for (i, sixteenth) in sixteenths.iter_mut().enumerate() {
                *sixteenth = _mm512_broadcast_i32x4(_mm_loadu_si128(row.table.as_ptr().add(16 * i).cast()));
            }
            for x in (0..end).step_by(LANES) {
                // As for AVX2.
                let mut above = _mm512_loadu_si512(row.levels.as_ptr().add(x).cast());
                let mut found = _mm512_setzero_si512();
                for sixteenth in sixteenths {
                    let index = _mm512_adds_epu8(above, _mm512_set1_epi8(0x70));
                    found = _mm512_or_si512(found, _mm512_shuffle_epi8(sixteenth, index));
                    above = _mm512_sub_epi8(above, _mm512_set1_epi8(16));
                }
                _mm512_storeu_si512(row.out.as_mut_ptr().add(x).cast(), found);
            }
        }
        row.from(end);
    }
}
