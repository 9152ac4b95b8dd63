//! A stripe of rows: everything that happens row by row, with its own buffers.
//!
//! The largest of them holds the column sums: `2·width·lanes` bytes, where lanes are disparities rounded up to whole
//! vectors, and twice that where sums need 32 bits. Without vectors, or with 32 bits, a row of costs is kept too, as large
//! again. Nothing grows with the height but the images and the map.

use std::ops::Range;

use super::aligned::AlignedVec;
use super::blocked::BlockedPixels;
use super::choices::Choices;
use super::coarse::CoarseCosts;
use super::map::Validity;
use super::params::MatcherParams;
use super::prepared::PreparedPair;
use super::row_queue::{Direction, MapRows, RowQueue};
use super::texture::TextureSums;
use crate::image::ImageRef;
use crate::kernels::sad::{AddRow, RowPair, RowShape, SadRow, blocked_groups};
use crate::kernels::{CostKernels, Kernels};

/// What every stripe of a frame reads.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub kernels: &'a Kernels,
    pub params: &'a MatcherParams,
    pub pair: &'a PreparedPair,
    pub left_valid: Option<ImageRef<'a, u8>>,
    pub right_valid: Option<ImageRef<'a, u8>>,
    /// What is known from half the resolution.
    pub coarse: Option<&'a CoarseCosts>,
    /// Columns from here on are matched; what is left of them is there for the right image's sake.
    pub first_column: usize,
}

impl Frame<'_> {
    fn shape(&self) -> RowShape {
        let params = self.params;
        let lanes = self.kernels.lanes(params.num_disparities);
        RowShape {
            width: self.pair.width() - self.first_column,
            lanes,
            radius: params.radius(),
            largest_difference: params.largest_difference(),
            uniqueness_ratio: params.uniqueness_ratio.into(),
            left_right_reach: params.left_right_reach(),
        }
    }

    /// A row of both images from the first column on.
    fn row(&self, y: isize) -> RowPair<'_> {
        let RowPair { left, right } = self.pair.row(y);
        RowPair { left: &left[self.first_column..], right: &right[self.first_column..] }
    }

    /// So too of the left image's x-Sobel.
    fn texture_row(&self, y: isize) -> &[u8] {
        &self.pair.texture_row(y)[self.first_column..]
    }
}

/// The buffers of one stripe, for costs of type `C`.
#[derive(Debug, Default)]
pub(super) struct Stripe<C> {
    column_sums: AlignedVec<C>,
    coarse: AlignedVec<u16>,
    /// The row at half the resolution that they are of.
    coarse_row: Option<usize>,
    scratch: AlignedVec<C>,
    blocked: BlockedPixels,
    blocked_groups: Vec<u8>,
    choices: Choices<C>,
    texture: TextureSums,
}

impl<C: CostKernels> Stripe<C> {
    /// Matches the rows of a queue on their way in a direction; row 0 of the map is row `first` of the images.
    pub fn compute(
        &mut self,
        frame: &Frame<'_>,
        first: usize,
        direction: Direction,
        queue: &RowQueue<MapRows<'_>>,
    ) {
        let shape = frame.shape();
        let mut is_ready = false;
        while let Some((rows, MapRows { values, bits, .. })) = queue.take(direction, 1) {
            let y = first + rows.start;
            if !is_ready {
                self.prepare(frame, &shape, direction.rows_before(y, shape.radius));
                is_ready = true;
            }
            self.refine(frame, y);
            let columns = frame.first_column..;
            self.compute_row(frame, shape, y, direction, &mut values[columns.clone()], &mut bits[columns]);
        }
    }

    /// Sizes the buffers and fills the window with some rows.
    fn prepare(&mut self, frame: &Frame<'_>, shape: &RowShape, rows: Range<isize>) {
        let RowShape { width, lanes, radius, .. } = *shape;
        self.column_sums.reset(width * lanes, C::ZERO);
        self.coarse.reset(if frame.coarse.is_some() { width.div_ceil(2) * lanes } else { 0 }, 0);
        self.coarse_row = None;
        self.scratch.reset(C::scratch_len(frame.kernels, shape), C::BLOCKED);
        self.blocked.reset(frame.pair.width(), lanes, frame.params);
        self.find_blocked_groups(frame, lanes);
        let border = frame.params.min_disparity.saturating_sub(frame.first_column);
        self.choices.resize(width, lanes, border);
        self.texture.reset(width, radius);
        for y in rows {
            C::add(
                frame.kernels,
                &mut AddRow { lanes, row: frame.row(y), column_sums: &mut self.column_sums },
            );
            if frame.params.texture_threshold > 0 {
                self.texture.enter(frame.texture_row(y), frame.params.prefilter_cap);
            }
        }
    }

    fn find_blocked_groups(&mut self, frame: &Frame<'_>, lanes: usize) {
        let BlockedPixels { left, right, .. } = &self.blocked;
        let columns = frame.first_column..;
        blocked_groups(&left[columns.clone()], &right[columns], lanes, &mut self.blocked_groups);
    }

    /// What is known of row `y` from half the resolution; it is the same for two rows.
    fn refine(&mut self, frame: &Frame<'_>, y: usize) {
        if let Some(coarse) = frame.coarse
            && self.coarse_row != Some(y / 2)
        {
            coarse.refine(frame, y / 2, &mut self.coarse);
            self.coarse_row = Some(y / 2);
        }
    }

    fn compute_row(
        &mut self,
        frame: &Frame<'_>,
        shape: RowShape,
        y: usize,
        direction: Direction,
        values: &mut [u16],
        bits: &mut [u8],
    ) {
        let Frame { kernels, params, first_column, .. } = *frame;
        let (entering_y, leaving_y) = direction.entering_and_leaving(y, shape.radius);
        if frame.left_valid.is_some() || frame.right_valid.is_some() {
            self.blocked.read([frame.left_valid, frame.right_valid], y);
            self.find_blocked_groups(frame, shape.lanes);
        }
        C::sad(
            kernels,
            &mut SadRow {
                shape,
                entering: frame.row(entering_y),
                leaving: frame.row(leaving_y),
                blocked_left: &self.blocked.left[first_column..],
                blocked_right: &self.blocked.right[first_column..],
                blocked_groups: &self.blocked_groups,
                blocked_lanes: &self.blocked.lanes,
                coarse: &self.coarse,
                column_sums: &mut self.column_sums,
                scratch: &mut self.scratch,
                chosen: &mut self.choices.chosen,
                rivals: &mut self.choices.rivals,
                nearby: &mut self.choices.nearby,
                right_best: &mut self.choices.right_best,
            },
        );
        let left_valid = frame.left_valid.map(|valid| &valid.row(y)[first_column..]);
        self.choices.select(kernels, params, left_valid, values, bits);
        if params.texture_threshold > 0 {
            let (level, threshold) = (params.prefilter_cap, params.texture_threshold);
            self.texture.enter(frame.texture_row(entering_y), level);
            self.texture.leave(frame.texture_row(leaving_y), level);
            let (bit, except) = (Validity::LOW_TEXTURE, Validity::NO_CANDIDATE);
            self.texture.mark(kernels, threshold, bit, except, bits);
        }
    }
}
