//! Matching by the windows of [`kernels::windowed`](crate::kernels::windowed): a stripe of rows with its own buffers.
//!
//! Box sums of a row follow from the pixel costs of the rows of its window, costs from the box sums of the row or, for
//! [`Method::Sad5`], from those of three. A stripe keeps both for as long as they are needed: `width · lanes` bytes for
//! each of the `n` rows of the window, and as many words for its column sums, its costs and the box sums of 1 or `n` rows.

use std::ops::Range;

use super::aligned::AlignedVec;
use super::blocked::BlockedPixels;
use super::choices::Choices;
use super::features::Features;
use super::params::{MatcherParams, Method, Prefilter};
use super::row_queue::{Direction, MapRows, RowQueue};
use crate::image::ImageRef;
use crate::kernels::Kernels;
use crate::kernels::semi_global::features::PixelRow;
use crate::kernels::windowed::{
    BestRow, BestWindowsRow, BoxRow, PixelCost, PixelCostRow, largest_pixel_cost,
};

/// What every stripe of a frame reads.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub kernels: &'a Kernels,
    pub params: &'a MatcherParams,
    pub left: ImageRef<'a, u8>,
    pub right: ImageRef<'a, u8>,
    pub left_valid: Option<ImageRef<'a, u8>>,
    pub right_valid: Option<ImageRef<'a, u8>>,
}

impl Frame<'_> {
    fn lanes(&self) -> usize {
        self.kernels.lanes(self.params.num_disparities)
    }

    fn width(&self) -> usize {
        self.left.width()
    }

    fn last_row(&self) -> usize {
        self.left.height() - 1
    }

    fn pixel_cost(&self) -> PixelCost {
        match self.params.method {
            Method::Census => PixelCost::Census,
            Method::Bt => PixelCost::SamplingInsensitive,
            Method::Sad | Method::Sad5 | Method::Sgm => PixelCost::Absolute,
        }
    }

    /// The rows of the windows above and below those of row `y`.
    fn corner_rows(&self, y: usize) -> (usize, usize) {
        let distance = self.corner_distance().unwrap_or(0);
        (y.saturating_sub(distance), (y + distance).min(self.last_row()))
    }

    /// How far the windows beside the pixel's own are from it, if there are any, px.
    fn corner_distance(&self) -> Option<usize> {
        (self.params.method == Method::Sad5).then_some(self.params.radius())
    }

    fn blocked_columns(&self) -> usize {
        let everywhere = self.lanes() != self.params.num_disparities
            || self.left_valid.is_some()
            || self.right_valid.is_some();
        // Near the left edge the larger disparities point outside the right image.
        let near_edge = (self.params.min_disparity + self.lanes() - 1).min(self.width());
        if everywhere { self.width() } else { near_edge }
    }
}

/// The buffers of one stripe.
#[derive(Debug, Default)]
pub(super) struct WindowStripe {
    left: Features,
    right: Features,
    /// Per row of the window, pixel costs; row `y` lies at `y` modulo their number.
    pixel_costs: Vec<AlignedVec<u8>>,
    column_sums: AlignedVec<u16>,
    /// Box sums of the rows that costs follow from; row `y` lies at `y` modulo their number.
    boxes: Vec<AlignedVec<u16>>,
    /// Rows whose box sums have been computed, of which the ring has the last.
    summed: Range<usize>,
    costs: AlignedVec<u16>,
    blocked: BlockedPixels,
    choices: Choices<u16>,
}

impl WindowStripe {
    /// Matches the rows of a queue on their way in a direction; row 0 of the map is row `first` of the images.
    pub fn compute(
        &mut self,
        frame: &Frame<'_>,
        first: usize,
        direction: Direction,
        queue: &RowQueue<MapRows<'_>>,
    ) {
        let mut is_ready = false;
        while let Some((rows, MapRows { values, bits, .. })) = queue.take(direction, 1) {
            let y = first + rows.start;
            if !is_ready {
                self.prepare(frame, y, direction);
                is_ready = true;
            }
            self.sum_costs(frame, y, direction);
            self.choose(frame, y);
            let left_valid = frame.left_valid.map(|valid| valid.row(y));
            self.choices.select(frame.kernels, frame.params, left_valid, values, bits);
        }
    }

