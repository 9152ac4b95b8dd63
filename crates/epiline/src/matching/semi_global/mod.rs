//! Semi-global matching of a frame: costs, paths, sums, in bands of rows.
//!
//! Horizontal paths stay within a row and vertical ones within a column, so every phase of a band has something that its
//! jobs can share out: rows for costs, columns for vertical paths, rows for the rest. No path runs across two jobs' parts,
//! hence the result does not depend on how many there are.
//!
//! Three paths (from the left, the right and above) need a band of costs at a time. The fourth, from below, begins at the
//! image's end: then matching costs and the path from above are kept for the whole image, `2·width·height·lanes` bytes.

mod costs;
mod penalties;
mod rows;

use std::ops::Range;

use self::costs::CostRows;
pub(super) use self::penalties::Penalties;
use self::rows::{Disparities, Excess, PathRows, Sink, Vertical};
use super::aligned::AlignedVec;
use super::map::DisparityMap;
use super::params::MatcherParams;
use super::texture_test::TextureTest;
use super::threads::run_all;
use crate::image::ImageRef;
use crate::kernels::Kernels;

/// Rows of a band per thread. Costs of the rows above a job's first are summed again.
const ROWS_PER_JOB: usize = 32;

/// What every job of a frame reads.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub kernels: &'a Kernels,
    pub params: &'a MatcherParams,
    pub penalties: &'a Penalties,
    pub left: ImageRef<'a, u8>,
    pub right: ImageRef<'a, u8>,
    pub left_valid: Option<ImageRef<'a, u8>>,
    pub right_valid: Option<ImageRef<'a, u8>>,
}

impl Frame<'_> {
    fn lanes(&self) -> usize {
        self.kernels.lanes(self.params.num_disparities)
    }

    /// Disparity of lane 0, px; so many right columns less one lie left of the image.
    fn first_disparity(&self) -> usize {
        self.params.min_disparity + self.lanes() - 1
    }

    fn width(&self) -> usize {
        self.left.width()
    }

    fn height(&self) -> usize {
        self.left.height()
    }
}

/// The buffers of the method.
#[derive(Debug, Default)]
pub(super) struct SemiGlobal {
    costs: AlignedVec<u8>,
    above: AlignedVec<u8>,
    below: AlignedVec<u8>,
    vertical: Vertical,
    cost_rows: Vec<CostRows>,
    path_rows: Vec<PathRows>,
    texture: TextureTest,
}

impl SemiGlobal {
    /// Matches a pair into `out`, which has its size.
    pub fn compute(&mut self, frame: &Frame<'_>, threads: usize, out: &mut DisparityMap) {
        let sink = Disparities { values: out.values.as_mut_slice(), bits: out.validity.as_mut_slice() };
        self.match_bands(frame, threads, sink);
        if frame.params.texture_threshold > 0 {
            self.texture.mark(frame.kernels, frame.params, frame.left, 0, out);
        }
    }

    /// How much the sum of each candidate exceeds the smallest of its pixel, 255 at most and where there is no candidate;
    /// 0 for all lanes of a pixel without any. `width * lanes` per row.
    pub fn compute_excess(&mut self, frame: &Frame<'_>, threads: usize, excess: &mut [u8]) {
        self.match_bands(frame, threads, Excess(excess));
    }

    fn match_bands<S: Sink>(&mut self, frame: &Frame<'_>, threads: usize, mut sink: S) {
        let (width, height) = (frame.width(), frame.height());
        let row_cells = width * frame.lanes();
        // A single thread keeps a row in its cache from its costs to its disparities.
        let band_rows = if threads == 1 { 1 } else { ROWS_PER_JOB * threads }.min(height);
        let jobs = threads.min(band_rows);
        self.cost_rows.resize_with(jobs, CostRows::default);
        self.path_rows.resize_with(jobs, PathRows::default);
        self.cost_rows.iter_mut().for_each(|rows| rows.prepare(frame));
        self.path_rows.iter_mut().for_each(|rows| rows.prepare(frame));
        let whole = frame.params.paths == 4;
        let kept = if whole { height } else { band_rows };
        self.costs.resize(kept * row_cells, 0);
        self.above.resize(kept * row_cells, 0);
        self.below.resize(if whole { band_rows * row_cells } else { 0 }, 0);

        let bands = (0..height).step_by(band_rows).map(|first| first..(first + band_rows).min(height));
        self.vertical.start(frame);
        for band in bands.clone() {
            let at = if whole { band.start } else { 0 };
            let cells = at * row_cells..(at + band.len()) * row_cells;
            let (costs, above) = (&mut self.costs[cells.clone()], &mut self.above[cells]);
            compute_costs(&mut self.cost_rows, frame, band.clone(), costs);
            self.vertical.extend(frame, band.clone(), costs, above, jobs);
            if !whole {
                let own;
                (own, sink) = sink.split(frame, band.len());
                choose(&mut self.path_rows, frame, band, [costs, above, &[]], own);
            }
        }
        if !whole {
            return;
        }
        self.vertical.start(frame);
        for band in bands.rev() {
            let cells = band.start * row_cells..band.end * row_cells;
            let (costs, above) = (&self.costs[cells.clone()], &self.above[cells]);
            let below = &mut self.below[..band.len() * row_cells];
            self.vertical.extend_upward(frame, band.clone(), costs, below, jobs);
            let own;
            (sink, own) = sink.split(frame, band.start);
            choose(&mut self.path_rows, frame, band, [costs, above, below], own);
        }
    }
}

/// Matching costs of a band, rows shared out.
fn compute_costs(buffers: &mut [CostRows], frame: &Frame<'_>, band: Range<usize>, costs: &mut [u8]) {
    let row_cells = frame.width() * frame.lanes();
    let mut rest = costs;
    let jobs: Vec<_> = parts(band, buffers.len())
        .zip(buffers)
        .map(|(rows, buffers)| {
            let own;
            (own, rest) = std::mem::take(&mut rest).split_at_mut(rows.len() * row_cells);
            move || buffers.compute(frame, rows, own)
        })
        .collect();
    run_all(jobs.into_iter());
}

/// Sums of a band from its costs and vertical paths, rows shared out.
fn choose<S: Sink>(
    buffers: &mut [PathRows],
    frame: &Frame<'_>,
    band: Range<usize>,
    [costs, above, below]: [&[u8]; 3],
    mut sink: S,
) {
    let (width, lanes) = (frame.width(), frame.lanes());
    let first = band.start;
    let mut jobs = Vec::with_capacity(buffers.len());
    for (rows, buffers) in parts(band, buffers.len()).zip(buffers) {
        let cells = (rows.start - first) * width * lanes..(rows.end - first) * width * lanes;
        let below = if below.is_empty() { below } else { &below[cells.clone()] };
        let volumes = [&costs[cells.clone()], &above[cells], below];
        let own;
        (own, sink) = sink.split(frame, rows.len());
        jobs.push(move || buffers.compute(frame, rows, volumes, own));
    }
    run_all(jobs.into_iter());
}

/// A range in `count` parts, as even as possible; fewer if it is shorter.
fn parts(range: Range<usize>, count: usize) -> impl Iterator<Item = Range<usize>> {
    let (first, len) = (range.start, range.len());
    let count = count.min(len).max(1);
    (0..count).map(move |i| first + len * i / count..first + len * (i + 1) / count)
}
