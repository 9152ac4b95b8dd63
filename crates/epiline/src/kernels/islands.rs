//! Where stretches of linked disparities end.

use super::portable;

/// Finds the columns of a row that do not continue the one before: exactly one of both has a value, or both have and their
/// disparities differ by more than the range.
#[derive(Debug)]
pub struct BreaksRow<'a> {
    /// Disparities.
    pub values: &'a [u16],
    /// A pixel with one of the bits in `except` has no value.
    pub bits: &'a [u8],
    /// See there.
    pub except: u8,
    /// The largest difference of linked disparities.
    pub range: u16,
    /// Out: 1 at breaks, else 0; the first is 0.
    pub breaks: &'a mut [u8],
}

impl BreaksRow<'_> {
    pub(super) fn check(&self) {
        let width = self.values.len();
        assert!(width > 0 && self.bits.len() == width && self.breaks.len() == width, "a row's length");
    }
}

#[inline(always)]
pub(super) fn breaks_row(row: &mut BreaksRow<'_>) {
    let last = row.values.len() - 1;
    let (values, next_values) = (&row.values[..last], &row.values[1..]);
    let (bits, next_bits) = (&row.bits[..last], &row.bits[1..]);
    let (first, breaks) = row.breaks.split_at_mut(1);
    let breaks = &mut breaks[..last];
    first[0] = 0;
    for i in 0..last {
        let (has, next_has) = (bits[i] & row.except == 0, next_bits[i] & row.except == 0);
        breaks[i] = u8::from((has != next_has) | (has & (values[i].abs_diff(next_values[i]) > row.range)));
    }
}

portable!(row, breaks_row, BreaksRow<'_>);
