//! Paths through the costs, and what is chosen by their sums.

use std::ops::Range;

use super::Frame;
use crate::kernels::semi_global::{HorizontalRow, SumRow, VerticalRow};
use crate::matching::aligned::AlignedVec;
use crate::matching::choices::Choices;

/// The vertical paths as far as they have come.
#[derive(Debug, Default)]
pub(super) struct Vertical {
    /// Path costs of the last row, where the next band needs them.
    last: AlignedVec<u8>,
    smallest: Vec<u8>,
    p2: Vec<u8>,
}

impl Vertical {
    /// Before the first row.
    pub fn start(&mut self, frame: &Frame<'_>) {
        let width = frame.width();
        self.last.reset(width * frame.lanes(), 0);
        self.smallest.clear();
        self.smallest.resize(width, 0);
        self.p2.resize(width, 0);
    }

    /// Downward through a band.
    pub fn extend(
        &mut self,
        frame: &Frame<'_>,
        band: Range<usize>,
        costs: &[u8],
        paths: &mut [u8],
        jobs: usize,
    ) {
        let cells = frame.width() * frame.lanes();
        for (i, y) in band.enumerate() {
            let (done, rest) = paths.split_at_mut(i * cells);
            let before = if i > 0 { &done[(i - 1) * cells..] } else { &self.last };
            let beside = y.checked_sub(1).unwrap_or(y);
            frame.penalties.between(frame.left.row(y), frame.left.row(beside), &mut self.p2);
            let costs = &costs[i * cells..(i + 1) * cells];
            step(frame, costs, &self.p2, before, &mut self.smallest, &mut rest[..cells], jobs);
        }
        self.last.copy_from_slice(&paths[paths.len() - cells..]);
    }

    /// Upward through a band.
    pub fn extend_upward(
        &mut self,
        frame: &Frame<'_>,
        band: Range<usize>,
        costs: &[u8],
        paths: &mut [u8],
        jobs: usize,
    ) {
        let cells = frame.width() * frame.lanes();
        let count = band.len();
        for (i, y) in band.enumerate().rev() {
            let (rest, done) = paths.split_at_mut((i + 1) * cells);
            let before = if i + 1 < count { &done[..cells] } else { &self.last };
            let beside = (y + 1).min(frame.height() - 1);
            frame.penalties.between(frame.left.row(y), frame.left.row(beside), &mut self.p2);
            let costs = &costs[i * cells..(i + 1) * cells];
            step(frame, costs, &self.p2, before, &mut self.smallest, &mut rest[i * cells..], jobs);
        }
        self.last.copy_from_slice(&paths[..cells]);
    }
}

/// One row of vertical paths, columns shared out.
fn step(
    frame: &Frame<'_>,
    costs: &[u8],
    p2: &[u8],
    before: &[u8],
    smallest: &mut [u8],
    after: &mut [u8],
    jobs: usize,
) {
    let lanes = frame.lanes();
    let (columns, p1) = (p2.len().div_ceil(jobs), frame.penalties.p1);
    let parts = costs
        .chunks(columns * lanes)
        .zip(p2.chunks(columns))
        .zip(before.chunks(columns * lanes))
        .zip(smallest.chunks_mut(columns))
        .zip(after.chunks_mut(columns * lanes));
    super::run_all(parts.map(|((((costs, p2), before), smallest), after)| {
        move || frame.kernels.vertical(&mut VerticalRow { lanes, costs, p1, p2, before, smallest, after })
    }));
}

/// What becomes of the sums of neighbouring rows.
pub(super) trait Sink: Sized + Send {
    /// Those of the first `count` rows, and the rest.
    fn split(self, frame: &Frame<'_>, count: usize) -> (Self, Self);

    /// Takes the sums of image row `y`, the `i`-th of these.
    fn take(&mut self, frame: &Frame<'_>, i: usize, y: usize, sums: &PathRows);
}

/// Rows of the disparity map.
pub(super) struct Disparities<'a> {
    pub values: &'a mut [u16],
    pub bits: &'a mut [u8],
}

impl Sink for Disparities<'_> {
    fn split(self, frame: &Frame<'_>, count: usize) -> (Self, Self) {
        let (values, next_values) = self.values.split_at_mut(count * frame.width());
        let (bits, next_bits) = self.bits.split_at_mut(count * frame.width());
        (Self { values, bits }, Self { values: next_values, bits: next_bits })
    }

