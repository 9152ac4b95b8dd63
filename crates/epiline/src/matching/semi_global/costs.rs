//! Matching costs, row by row.

use std::ops::Range;

use super::Frame;
use crate::image::ImageRef;
use crate::kernels::semi_global::features::{
    CENSUS_BYTES, CENSUS_RADIUS, CensusRow, Channel, ExtremesRow, PixelRow,
};
use crate::kernels::semi_global::{CostRow, NO_CANDIDATE, WindowRow};
use crate::matching::aligned::AlignedVec;
use crate::matching::params::Prefilter;
use crate::preprocess::xsobel_row;

/// The window's pixel costs and their sums, for one job.
#[derive(Debug, Default)]
pub(super) struct CostRows {
    left: Features,
    right: Features,
    /// Per row of the window, pixel costs; row `y` lies at `y` modulo their number.
    pixel_costs: Vec<AlignedVec<u8>>,
    column_sums: AlignedVec<u16>,
    blocked_left: Vec<u8>,
    blocked_right: Vec<u8>,
    blocked_lanes: Vec<u8>,
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
        self.blocked_left = vec![0; width];
        self.blocked_right = vec![0; width + lanes - 1];
        let outside = frame.first_disparity().min(self.blocked_right.len());
        self.blocked_right[..outside].fill(NO_CANDIDATE);
        self.blocked_lanes = vec![0; lanes];
        self.blocked_lanes[..lanes - frame.params.num_disparities].fill(NO_CANDIDATE);
        self.row = None;
    }

    /// Matching costs of some rows, `width * lanes` each.
    pub fn compute(&mut self, frame: &Frame<'_>, rows: Range<usize>, costs: &mut [u8]) {
        let (lanes, radius) = (frame.lanes(), frame.params.radius());
        for (y, costs) in rows.zip(costs.chunks_exact_mut(frame.width() * lanes)) {
            self.move_to(frame, y);
            if let Some(valid) = frame.left_valid {
                block(&mut self.blocked_left, valid.row(y));
            }
            if let Some(valid) = frame.right_valid
                && let Some(inside) = self.blocked_right.get_mut(frame.first_disparity()..)
            {
                block(inside, valid.row(y));
            }
            frame.kernels.window(&mut WindowRow {
                lanes,
                radius,
                column_sums: &self.column_sums,
                blocked_left: &self.blocked_left,
                blocked_right: &self.blocked_right,
                blocked_lanes: &self.blocked_lanes,
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
        self.left.compute(frame, frame.left, image_row);
        self.right.compute(frame, frame.right, image_row);
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

/// Pixels without source become blocked.
fn block(blocked: &mut [u8], valid: &[u8]) {
    for (blocked, &valid) in blocked.iter_mut().zip(valid) {
        *blocked = if valid == 0 { NO_CANDIDATE } else { 0 };
    }
}

/// What the pixels of one row are compared by, in planes that begin with `padding` copies of their first pixel's.
#[derive(Debug, Default)]
struct Features {
    padding: usize,
    filtered: [Vec<u8>; 3],
    grey: [Vec<u8>; 3],
    census: [Vec<u8>; CENSUS_BYTES],
    /// Rows of the census window, extended to both sides.
    extended: [Vec<u8>; 2 * CENSUS_RADIUS + 1],
}

impl Features {
    fn resize(&mut self, width: usize, padding: usize) {
        self.padding = padding;
        let planes = self.filtered.iter_mut().chain(&mut self.grey).chain(&mut self.census);
        planes.for_each(|plane| plane.resize(padding + width, 0));
        self.extended.iter_mut().for_each(|row| row.resize(width + 2 * CENSUS_RADIUS, 0));
    }

    fn compute(&mut self, frame: &Frame<'_>, image: ImageRef<'_, u8>, y: usize) {
        let (kernels, padding) = (frame.kernels, self.padding);
        match frame.params.prefilter {
            // Grey values are compared in any case.
            Prefilter::None => self.filtered[0].fill(0),
            Prefilter::XSobel => {
                let filtered = &mut self.filtered[0][padding..];
                xsobel_row(kernels, image, y, frame.params.prefilter_cap, filtered);
            }
        }
        self.grey[0][padding..].copy_from_slice(image.row(y));
        for [value, low, high] in [&mut self.filtered, &mut self.grey] {
            kernels.extremes(&mut ExtremesRow {
                value: &value[padding..],
                low: &mut low[padding..],
                high: &mut high[padding..],
            });
        }
        let last = image.height() as isize - 1;
        for (j, extended) in self.extended.iter_mut().enumerate() {
            let row = image.row((y as isize + j as isize - CENSUS_RADIUS as isize).clamp(0, last) as usize);
            let (front, rest) = extended.split_at_mut(CENSUS_RADIUS);
            let (inside, back) = rest.split_at_mut(row.len());
            front.fill(row[0]);
            inside.copy_from_slice(row);
            back.fill(row[row.len() - 1]);
        }
        kernels.census(&mut CensusRow {
            rows: self.extended.each_ref().map(Vec::as_slice),
            planes: self.census.each_mut().map(|plane| &mut plane[padding..]),
        });
        for plane in self.filtered.iter_mut().chain(&mut self.grey).chain(&mut self.census) {
            let first = plane[padding];
            plane[..padding].fill(first);
        }
    }

    /// The first `len` pixels.
    fn row(&self, len: usize) -> PixelRow<'_> {
        fn cut(planes: &[Vec<u8>; 3], len: usize) -> Channel<'_> {
            let [value, low, high] = planes;
            Channel { value: &value[..len], low: &low[..len], high: &high[..len] }
        }
        PixelRow {
            filtered: cut(&self.filtered, len),
            grey: cut(&self.grey, len),
            census: self.census.each_ref().map(|plane| &plane[..len]),
        }
    }
}
