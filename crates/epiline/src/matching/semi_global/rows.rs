//! Paths through the costs, and what is chosen by their sums.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::Frame;
use crate::kernels::semi_global::{ExcessRow, HorizontalRow, HorizontalRows, SumRow, VerticalRow};
use crate::matching::aligned::AlignedVec;
use crate::matching::choices::Choices;
use crate::matching::crew::pause;
use crate::matching::row_queue::{Direction, MapRows, Rows, lock};

/// Rows of a volume.
type VolumeRows<'a> = &'a [Mutex<AlignedVec<u8>>];

/// The vertical paths of one direction, as far as they have come.
#[derive(Debug, Default)]
pub(super) struct VerticalPaths {
    state: Mutex<VerticalState>,
}

#[derive(Debug, Default)]
struct VerticalState {
    /// The row they come to next.
    next: usize,
    /// Path costs of the row they have come to.
    last: AlignedVec<u8>,
    /// The smallest of each column.
    smallest: Vec<u8>,
    p2: Vec<u8>,
}

impl VerticalPaths {
    /// Before row `first`.
    pub fn start(&mut self, frame: &Frame<'_>, first: usize) {
        let VerticalState { next, last, smallest, p2 } =
            self.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        *next = first;
        last.reset(frame.cells(), 0);
        smallest.clear();
        smallest.resize(frame.width(), 0);
        p2.resize(frame.width(), 0);
    }

    /// When dropped by a thread that panics, lets those panic, too, that wait for it.
    pub fn tell_of_failure(&self) -> impl Drop {
        FailureWatch(self)
    }

    /// Leads them through some rows once they have come there.
    pub fn extend(
        &self,
        frame: &Frame<'_>,
        direction: Direction,
        rows: Range<usize>,
        costs: VolumeRows<'_>,
        paths: VolumeRows<'_>,
    ) {
        let first = direction.through(rows.clone()).next().unwrap_or(rows.start);
        let mut turns = 0;
        let mut state = loop {
            let state = lock(&self.state);
            assert!(state.next != FAILED, "another thread failed");
            if state.next == first {
                break state;
            }
            drop(state);
            pause(&mut turns);
        };
        let VerticalState { next, last, smallest, p2 } = &mut *state;
        let mut done: Option<MutexGuard<'_, AlignedVec<u8>>> = None;
        for y in direction.through(rows.clone()) {
            let beside = match direction {
                Direction::Down => y.saturating_sub(1),
                Direction::Up => (y + 1).min(frame.height() - 1),
            };
            frame.penalties.between(frame.left.row(y), frame.left.row(beside), p2);
            let mut after = lock(&paths[y - rows.start]);
            frame.kernels.vertical(&mut VerticalRow {
                lanes: frame.lanes(),
                costs: &lock(&costs[y - rows.start]),
                p1: frame.penalties.p1,
                p2,
                before: done.as_deref().unwrap_or(last),
                smallest,
                after: &mut after,
            });
            done = Some(after);
            *next = direction.after(y);
        }
        if let Some(done) = done {
            last.copy_from_slice(&done);
        }
    }
}

/// The row that paths come to next if someone failed on the way.
const FAILED: usize = usize::MAX - 1;

struct FailureWatch<'a>(&'a VerticalPaths);

impl Drop for FailureWatch<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            lock(&self.0.state).next = FAILED;
        }
    }
}

/// The paths that meet in a row; the second vertical one may be empty.
#[derive(Clone, Copy)]
pub(super) struct Paths<'a> {
    horizontal: &'a HorizontalPaths,
    vertical: [&'a [u8]; 2],
}

/// What becomes of the paths of some rows.
pub(super) trait Sink: Rows {
    /// Takes those of image row `y`, the `i`-th of these.
    fn take(&mut self, frame: &Frame<'_>, i: usize, y: usize, paths: Paths<'_>, sums: &mut Sums);
}

impl Sink for MapRows<'_> {
    fn take(&mut self, frame: &Frame<'_>, i: usize, y: usize, paths: Paths<'_>, sums: &mut Sums) {
        let pixels = i * frame.width()..(i + 1) * frame.width();
        sums.compute(frame, paths);
        sums.choices.select(
            frame.kernels,
            frame.params,
            frame.left_valid.map(|valid| valid.row(y)),
            &mut self.values[pixels.clone()],
            &mut self.bits[pixels],
        );
    }
}

/// Rows of how much every candidate's sum exceeds the pixel's smallest.
pub(super) struct ByteRows<'a> {
    pub cells: usize,
    pub bytes: &'a mut [u8],
}

