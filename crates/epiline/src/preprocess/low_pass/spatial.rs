//! The filter as sums over neighbours.
//!
//! The spectrum of a line of `n` pixels times `h(k)` is the line convolved, around its ends, with the inverse transform
//! of `h`: about a Gaussian of standard deviation `s = n / 2πσ` pixels. What is blurred that much needs few samples:
//!
//! ```text
//! down    every m-th sample of the line convolved with a Gaussian g of standard deviation 0.85·m
//! middle  convolved with what the other two leave to do: H(k) / G(k)², inverse transform
//! up      zeros between the samples, convolved with m·g
//! ```
//!
//! `m` divides `n`, so that the coarse line goes around too. `g` holds back the frequencies that `down` would fold onto
//! others and the images of them that `up` makes: both by a factor of 1e-5 where `s >= 2.2·m`. The cost hardly depends on
//! σ then.

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

use super::frequency::response;
use super::transpose;
use crate::image::{Image, ImageRef};

/// Standard deviation of the Gaussian before leaving out samples, in steps between those that stay.
const GUARD: f64 = 0.85;
/// Standard deviation of the whole filter that it takes to leave out samples, likewise.
const ENOUGH_BLUR: f64 = 2.2;
/// Standard deviations after which that Gaussian ends; 7e-6 of it are beyond.
const REACH: f64 = 4.5;
/// What a convolution may leave out, as a share of the largest pixel.
const NEGLIGIBLE: f64 = 1e-5;
/// Beyond so many products for a pixel and axis the Fourier transform is not much slower.
const MAX_PRODUCTS: usize = 64;

/// Both axes, the columns' first and last: sums over rows of pixels need no transposition.
pub(super) struct SpatialFilter {
    columns: Axis,
    rows: Axis,
    /// Image of fewer rows, and the same transposed with fewer columns, before and after each stage.
    upright: [Image<f32>; 2],
    lying: [Image<f32>; 2],
    coarse: [Image<f32>; 2],
}

impl SpatialFilter {
    /// `None` where it would not be fast: too little blur, or too few divisors of a side.
    pub fn new(width: usize, height: usize, sigma: f64) -> Option<Self> {
        let (rows, columns) = (Axis::new(width, sigma)?, Axis::new(height, sigma)?);
        let few = height / columns.step;
        Some(Self {
            upright: [(); 2].map(|()| Image::new(width, few)),
            lying: [(); 2].map(|()| Image::new(few, width)),
            coarse: [(); 2].map(|()| Image::new(few, width / rows.step)),
            columns,
            rows,
        })
    }

    /// Both images have the filter's size.
    pub fn apply(&mut self, src: ImageRef<'_, f32>, dst: &mut Image<f32>) {
        let [upright, filtered] = &mut self.upright;
        match &self.columns.change {
            Some(change) => {
                change.down.apply(src, upright);
                self.columns.middle.apply(upright.view(), filtered);
            }
            None => self.columns.middle.apply(src, filtered),
        }

        let [lying, other] = &mut self.lying;
        transpose(filtered, lying);
        match &self.rows.change {
            Some(change) => {
                let [coarse, filtered] = &mut self.coarse;
                change.down.apply(lying.view(), coarse);
                self.rows.middle.apply(coarse.view(), filtered);
                change.up.apply(filtered.view(), other);
            }
            None => self.rows.middle.apply(lying.view(), other),
        }
        match &self.columns.change {
            Some(change) => {
                transpose(other, upright);
                change.up.apply(upright.view(), dst);
            }
            None => transpose(other, dst),
        }
    }
}

/// The filter along one axis.
struct Axis {
    /// One sample of so many stays.
    step: usize,
    middle: Weights,
    /// To and from the coarse line, unless all samples stay.
    change: Option<Change>,
}

struct Change {
    down: Weights,
    up: Weights,
}

impl Axis {
    fn new(len: usize, sigma: f64) -> Option<Self> {
        let blur_px = len as f64 / (std::f64::consts::TAU * sigma);
        let limit = (blur_px / ENOUGH_BLUR).min(len as f64) as usize;
        let step = (1..=limit).rev().find(|step| len.is_multiple_of(*step)).unwrap_or(1);
        let few = len / step;
        let guard = if step > 1 { gaussian(GUARD * step as f64) } else { vec![1.0] };
        let wanted = |k: usize| {
            let held_back = cosine_sum(&guard, std::f64::consts::TAU * k as f64 / len as f64);
            response(k, sigma) / (held_back * held_back)
        };
        let middle = shortened(inverse_transform(&(0..=few / 2).map(wanted).collect::<Vec<_>>(), few));
        let middle = Weights { first: -(middle.len() as isize / 2), step: (1, 1), phases: vec![middle] };
        let change =
            (step > 1).then(|| Change { down: Weights::down(&guard, step), up: Weights::up(&guard, step) });
        let products = |weights: &Weights| weights.phases[0].len();
        let cost = products(&middle).div_ceil(step)
            + change
                .as_ref()
                .map_or(0, |change| products(&change.down).div_ceil(step) + products(&change.up));
        (cost <= MAX_PRODUCTS).then_some(Self { step, middle, change })
    }
}

