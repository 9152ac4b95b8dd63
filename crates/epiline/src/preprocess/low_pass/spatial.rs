//! The filter as sums over neighbours.
//!
//! The spectrum of a line of `n` pixels times `h(k)` is the line convolved, around its ends, with the inverse transform
//! of `h`: about a Gaussian of standard deviation `s = n / 2πσ` pixels. What is blurred that much needs few samples:
//!
//! ```text
//! down    every m-th sample of the line convolved with a Gaussian g of standard deviation 0.82·m
//! middle  convolved with what the other two leave to do: H(k) / G(k)², inverse transform
//! up      zeros between the samples, convolved with m·g
//! ```
//!
//! `m` divides `n`, so that the coarse line goes around too. `g` holds back the frequencies that `down` would fold onto
//! others and the images of them that `up` makes: both by a factor of 2e-5 where `s >= 1.9·m`. The cost hardly depends on
//! σ then. With `m = 1` there is only the middle.
//!
//! Columns come first and last: `down` leaves fewer rows for everything in between.

use std::f64::consts::TAU;

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

use super::frequency::response;
use crate::image::{Image, ImageRef};
use crate::kernels::weighted::WeightedRow;
use crate::kernels::{Kernels, Level};

/// Standard deviation of the Gaussian before leaving out samples, in steps between those that stay.
const GUARD: f64 = 0.82;
/// Standard deviation of the whole filter that it takes to leave out samples, likewise.
const ENOUGH_BLUR: f64 = 1.9;
/// Standard deviations after which that Gaussian ends; 2e-5 of it are beyond.
const REACH: f64 = 4.3;
/// What a convolution may leave out, as a share of the largest pixel.
const NEGLIGIBLE: f64 = 1e-5;
/// Products for a pixel that it costs as much as to take the samples of a row apart, and to put them together again.
const APART: f64 = 12.0;
/// Beyond so many products for a pixel and axis the Fourier transform is not much slower.
const MAX_PRODUCTS: f64 = 96.0;

/// Both axes.
pub(super) struct SpatialFilter {
    kernels: Kernels,
    columns: ColumnFilter,
    rows: RowFilter,
    /// An image of few rows, filtered along its columns, and then along its rows.
    upright: Image<f32>,
    filtered: Image<f32>,
}

impl SpatialFilter {
    /// `None` where it would not be fast: too little blur, or too few divisors of a side.
    pub fn new(width: usize, height: usize, sigma: f64) -> Option<Self> {
        let (rows, columns) = (Axis::new(width, sigma, APART)?, Axis::new(height, sigma, 0.0)?);
        let few = height / columns.step;
        Some(Self {
            kernels: Kernels::new(Level::current()),
            upright: Image::new(width, few),
            filtered: Image::new(width, few),
            columns: ColumnFilter::new(columns),
            rows: RowFilter::new(width, &rows),
        })
    }

    /// Both images have the filter's size.
    pub fn apply(&mut self, src: ImageRef<'_, f32>, dst: &mut Image<f32>) {
        let Self { kernels, columns, rows, upright, filtered } = self;
        match &mut columns.change {
            None => {
                columns.middle.apply(kernels, src, filtered);
                for y in 0..filtered.height() {
                    rows.apply(kernels, filtered.row(y), dst.row_mut(y));
                }
            }
            Some([down, up]) => {
                down.apply(kernels, src, upright);
                columns.middle.apply(kernels, upright.view(), filtered);
                for y in 0..filtered.height() {
                    rows.apply(kernels, filtered.row(y), upright.row_mut(y));
                }
                up.apply(kernels, upright.view(), dst);
            }
        }
    }
}

/// The weights of an axis.
struct Axis {
    /// One sample of so many stays.
    step: usize,
    /// Of the middle, and of the Gaussian around it unless all samples stay; of an odd number, the middle one is the
    /// sample's own, of an even number the next.
    middle: Vec<f32>,
    guard: Option<Vec<f32>>,
}

impl Axis {
    /// The cheapest way; `None` if that is dear. `apart` is what leaving out samples costs besides, in products.
    fn new(len: usize, sigma: f64, apart: f64) -> Option<Self> {
        let blur_px = len as f64 / (TAU * sigma);
        let limit = (blur_px / ENOUGH_BLUR).min(len as f64) as usize;
        let steps = (1..=limit.max(1)).filter(|step| len.is_multiple_of(*step));
        // The fewest samples that do, or all of them: what lies between is never much cheaper than both.
        let most = steps.max().expect("1 divides everything");
        [1, most]
            .map(|step| Self::with_step(len, sigma, step))
            .into_iter()
            .map(|axis| (axis.products(apart), axis))
            .min_by(|one, other| one.0.total_cmp(&other.0))
            .filter(|(products, _)| *products <= MAX_PRODUCTS)
            .map(|(_, axis)| axis)
    }