impl Rows for ByteRows<'_> {
    fn split(self, count: usize) -> (Self, Self) {
        let cells = self.cells;
        let (bytes, next) = self.bytes.split_at_mut(count * cells);
        (Self { cells, bytes }, Self { cells, bytes: next })
    }
}

impl Sink for ByteRows<'_> {
    fn take(&mut self, frame: &Frame<'_>, i: usize, _: usize, paths: Paths<'_>, _: &mut Sums) {
        frame.kernels.excess(&mut ExcessRow {
            lanes: frame.lanes(),
            from_left: &paths.horizontal.from_left,
            from_right: &paths.horizontal.from_right,
            from_above: paths.vertical[0],
            excess: &mut self.bytes[i * self.cells..(i + 1) * self.cells],
        });
    }
}

/// The horizontal paths of a row.
#[derive(Debug, Default)]
struct HorizontalPaths {
    p2: Vec<u8>,
    from_left: AlignedVec<u8>,
    from_right: AlignedVec<u8>,
}

impl HorizontalPaths {
    /// What the kernel needs of image row `y`.
    fn row<'a>(&'a mut self, frame: &Frame<'_>, y: usize, costs: &'a [u8]) -> HorizontalRow<'a> {
        let grey = frame.left.row(y);
        frame.penalties.between(&grey[1..], grey, &mut self.p2[1..]);
        let Self { p2, from_left, from_right } = self;
        HorizontalRow { costs, p2, from_left, from_right }
    }
}

/// Sums over the paths of a row, and its choices.
#[derive(Debug, Default)]
pub(super) struct Sums {
    sums: AlignedVec<u16>,
    choices: Choices<u16>,
}

impl Sums {
    fn compute(&mut self, frame: &Frame<'_>, Paths { horizontal, vertical }: Paths<'_>) {
        let params = frame.params;
        frame.kernels.sum(&mut SumRow {
            lanes: frame.lanes(),
            from_left: &horizontal.from_left,
            from_right: &horizontal.from_right,
            from_above: vertical[0],
            from_below: vertical[1],
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

/// Horizontal paths, sums and choices, for one job.
#[derive(Debug, Default)]
pub(super) struct PathRows {
    /// Of two rows, which advance together.
    horizontal: [HorizontalPaths; 2],
    sums: Sums,
}

impl PathRows {
    /// Sizes the buffers for a frame.
    pub fn prepare(&mut self, frame: &Frame<'_>) {
        for HorizontalPaths { p2, from_left, from_right } in &mut self.horizontal {
            p2.resize(frame.width(), 0);
            from_left.resize(frame.cells(), 0);
            from_right.resize(frame.cells(), 0);
        }
        self.sums.sums.resize(frame.cells(), 0);
        self.sums.choices.resize(frame.width(), frame.lanes(), frame.params.min_disparity);
    }

    /// Sums of some rows from their costs and vertical paths, each handed to the sink. The second paths may be none.
    pub fn choose<S: Sink>(
        &mut self,
        frame: &Frame<'_>,
        rows: Range<usize>,
        [costs, paths, other]: [VolumeRows<'_>; 3],
        mut sink: S,
    ) {
        for first in (0..rows.len()).step_by(2) {
            let count = (rows.len() - first).min(2);
            self.walk_along(frame, rows.start + first, &costs[first..first + count]);
            for (i, horizontal) in (first..first + count).zip(&self.horizontal) {
                let (own, other) = (lock(&paths[i]), other.get(i).map(lock));
                let vertical = [&**own, other.as_deref().map_or(&[][..], |row| row)];
                sink.take(frame, i, rows.start + i, Paths { horizontal, vertical }, &mut self.sums);
            }
        }
    }

    /// Both horizontal paths of one or two rows from image row `y` on.
    fn walk_along(&mut self, frame: &Frame<'_>, y: usize, costs: VolumeRows<'_>) {
        let (lanes, p1) = (frame.lanes(), frame.penalties.p1);
        let [first, second] = &mut self.horizontal;
        let costs_of_first = lock(&costs[0]);
        let first = first.row(frame, y, &costs_of_first);
        match costs.get(1).map(lock) {
            Some(costs) => {
                let second = second.row(frame, y + 1, &costs);
                frame.kernels.horizontal(&mut HorizontalRows { lanes, p1, rows: &mut [first, second] });
            }
            None => frame.kernels.horizontal(&mut HorizontalRows { lanes, p1, rows: &mut [first] }),
        }
    }
}
