//! Window sums of pixel costs that eq. 5 does not have, and the best of several windows; one image row at a time.
//!
//! # Definitions
//!
//! The cost `p` of a left and a right pixel is a [`PixelCost`], truncated at [`largest_pixel_cost`]. The *box sum*
//! `B(x, y, d) = Σ_{i, j = -r..r} p(x', y', d)` has the window of [`sad`](super::sad), clamped to the left image, and is
//! the cost of a candidate; or the window is one of five, the one around the pixel and the best two of the four around
//! the corners of that (Hirschmüller, Innocent and Garibaldi, IJCV 2002, with their configuration of five windows):
//!
//! `C(x, y, d) = B(x, y, d) + the two smallest of B(clamp(x ± r), clamp(y ± r), d)`
//!
//! so that near the edge of an object windows that lie across it do not count.
//!
//! # Layout
//!
//! As in [`sad`](super::sad): the costs of one pixel lie side by side, **largest disparity first**; right rows are padded
//! so that the right pixel of column `c`, lane `k` is `right[c + k]`.
//!
//! # Bounds
//!
//! Costs are 16 bits wide, of which [`Cost::BLOCKED`](super::sad::Cost::BLOCKED) is none that a candidate has: a cost sums at
//! most `n²` pixels of one window or `3 n²` of three, and [`largest_pixel_cost`] is the largest `T` with
//! `T · 3 n² <= 65 534`. The census, 24 at most, is not truncated by one window of any side up to 31: `24·31² = 23 064`.
//! Other pixel costs are so where windows are large: sums of Birchfield and Tomasi's differences of x-Sobel up to 62 and
//! grey values (`62 + 63 = 125`) from 23 on, three of x-Sobel alone from 19 on. Column sums are at most `255·31`.

pub mod reference;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) mod vector;

use super::sad::{Choice, Cost};
use super::semi_global::features::PixelRow;

/// What two pixels are compared by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelCost {
    /// `|f_L - f_R|` of the filtered image.
    Absolute,
    /// Hamming distance of the census.
    Census,
    /// `BT(f_L, f_R) + BT(I_L, I_R) / 4` with Birchfield and Tomasi's difference, on the filtered and the grey image.
    SamplingInsensitive,
}

/// Pixel costs are truncated at this, so that the sums over `windows` windows fit 16 bits.
pub fn largest_pixel_cost(windows: usize, block_size: usize) -> u8 {
    let pixels = windows * block_size * block_size;
    (usize::from(u16::BLOCKED - 1) / pixels).min(u8::MAX.into()) as u8
}

/// Lets a row of pixel costs enter the windows and another leave them.
#[derive(Debug)]
pub struct PixelCostRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// How pixels are compared.
    pub cost: PixelCost,
    /// What costs are truncated at.
    pub largest: u8,
    /// What is compared, `width` pixels. For differences of grey values only, they stand in for the filtered ones and the
    /// grey ones are zero.
    pub left: PixelRow<'a>,
    /// The same of the right image, `width + lanes - 1` pixels.
    pub right: PixelRow<'a>,
    /// In: pixel costs of the row that leaves. Out: of the row that enters. `width * lanes`.
    pub pixel_costs: &'a mut [u8],
    /// Per column and lane: the sum of the pixel costs of the window's rows. `width * lanes`.
    pub column_sums: &'a mut [u16],
}

impl PixelCostRow<'_> {
    pub(super) fn check(&self) {
        let width = self.left.check();
        assert!(width > 0 && self.lanes > 0, "an empty row");
        assert!(self.right.check() == width + self.lanes - 1, "right");
        assert!(self.pixel_costs.len() == width * self.lanes, "pixel_costs");
        assert!(self.column_sums.len() == width * self.lanes, "column_sums");
    }
}

/// Box sums from column sums.
#[derive(Debug)]
pub struct BoxRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// Half the window.
    pub radius: usize,
    /// `width * lanes`.
    pub column_sums: &'a [u16],
    /// Out: `width * lanes`.
    pub boxes: &'a mut [u16],
}

impl BoxRow<'_> {
    pub(super) fn check(&self) {
        assert!(self.lanes > 0 && !self.boxes.is_empty(), "an empty row");
        assert!(self.boxes.len().is_multiple_of(self.lanes), "boxes");
        assert!(self.column_sums.len() == self.boxes.len(), "column_sums");
    }
}

