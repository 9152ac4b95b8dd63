//! The filter of one axis as weights.
//!
//! The spectrum of a line of `n` pixels times `h(k)` is the line convolved, around its ends, with the inverse transform
//! of `h`: about a Gaussian of standard deviation `s = n / 2πσ` pixels. A wide Gaussian is two narrower ones in turn, each
//! of `s/√2`, and what the first leaves needs few samples:
//!
//! ```text
//! down   c samples of the line convolved with a Gaussian of s/√2, evenly spaced by m = n/c pixels: c·m = n
//! up     n pixels of those samples convolved with m times the same Gaussian
//! ```
//!
//! c need not divide n, since weights are kept for every sample. A frequency ω that leaving out samples takes for
//! `ω − 2π/m` passes both Gaussians by no more than `exp(-(πs/m)²/2)`, which is what [`OVERSAMPLING`] chooses.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

use super::frequency::response;
use crate::kernels::weighted::{Group, SUMS};

/// Samples for each standard deviation of the whole filter, s/m.
const OVERSAMPLING: f64 = 1.55;
/// Standard deviations after which a Gaussian ends; 3e-6 of it are beyond.
const REACH: f64 = 4.7;
/// Periods across the image below which every sigma leaves the mean alone.
const ONLY_THE_MEAN: f64 = 0.05;

/// Weighted sums of consecutive samples of a line that goes around, in groups that share their samples.
pub(super) struct Bands {
    pub samples: usize,
    pub sums: usize,
    groups: Vec<Group>,
}

/// One sum: its first sample, which may lie before the line, and the weights from there on.
struct Line {
    first: isize,
    weights: Vec<f64>,
}

impl Bands {
    fn new(samples: usize, lines: &[Line]) -> Self {
        let groups = lines.chunks(SUMS).map(|lines| group_of(samples, lines)).collect();
        Self { samples, sums: lines.len(), groups }
    }

    /// Products for all sums.
    pub fn products(&self) -> usize {
        self.groups.iter().map(|group| group.weights.len() * SUMS).sum()
    }

    /// Most samples that a group counts.
    pub fn longest(&self) -> usize {
        self.groups.iter().map(|group| group.weights.len()).max().expect("a line has a sample")
    }

    /// The groups from sum `first` on, the first of its group, up to sum `end`.
    pub fn groups(&self, first: usize, end: usize) -> &[Group] {
        &self.groups[first / SUMS..end.div_ceil(SUMS)]
    }
}

/// The sums of a group, which lie close together.
fn group_of(samples: usize, lines: &[Line]) -> Group {
    let first = lines.iter().map(|line| line.first).min().expect("a group has a sum");
    let end = lines.iter().map(|line| line.first + line.weights.len() as isize).max().expect("likewise");
    // What goes around more than once counts each sample once, with the weights of all its turns.
    let length = ((end - first) as usize).min(samples);
    let mut weights = vec![[0.0_f64; SUMS]; length];
    for (i, line) in lines.iter().enumerate() {
        let before = (line.first - first) as usize;
        for (k, weight) in line.weights.iter().enumerate() {
            weights[(before + k) % length][i] += weight;
        }
    }
    let weights = weights.into_iter().map(|weights| weights.map(|weight| weight as f32)).collect();
    Group { first: first.rem_euclid(samples as isize) as usize, weights }
}

/// The filter of an axis.
pub(super) enum Axis {
    /// All samples convolved.
    Direct(Bands),
    /// Down and up.
    Coarse(Bands, Bands),
}

impl Axis {
    /// The way of fewer products, where every sample between down and up takes some more besides. A convolution with all
    /// samples leaves out no more than `left_out` of the largest pixel.
    pub fn cheapest(len: usize, sigma: f64, left_out: f64, besides: f64) -> Self {
        let sigma = sigma.max(ONLY_THE_MEAN);
        let blur_px = len as f64 / (TAU * sigma);
        let count = (OVERSAMPLING * len as f64 / blur_px).ceil() as usize;
        let coarse = (count < len).then(|| Self::coarse(len, blur_px, count));
        match coarse {
            // A convolution that goes around is dearer than few samples.
            Some(coarse) if REACH * blur_px > len as f64 => coarse,
            coarse => {
                let direct = Self::direct(len, sigma, left_out);
                let cost = |axis: &Self| axis.products() as f64 + besides * axis.between() as f64;
                coarse.filter(|coarse| cost(coarse) < cost(&direct)).unwrap_or(direct)
            }
        }
    }

    fn direct(len: usize, sigma: f64, left_out: f64) -> Self {
        let weights = shortened(&inverse_transform(len, sigma), left_out);
        let before = weights.len() as isize / 2;
        let lines: Vec<Line> =
            (0..len as isize).map(|i| Line { first: i - before, weights: weights.clone() }).collect();
        Self::Direct(Bands::new(len, &lines))
    }

