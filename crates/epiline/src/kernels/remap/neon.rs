//! Eight pixels at a time: half a group.

use std::arch::aarch64::*;

use super::{GROUP, HALF, RemapRow, WINDOW, WINDOW_ROWS, reference};

/// A row.
///
/// # Safety
/// The processor has what `Level::neon` proves, and the row's `check` has passed.
#[target_feature(enable = "neon")]
pub unsafe fn remap_row(row: &mut RemapRow<'_>) {
    let RemapRow { table, y, source, stride, ref mut values } = *row;
    for (group, values) in table.groups_of(y).iter().zip(values.chunks_mut(GROUP)) {
        if group.is_by_taps() {
            reference::remap_group(table, group, source, stride, values);
            continue;
        }
        for (half, values) in values.chunks_mut(HALF).enumerate() {
            let [x, y] = group.windows[half].map(usize::from);
            let window = &source[y * stride + x..][..(WINDOW_ROWS - 1) * stride + WINDOW];
            let [places, right, down] =
                [&group.places, &group.right, &group.down].map(|cells| &cells[half * HALF..][..HALF]);
            let mut eight = [0u8; HALF];
            // SAFETY: the window was sliced to three rows of sixteen columns; each of the others has eight cells.
            unsafe {
                let rows: [uint8x16_t; WINDOW_ROWS] =
                    std::array::from_fn(|y| vld1q_u8(window.as_ptr().add(y * stride)));
                let [places, right, down] = [places, right, down].map(|cells| vld1_u8(cells.as_ptr()));
                // The second source is the next one, or the first again where `right` is 0; a place beyond both rows
                // gives 0.
                let next = vsub_u8(places, vtst_u8(right, right));
                let across = |a, b| {
                    let rows = uint8x16x2_t(a, b);
                    let (first, second) = (vqtbl2_u8(rows, places), vqtbl2_u8(rows, next));
                    // 256·first + right·(second - first), modulo 2¹⁶ on the way.
                    vmlsl_u8(vmlal_u8(vshll_n_u8::<8>(first), second, right), first, right)
                };
                let (upper, lower) = (across(rows[0], rows[1]), across(rows[1], rows[2]));
                let down = vmovl_u8(down);
                let along = |upper, lower, down| {
                    vrshrn_n_u32::<16>(vmlsl_u16(
                        vmlal_u16(vshll_n_u16::<8>(upper), lower, down),
                        upper,
                        down,
                    ))
                };
                let low = along(vget_low_u16(upper), vget_low_u16(lower), vget_low_u16(down));
                let high = along(vget_high_u16(upper), vget_high_u16(lower), vget_high_u16(down));
                vst1_u8(eight.as_mut_ptr(), vmovn_u16(vcombine_u16(low, high)));
            }
            values.copy_from_slice(&eight[..values.len()]);
        }
    }
}
