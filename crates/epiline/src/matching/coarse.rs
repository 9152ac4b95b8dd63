//! Costs at half the resolution, which steer window sums at the full one.
//!
//! A window decides by itself; where it sees too little, semi-global matching knows more from its surroundings, and at half
//! the resolution that costs an eighth. So window sums get
//!
//! `C'(x, y, d) = C(x, y, d) + w·n²·(S(x/2, y/2, d/2) - min_k S(x/2, y/2, k))`
//!
//! with the window's area `n²`, the weight `w` of [`MatcherParams::coarse_weight`], and the path sums `S` of
//! [`semi_global`](super::semi_global) over three paths in images of half the size, whose excess is truncated at 255. At
//! odd `d`, the excess is the mean of that at both neighbours, rounded up. It says where to look, and hardly favours a disparity over
//! its neighbour, so that the sub-pixel position remains the window's.

use super::aligned::AlignedVec;
use super::crew::Crew;
use super::params::{MatcherParams, Method};
use super::semi_global::{Frame, Penalties, SemiGlobal};
use super::stripe;
use crate::image::{Image, ImageRef};
use crate::kernels::coarse::{RefineRow, padding};
use crate::kernels::{Kernels, Level};

/// The excess of path sums in images of half the size.
#[derive(Debug)]
pub(super) struct CoarseCosts {
    level: Level,
    kernels: Kernels,
    params: MatcherParams,
    penalties: Penalties,
    semi_global: SemiGlobal,
    images: [Image<u8>; 2],
    valid: [Image<u8>; 2],
    /// Padding, then per row: half the width times the lanes.
    excess: AlignedVec<u8>,
    weight: u16,
}

impl CoarseCosts {
    /// For a matcher at that level.
    pub fn new(level: Level) -> Self {
        let params = MatcherParams::for_method(Method::Sgm);
        Self {
            level,
            kernels: Kernels::new(level),
            params,
            penalties: Penalties::new(params.p1, params.p2),
            semi_global: SemiGlobal::default(),
            images: [Image::new(0, 0), Image::new(0, 0)],
            valid: [Image::new(0, 0), Image::new(0, 0)],
            excess: AlignedVec::default(),
            weight: 0,
        }
    }

    /// Matches a pair at half the resolution, for the disparities that `params` asks for at the full one.
    pub fn compute(
        &mut self,
        params: &MatcherParams,
        [left, right]: [ImageRef<'_, u8>; 2],
        [left_valid, right_valid]: [Option<ImageRef<'_, u8>>; 2],
        crew: &Crew,
    ) {
        let (first, last) = (params.min_disparity, params.min_disparity + params.num_disparities - 1);
        self.params = MatcherParams {
            min_disparity: first / 2,
            num_disparities: last / 2 - first / 2 + 1,
            block_size: 3,
            prefilter: params.prefilter,
            prefilter_cap: 15,
            paths: 3,
            p1: 48,
            p2: 127,
            ..MatcherParams::for_method(Method::Sgm)
        };
        self.kernels = fewest_lanes(self.level, self.params.num_disparities);
        self.penalties = Penalties::new(self.params.p1, self.params.p2);
        self.weight = params.coarse_cost_weight();
        let halves = self.images.iter_mut().zip([left, right]).map(|(half, image)| {
            move || {
                halve(image, half, |pixels| {
                    (pixels.map(u16::from).iter().sum::<u16>() + 2).div_euclid(4) as u8
                })
            }
        });
        crew.run_all(halves);
        let [half_left, half_right] = self.images.each_ref().map(Image::view);
        // A coarse pixel has a source if any of its pixels has: no candidate is lost.
        let mut masks = [None, None];
        for ((half, valid), mask) in self.valid.iter_mut().zip([left_valid, right_valid]).zip(&mut masks) {
            if let Some(valid) = valid {
                halve(valid, half, |pixels| pixels.into_iter().fold(0, |any, pixel| any | pixel));
                *mask = Some(half.view());
            }
        }
        let [left_valid, right_valid] = masks;
        let lanes = self.kernels.lanes(self.params.num_disparities);
        let padding = padding(lanes, Kernels::new(self.level).lanes(params.num_disparities));
        self.excess.resize(padding + half_left.width() * half_left.height() * lanes, 0);
        let frame = Frame {
            kernels: &self.kernels,
            params: &self.params,
            penalties: &self.penalties,
            left: half_left,
            right: half_right,
            left_valid,
            right_valid,
        };
        self.semi_global.compute_excess(&frame, crew, &mut self.excess[padding..]);
    }

    /// What coarse row `y` adds to the costs of a frame.
    pub fn refine(&self, frame: &stripe::Frame<'_>, y: usize, added: &mut [u16]) {
        let lanes = frame.kernels.lanes(frame.params.num_disparities);
        let coarse_lanes = self.kernels.lanes(self.params.num_disparities);
        let cells = self.images[0].width() * coarse_lanes;
        let padding = padding(coarse_lanes, lanes);
        frame.kernels.refine(&mut RefineRow {
            coarse_lanes,
            weight: self.weight,
            costs: &self.excess[y * cells..(y + 1) * cells + padding],
            lanes,
            num_disparities: frame.params.num_disparities,
            starts_odd: (frame.params.min_disparity + lanes).is_multiple_of(2),
            added,
        });
    }
}

/// Kernels up to `level` with the fewest lanes for so many disparities: half a vector of costs is no faster than a whole
/// one, and the path through it as long.
fn fewest_lanes(level: Level, num_disparities: usize) -> Kernels {
    Level::available().filter(|&lower| Level::SCALAR < lower && lower < level).map(Kernels::new).fold(
        Kernels::new(level),
        |best, kernels| {
            if kernels.lanes(num_disparities) < best.lanes(num_disparities) { kernels } else { best }
        },
    )
}

/// Each pixel of the half-size image from four; beyond an odd side, the last is repeated.
fn halve(image: ImageRef<'_, u8>, half: &mut Image<u8>, of_four: impl Fn([u8; 4]) -> u8) {
    let (width, height) = (image.width(), image.height());
    half.resize(width.div_ceil(2), height.div_ceil(2));
    for y in 0..height.div_ceil(2) {
        let (above, below) = (image.row(2 * y), image.row((2 * y + 1).min(height - 1)));
        let (above, below) = (&above[..width], &below[..width]);
        let half_row = half.row_mut(y);
        let ((above, above_rest), (below, below_rest)) = (above.as_chunks::<2>(), below.as_chunks::<2>());
        for ((half, &[a, b]), &[c, d]) in half_row.iter_mut().zip(above).zip(below) {
            *half = of_four([a, b, c, d]);
        }
        if let (&[a], &[c]) = (above_rest, below_rest) {
            half_row[width / 2] = of_four([a, a, c, c]);
        }
    }
}
