//! The best candidates of a row, and their disparities.

use super::left_right;
use super::map::Validity;
use super::params::MatcherParams;
use crate::kernels::sad::Choice;
use crate::kernels::select::SelectRow;
use crate::kernels::{CostKernels, Kernels};

/// What a kernel tells about the best candidates of a row: see [`SadRow`](crate::kernels::sad::SadRow).
#[derive(Debug, Default)]
pub(super) struct Choices<C> {
    pub chosen: Vec<Choice<C>>,
    pub rivals: Vec<u16>,
    pub nearby: Vec<C>,
    pub right_best: Vec<C>,
    lanes: usize,
    /// So many columns on the left have no disparity asked for inside the right image.
    border: usize,
}

impl<C: CostKernels> Choices<C> {
    /// For rows of `width` pixels with so many lanes, `border` of which see nothing of the right image.
    pub fn resize(&mut self, width: usize, lanes: usize, border: usize) {
        self.lanes = lanes;
        self.border = border.min(width);
        self.chosen.resize(width, Choice::NONE);
        self.rivals.resize(width, 0);
        self.nearby.resize(width, C::BLOCKED);
        self.right_best.resize(width + lanes - 1, C::BLOCKED);
    }

    /// Disparities and the tests decided by costs. `left_valid` is the row's part of the mask.
    pub fn select(
        &self,
        kernels: &Kernels,
        params: &MatcherParams,
        left_valid: Option<&[u8]>,
        values: &mut [u16],
        bits: &mut [u8],
    ) {
        let row = &mut SelectRow {
            chosen: &self.chosen,
            rivals: &self.rivals,
            first_disparity: (params.min_disparity + self.lanes - 1) as u16,
            subpixel: params.subpixel,
            uniqueness_ratio: params.uniqueness_ratio.into(),
            no_candidate: Validity::NO_SOURCE,
            not_unique: Validity::NOT_UNIQUE,
            values,
            bits,
        };
        C::select(kernels, row);
        let SelectRow { bits, .. } = row;
        // Whatever has a source.
        bits[..self.border].fill(Validity::BORDER);
        if let Some(valid) = left_valid {
            let sourceless = bits.iter_mut().zip(valid).filter(|&(_, &valid)| valid == 0);
            sourceless.for_each(|(bits, _)| *bits |= Validity::NO_SOURCE);
        }
        if params.left_right_reach().is_some() {
            let (bit, except) = (Validity::LEFT_RIGHT, Validity::NO_CANDIDATE);
            left_right::mark(&self.chosen, &self.nearby, &self.right_best, bit, except, bits);
        }
    }
}