    fn take(&mut self, frame: &Frame<'_>, i: usize, y: usize, sums: &PathRows) {
        let pixels = i * frame.width()..(i + 1) * frame.width();
        let (values, bits) = (&mut self.values[pixels.clone()], &mut self.bits[pixels]);
        sums.choices.select(
            frame.kernels,
            frame.params,
            frame.left_valid.map(|valid| valid.row(y)),
            values,
            bits,
        );
    }
}

/// Rows of how much every candidate's sum exceeds the pixel's smallest, `width * lanes` each.
pub(super) struct Excess<'a>(pub &'a mut [u8]);

impl Sink for Excess<'_> {
    fn split(self, frame: &Frame<'_>, count: usize) -> (Self, Self) {
        let (rows, next) = self.0.split_at_mut(count * frame.width() * frame.lanes());
        (Self(rows), Self(next))
    }

    fn take(&mut self, frame: &Frame<'_>, i: usize, _: usize, sums: &PathRows) {
        let (lanes, cells) = (frame.lanes(), frame.width() * frame.lanes());
        let columns = self.0[i * cells..(i + 1) * cells].chunks_exact_mut(lanes);
        for ((excess, sums), choice) in columns.zip(sums.sums.chunks_exact(lanes)).zip(&sums.choices.chosen) {
            for (excess, sum) in excess.iter_mut().zip(sums) {
                *excess = (sum - choice.best).min(u8::MAX.into()) as u8;
            }
        }
    }
}

/// Horizontal paths, sums and choices of a row, for one job.
#[derive(Debug, Default)]
pub(super) struct PathRows {
    p2: Vec<u8>,
    from_left: AlignedVec<u8>,
    from_right: AlignedVec<u8>,
    sums: AlignedVec<u16>,
    choices: Choices,
}

impl PathRows {
    /// Sizes the buffers for a frame.
    pub fn prepare(&mut self, frame: &Frame<'_>) {
        let (width, lanes) = (frame.width(), frame.lanes());
        self.p2.resize(width, 0);
        self.from_left.reset(width * lanes, 0);
        self.from_right.reset(width * lanes, 0);
        self.sums.reset(width * lanes, 0);
        self.choices.resize(width, lanes);
    }

    /// Sums of some rows from their costs and vertical paths, each handed to the sink.
    pub fn compute<S: Sink>(
        &mut self,
        frame: &Frame<'_>,
        rows: Range<usize>,
        [costs, above, below]: [&[u8]; 3],
        mut sink: S,
    ) {
        let cells = frame.width() * frame.lanes();
        for (i, y) in rows.enumerate() {
            let row = i * cells..(i + 1) * cells;
            let below = if below.is_empty() { below } else { &below[row.clone()] };
            self.sum(frame, y, [&costs[row.clone()], &above[row], below]);
            sink.take(frame, i, y, self);
        }
    }

    fn sum(&mut self, frame: &Frame<'_>, y: usize, [costs, from_above, from_below]: [&[u8]; 3]) {
        let params = frame.params;
        let grey = frame.left.row(y);
        frame.penalties.between(&grey[1..], grey, &mut self.p2[1..]);
        frame.kernels.horizontal(&mut HorizontalRow {
            lanes: frame.lanes(),
            costs,
            p1: frame.penalties.p1,
            p2: &self.p2,
            from_left: &mut self.from_left,
            from_right: &mut self.from_right,
        });
        frame.kernels.sum(&mut SumRow {
            lanes: frame.lanes(),
            from_left: &self.from_left,
            from_right: &self.from_right,
            from_above,
            from_below,
            uniqueness_ratio: params.uniqueness_ratio.into(),
            left_right_reach: params.left_right_reach(),
            sums: &mut self.sums,
            chosen: &mut self.choices.chosen,
            rivals: &mut self.choices.rivals,
            nearby: &mut self.choices.nearby,
            right_best: &mut self.choices.right_best,
        });
    }
}
