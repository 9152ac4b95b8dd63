//! Paths through the costs, and what is chosen by their sums.

use std::ops::Range;

use super::Frame;
use crate::kernels::semi_global::{ExcessRow, HorizontalRow, SumRow, VerticalRow};
use crate::matching::aligned::AlignedVec;
use crate::matching::choices::Choices;
use crate::matching::threads::run_all;

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
        let rows = band.zip(costs.chunks_exact(cells)).zip(paths.chunks_exact_mut(cells));
        let steps = rows.map(|((y, costs), paths)| Step { y, beside: y.saturating_sub(1), costs, paths });
        self.walk(frame, steps, jobs);
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
        let (cells, last) = (frame.width() * frame.lanes(), frame.height() - 1);
        let rows = band.zip(costs.chunks_exact(cells)).zip(paths.chunks_exact_mut(cells)).rev();
        let steps = rows.map(|((y, costs), paths)| Step { y, beside: (y + 1).min(last), costs, paths });
        self.walk(frame, steps, jobs);
    }

    /// Step by step, columns shared out.
    fn walk<'a>(&mut self, frame: &Frame<'_>, steps: impl Iterator<Item = Step<'a>>, jobs: usize) {
        let (width, lanes) = (frame.width(), frame.lanes());
        if jobs == 1 {
            let columns =
                Columns { first: 0, last: &mut self.last, smallest: &mut self.smallest, p2: &mut self.p2 };
            columns.walk(frame, steps);
            return;
        }
        let count = width.div_ceil(jobs);
        let mut parts: Vec<Vec<Step<'a>>> = Vec::new();
        parts.resize_with(width.div_ceil(count), Vec::new);
        for Step { y, beside, costs, paths } in steps {
            let chunks = costs.chunks(count * lanes).zip(paths.chunks_mut(count * lanes));
            for (part, (costs, paths)) in parts.iter_mut().zip(chunks) {
                part.push(Step { y, beside, costs, paths });
            }
        }
        let columns = (0..width)
            .step_by(count)
            .zip(self.last.chunks_mut(count * lanes))
            .zip(self.smallest.chunks_mut(count))
            .zip(self.p2.chunks_mut(count))
            .map(|(((first, last), smallest), p2)| Columns { first, last, smallest, p2 });
        run_all(columns.zip(parts).map(|(columns, steps)| move || columns.walk(frame, steps.into_iter())));
    }
}

/// One row of vertical paths, or a part of it.
struct Step<'a> {
    y: usize,
    /// The row that the paths come from; `y` itself where they start.
    beside: usize,
    costs: &'a [u8],
    paths: &'a mut [u8],
}

/// Some columns of [`Vertical`].
struct Columns<'a> {
    first: usize,
    last: &'a mut [u8],
    smallest: &'a mut [u8],
    p2: &'a mut [u8],
}

impl Columns<'_> {
    fn walk<'a>(self, frame: &Frame<'_>, steps: impl Iterator<Item = Step<'a>>) {
        let Self { first, last, smallest, p2 } = self;
        let columns = first..first + p2.len();
        let mut done: Option<&[u8]> = None;
        for Step { y, beside, costs, paths } in steps {
            let [here, there] = [y, beside].map(|y| &frame.left.row(y)[columns.clone()]);
            frame.penalties.between(here, there, p2);
            frame.kernels.vertical(&mut VerticalRow {
                lanes: frame.lanes(),
                costs,
                p1: frame.penalties.p1,
                p2,
                before: done.unwrap_or(last),
                smallest,
                after: paths,
            });
            done = Some(paths);
        }
        if let Some(done) = done {
            last.copy_from_slice(done);
        }
    }
}

/// What becomes of the paths of neighbouring rows.
pub(super) trait Sink: Sized + Send {
    /// What becomes of the first `count` rows, and of the rest.
    fn split(self, frame: &Frame<'_>, count: usize) -> (Self, Self);

    /// Takes image row `y`, the `i`-th of these, given its vertical paths. The horizontal ones are in `paths`.
    fn take(
        &mut self,
        frame: &Frame<'_>,
        i: usize,
        y: usize,
        paths: &mut PathRows,
        from_above: &[u8],
        from_below: &[u8],
    );
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

    fn take(
        &mut self,
        frame: &Frame<'_>,
        i: usize,
        y: usize,
        paths: &mut PathRows,
        from_above: &[u8],
        from_below: &[u8],
    ) {
        let pixels = i * frame.width()..(i + 1) * frame.width();
        paths.sum(frame, from_above, from_below);
        paths.choices.select(
            frame.kernels,
            frame.params,
            frame.left_valid.map(|valid| valid.row(y)),
            &mut self.values[pixels.clone()],
            &mut self.bits[pixels],
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

    fn take(
        &mut self,
        frame: &Frame<'_>,
        i: usize,
        _: usize,
        paths: &mut PathRows,
        from_above: &[u8],
        _: &[u8],
    ) {
        let (lanes, cells) = (frame.lanes(), frame.width() * frame.lanes());
        frame.kernels.excess(&mut ExcessRow {
            lanes,
            from_left: &paths.from_left,
            from_right: &paths.from_right,
            from_above,
            excess: &mut self.0[i * cells..(i + 1) * cells],
        });
    }
}

/// Horizontal paths, sums and choices of a row, for one job.
#[derive(Debug, Default)]
pub(super) struct PathRows {
    p2: Vec<u8>,
    from_left: AlignedVec<u8>,
    from_right: AlignedVec<u8>,
    sums: AlignedVec<u16>,
    choices: Choices<u16>,
}

impl PathRows {
    /// Sizes the buffers for a frame.
    pub fn prepare(&mut self, frame: &Frame<'_>) {
        let (width, lanes) = (frame.width(), frame.lanes());
        self.p2.resize(width, 0);
        self.from_left.resize(width * lanes, 0);
        self.from_right.resize(width * lanes, 0);
        self.sums.resize(width * lanes, 0);
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
            self.extend(frame, y, &costs[row.clone()]);
            sink.take(frame, i, y, self, &above[row], below);
        }
    }

    /// Both horizontal paths.
    fn extend(&mut self, frame: &Frame<'_>, y: usize, costs: &[u8]) {
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
    }

    fn sum(&mut self, frame: &Frame<'_>, from_above: &[u8], from_below: &[u8]) {
        let params = frame.params;
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
