//! Semi-global matching (Hirschmüller, PAMI 2008), one image row at a time.
//!
//! # Definitions
//!
//! The *pixel cost* of a left and a right pixel is
//!
//! `p = BT(f_L, f_R) + BT(I_L, I_R) / 4 + |census_L ⊕ census_R|`
//!
//! with the sampling-insensitive difference `BT` of Birchfield and Tomasi (PAMI 1998) on the prefiltered and on the
//! grey image and the Hamming distance of their 5x5 census. The *matching cost* `C(x, y, d)` is the mean of `p` over a
//! window, rounded down and truncated at [`LARGEST_COST`]; windows are clamped as in [`sad`](super::sad). A pair that is
//! not a candidate (outside the right image, without source, not a disparity asked for) costs [`NO_CANDIDATE`].
//!
//! Along each path r that ends in a pixel p (Hirschmüller's eq. 13)
//!
//! `L_r(p, d) = C(p, d) + min(L_r(p-r, d), L_r(p-r, d±1) + P1, min_k L_r(p-r, k) + P2(p)) - min_k L_r(p-r, k)`
//!
//! and the disparity minimises `S = Σ_r L_r` over the candidates.
//!
//! # Layout
//!
//! As in [`sad`](super::sad): the costs of one pixel lie side by side, **largest disparity first**; right rows are padded
//! so that the right pixel of column `c`, lane `k` is `right[c + k]`.
//!
//! # Bounds
//!
//! Pixel costs fit bytes: `126 + 255/4 + 24 = 213 < 256` (x-Sobel differences are at most `2·63`). Window sums fit 16 bits up
//! to a side of [`MAX_BLOCK_SIZE`]: `213·15² = 47 925`. Path costs fit bytes without saturating: what `min(…) - min_k` adds
//! is at most P2, so `L <= LARGEST_COST + LARGEST_PENALTY = 127 + 127 = 254`. Only what is not a candidate saturates, at
//! [`NO_CANDIDATE`] `= 255`, and so is told from all others by its path costs too. Sums of four paths are below `2¹⁰`.

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512;
pub mod features;
#[cfg(target_arch = "aarch64")]
pub(super) mod neon;
pub mod reference;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) mod vector;

use super::sad::Choice;
use features::PixelRow;

/// Matching costs are truncated at this.
pub const LARGEST_COST: u8 = 127;
/// P1 and P2 do not exceed this.
pub const LARGEST_PENALTY: u8 = 127;
/// The matching cost, and every path cost, of what is not a candidate.
pub const NO_CANDIDATE: u8 = u8::MAX;
/// Sides of windows whose sums fit 16 bits.
pub const MAX_BLOCK_SIZE: usize = 15;

/// Lets a row of pixel costs enter the window and another leave it.
#[derive(Debug)]
pub struct CostRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// What is compared, `width` pixels.
    pub left: PixelRow<'a>,
    /// The same of the right image, `width + lanes - 1` pixels.
    pub right: PixelRow<'a>,
    /// In: pixel costs of the row that leaves. Out: of the row that enters. `width * lanes`.
    pub pixel_costs: &'a mut [u8],
    /// Per column and lane: the sum of the pixel costs of the window's rows. `width * lanes`.
    pub column_sums: &'a mut [u16],
}

impl CostRow<'_> {
    pub(super) fn check(&self) {
        let width = self.left.check();
        assert!(width > 0 && self.lanes > 0, "an empty row");
        assert!(self.right.check() == width + self.lanes - 1, "right");
        assert!(self.pixel_costs.len() == width * self.lanes, "pixel_costs");
        assert!(self.column_sums.len() == width * self.lanes, "column_sums");
    }
}

/// Matching costs from column sums.
#[derive(Debug)]
pub struct WindowRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// Half the window.
    pub radius: usize,
    /// `width * lanes`.
    pub column_sums: &'a [u16],
    /// Per left column: 0, or [`NO_CANDIDATE`] if it has no source.
    pub blocked_left: &'a [u8],
    /// Per padded right column: 0, or [`NO_CANDIDATE`] if outside the image or without source.
    pub blocked_right: &'a [u8],
    /// Per lane: 0, or [`NO_CANDIDATE`] where it is not a disparity asked for.
    pub blocked_lanes: &'a [u8],
    /// Out: matching costs. `width * lanes`.
    pub costs: &'a mut [u8],
}

impl WindowRow<'_> {
    pub(super) fn check(&self) {
        let width = self.blocked_left.len();
        assert!(width > 0 && self.lanes > 0, "an empty row");
        assert!(self.column_sums.len() == width * self.lanes, "column_sums");
        assert!(self.blocked_right.len() == width + self.lanes - 1, "blocked_right");
        assert!(self.blocked_lanes.len() == self.lanes, "blocked_lanes");
        assert!(self.costs.len() == width * self.lanes, "costs");
        assert!(2 * self.radius < MAX_BLOCK_SIZE, "radius");
    }

    /// The mean as a product: a sum times this, divided by 2¹⁶.
    pub(super) fn reciprocal(&self) -> u16 {
        let side = 2 * self.radius as u32 + 1;
        // Rounded up, a multiple of the window's area gives the whole mean; a window of one pixel loses one level.
        (65_536_u32.div_ceil(side * side)).min(u16::MAX.into()) as u16
    }
}