/// The window around each pixel and the best two of the four around its corners.
#[derive(Debug)]
pub struct BestWindowsRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// How far the corners are from the pixel, columns.
    pub radius: usize,
    /// Box sums of the row of the upper corners, `width * lanes` each.
    pub above: &'a [u16],
    /// Of the row.
    pub middle: &'a [u16],
    /// Of the row of the lower corners.
    pub below: &'a [u16],
    /// Out: costs.
    pub costs: &'a mut [u16],
}

impl BestWindowsRow<'_> {
    pub(super) fn check(&self) {
        assert!(self.lanes > 0 && !self.costs.is_empty(), "an empty row");
        assert!(self.costs.len().is_multiple_of(self.lanes), "costs");
        let boxes = [self.above, self.middle, self.below];
        assert!(boxes.iter().all(|boxes| boxes.len() == self.costs.len()), "boxes");
    }
}

/// The best candidates of a row, and what the tests need to know about them.
#[derive(Debug)]
pub struct BestRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// The leftmost so many columns have blocked candidates; what follows is read for those.
    pub blocked_columns: usize,
    /// Per left column: 0, or 255 if it has no source.
    pub blocked_left: &'a [u8],
    /// Per padded right column: 0, or 255 if outside or without source.
    pub blocked_right: &'a [u8],
    /// Per lane: 0, or 255 where it is not a disparity asked for.
    pub blocked_lanes: &'a [u8],
    /// Percent above the best cost within which candidates are counted; 0 counts none.
    pub uniqueness_ratio: u32,
    /// For the left–right test: how far around the best lane `nearby` looks.
    pub left_right_reach: Option<usize>,
    /// In: costs. Out: [`Cost::BLOCKED`] where there is no candidate. `width * lanes`.
    pub costs: &'a mut [u16],
    /// Out, per column, as in [`SadRow::chosen`](super::sad::SadRow::chosen).
    pub chosen: &'a mut [Choice<u16>],
    /// Out, per column, as in [`SadRow::rivals`](super::sad::SadRow::rivals).
    pub rivals: &'a mut [u16],
    /// Out, per column, as in [`SadRow::nearby`](super::sad::SadRow::nearby).
    pub nearby: &'a mut [u16],
    /// Out, per padded right column, as in [`SadRow::right_best`](super::sad::SadRow::right_best).
    pub right_best: &'a mut [u16],
}

impl BestRow<'_> {
    pub(super) fn check(&self) {
        let width = self.chosen.len();
        assert!(width > 0 && self.lanes > 0, "an empty row");
        assert!(self.blocked_left.len() == width && self.blocked_columns <= width, "blocked_left");
        assert!(self.blocked_right.len() == width + self.lanes - 1, "blocked_right");
        assert!(self.blocked_lanes.len() == self.lanes, "blocked_lanes");
        assert!(self.costs.len() == width * self.lanes, "costs");
        assert!(self.rivals.len() == width, "rivals");
        if self.left_right_reach.is_some() {
            let padded = width + self.lanes - 1;
            assert!(self.nearby.len() == width && self.right_best.len() == padded, "left-right");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_pixel_cost_is_the_largest_whose_sums_fit() {
        for (windows, block_size) in [1, 3].into_iter().flat_map(|n| (1..=31).map(move |side| (n, side))) {
            let pixels = windows * block_size * block_size;
            let largest = usize::from(largest_pixel_cost(windows, block_size));
            assert!(largest > 0 && largest * pixels < usize::from(u16::BLOCKED), "{windows} {block_size}");
            let fits_one_more = (largest + 1) * pixels < usize::from(u16::BLOCKED);
            assert!(largest == 255 || !fits_one_more, "{windows} {block_size}");
        }
    }

    #[test]
    fn pixel_costs_are_truncated_only_where_stated() {
        assert!(largest_pixel_cost(1, 31) >= 24, "the census");
        assert!(largest_pixel_cost(1, 21) >= 125 && largest_pixel_cost(1, 23) < 125, "Birchfield and Tomasi");
        assert!(largest_pixel_cost(3, 17) >= 62 && largest_pixel_cost(3, 19) < 62, "five windows");
    }
}
