//! Sixteen pixels at a time in 256-bit vectors: a half of a group in each 128-bit lane.

use std::arch::x86_64::*;

use super::{GROUP, Group, RemapRow, Table, WINDOW, WINDOW_ROWS, reference};

/// A row.
///
/// # Safety
/// The processor has what `Level::avx2` proves, and the row's `check` has passed.
#[target_feature(enable = "avx2,bmi1,popcnt")]
pub unsafe fn remap_row(row: &mut RemapRow<'_>) {
    let RemapRow { table, y, source, stride, ref mut values } = *row;
    for (group, values) in table.groups_of(y).iter().zip(values.chunks_mut(GROUP)) {
        // SAFETY: as this function's.
        unsafe { remap_group(table, group, source, stride, values) };
    }
}

/// A group, or as much of it as there is room for.
///
/// # Safety
/// The processor has AVX2, and `source` has the size that the table was made for.
#[target_feature(enable = "avx2,bmi1,popcnt")]
pub(super) unsafe fn remap_group(
    table: &Table,
    group: &Group,
    source: &[u8],
    stride: usize,
    values: &mut [u8],
) {
    if group.is_by_taps() {
        reference::remap_group(table, group, source, stride, values);
        return;
    }
    let mut sixteen = [0u8; GROUP];
    let whole = values.len() == GROUP;
    let cells = if whole { &mut *values } else { &mut sixteen };
    // SAFETY: a table's windows lie inside a source of its size; there are sixteen cells.
    unsafe { _mm_storeu_si128(cells.as_mut_ptr().cast(), sixteen_values(group, source, stride)) };
    if !whole {
        values.copy_from_slice(&sixteen[..values.len()]);
    }
}

/// # Safety
/// The processor has AVX2 and both of the group's windows lie inside `source`.
#[target_feature(enable = "avx2,bmi1,popcnt")]
unsafe fn sixteen_values(group: &Group, source: &[u8], stride: usize) -> __m128i {
    let first = group.windows.map(|[x, y]| usize::from(y) * stride + usize::from(x));
    debug_assert!(first.iter().all(|f| f + (WINDOW_ROWS - 1) * stride + WINDOW <= source.len()));
    // SAFETY: the windows lie inside, by the caller's promise; a group's arrays have sixteen cells.
    unsafe {
        let rows: [__m256i; WINDOW_ROWS] = std::array::from_fn(|y| {
            let [low, high] = first.map(|f| _mm_loadu_si128(source.as_ptr().add(f + y * stride).cast()));
            _mm256_set_m128i(high, low)
        });
        let words = |bytes: &[u8; GROUP]| _mm256_cvtepu8_epi16(_mm_loadu_si128(bytes.as_ptr().cast()));
        let (places, right, down) = (words(&group.places), words(&group.right), words(&group.down));

        // Places and weights of two sources each: the second is the next, or the first again where `right` is 0.
        let at_pixel = _mm256_cmpeq_epi16(right, _mm256_setzero_si256());
        let next = _mm256_andnot_si256(at_pixel, _mm256_set1_epi16(0x0100));
        let pairs = _mm256_add_epi16(_mm256_or_si256(places, _mm256_slli_epi16::<8>(places)), next);
        let left = _mm256_sub_epi16(_mm256_set1_epi16(0x0100), right);
        let weights = _mm256_or_si256(left, _mm256_slli_epi16::<8>(right));
        let weights = _mm256_blendv_epi8(weights, _mm256_set1_epi16(0x8080u16 as i16), at_pixel);

        // A shuffle gives 0 where the highest bit is set: places 16 and above, then those below 16, and nowhere.
        let first_row = _mm256_adds_epu8(pairs, _mm256_set1_epi8(0x70));
        let second_row = _mm256_sub_epi8(pairs, _mm256_set1_epi8(0x10));
        let signed = _mm256_set1_epi8(i8::MIN);
        let pick = |a, b| {
            let picked =
                _mm256_or_si256(_mm256_shuffle_epi8(a, first_row), _mm256_shuffle_epi8(b, second_row));
            _mm256_maddubs_epi16(weights, _mm256_xor_si256(picked, signed))
        };
        let (upper, lower) = (pick(rows[0], rows[1]), pick(rows[1], rows[2]));

        // What 128 less on every level has taken away, and a half to round.
        let back = _mm256_set1_epi32((128 << 16) + (1 << 15));
        let up = _mm256_sub_epi16(_mm256_set1_epi16(0x0100), down);
        let combine = |levels, weights| {
            _mm256_srli_epi32::<16>(_mm256_add_epi32(_mm256_madd_epi16(levels, weights), back))
        };
        let low = combine(_mm256_unpacklo_epi16(upper, lower), _mm256_unpacklo_epi16(up, down));
        let high = combine(_mm256_unpackhi_epi16(upper, lower), _mm256_unpackhi_epi16(up, down));
        let words = _mm256_packus_epi32(low, high);
        _mm_packus_epi16(_mm256_castsi256_si128(words), _mm256_extracti128_si256::<1>(words))
    }
}
