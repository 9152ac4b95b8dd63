//! Matching costs, row by row.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use super::Frame;
use crate::kernels::semi_global::{CostRow, WindowRow};
use crate::matching::aligned::AlignedVec;
use crate::matching::blocked::BlockedPixels;
use crate::matching::features::Features;
use crate::matching::row_queue::{Direction, lock};

/// The sums of a few windows. A thread that needs costs takes those that have come to the row before, if they are free,
/// and else sums the rows of a window anew.
#[derive(Debug, Default)]
pub(super) struct CostPool {
    free: Mutex<Vec<CostRows>>,
}

impl CostPool {
    /// Sizes the buffers of so many threads for a frame.
    pub fn prepare(&mut self, frame: &Frame<'_>, threads: usize) {
        let free = self.free.get_mut().unwrap_or_else(PoisonError::into_inner);
        free.resize_with(threads, CostRows::default);
        free.iter_mut().for_each(|rows| rows.prepare(frame));
    }

    /// Matching costs of some rows, `width * lanes` each.
    pub fn compute(
        &self,
        frame: &Frame<'_>,
        direction: Direction,
        rows: Range<usize>,
        costs: &[Mutex<AlignedVec<u8>>],
    ) {
        let first = direction.through(rows.clone()).next();
        let mut cost_rows = {
            let mut free = lock(&self.free);
            let fits = |rows: &CostRows| rows.row.map(|row| direction.after(row)) == first;
            let at = free.iter().position(fits).or_else(|| free.iter().position(|rows| rows.row.is_none()));
            // There are as many as threads.
            match at.or_else(|| free.len().checked_sub(1)) {
                Some(at) => free.swap_remove(at),
                None => CostRows::default(),
            }
        };
        for y in direction.through(rows.clone()) {
            cost_rows.compute(frame, y, &mut lock(&costs[y - rows.start]));
        }
        lock(&self.free).push(cost_rows);
    }
}

/// The window's pixel costs and their sums.
#[derive(Debug, Default)]
struct CostRows {
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
    fn prepare(&mut self, frame: &Frame<'_>) {
        let (width, lanes) = (frame.width(), frame.lanes());
        self.left.resize(width, 0);
        self.right.resize(width, frame.first_disparity());
        self.pixel_costs.resize_with(frame.params.block_size, AlignedVec::default);
        self.pixel_costs.iter_mut().for_each(|row| row.resize(frame.cells(), 0));
        self.column_sums.resize(frame.cells(), 0);
        self.blocked.reset(width, lanes, frame.params);
        self.row = None;
    }

    /// Matching costs of a row.
    fn compute(&mut self, frame: &Frame<'_>, y: usize, costs: &mut [u8]) {
        self.move_to(frame, y);
        self.blocked.read([frame.left_valid, frame.right_valid], y);
        frame.kernels.window(&mut WindowRow {
            lanes: frame.lanes(),
            radius: frame.params.radius(),
            column_sums: &self.column_sums,
            blocked_left: &self.blocked.left,
            blocked_right: &self.blocked.right,
            blocked_lanes: &self.blocked.lanes,
            costs,
        });
    }

    /// Lets the sums hold the window around row `y`.
    fn move_to(&mut self, frame: &Frame<'_>, y: usize) {
        let radius = frame.params.radius();
        let from = |direction: Direction| self.row.is_some_and(|row| direction.after(row) == y);
        match [Direction::Down, Direction::Up].into_iter().find(|&direction| from(direction)) {
            Some(direction) => self.enter(frame, direction.entering_and_leaving(y, radius).0),
            None => {
                self.pixel_costs.iter_mut().for_each(|row| row.fill(0));
                self.column_sums.fill(0);
                let (y, radius) = (y as isize, radius as isize);
                (y - radius..=y + radius).for_each(|y| self.enter(frame, y));
            }
        }
        self.row = Some(y);
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