/// A Gaussian of this standard deviation that sums to 1: weights of the samples on either side of the middle one.
fn gaussian(sigma_px: f64) -> Vec<f32> {
    let reach = (REACH * sigma_px).ceil() as isize;
    let weights = (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp());
    let total: f64 = weights.clone().sum();
    weights.map(|weight| (weight / total) as f32).collect()
}

/// Transform of symmetric weights about their middle, at `omega` radians a sample.
fn cosine_sum(weights: &[f32], omega: f64) -> f64 {
    let middle = (weights.len() / 2) as f64;
    weights
        .iter()
        .enumerate()
        .map(|(i, &weight)| f64::from(weight) * ((i as f64 - middle) * omega).cos())
        .sum()
}

/// Symmetric weights whose transform over `len` samples is `spectrum`: entry 0 is the middle one's.
fn inverse_transform(spectrum: &[f64], len: usize) -> Vec<f64> {
    let mut samples: Vec<_> = spectrum.iter().map(|&value| Complex::new(value / len as f64, 0.0)).collect();
    let mut weights = vec![0.0; len];
    RealFftPlanner::new()
        .plan_fft_inverse(len)
        .process(&mut samples, &mut weights)
        .expect("a real spectrum of half the length");
    weights
}

/// The weights around the middle one that matter, from the leftmost to the rightmost.
fn shortened(around: Vec<f64>) -> Vec<f32> {
    let len = around.len();
    // Each of two sides; of an even number the farthest weight stands on one.
    let mut reach = (len - 1) / 2;
    let mut left_out = if len.is_multiple_of(2) { around[len / 2].abs() } else { 0.0 };
    if left_out > NEGLIGIBLE {
        return (0..len).map(|i| around[(i + len - len / 2) % len] as f32).collect();
    }
    while reach > 0 && left_out + 2.0 * around[reach].abs() <= NEGLIGIBLE {
        left_out += 2.0 * around[reach].abs();
        reach -= 1;
    }
    (0..=2 * reach).map(|i| around[(i + len - reach) % len] as f32).collect()
}

/// Every row of an image as a weighted sum of consecutive rows of another, around its ends.
///
/// Row `i` begins `step.0·(i / step.1)` rows after `first` and has the weights `phases[i % step.1]`.
struct Weights {
    first: isize,
    step: (usize, usize),
    phases: Vec<Vec<f32>>,
}

impl Weights {
    /// Every `step`-th sum with these weights.
    fn down(weights: &[f32], step: usize) -> Self {
        Self { first: -(weights.len() as isize / 2), step: (step, 1), phases: vec![weights.to_vec()] }
    }

    /// Sums with these weights times `step` over samples with `step - 1` zeros between them.
    fn up(weights: &[f32], step: usize) -> Self {
        // Sample j of the coarse line stands at j·step; row i·step + phase sees it with weight reach + phase - j·step.
        let reach = weights.len() as isize / 2;
        let farthest = reach / step as isize + 1;
        let phases = (0..step as isize)
            .map(|phase| {
                (-farthest..=farthest)
                    .map(|j| usize::try_from(reach + phase - j * step as isize).ok())
                    .map(|at| at.and_then(|at| weights.get(at)).map_or(0.0, |weight| weight * step as f32))
                    .collect()
            })
            .collect();
        Self { first: -farthest, step: (1, step), phases }
    }

    fn apply(&self, src: ImageRef<'_, f32>, dst: &mut Image<f32>) {
        /// Pixels summed at a time: few enough to stay in registers.
        const LANES: usize = 32;
        let height = src.height() as isize;
        let width = dst.width();
        for i in 0..dst.height() {
            let weights = &self.phases[i % self.step.1];
            let begin = (self.first + (self.step.0 * (i / self.step.1)) as isize).rem_euclid(height) as usize;
            let out = dst.row_mut(i);
            let (blocks, rest) = out.as_chunks_mut::<LANES>();
            let whole = blocks.len() * LANES;
            for (block, x) in blocks.iter_mut().zip((0..whole).step_by(LANES)) {
                let mut sums = [0.0_f32; LANES];
                let mut y = begin;
                for &weight in weights {
                    let pixels: &[f32; LANES] =
                        src.row(y)[x..x + LANES].try_into().expect("as many as there are sums");
                    for (sum, pixel) in sums.iter_mut().zip(pixels) {
                        *sum += weight * pixel;
                    }
                    y = if y + 1 == height as usize { 0 } else { y + 1 };
                }
                *block = sums;
            }
            rest.fill(0.0);
            let mut y = begin;
            for &weight in weights {
                for (sum, pixel) in rest.iter_mut().zip(&src.row(y)[whole..width]) {
                    *sum += weight * pixel;
                }
                y = if y + 1 == height as usize { 0 } else { y + 1 };
            }
        }
    }
}
