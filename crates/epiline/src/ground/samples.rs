//! The pixels that are asked where the ground is.

use crate::matching::{DisparityMap, Validity};
use crate::rectification::RectifiedGeometry;

/// Columns and rows looked at, at most.
const COLUMNS: usize = 64;
const ROWS: usize = 120;
/// Samples of a column that are held against each other.
const STRIDE: usize = 4;

/// A pixel with a disparity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sample {
    /// Column and row from the principal point, px.
    pub u: f32,
    pub v: f32,
    /// Disparity counted from infinity, px, positive.
    pub seen_px: f32,
}

/// A grid of pixels with disparities, column after column; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    pub all: Vec<Sample>,
    /// Where each looked at column begins in `all`, and the end of the last.
    pub column_starts: Vec<usize>,
}

impl Samples {
    /// Looks at a map of the geometry's size.
    pub fn take(&mut self, disparity: &DisparityMap, geometry: &RectifiedGeometry) {
        let (width, height) = (disparity.width(), disparity.height());
        let (across, down) = (width.div_ceil(COLUMNS), height.div_ceil(ROWS));
        self.all.clear();
        self.column_starts.clear();
        let doffs_px = geometry.doffs_px as f32;
        for x in (across / 2..width).step_by(across) {
            self.column_starts.push(self.all.len());
            let u = (x as f64 - geometry.cx_px) as f32;
            for y in (down / 2..height).step_by(down) {
                let seen_px =
                    f32::from(disparity.values.row(y)[x]) / f32::from(DisparityMap::SCALE) + doffs_px;
                if Validity::has_value(disparity.validity.row(y)[x]) && seen_px > 0.0 {
                    self.all.push(Sample { u, v: (y as f64 - geometry.cy_px) as f32, seen_px });
                }
            }
        }
        self.column_starts.push(self.all.len());
    }

    /// The samples of a looked at column.
    pub fn column(&self, index: usize) -> &[Sample] {
        &self.all[self.column_starts[index]..self.column_starts[index + 1]]
    }

    /// How many samples have, with the one [`STRIDE`] rows looked at farther down their column, a step of disparity like
    /// that of `expected_px`, which gives it for a sample: those that lie along a plane, not across it.
    pub fn count_along(&self, expected_px: impl Fn(&Sample) -> Option<f32>) -> usize {
        let mut along = 0;
        for column in 0..self.columns() {
            for pair in self.column(column).windows(STRIDE + 1) {
                let (upper, lower) = (&pair[0], &pair[STRIDE]);
                let (Some(from), Some(to)) = (expected_px(upper), expected_px(lower)) else { continue };
                let step = lower.seen_px - upper.seen_px;
                along += usize::from((step - (to - from)).abs() < 0.6 * (to - from));
            }
        }
        along
    }

    /// How many columns were looked at.
    pub fn columns(&self) -> usize {
        self.column_starts.len() - 1
    }
}
