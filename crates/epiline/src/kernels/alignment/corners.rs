//! Corners after Shi & Tomasi, "Good features to track", 1994, a row at a time, and the image at half size.

use crate::kernels::portable;

/// Half side of the window over which gradients are gathered, pixels.
pub const RADIUS: usize = 3;
/// Side of that window.
pub const WINDOW: usize = 2 * RADIUS + 1;

/// Two rows of an image, and one at half the size.
#[derive(Debug)]
pub struct HalveRow<'a> {
    /// `2 · halved.len()` pixels,
    pub upper: &'a [u8],
    /// and those below.
    pub lower: &'a [u8],
    /// Out: means of four, rounded, halves upward.
    pub halved: &'a mut [u8],
}

impl HalveRow<'_> {
    pub(in crate::kernels) fn check(&self) {
        let full = 2 * self.halved.len();
        assert!(self.upper.len() == full && self.lower.len() == full, "a row's length");
    }
}

#[inline(always)]
pub(in crate::kernels) fn halve_row(row: &mut HalveRow<'_>) {
    let (upper, lower) = (row.upper.as_chunks::<2>().0, row.lower.as_chunks::<2>().0);
    for ((halved, a), b) in row.halved.iter_mut().zip(upper).zip(lower) {
        let sum = u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]);
        *halved = ((sum + 2) >> 2) as u8;
    }
}

/// Products of one row's gradients, and the sums of the last [`WINDOW`] rows of them.
///
/// In the order `gx²`, `gx·gy`, `gy²`, with central differences `g` over two pixels. All sums stay below 2²⁴, so single
/// precision holds them exactly.
#[derive(Debug)]
pub struct GradientRow<'a> {
    /// The row above the one whose gradients enter,
    pub above: &'a [u8],
    /// that one,
    pub here: &'a [u8],
    /// and the row below.
    pub below: &'a [u8],
    /// In: the products of the row that leaves. Out: those of the row that enters; 0 in the first and last column.
    pub products: [&'a mut [f32]; 3],
    /// In and out: sums down every column.
    pub columns: [&'a mut [f32]; 3],
}

impl GradientRow<'_> {
    pub(in crate::kernels) fn check(&self) {
        let width = self.here.len();
        assert!(width > 1 && self.above.len() == width && self.below.len() == width, "a row's length");
        let planes = self.products.iter().chain(&self.columns);
        assert!(planes.into_iter().all(|plane| plane.len() == width), "a plane's length");
    }
}

#[inline(always)]
pub(in crate::kernels) fn gradient_row(row: &mut GradientRow<'_>) {
    let inner = row.here.len() - 2;
    let (west, east) = (&row.here[..inner], &row.here[2..][..inner]);
    let (north, south) = (&row.above[1..][..inner], &row.below[1..][..inner]);
    let [xx, xy, yy] = row.products.each_mut().map(|plane| &mut plane[1..][..inner]);
    let [sum_xx, sum_xy, sum_yy] = row.columns.each_mut().map(|plane| &mut plane[1..][..inner]);
    for i in 0..inner {
        let gx = f32::from(i16::from(east[i]) - i16::from(west[i]));
        let gy = f32::from(i16::from(south[i]) - i16::from(north[i]));
        let (new_xx, new_xy, new_yy) = (gx * gx, gx * gy, gy * gy);
        sum_xx[i] += new_xx - xx[i];
        sum_xy[i] += new_xy - xy[i];
        sum_yy[i] += new_yy - yy[i];
        (xx[i], xy[i], yy[i]) = (new_xx, new_xy, new_yy);
    }
}

/// Column sums of gradient products, and the smaller eigenvalue of `Σ ∇I ∇Iᵀ` over the window around each pixel.
#[derive(Debug)]
pub struct StrengthRow<'a> {
    /// As in [`GradientRow`].
    pub columns: [&'a [f32]; 3],
    /// Out; the [`RADIUS`] first and last are left alone.
    pub strength: &'a mut [f32],
}

impl StrengthRow<'_> {
    pub(in crate::kernels) fn check(&self) {
        let width = self.strength.len();
        assert!(self.columns.iter().all(|plane| plane.len() == width), "a plane's length");
    }
}

#[inline(always)]
pub(in crate::kernels) fn strength_row(row: &mut StrengthRow<'_>) {
    let Some(inner) = row.strength.len().checked_sub(2 * RADIUS) else { return };
    // Equal lengths known beforehand: whole vectors at a time.
    let [xx, xy, yy] = [0, 1, 2].map(|plane| windows(row.columns[plane], inner));
    let strength = &mut row.strength[RADIUS..][..inner];
    for (i, strength) in strength.iter_mut().enumerate() {
        let (xx, xy, yy) = (sum_at(&xx, i), sum_at(&xy, i), sum_at(&yy, i));
        let half_difference = 0.5 * (xx - yy);
        *strength = 0.5 * (xx + yy) - (half_difference * half_difference + xy * xy).sqrt();
    }
}

/// A plane's elements from each place in the first window on.
#[inline(always)]
fn windows(plane: &[f32], inner: usize) -> [&[f32]; WINDOW] {
    std::array::from_fn(|k| &plane[k..][..inner])
}

#[inline(always)]
fn sum_at(c: &[&[f32]; WINDOW], i: usize) -> f32 {
    ((c[0][i] + c[1][i]) + (c[2][i] + c[3][i])) + ((c[4][i] + c[5][i]) + c[6][i])
}

/// Three rows of strengths, and where the middle one has a local maximum.
#[derive(Debug)]
pub struct MaximaRow<'a> {
    /// The row above,
    pub above: &'a [f32],
    /// the one asked about,
    pub here: &'a [f32],
    /// the row below.
    pub below: &'a [f32],
    /// A maximum is stronger than this,
    pub least: f32,
    /// Out: not 0 where no neighbour is stronger; of two equal ones the earlier counts. 0 in the first and last column.
    pub marks: &'a mut [u8],
}

impl MaximaRow<'_> {
    pub(in crate::kernels) fn check(&self) {
        let width = self.marks.len();
        assert!(width > 1, "an empty row");
        assert!([self.above, self.here, self.below].iter().all(|row| row.len() == width), "a row's length");
    }
}

#[inline(always)]
pub(in crate::kernels) fn maxima_row(row: &mut MaximaRow<'_>) {
    let inner = row.marks.len() - 2;
    let [north_west, north, north_east] = shifted(row.above, inner);
    let [west, center, east] = shifted(row.here, inner);
    let [south_west, south, south_east] = shifted(row.below, inner);
    (row.marks[0], row.marks[inner + 1]) = (0, 0);
    let marks = &mut row.marks[1..][..inner];
    for i in 0..inner {
        let before = larger(larger(north_west[i], north[i]), larger(north_east[i], west[i]));
        let after = larger(larger(east[i], south_west[i]), larger(south[i], south_east[i]));
        // No short circuit: whole vectors at a time beat a branch that textured pictures make unpredictable.
        marks[i] = u8::from((center[i] > larger(before, row.least)) & (center[i] >= after));
    }
}

/// A row's elements from the first, second and third on.
#[inline(always)]
fn shifted(row: &[f32], inner: usize) -> [&[f32]; 3] {
    [0, 1, 2].map(|x| &row[x..][..inner])
}

/// Of numbers: one instruction, where `f32::max` minds NaN.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

portable!(halve, halve_row, HalveRow<'_>);
portable!(gradient, gradient_row, GradientRow<'_>);
portable!(strength, strength_row, StrengthRow<'_>);
portable!(maxima, maxima_row, MaximaRow<'_>);