/// Both horizontal paths through each of some rows.
#[derive(Debug)]
pub struct HorizontalRows<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// Penalty for a step of one disparity.
    pub p1: u8,
    /// The rows.
    pub rows: &'a mut [HorizontalRow<'a>],
}

/// One of [`HorizontalRows`].
#[derive(Debug)]
pub struct HorizontalRow<'a> {
    /// Matching costs, `width * lanes`.
    pub costs: &'a [u8],
    /// Per column: penalty for larger steps between it and the column before; the first is not read.
    pub p2: &'a [u8],
    /// Out: costs of the path that comes from the left. `width * lanes`.
    pub from_left: &'a mut [u8],
    /// Out: costs of the path that comes from the right. `width * lanes`.
    pub from_right: &'a mut [u8],
}

impl HorizontalRows<'_> {
    pub(super) fn check(&self) {
        let width = self.rows.first().map_or(0, |row| row.p2.len());
        let cells = width * self.lanes;
        for row in &*self.rows {
            assert!(cells > 0 && row.p2.len() == width, "an empty row, or rows of different widths");
            assert!(row.costs.len() == cells, "costs");
            assert!(row.from_left.len() == cells && row.from_right.len() == cells, "path costs");
        }
    }
}

/// One step of the vertical paths of neighbouring columns.
#[derive(Debug)]
pub struct VerticalRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// Matching costs, `columns * lanes`.
    pub costs: &'a [u8],
    /// Penalty for a step of one disparity.
    pub p1: u8,
    /// Per column: penalty for larger steps.
    pub p2: &'a [u8],
    /// Path costs of the row before; all zero at the path's start. `columns * lanes`.
    pub before: &'a [u8],
    /// In: the smallest path cost of each column of the row before. Out: of this row.
    pub smallest: &'a mut [u8],
    /// Out: path costs. `columns * lanes`.
    pub after: &'a mut [u8],
}

impl VerticalRow<'_> {
    pub(super) fn check(&self) {
        let cells = self.p2.len() * self.lanes;
        assert!(cells > 0, "an empty row");
        assert!(self.costs.len() == cells, "costs");
        assert!(self.smallest.len() == self.p2.len(), "smallest");
        assert!(self.before.len() == cells && self.after.len() == cells, "path costs");
    }
}

/// Sums over the paths, and the best candidates.
#[derive(Debug)]
pub struct SumRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// Path costs, each `width * lanes`; the second vertical path may be empty.
    pub from_left: &'a [u8],
    /// From the right.
    pub from_right: &'a [u8],
    /// From above.
    pub from_above: &'a [u8],
    /// From below, or empty.
    pub from_below: &'a [u8],
    /// Percent above the best sum within which candidates are counted; 0 counts none.
    pub uniqueness_ratio: u32,
    /// For the left–right test: how far around the best lane `nearby` looks.
    pub left_right_reach: Option<usize>,
    /// Out: sums; `u16::MAX` where there is no candidate. `width * lanes`.
    pub sums: &'a mut [u16],
    /// Out, per column, as in [`SadRow::chosen`](super::sad::SadRow::chosen).
    pub chosen: &'a mut [Choice<u16>],
    /// Out, per column, as in [`SadRow::rivals`](super::sad::SadRow::rivals).
    pub rivals: &'a mut [u16],
    /// Out, per column, as in [`SadRow::nearby`](super::sad::SadRow::nearby).
    pub nearby: &'a mut [u16],
    /// Out, per padded right column, as in [`SadRow::right_best`](super::sad::SadRow::right_best).
    pub right_best: &'a mut [u16],
}

impl SumRow<'_> {
    pub(super) fn check(&self) {
        let width = self.chosen.len();
        let cells = width * self.lanes;
        assert!(cells > 0, "an empty row");
        assert!(self.from_left.len() == cells && self.from_right.len() == cells, "horizontal paths");
        assert!(self.from_above.len() == cells, "vertical path");
        assert!(self.from_below.is_empty() || self.from_below.len() == cells, "second vertical path");
        assert!(self.sums.len() == cells, "sums");
        assert!(self.rivals.len() == width, "rivals");
        if self.left_right_reach.is_some() {
            assert!(
                self.nearby.len() == width && self.right_best.len() == width + self.lanes - 1,
                "left-right"
            );
        }
    }
}

/// By how much the sum of each candidate exceeds the smallest of its pixel.
#[derive(Debug)]
pub struct ExcessRow<'a> {
    /// Lanes per column.
    pub lanes: usize,
    /// Path costs, each `width * lanes`.
    pub from_left: &'a [u8],
    /// From the right.
    pub from_right: &'a [u8],
    /// From above.
    pub from_above: &'a [u8],
    /// Out: the excess, 255 at most and where there is no candidate; 0 for all lanes of a pixel without any.
    pub excess: &'a mut [u8],
}

impl ExcessRow<'_> {
    pub(super) fn check(&self) {
        let cells = self.excess.len();
        assert!(cells > 0 && cells.is_multiple_of(self.lanes), "excess");
        assert!(self.from_left.len() == cells && self.from_right.len() == cells, "horizontal paths");
        assert!(self.from_above.len() == cells, "vertical path");
    }
}