    fn with_step(len: usize, sigma: f64, step: usize) -> Self {
        let few = len / step;
        let guard = (step > 1).then(|| gaussian(GUARD * step as f64));
        let left_to_do = |k: usize| {
            let held_back =
                guard.as_ref().map_or(1.0, |guard| cosine_sum(guard, TAU * k as f64 / len as f64));
            response(k, sigma) / (held_back * held_back)
        };
        let middle = shortened(&inverse_transform(&(0..=few / 2).map(left_to_do).collect::<Vec<_>>(), few));
        Self { step, middle, guard }
    }

    /// Products for a pixel, about.
    fn products(&self, apart: f64) -> f64 {
        let of_guard = |guard: &Vec<f32>| apart + 2.0 * guard.len() as f64 / self.step as f64;
        let change = self.guard.as_ref().map_or(0.0, of_guard);
        change + self.middle.len() as f64 / self.step as f64
    }

    /// For each place between two coarse samples, the weights of the coarse samples from `reach_up` before to as many after.
    fn up_phases(&self, guard: &[f32]) -> Vec<Vec<f32>> {
        // Coarse sample j stands at j·step and counts for place `phase` with the Gaussian's weight at their distance.
        let (reach, step) = (guard.len() as isize / 2, self.step as isize);
        let farthest = reach_up(guard, self.step) as isize;
        let weight = |phase: isize, j: isize| {
            let at = usize::try_from(reach + phase - j * step).ok();
            at.and_then(|at| guard.get(at)).map_or(0.0, |weight| weight * step as f32)
        };
        (0..step).map(|phase| (-farthest..=farthest).map(|j| weight(phase, j)).collect()).collect()
    }
}