    /// Sizes the buffers and fills the window with the rows before those of the first box sums.
    fn prepare(&mut self, frame: &Frame<'_>, y: usize, direction: Direction) {
        let (params, width, lanes) = (frame.params, frame.width(), frame.lanes());
        let cells = width * lanes;
        self.left.resize(width, 0);
        self.right.resize(width, params.min_disparity + lanes - 1);
        self.pixel_costs.resize_with(params.block_size, AlignedVec::default);
        self.pixel_costs.iter_mut().for_each(|row| row.reset(cells, 0));
        self.column_sums.reset(cells, 0);
        let distance = frame.corner_distance();
        self.boxes.resize_with(distance.map_or(0, |distance| 2 * distance + 1), AlignedVec::default);
        self.boxes.iter_mut().for_each(|row| row.reset(cells, 0));
        self.costs.reset(cells, 0);
        self.blocked.reset(width, lanes, params);
        self.choices.resize(width, lanes, params.min_disparity);
        let (above, below) = frame.corner_rows(y);
        let first = match direction {
            Direction::Down => above,
            Direction::Up => below,
        };
        self.summed = direction.empty_before(first);
        direction.rows_before(first, params.radius()).for_each(|y| self.enter(frame, y));
    }

    /// Row `y`, clamped to the image, takes the place of the one that entered a window before.
    fn enter(&mut self, frame: &Frame<'_>, y: isize) {
        let Frame { kernels, params, left, right, .. } = *frame;
        let image_row = y.clamp(0, frame.last_row() as isize) as usize;
        self.left.compute(kernels, params, left, image_row);
        self.right.compute(kernels, params, right, image_row);
        let slot = y.rem_euclid(self.pixel_costs.len() as isize) as usize;
        let (width, lanes) = (frame.width(), frame.lanes());
        let windows = if frame.corner_distance().is_some() { 3 } else { 1 };
        kernels.pixel_cost(&mut PixelCostRow {
            lanes,
            cost: frame.pixel_cost(),
            largest: largest_pixel_cost(windows, params.block_size),
            left: compared(params.prefilter, self.left.row(width)),
            right: compared(params.prefilter, self.right.row(width + lanes - 1)),
            pixel_costs: &mut self.pixel_costs[slot],
            column_sums: &mut self.column_sums,
        });
    }

    /// Costs of row `y`, the next one, before anything is blocked.
    fn sum_costs(&mut self, frame: &Frame<'_>, y: usize, direction: Direction) {
        let (lanes, radius) = (frame.lanes(), frame.params.radius());
        let Some(distance) = frame.corner_distance() else {
            self.enter(frame, direction.entering_and_leaving(y, radius).0);
            let Self { column_sums, costs: boxes, .. } = self;
            frame.kernels.boxes(&mut BoxRow { lanes, radius, column_sums, boxes });
            return;
        };
        let (above, below) = frame.corner_rows(y);
        while let Some(row) = direction.next_after(&self.summed, above..below + 1) {
            self.enter(frame, direction.entering_and_leaving(row, radius).0);
            let slot = row % self.boxes.len();
            let (column_sums, boxes) = (&self.column_sums, &mut self.boxes[slot]);
            frame.kernels.boxes(&mut BoxRow { lanes, radius, column_sums, boxes });
            self.summed = self.summed.start.min(row)..self.summed.end.max(row + 1);
        }
        let [above, middle, below] = [above, y, below].map(|row| &*self.boxes[row % self.boxes.len()]);
        let costs = &mut self.costs;
        frame.kernels.best_windows(&mut BestWindowsRow {
            lanes,
            radius: distance,
            above,
            middle,
            below,
            costs,
        });
    }

    fn choose(&mut self, frame: &Frame<'_>, y: usize) {
        self.blocked.read([frame.left_valid, frame.right_valid], y);
        frame.kernels.best(&mut BestRow {
            lanes: frame.lanes(),
            blocked_columns: frame.blocked_columns(),
            blocked_left: &self.blocked.left,
            blocked_right: &self.blocked.right,
            blocked_lanes: &self.blocked.lanes,
            uniqueness_ratio: frame.params.uniqueness_ratio.into(),
            left_right_reach: frame.params.left_right_reach(),
            costs: &mut self.costs,
            chosen: &mut self.choices.chosen,
            rivals: &mut self.choices.rivals,
            nearby: &mut self.choices.nearby,
            right_best: &mut self.choices.right_best,
        });
    }
}

/// Without a prefilter, grey values take the place of the filtered ones, and none are beside them.
fn compared(prefilter: Prefilter, row: PixelRow<'_>) -> PixelRow<'_> {
    match prefilter {
        Prefilter::XSobel => row,
        Prefilter::None => PixelRow { filtered: row.grey, grey: row.filtered, ..row },
    }
}