    fn coarse(len: usize, blur_px: f64, count: usize) -> Self {
        let (step_px, gaussian_px) = (len as f64 / count as f64, blur_px * FRAC_1_SQRT_2);
        let down: Vec<Line> = (0..count).map(|j| gaussian(j as f64 * step_px, gaussian_px)).collect();
        let up: Vec<Line> = (0..len).map(|x| gaussian(x as f64 / step_px, gaussian_px / step_px)).collect();
        Self::Coarse(Bands::new(len, &down), Bands::new(count, &up))
    }

    /// Samples after the first sums.
    pub fn between(&self) -> usize {
        let (Self::Direct(first) | Self::Coarse(first, _)) = self;
        first.sums
    }

    /// Products for the whole axis.
    pub fn products(&self) -> usize {
        match self {
            Self::Direct(bands) => bands.products(),
            Self::Coarse(down, up) => down.products() + up.products(),
        }
    }
}

/// A Gaussian of weights that add up to 1, about a place between samples.
fn gaussian(centre: f64, sigma: f64) -> Line {
    let first = (centre - REACH * sigma).ceil();
    let last = (centre + REACH * sigma).floor();
    let weight = |i: isize| (-0.5 * ((i as f64 - centre) / sigma).powi(2)).exp();
    let weights: Vec<f64> = (first as isize..=last as isize).map(weight).collect();
    let total: f64 = weights.iter().sum();
    Line { first: first as isize, weights: weights.into_iter().map(|weight| weight / total).collect() }
}

/// Symmetric weights around a line whose transform is the response: entry 0 is the middle one's.
fn inverse_transform(len: usize, sigma: f64) -> Vec<f64> {
    let mut samples: Vec<_> =
        (0..=len / 2).map(|k| Complex::new(response(k, sigma) / len as f64, 0.0)).collect();
    let mut weights = vec![0.0; len];
    RealFftPlanner::new()
        .plan_fft_inverse(len)
        .process(&mut samples, &mut weights)
        .expect("a real spectrum of half the length");
    weights
}

/// The weights around the middle one, from the leftmost to the rightmost, without outer ones of no more than `negligible`.
fn shortened(around: &[f64], negligible: f64) -> Vec<f64> {
    let len = around.len();
    let from_middle = |before: usize, count: usize| (0..count).map(move |i| around[(i + len - before) % len]);
    // Of an even number the farthest weight stands on one side only.
    let mut left_out = if len.is_multiple_of(2) { around[len / 2].abs() } else { 0.0 };
    if left_out > negligible {
        return from_middle(len / 2, len).collect();
    }
    let mut reach = (len - 1) / 2;
    while reach > 0 && left_out + 2.0 * around[reach].abs() <= negligible {
        left_out += 2.0 * around[reach].abs();
        reach -= 1;
    }
    from_middle(reach, 2 * reach + 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Adds what the bands make of the line that is one at `at` and else zero.
    fn impulse(bands: &Bands, line: &[f64]) -> Vec<f64> {
        let sum = |i: usize| {
            let Group { first, weights } = &bands.groups[i / SUMS];
            let products = weights
                .iter()
                .enumerate()
                .map(|(k, w)| f64::from(w[i % SUMS]) * line[(first + k) % line.len()]);
            products.sum()
        };
        (0..bands.sums).map(sum).collect()
    }

    /// The largest error of an axis over all lines of magnitudes up to one: the sum over columns of |operator − filter|.
    fn worst_case(len: usize, sigma: f64, axis: &Axis) -> f64 {
        let exact = inverse_transform(len, sigma);
        let mut errors = vec![0.0_f64; len];
        for at in 0..len {
            let mut line = vec![0.0; len];
            line[at] = 1.0;
            let answer = match axis {
                Axis::Direct(bands) => impulse(bands, &line),
                Axis::Coarse(down, up) => impulse(up, &impulse(down, &line)),
            };
            for (x, error) in errors.iter_mut().enumerate() {
                *error += (answer[x] - exact[(x + len - at) % len]).abs();
            }
        }
        errors.into_iter().fold(0.0, f64::max)
    }

    #[test]
    fn no_line_is_farther_off_than_what_an_axis_may_leave_out() {
        for len in [60, 97, 320] {
            for blur_px in [1.3, 2.0, 3.1, 4.7, 9.0, 26.0, 80.0, 500.0] {
                let sigma = len as f64 / (TAU * blur_px);
                for left_out in [2e-5, 7e-5] {
                    let axis = Axis::cheapest(len, sigma, left_out, 0.0);
                    let allowed = if matches!(axis, Axis::Direct(_)) { left_out + 1e-6 } else { 2.5e-5 };
                    let worst = worst_case(len, sigma, &axis);
                    assert!(worst <= allowed, "{len} px blurred by {blur_px} px: {worst:e}");
                }
            }
        }
    }

    #[test]
    fn a_flat_line_stays_flat_where_few_samples_are_left() {
        let Axis::Coarse(down, up) = Axis::cheapest(101, 0.7, 2e-5, 0.0) else { panic!("much blur") };
        let flat = impulse(&up, &impulse(&down, &[1.0; 101]));
        assert!(flat.iter().all(|value| (value - 1.0).abs() < 1e-6));
    }
}
