//! Semi-global matching of a frame: costs, paths, sums, in bands of rows.
//!
//! Horizontal paths stay within a row and vertical ones within a column. A thread takes a band, sums its matching costs,
//! waits until the vertical paths have come to the band, leads them through, and then does what remains for each row by
//! itself, while others lead the paths further. A band is small enough to stay in the thread's cache.
//!
//! Three paths (from the left, the right and above) need nothing more than the band. The fourth, from below, meets the
//! other in the middle: threads going down and threads going up first keep costs and vertical paths of the rows they take,
//! `2·width·height·lanes` bytes together, and then go on through the rows of the others, which have all that was missing.
//!
//! Every path costs the same whoever leads it, so the result does not depend on how many threads there are.

mod costs;
mod penalties;
mod rows;

use std::sync::{Mutex, PoisonError};

use self::costs::CostPool;
pub(super) use self::penalties::Penalties;
use self::rows::{ByteRows, PathRows, Sink, VerticalPaths};
use super::aligned::AlignedVec;
use super::crew::Crew;
use super::map::DisparityMap;
use super::params::MatcherParams;
use super::row_queue::{Direction, MapRows, RowQueue};
use super::texture_test::TextureTest;
use crate::image::ImageRef;
use crate::kernels::Kernels;

/// What costs and vertical paths of a band may take of a core's cache, bytes.
const BAND_BYTES: usize = 512 * 1024;

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

    /// Costs of a row.
    fn cells(&self) -> usize {
        self.width() * self.lanes()
    }

    /// Rows of a band. Every band costs its threads a few microseconds, whatever its size.
    fn band_rows(&self) -> usize {
        (BAND_BYTES / (2 * self.cells())).clamp(3, 16)
    }
}

/// One of the volumes, row by row: who holds a row's lock works on it.
type Volume = Vec<Mutex<AlignedVec<u8>>>;

/// Sizes the rows for a frame.
fn resize(volume: &mut Volume, rows: usize, frame: &Frame<'_>) {
    volume.resize_with(rows, Mutex::default);
    for row in volume {
        row.get_mut().unwrap_or_else(PoisonError::into_inner).resize(frame.cells(), 0);
    }
}

/// The buffers of the method.
#[derive(Debug, Default)]
pub(super) struct SemiGlobal {
    cost_pool: CostPool,
    down: VerticalPaths,
    up: VerticalPaths,
    workers: Vec<Worker>,
    /// For four paths, of the whole image: costs, and the vertical path that came by first.
    kept_costs: Volume,
    kept_paths: Volume,
    texture: TextureTest,
}

/// The buffers of one thread: costs and vertical paths of a band.
#[derive(Debug, Default)]
struct Worker {
    costs: Volume,
    paths: Volume,
    rows: PathRows,
}

impl SemiGlobal {
    /// Matches a pair into `out`, which has its size.
    pub fn compute(&mut self, frame: &Frame<'_>, crew: &Crew, out: &mut DisparityMap) {
        self.match_rows(frame, crew, MapRows::of(out));
        if frame.params.texture_threshold > 0 {
            self.texture.mark(frame.kernels, frame.params, frame.left, 0, out);
        }
    }

    /// How much the sum of each candidate exceeds the smallest of its pixel, 255 at most and where there is no candidate;
    /// 0 for all lanes of a pixel without any. `width * lanes` per row.
    pub fn compute_excess(&mut self, frame: &Frame<'_>, crew: &Crew, excess: &mut [u8]) {
        self.match_rows(frame, crew, ByteRows { cells: frame.cells(), bytes: excess });
    }

    fn match_rows<S: Sink>(&mut self, frame: &Frame<'_>, crew: &Crew, sink: S) {
        let band = frame.band_rows();
        self.workers.resize_with(crew.size(), Worker::default);
        self.cost_pool.prepare(frame, crew.size());
        self.down.start(frame, 0);
        self.up.start(frame, frame.height() - 1);
        for worker in &mut self.workers {
            worker.rows.prepare(frame);
            resize(&mut worker.paths, band, frame);
        }
        if frame.params.paths == 4 {
            self.match_from_both_ends(frame, crew, band, sink);
            return;
        }
        let Self { cost_pool, down, workers, .. } = self;
        let queue = RowQueue::new(0..frame.height(), sink);
        let (cost_pool, down, queue) = (&*cost_pool, &*down, &queue);
        crew.run_all(workers.iter_mut().map(|Worker { costs, paths, rows: path_rows }| {
            resize(costs, band, frame);
            move || {
                let _failure = down.tell_of_failure();
                while let Some((rows, own)) = queue.take(Direction::Down, band) {
                    let (costs, paths) = (&costs[..rows.len()], &paths[..rows.len()]);
                    cost_pool.compute(frame, Direction::Down, rows.clone(), costs);
                    down.extend(frame, Direction::Down, rows.clone(), costs, paths);
                    path_rows.choose(frame, rows, [costs, paths, &[]], own);
                }
            }
        }));
    }

    /// The same with a path from below.
    fn match_from_both_ends<S: Sink>(&mut self, frame: &Frame<'_>, crew: &Crew, band: usize, sink: S) {
        let Self { cost_pool, down, up, workers, kept_costs, kept_paths, .. } = self;
        let height = frame.height();
        resize(kept_costs, height, frame);
        resize(kept_paths, height, frame);
        let (cost_pool, kept_costs, kept_paths) = (&*cost_pool, &**kept_costs, &**kept_paths);
        let fronts = [(Direction::Down, &*down), (Direction::Up, &*up)];
        let unseen = &RowQueue::new(0..height, ());
        crew.each(crew.size(), &|worker| {
            let (direction, front) = fronts[worker % 2];
            let _failure = front.tell_of_failure();
            while let Some((rows, ())) = unseen.take(direction, band) {
                let (costs, paths) = (&kept_costs[rows.clone()], &kept_paths[rows.clone()]);
                cost_pool.compute(frame, direction, rows.clone(), costs);
                front.extend(frame, direction, rows, costs, paths);
            }
        });
        let middle = unseen.rest().start;
        let (upper, lower) = sink.split(middle);
        let queues = [RowQueue::new(middle..height, lower), RowQueue::new(0..middle, upper)];
        let queues = &queues;
        crew.run_all(workers.iter_mut().enumerate().map(
            |(worker, Worker { paths, rows: path_rows, .. })| {
                let paths = &**paths;
                move || {
                    // A lone thread goes both ways, and so does one whose own is done.
                    for side in [worker % 2, 1 - worker % 2] {
                        let (direction, front) = fronts[side];
                        let _failure = front.tell_of_failure();
                        while let Some((rows, own)) = queues[side].take(direction, band) {
                            let (costs, other) = (&kept_costs[rows.clone()], &kept_paths[rows.clone()]);
                            let paths = &paths[..rows.len()];
                            front.extend(frame, direction, rows.clone(), costs, paths);
                            path_rows.choose(frame, rows, [costs, paths, other], own);
                        }
                    }
                }
            },
        ));
    }
}
