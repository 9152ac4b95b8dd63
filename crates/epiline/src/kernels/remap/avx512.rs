//! Thirty-two pixels at a time in 512-bit vectors: half a group in each 128-bit lane.

use std::arch::x86_64::*;

use super::{GROUP, Group, RemapRow, WINDOW, WINDOW_ROWS, avx2};

/// A row.
///
/// # Safety
/// The processor has what `Level::avx512` proves, and the row's `check` has passed.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt")]
pub unsafe fn remap_row(row: &mut RemapRow<'_>) {
    let RemapRow { table, y, source, stride, ref mut values } = *row;
    for (groups, values) in table.groups_of(y).chunks(2).zip(values.chunks_mut(2 * GROUP)) {
        match (groups, values.first_chunk_mut::<{ 2 * GROUP }>()) {
            ([a, b], Some(values)) if !a.is_by_taps() && !b.is_by_taps() => {
                // SAFETY: a table's windows lie inside the source, which the row's check found as large as the table
                // says; there are 32 values.
                unsafe {
                    _mm256_storeu_si256(values.as_mut_ptr().cast(), remap_groups([a, b], source, stride));
                }
            }
            _ => {
                for (group, values) in groups.iter().zip(values.chunks_mut(GROUP)) {
                    // SAFETY: the level has AVX2 too, and the row was checked.
                    unsafe { avx2::remap_group(table, group, source, stride, values) };
                }
            }
        }
    }
}

/// # Safety
/// The processor has AVX-512 and all windows lie inside `source`.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt")]
unsafe fn remap_groups([a, b]: [&Group; 2], source: &[u8], stride: usize) -> __m256i {
    let first = [a.windows[0], a.windows[1], b.windows[0], b.windows[1]]
        .map(|[x, y]| usize::from(y) * stride + usize::from(x));
    debug_assert!(first.iter().all(|f| f + (WINDOW_ROWS - 1) * stride + WINDOW <= source.len()));
    // SAFETY: the windows lie inside, by the caller's promise; a group's arrays have sixteen cells.
    unsafe {
        let rows: [__m512i; WINDOW_ROWS] = std::array::from_fn(|y| {
            let [p, q, r, s] = first.map(|f| _mm_loadu_si128(source.as_ptr().add(f + y * stride).cast()));
            let low = _mm256_set_m128i(q, p);
            _mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), _mm256_set_m128i(s, r))
        });
        let words = |low: &[u8; GROUP], high: &[u8; GROUP]| {
            let [low, high] = [low, high].map(|bytes| _mm_loadu_si128(bytes.as_ptr().cast()));
            _mm512_cvtepu8_epi16(_mm256_set_m128i(high, low))
        };
        let (places, right) = (words(&a.places, &b.places), words(&a.right, &b.right));
        let down = words(&a.down, &b.down);

        // Places and weights of two sources each: the second is the next, or the first again where `right` is 0.
        let between = _mm512_test_epi16_mask(right, right);
        let pairs = _mm512_or_si512(places, _mm512_slli_epi16::<8>(places));
        let pairs = _mm512_mask_add_epi16(pairs, between, pairs, _mm512_set1_epi16(0x0100));
        let left = _mm512_sub_epi16(_mm512_set1_epi16(0x0100), right);
        let at_pixel = _mm512_set1_epi16(0x8080u16 as i16);
        let weights = _mm512_or_si512(left, _mm512_slli_epi16::<8>(right));
        let weights = _mm512_mask_blend_epi16(between, at_pixel, weights);

        // A shuffle gives 0 where the highest bit is set: places 16 and above, then those below 16, and nowhere.
        let first_row = _mm512_adds_epu8(pairs, _mm512_set1_epi8(0x70));
        let second_row = _mm512_sub_epi8(pairs, _mm512_set1_epi8(0x10));
        let signed = _mm512_set1_epi8(i8::MIN);
        let pick = |a, b| {
            let picked =
                _mm512_or_si512(_mm512_shuffle_epi8(a, first_row), _mm512_shuffle_epi8(b, second_row));
            _mm512_maddubs_epi16(weights, _mm512_xor_si512(picked, signed))
        };
        let (upper, lower) = (pick(rows[0], rows[1]), pick(rows[1], rows[2]));

        // What 128 less on every level has taken away, and a half to round.
        let back = _mm512_set1_epi32((128 << 16) + (1 << 15));
        let up = _mm512_sub_epi16(_mm512_set1_epi16(0x0100), down);
        let combine = |levels, weights| {
            _mm512_srli_epi32::<16>(_mm512_add_epi32(_mm512_madd_epi16(levels, weights), back))
        };
        let low = combine(_mm512_unpacklo_epi16(upper, lower), _mm512_unpacklo_epi16(up, down));
        let high = combine(_mm512_unpackhi_epi16(upper, lower), _mm512_unpackhi_epi16(up, down));
        _mm512_cvtepi16_epi8(_mm512_packus_epi32(low, high))
    }
}