/// Coarse samples on either side that a Gaussian reaches.
fn reach_up(guard: &[f32], step: usize) -> usize {
    guard.len() / 2 / step + 1
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
fn shortened(around: &[f64]) -> Vec<f32> {
    let len = around.len();
    let from_middle =
        |before: usize, count: usize| (0..count).map(move |i| around[(i + len - before) % len] as f32);
    // Of an even number the farthest weight stands on one side only.
    let mut left_out = if len.is_multiple_of(2) { around[len / 2].abs() } else { 0.0 };
    if left_out > NEGLIGIBLE {
        return from_middle(len / 2, len).collect();
    }
    let mut reach = (len - 1) / 2;
    while reach > 0 && left_out + 2.0 * around[reach].abs() <= NEGLIGIBLE {
        left_out += 2.0 * around[reach].abs();
        reach -= 1;
    }
    from_middle(reach, 2 * reach + 1).collect()
}

/// The filter along columns: sums over rows of pixels.
struct ColumnFilter {
    middle: RowSums,
    change: Option<[RowSums; 2]>,
}

impl ColumnFilter {
    fn new(axis: Axis) -> Self {
        let change = axis.guard.as_ref().map(|guard| {
            let farthest = reach_up(guard, axis.step) as isize;
            [
                RowSums::new(-(guard.len() as isize / 2), (axis.step, 1), vec![guard.clone()]),
                RowSums::new(-farthest, (1, axis.step), axis.up_phases(guard)),
            ]
        });
        let first = -(axis.middle.len() as isize / 2);
        Self { middle: RowSums::new(first, (1, 1), vec![axis.middle]), change }
    }
}

/// Every row of an image as a weighted sum of consecutive rows of another, around its ends.
///
/// Row `i` begins `step.0·(i / step.1)` rows after `first` and has the weights `phases[i % step.1]`.
struct RowSums {
    first: isize,
    step: (usize, usize),
    phases: Vec<Vec<f32>>,
    starts: Vec<usize>,
}

impl RowSums {
    fn new(first: isize, step: (usize, usize), phases: Vec<Vec<f32>>) -> Self {
        let starts = vec![0; phases[0].len()];
        Self { first, step, phases, starts }
    }

    fn apply(&mut self, kernels: &Kernels, src: ImageRef<'_, f32>, dst: &mut Image<f32>) {
        let (pixels, stride) = (src.elements_from(0, 0), src.stride());
        let height = src.height();
        for i in 0..dst.height() {
            let begin = self.first + (self.step.0 * (i / self.step.1)) as isize;
            let mut y = begin.rem_euclid(height as isize) as usize;
            for start in &mut self.starts {
                *start = stride * y;
                y = if y + 1 == height { 0 } else { y + 1 };
            }
            let weights = &self.phases[i % self.step.1];
            kernels.weighted(&mut WeightedRow { pixels, starts: &self.starts, weights, out: dst.row_mut(i) });
        }
    }
}

/// Stretches of a line and their weights.
struct Stretches {
    starts: Vec<usize>,
    weights: Vec<f32>,
}

impl Stretches {
    /// Every sum begins one sample after the one before.
    fn consecutive(weights: Vec<f32>) -> Self {
        Self { starts: (0..weights.len()).collect(), weights }
    }

    fn sum(&self, kernels: &Kernels, pixels: &[f32], out: &mut [f32]) {
        kernels.weighted(&mut WeightedRow { pixels, starts: &self.starts, weights: &self.weights, out });
    }
}

/// The filter along one row.
struct RowFilter {
    middle: Stretches,
    /// The line with what lies around its ends, as the middle reads it.
    line: Vec<f32>,
    change: Option<RowChange>,
}

/// To and from the coarse line. Samples that are `step` apart stand together, so that a register holds neighbours.
struct RowChange {
    step: usize,
    /// Samples of the line before its first that `down` reads; coarse samples before the first that `up` reads.
    before: [usize; 2],
    /// The line, taken apart.
    apart: Vec<f32>,
    down: Stretches,
    coarse: Vec<f32>,
    around: Vec<f32>,
    up: Vec<Stretches>,
    /// The filtered line, taken apart.
    places: Vec<f32>,
}

impl RowFilter {
    fn new(len: usize, axis: &Axis) -> Self {
        let few = len / axis.step;
        let change = axis.guard.as_ref().map(|guard| {
            let stretch = few + guard.len().div_ceil(axis.step);
            let farthest = reach_up(guard, axis.step);
            let starts = (0..guard.len()).map(|tap| tap % axis.step * stretch + tap / axis.step).collect();
            RowChange {
                step: axis.step,
                before: [guard.len() / 2, farthest],
                apart: vec![0.0; stretch * axis.step],
                down: Stretches { starts, weights: guard.clone() },
                coarse: vec![0.0; few],
                around: vec![0.0; few + 2 * farthest],
                up: axis.up_phases(guard).into_iter().map(Stretches::consecutive).collect(),
                places: vec![0.0; few],
            }
        });
        let line = vec![0.0; few + axis.middle.len() - 1];
        Self { middle: Stretches::consecutive(axis.middle.clone()), line, change }
    }

    fn apply(&mut self, kernels: &Kernels, row: &[f32], out: &mut [f32]) {
        let before_middle = self.middle.weights.len() / 2;
        let Some(change) = &mut self.change else {
            go_around(row, before_middle, &mut self.line);
            self.middle.sum(kernels, &self.line, out);
            return;
        };
        let RowChange { step, before, apart, down, coarse, around, up, places } = change;
        let stretch = apart.len() / *step;
        for (place, together) in apart.chunks_exact_mut(stretch).enumerate() {
            take_every(row, *step, place as isize - before[0] as isize, together);
        }
        down.sum(kernels, apart, coarse);
        go_around(coarse, before_middle, &mut self.line);
        self.middle.sum(kernels, &self.line, coarse);
        go_around(coarse, before[1], around);
        for (place, weights) in up.iter().enumerate() {
            weights.sum(kernels, around, places);
            for (value, &filtered) in out[place..].iter_mut().step_by(*step).zip(&*places) {
                *value = filtered;
            }
        }
    }
}

/// Continues a line around its ends: `out` begins `before` samples before it.
fn go_around(line: &[f32], before: usize, out: &mut [f32]) {
    let mut from = (line.len() - before % line.len()) % line.len();
    let mut rest = out;
    while !rest.is_empty() {
        let count = rest.len().min(line.len() - from);
        let (part, after) = rest.split_at_mut(count);
        part.copy_from_slice(&line[from..from + count]);
        (rest, from) = (after, 0);
    }
}

/// Every `step`-th sample of a line that goes around, from `first` on. `step` divides the line.
fn take_every(line: &[f32], step: usize, first: isize, out: &mut [f32]) {
    let mut from = first.rem_euclid(line.len() as isize) as usize;
    let mut filled = 0;
    while filled < out.len() {
        for (value, &sample) in out[filled..].iter_mut().zip(line[from..].iter().step_by(step)) {
            *value = sample;
        }
        filled += (line.len() - from).div_ceil(step);
        from %= step;
    }
}
