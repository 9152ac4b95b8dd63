//! Rows to columns.

use std::ops::Range;

/// `columns[x·columns_stride + y] = rows[y·rows_stride + x]` for `width` by `height` values.
#[derive(Debug)]
pub struct Transpose<'a> {
    /// The rows.
    pub rows: &'a [f32],
    /// From one row to the next.
    pub rows_stride: usize,
    /// Out: the columns, each a row.
    pub columns: &'a mut [f32],
    /// From one column to the next.
    pub columns_stride: usize,
    /// Values of a row.
    pub width: usize,
    /// Values of a column.
    pub height: usize,
}

impl Transpose<'_> {
    pub(super) fn check(&self) {
        let needed = |lines: usize, length: usize, stride: usize| {
            assert!(0 < length && length <= stride && lines > 0, "lines beside each other");
            (lines - 1).checked_mul(stride).and_then(|before| before.checked_add(length))
        };
        let in_rows = needed(self.height, self.width, self.rows_stride);
        assert!(in_rows.is_some_and(|cells| cells <= self.rows.len()), "rows inside the slice");
        let in_columns = needed(self.width, self.height, self.columns_stride);
        assert!(in_columns.is_some_and(|cells| cells <= self.columns.len()), "columns inside the slice");
    }

    /// Some columns, from row `top` on.
    fn values(&mut self, columns: Range<usize>, top: usize) {
        for x in columns {
            let column = &mut self.columns[x * self.columns_stride..][..self.height];
            for (y, value) in column.iter_mut().enumerate().skip(top) {
                *value = self.rows[y * self.rows_stride + x];
            }
        }
    }
}

/// The plain one.
pub(super) fn transpose(call: &mut Transpose<'_>) {
    call.values(0..call.width, 0);
}

/// A module with `transpose` by squares that fit the registers.
#[cfg(target_arch = "x86_64")]
macro_rules! by_squares {
    ($level:ident, $features:literal, $side:literal, $square:item) => {
        pub(super) mod $level {
            use std::arch::x86_64::*;

            use super::Transpose;

            /// Values of a register.
            const SIDE: usize = $side;

            /// See [`Transpose`].
            ///
            /// # Safety
            /// The processor has what the level proves, and the call was checked.
            #[target_feature(enable = $features)]
            pub unsafe fn transpose(call: &mut Transpose<'_>) {
                let (right, bottom) = (call.width / SIDE * SIDE, call.height / SIDE * SIDE);
                for left in (0..right).step_by(SIDE) {
                    for top in (0..bottom).step_by(SIDE) {
                        // SAFETY: the square lies inside both, as the call was checked and sides are whole squares.
                        unsafe {
                            let rows = call.rows.as_ptr().add(top * call.rows_stride + left);
                            let columns = call.columns.as_mut_ptr().add(left * call.columns_stride + top);
                            square(rows, call.rows_stride, columns, call.columns_stride);
                        }
                    }
                }
                call.values(right..call.width, 0);
                call.values(0..right, bottom);
            }

            /// # Safety
            /// `SIDE` values from each of `SIDE` starts can be read, and written.
            #[target_feature(enable = $features)]
            #[inline]
            $square
        }
    };
}

#[cfg(target_arch = "x86_64")]
by_squares!(
    avx2,
    "avx2",
    8,
    unsafe fn square(rows: *const f32, rows_stride: usize, columns: *mut f32, columns_stride: usize) {
        for x in [0, 4] {
            let mut quarters = [_mm256_setzero_ps(); 4];
            for (y, quarter) in quarters.iter_mut().enumerate() {
                // Four values of rows y and y + 4 side by side: what is left to do stays within halves.
                // SAFETY: the caller's promise.
                *quarter = unsafe {
                    let (upper, lower) = (rows.add(y * rows_stride + x), rows.add((y + 4) * rows_stride + x));
                    _mm256_insertf128_ps::<1>(
                        _mm256_castps128_ps256(_mm_loadu_ps(upper)),
                        _mm_loadu_ps(lower),
                    )
                };
            }
            let [a, b, c, d] = quarters;
            let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
            let (ab_high, cd_high) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
            let turned = [
                _mm256_shuffle_ps::<0x44>(ab, cd),
                _mm256_shuffle_ps::<0xEE>(ab, cd),
                _mm256_shuffle_ps::<0x44>(ab_high, cd_high),
                _mm256_shuffle_ps::<0xEE>(ab_high, cd_high),
            ];
            for (i, column) in turned.into_iter().enumerate() {
                // SAFETY: the caller's promise.
                unsafe { _mm256_storeu_ps(columns.add((x + i) * columns_stride), column) };
            }
        }
    }
);

#[cfg(target_arch = "x86_64")]
by_squares!(
    avx512,
    "avx512f",
    16,
    unsafe fn square(rows: *const f32, rows_stride: usize, columns: *mut f32, columns_stride: usize) {
        // Four by four within quarters of registers: afterwards `within[4·j + i]` holds column 4·q + i of rows 4·j to 4·j + 3
        // in its quarter q.
        let mut within = [_mm512_setzero_ps(); SIDE];
        for j in 0..4 {
            // SAFETY: the caller's promise.
            let [a, b, c, d] = unsafe {
                let row = rows.add(4 * j * rows_stride);
                [
                    _mm512_loadu_ps(row),
                    _mm512_loadu_ps(row.add(rows_stride)),
                    _mm512_loadu_ps(row.add(2 * rows_stride)),
                    _mm512_loadu_ps(row.add(3 * rows_stride)),
                ]
            };
            let (ab, cd) = (_mm512_unpacklo_ps(a, b), _mm512_unpacklo_ps(c, d));
            let (ab_high, cd_high) = (_mm512_unpackhi_ps(a, b), _mm512_unpackhi_ps(c, d));
            within[4 * j] = _mm512_shuffle_ps::<0x44>(ab, cd);
            within[4 * j + 1] = _mm512_shuffle_ps::<0xEE>(ab, cd);
            within[4 * j + 2] = _mm512_shuffle_ps::<0x44>(ab_high, cd_high);
            within[4 * j + 3] = _mm512_shuffle_ps::<0xEE>(ab_high, cd_high);
        }
        // Then quarters: column 4·q + i is quarter q of each of the four.
        for i in 0..4 {
            let [a, b, c, d] = [within[i], within[4 + i], within[8 + i], within[12 + i]];
            let (even_ab, even_cd) = (_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0x88>(c, d));
            let (odd_ab, odd_cd) = (_mm512_shuffle_f32x4::<0xDD>(a, b), _mm512_shuffle_f32x4::<0xDD>(c, d));
            let turned = [
                _mm512_shuffle_f32x4::<0x88>(even_ab, even_cd),
                _mm512_shuffle_f32x4::<0x88>(odd_ab, odd_cd),
                _mm512_shuffle_f32x4::<0xDD>(even_ab, even_cd),
                _mm512_shuffle_f32x4::<0xDD>(odd_ab, odd_cd),
            ];
            for (q, column) in turned.into_iter().enumerate() {
                // SAFETY: the caller's promise.
                unsafe { _mm512_storeu_ps(columns.add((4 * q + i) * columns_stride), column) };
            }
        }
    }
);
