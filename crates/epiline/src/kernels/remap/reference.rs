//! One pixel at a time.

use super::{FRACTION_BITS, GROUP, Group, ONE, RemapRow, Table, Tap};

/// A row.
pub fn remap_row(row: &mut RemapRow<'_>) {
    let groups = row.table.groups_of(row.y);
    for (group, values) in groups.iter().zip(row.values.chunks_mut(GROUP)) {
        remap_group(row.table, group, row.source, row.stride, values);
    }
}

/// A group, or as much of it as there is room for.
pub(super) fn remap_group(table: &Table, group: &Group, source: &[u8], stride: usize, values: &mut [u8]) {
    for (member, value) in values.iter_mut().enumerate() {
        *value = table.tap(group, member).map_or(0, |tap| bilinear(&tap, source, stride));
    }
}

/// `a1·I1 + a2·I2 + a3·I3 + a4·I4`, rounded: upper left, upper right, lower left, lower right.
#[inline]
fn bilinear(tap: &Tap, source: &[u8], stride: usize) -> u8 {
    let (right, down) = (u32::from(tap.right), u32::from(tap.down));
    let (left, up) = (u32::from(ONE) - right, u32::from(ONE) - down);
    let first = usize::from(tap.y) * stride + usize::from(tap.x);
    // A neighbour without weight need not exist: the first, which does, stands for it.
    let (across, along) = (usize::from(right > 0), if down > 0 { stride } else { 0 });
    let [i1, i2, i3, i4] = [0, across, along, along + across].map(|offset| u32::from(source[first + offset]));
    let sum = (i1 * left + i2 * right) * up + (i3 * left + i4 * right) * down;
    ((sum + (1 << (2 * FRACTION_BITS - 1))) >> (2 * FRACTION_BITS)) as u8
}
