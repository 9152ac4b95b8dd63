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
use super::texture::TextureSums;
use crate::image::ImageRef;
use crate::kernels::sad::{AddRow, RowShape, SadRow};
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
}

impl Frame<'_> {
    fn shape(&self) -> RowShape {
        let params = self.params;
        let lanes = self.kernels.lanes(params.num_disparities);
        let width = self.pair.width();
        let everywhere =
            lanes != params.num_disparities || self.left_valid.is_some() || self.right_valid.is_some();
        // Near the left edge the larger disparities point outside the right image.
        let near_edge = (params.min_disparity + lanes - 1).min(width);
        RowShape {
            width,
            lanes,
            radius: params.radius(),
            largest_difference: params.largest_difference(),
            blocked_columns: if everywhere { width } else { near_edge },
            uniqueness_ratio: params.uniqueness_ratio.into(),
            left_right_reach: params.left_right_reach(),
        }
    }
}

/// The buffers of one stripe, for costs of type `C`.
#[derive(Debug, Default)]
pub(super) struct Stripe<C> {
    column_sums: AlignedVec<C>,
    coarse: AlignedVec<u16>,
    scratch: AlignedVec<C>,
    blocked: BlockedPixels,
    choices: Choices<C>,
    texture: TextureSums,
}

impl<C: CostKernels> Stripe<C> {
    /// Matches some rows. `values` and `bits` hold those rows of the disparity map.
    pub fn compute(&mut self, frame: &Frame<'_>, rows: Range<usize>, values: &mut [u16], bits: &mut [u8]) {
        let shape = frame.shape();
        self.prepare(frame, &shape, rows.start);
        let outputs = values.chunks_exact_mut(shape.width).zip(bits.chunks_exact_mut(shape.width));
        for (y, (values, bits)) in rows.clone().zip(outputs) {
            if let Some(coarse) = frame.coarse
                && (y == rows.start || y.is_multiple_of(2))
            {
                coarse.refine(frame, y / 2, &mut self.coarse);
            }
            self.compute_row(frame, shape, y, values, bits);
        }
    }

    /// Sizes the buffers and fills the window with the rows above the first.
    fn prepare(&mut self, frame: &Frame<'_>, shape: &RowShape, first_row: usize) {
        let RowShape { width, lanes, radius, .. } = *shape;
        self.column_sums.reset(width * lanes, C::ZERO);
        self.coarse.reset(if frame.coarse.is_some() { width.div_ceil(2) * lanes } else { 0 }, 0);
        self.scratch.reset(C::scratch_len(frame.kernels, shape), C::BLOCKED);
        self.blocked.reset(width, lanes, frame.params);
        self.choices.resize(width, lanes);
        self.texture.reset(width, radius);

        let (first_row, radius) = (first_row as isize, radius as isize);
        for y in first_row - radius - 1..first_row + radius {
            C::add(
                frame.kernels,
                &mut AddRow { lanes, row: frame.pair.row(y), column_sums: &mut self.column_sums },
            );
            if frame.params.texture_threshold > 0 {
                self.texture.enter(frame.pair.texture_row(y), frame.params.prefilter_cap);
            }
        }
    }

    fn compute_row(
        &mut self,
        frame: &Frame<'_>,
        shape: RowShape,
        y: usize,
        values: &mut [u16],
        bits: &mut [u8],
    ) {
        let Frame { kernels, params, pair, .. } = *frame;
        let (entering_y, leaving_y) =
            (y as isize + shape.radius as isize, y as isize - shape.radius as isize - 1);
        self.blocked.read([frame.left_valid, frame.right_valid], y);
        C::sad(
            kernels,
            &mut SadRow {
                shape,
                entering: pair.row(entering_y),
                leaving: pair.row(leaving_y),
                blocked_left: &self.blocked.left,
                blocked_right: &self.blocked.right,
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
        self.choices.select(kernels, params, frame.left_valid.map(|valid| valid.row(y)), values, bits);
        if params.texture_threshold > 0 {
            let (level, threshold) = (params.prefilter_cap, params.texture_threshold);
            self.texture.enter(pair.texture_row(entering_y), level);
            self.texture.leave(pair.texture_row(leaving_y), level);
            let (bit, except) = (Validity::LOW_TEXTURE, Validity::NO_CANDIDATE);
            self.texture.mark(kernels, threshold, bit, except, bits);
        }
    }
}
