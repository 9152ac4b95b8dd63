//! The x-Sobel prefilter, one row.

use super::portable;

/// Three rows of an image and the filtered middle one.
#[derive(Debug)]
pub struct XSobelRow<'a> {
    /// The row above; below the first row, where there is none.
    pub above: &'a [u8],
    /// The row to filter.
    pub middle: &'a [u8],
    /// The row below; above the last row, where there is none.
    pub below: &'a [u8],
    /// Derivatives are clipped to plus or minus this, 1 to 127.
    pub cap: u8,
    /// Out: clipped derivative plus `cap`.
    pub filtered: &'a mut [u8],
}

impl XSobelRow<'_> {
    pub(super) fn check(&self) {
        let width = self.filtered.len();
        assert!(width > 0 && self.cap < 128, "an empty row, or a cap beyond a byte");
        assert!([self.above, self.middle, self.below].iter().all(|row| row.len() == width), "a row's length");
    }
}

#[inline(always)]
pub(super) fn xsobel_row(row: &mut XSobelRow<'_>) {
    let cap = i16::from(row.cap);
    let width = row.filtered.len();
    // Mirrored at the first and last column, the derivative is zero there.
    row.filtered[0] = row.cap;
    row.filtered[width - 1] = row.cap;
    if width < 3 {
        return;
    }
    let inner = &mut row.filtered[1..width - 1];
    let n = inner.len();
    let (above, middle, below) = (&row.above[..n + 2], &row.middle[..n + 2], &row.below[..n + 2]);
    for x in 0..n {
        let before = i16::from(above[x]) + 2 * i16::from(middle[x]) + i16::from(below[x]);
        let after = i16::from(above[x + 2]) + 2 * i16::from(middle[x + 2]) + i16::from(below[x + 2]);
        let derivative = after - before;
        inner[x] = (derivative.clamp(-cap, cap) + cap) as u8;
    }
}

portable!(row, xsobel_row, XSobelRow<'_>);
