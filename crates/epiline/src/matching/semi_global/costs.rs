//! Matching costs, row by row.

use std::ops::Range;

use super::Frame;
use crate::kernels::semi_global::{CostRow, WindowRow};
use crate::matching::aligned::AlignedVec;
use crate::matching::blocked::BlockedPixels;
use crate::matching::features::Features;

/// The window's pixel costs and their sums, for one job.
#[derive(Debug, Default)]
pub(super) struct CostRows {
    left: Features,
    right: Features,
    /// Per row of the window, pixel costs; row `y` lies at `y` modulo their number.
    pixel_costs: Vec<AlignedVec<u8>>,
    column_sums: AlignedVec<u16>,
    blocked: BlockedPixels,
    /// The row whose window the sums hold.
    row: Option<usize>,
}

impl CostRows {
    /// Sizes the buffers for a frame.
    pub fn prepare(&mut self, frame: &Frame<'_>) {
        let (width, lanes) = (frame.width(), frame.lanes());
        let cells = width * lanes;
        self.left.resize(width, 0);
        self.right.resize(width, frame.first_disparity());
        self.pixel_costs.resize_with(frame.params.block_size, AlignedVec::default);
        self.pixel_costs.iter_mut().for_each(|row| row.reset(cells, 0));
        self.column_sums.reset(cells, 0);
        self.blocked.reset(width, lanes, frame.params);
        self.row = None;
    }

    /// Matching costs of some rows, `width * lanes` each.
    pub fn compute(&mut self, frame: &Frame<'_>, rows: Range<usize>, costs: &mut [u8]) {
        let (lanes, radius) = (frame.lanes(), frame.params.radius());
        for (y, costs) in rows.zip(costs.chunks_exact_mut(frame.width() * lanes)) {
            self.move_to(frame, y);
            self.blocked.read([frame.left_valid, frame.right_valid], y);
            frame.kernels.window(&mut WindowRow {
                lanes,
                radius,
                column_sums: &self.column_sums,
                blocked_left: &self.blocked.left,
                blocked_right: &self.blocked.right,
                blocked_lanes: &self.blocked.lanes,
                costs,
            });
        }
    }

    /// Lets the sums hold the window around row `y`.
    fn move_to(&mut self, frame: &Frame<'_>, y: usize) {
        let radius = frame.params.radius() as isize;
        let y = y as isize;
        if self.row == Some((y - 1) as usize) {
            self.enter(frame, y + radius);
        } else {
            self.pixel_costs.iter_mut().for_each(|row| row.fill(0));
            self.column_sums.fill(0);
            (y - radius..=y + radius).for_each(|y| self.enter(frame, y));
        }
        self.row = Some(y as usize);
    }

    /// Row `y`, clamped to the image, takes the place of the one that entered a window before.
    fn enter(&mut self, frame: &Frame<'_>, y: isize) {
        let image_row = y.clamp(0, frame.height() as isize - 1) as usize;
        self.left.compute(frame.kernels, frame.params, frame.left, image_row);
        self.right.compute(frame.kernels, frame.params, frame.right, image_row);
        let slot = y.rem_euclid(self.pixel_costs.len() as isize) as usize;
        let (width, lanes) = (frame.width(), frame.lanes());
        frame.kernels.cost(&mut CostRow {
            lanes,
            left: self.left.row(width),
            right: self.right.row(width + lanes - 1),
            pixel_costs: &mut self.pixel_costs[slot],
            column_sums: &mut self.column_sums,
        });
    }
}
