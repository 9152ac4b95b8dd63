//! Smooth surfaces: noise and rounding of sub-pixel disparities averaged out, edges kept.

use std::ops::Range;

use super::crew::Crew;
use super::map::{DisparityMap, Validity};
use crate::image::{Image, ImageRef};

/// Rows, or columns, that are solved side by side, one to a vector's lane.
const STRIP: usize = 16;
/// How much neighbours bind each other where the image shows no edge; λ below.
const STRENGTH: f32 = 8.0;
/// How fast that falls with the difference of grey values.
const CONTRAST: f32 = 6.0;
/// Larger steps of disparity separate surfaces, 1/16 px.
const LARGEST_STEP: u16 = 2 * DisparityMap::SCALE;

/// Smooths maps; its buffers are kept from frame to frame.
///
/// Along every row, and then along every column, the disparities `d` become the `u` that minimise
///
/// `Σ_i (u_i - d_i)² + λ Σ_i w_i (u_i - u_(i-1))²`, `w_i = exp(-|I_i - I_(i-1)| / 6)`,
///
/// where pixels without a value, and neighbours more than 2 px apart, are not bound to each other: one iteration of the
/// fast global smoother of Min et al., TIP 2014. The minimum of one line solves a tri-diagonal system.
#[derive(Debug)]
pub(super) struct Smoother {
    /// `λ w` by the difference of grey values.
    bonds: [f32; 256],
    /// One per thread.
    strips: Vec<Strip>,
}

impl Default for Smoother {
    fn default() -> Self {
        let bonds = std::array::from_fn(|difference| STRENGTH * (-(difference as f32) / CONTRAST).exp());
        Self { bonds, strips: Vec::new() }
    }
}

/// What pixels side by side are, one to a lane.
#[derive(Debug, Clone, Copy)]
struct Pixels {
    disparity: [u16; STRIP],
    bits: [u8; STRIP],
    grey: [u8; STRIP],
}

impl Pixels {
    /// Without a value.
    const NONE: Self = Self { disparity: [0; STRIP], bits: [Validity::BORDER; STRIP], grey: [0; STRIP] };
}

/// The systems of one strip; a step per pixel along it.
#[derive(Debug, Default)]
struct Strip {
    values: Vec<[f32; STRIP]>,
    /// Bond to the step before; one more than there are pixels, the first and last of them zero.
    bonds: Vec<[f32; STRIP]>,
    /// Elimination: how much of the next value belongs to this one.
    ratios: Vec<[f32; STRIP]>,
}

impl Smoother {
    /// Smooths a map of the image `guide`, which has its size.
    pub fn smooth(&mut self, crew: &Crew, map: &mut DisparityMap, guide: ImageRef<'_, u8>) {
        let Self { bonds, strips } = self;
        let bonds = &*bonds;
        let jobs = crew.size();
        strips.resize_with(jobs, Strip::default);
        let validity = &map.validity;
        let (width, height) = (map.values.width(), map.values.height());

        let mut rest = map.values.as_mut_slice();
        crew.run_all(shares(height, jobs).zip(&mut *strips).map(|(rows, strip)| {
            let own;
            (own, rest) = std::mem::take(&mut rest).split_at_mut(rows.len() * width);
            move || {
                for (first, values) in rows.step_by(STRIP).zip(own.chunks_mut(STRIP * width)) {
                    strip.smooth_rows(bonds, first, values, validity, guide);
                }
            }
        }));

        // Columns that are neighbours share cache lines, so each thread has a block of them, in every row.
        let blocks = shares(width, jobs);
        let mut parts: Vec<Vec<&mut [u16]>> = blocks.clone().map(|_| Vec::with_capacity(height)).collect();
        for mut row in map.values.as_mut_slice().chunks_exact_mut(width) {
            for (columns, part) in blocks.clone().zip(&mut parts) {
                let own;
                (own, row) = row.split_at_mut(columns.len());
                part.push(own);
            }
        }
        crew.run_all(blocks.zip(parts).zip(strips).map(|((columns, mut part), strip)| {
            move || {
                for first in columns.clone().step_by(STRIP) {
                    let columns = first - columns.start..columns.len().min(first - columns.start + STRIP);
                    strip.smooth_columns(bonds, first, columns, &mut part, validity, guide);
                }
            }
        }));
    }
}

/// Ranges of `0..len` for so many jobs, all but the last a multiple of [`STRIP`] long.
fn shares(len: usize, jobs: usize) -> impl Iterator<Item = Range<usize>> + Clone {
    let strips = len.div_ceil(STRIP);
    let count = jobs.min(strips);
    (0..count).map(move |i| strips * i / count * STRIP..len.min(strips * (i + 1) / count * STRIP))
}

/// To the nearest sixteenth. A solution lies between the smallest and the largest of the values it is made of.
fn rounded(solved: f32) -> u16 {
    (solved + 0.5) as u16
}

impl Strip {
    /// Smooths rows from `first` on, at most [`STRIP`] of them.
    fn smooth_rows(
        &mut self,
        bonds: &[f32; 256],
        first: usize,
        values: &mut [u16],
        validity: &Image<u8>,
        guide: ImageRef<'_, u8>,
    ) {
        let width = validity.width();
        let count = values.len() / width;
        // The last strip's lanes may repeat a row.
        let row = |lane: usize| lane.min(count - 1);
        let disparities: [_; STRIP] = std::array::from_fn(|lane| &values[row(lane) * width..][..width]);
        let bits: [_; STRIP] = std::array::from_fn(|lane| validity.row(first + row(lane)));
        let greys: [_; STRIP] = std::array::from_fn(|lane| guide.row(first + row(lane)));
        self.load(bonds, width, |x| Pixels {
            disparity: disparities.map(|row| row[x]),
            bits: bits.map(|row| row[x]),
            grey: greys.map(|row| row[x]),
        });
        self.solve();
        for (lane, row) in values.chunks_exact_mut(width).enumerate() {
            for (value, solved) in row.iter_mut().zip(&self.values) {
                *value = rounded(solved[lane]);
            }
        }
    }

    /// Smooths `columns` of some rows' parts, at most [`STRIP`] of them; the first is the image's column `first`.
    fn smooth_columns(
        &mut self,
        bonds: &[f32; 256],
        first: usize,
        columns: Range<usize>,
        rows: &mut [&mut [u16]],
        validity: &Image<u8>,
        guide: ImageRef<'_, u8>,
    ) {
        let count = columns.len();
        let image_columns = first..first + count;
        self.load(bonds, rows.len(), |y| {
            let mut pixels = Pixels::NONE;
            pixels.disparity[..count].copy_from_slice(&rows[y][columns.clone()]);
            pixels.bits[..count].copy_from_slice(&validity.row(y)[image_columns.clone()]);
            pixels.grey[..count].copy_from_slice(&guide.row(y)[image_columns.clone()]);
            pixels
        });
        self.solve();
        for (row, solved) in rows.iter_mut().zip(&self.values) {
            for (value, &solved) in row[columns.clone()].iter_mut().zip(solved) {
                *value = rounded(solved);
            }
        }
    }

    /// Sets up the systems of `len` pixels.
    fn load(&mut self, bonds: &[f32; 256], len: usize, pixels: impl Fn(usize) -> Pixels) {
        self.values.resize(len, [0.0; STRIP]);
        self.bonds.resize(len + 1, [0.0; STRIP]);
        self.ratios.resize(len, [0.0; STRIP]);
        self.bonds[len] = [0.0; STRIP];
        let mut before = Pixels::NONE;
        for i in 0..len {
            let here = pixels(i);
            let (bond, value) = (&mut self.bonds[i], &mut self.values[i]);
            for lane in 0..STRIP {
                let bound = Validity::has_value(before.bits[lane] | here.bits[lane])
                    & (before.disparity[lane].abs_diff(here.disparity[lane]) <= LARGEST_STEP);
                let unless_apart = bonds[usize::from(before.grey[lane].abs_diff(here.grey[lane]))];
                bond[lane] = if bound { unless_apart } else { 0.0 };
                value[lane] = here.disparity[lane].into();
            }
            before = here;
        }
    }

    /// Elimination forward, substitution backward (Thomas). Sums and products are not fused: the bits are the same
    /// everywhere.
    fn solve(&mut self) {
        let len = self.values.len();
        let (mut value_before, mut ratio_before) = ([0.0; STRIP], [0.0; STRIP]);
        for i in 0..len {
            let (before, after) = (&self.bonds[i], &self.bonds[i + 1]);
            let (value, ratio) = (&mut self.values[i], &mut self.ratios[i]);
            for lane in 0..STRIP {
                let scale = 1.0 / (1.0 + after[lane] + before[lane] * (1.0 - ratio_before[lane]));
                ratio[lane] = after[lane] * scale;
                value[lane] = (value[lane] + before[lane] * value_before[lane]) * scale;
            }
            (value_before, ratio_before) = (*value, *ratio);
        }
        for i in (0..len.saturating_sub(1)).rev() {
            let [value, after] = &mut self.values[i..=i + 1] else { unreachable!("two neighbours") };
            for lane in 0..STRIP {
                value[lane] += self.ratios[i][lane] * after[lane];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One line, solved densely in double precision by Gauss–Jordan elimination.
    fn solve_densely(values: &[u16], bits: &[u8], grey: &[u8]) -> Vec<u16> {
        let n = values.len();
        let mut system = vec![vec![0.0; n + 1]; n];
        for i in 0..n {
            system[i][i] += 1.0;
            system[i][n] = f64::from(values[i]);
            if i > 0
                && [bits[i - 1], bits[i]].iter().all(|&bits| bits & !Validity::FILLED == 0)
                && (i32::from(values[i]) - i32::from(values[i - 1])).abs() <= 32
            {
                let contrast = (f64::from(grey[i]) - f64::from(grey[i - 1])).abs();
                let bond = 8.0 * (-contrast / 6.0).exp();
                for (a, b, sign) in [(i, i, 1.0), (i - 1, i - 1, 1.0), (i, i - 1, -1.0), (i - 1, i, -1.0)] {
                    system[a][b] += sign * bond;
                }
            }
        }
        for i in 0..n {
            let pivot = system[i].clone();
            for (k, row) in system.iter_mut().enumerate() {
                let factor = if k == i { 1.0 - 1.0 / pivot[i] } else { row[i] / pivot[i] };
                row.iter_mut().zip(&pivot).for_each(|(a, b)| *a -= factor * b);
            }
        }
        system.iter().map(|row| (row[n] + 0.5) as u16).collect()
    }

    fn scene(width: usize, height: usize) -> (DisparityMap, Image<u8>) {
        let mut state = 1_u64;
        let mut next = |n: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % n
        };
        let mut map = DisparityMap::new(width, height);
        for y in 0..height {
            for x in 0..width {
                map.values.row_mut(y)[x] = 160 + next(20) as u16 + if x > width / 2 { 300 } else { 0 };
                map.validity.row_mut(y)[x] = [0, 0, 0, Validity::FILLED, Validity::SPECKLE][next(5) as usize];
            }
        }
        (map, Image::from_fn(width, height, |_, _| next(12) as u8))
    }

    #[test]
    fn lines_minimise_the_sum_of_squares() {
        for (width, height) in [(1, 1), (1, 40), (40, 1), (37, 19), (16, 16)] {
            let (mut map, guide) = scene(width, height);
            let mut expected = map.clone();
            for y in 0..height {
                let row = solve_densely(map.values.row(y), map.validity.row(y), guide.row(y));
                expected.values.row_mut(y).copy_from_slice(&row);
            }
            for x in 0..width {
                let [values, bits, grey] = [
                    (0..height).map(|y| expected.values.row(y)[x]).collect::<Vec<_>>(),
                    (0..height).map(|y| map.validity.row(y)[x].into()).collect(),
                    (0..height).map(|y| guide.row(y)[x].into()).collect(),
                ];
                let narrow = |v: &[u16]| v.iter().map(|&v| v as u8).collect::<Vec<_>>();
                let column = solve_densely(&values, &narrow(&bits), &narrow(&grey));
                (0..height).for_each(|y| expected.values.row_mut(y)[x] = column[y]);
            }
            Crew::assemble(1, |crew| Smoother::default().smooth(crew, &mut map, guide.view()));
            let off = map.values.as_slice().iter().zip(expected.values.as_slice());
            // Single precision may round a half the other way, in the rows and then once more in the columns.
            assert!(off.clone().all(|(a, b)| a.abs_diff(*b) <= 1), "{width}x{height}");
            assert!(off.filter(|(a, b)| a != b).count() * 50 <= width * height, "{width}x{height}");
        }
    }

    #[test]
    fn threads_do_not_show() {
        let (map, guide) = scene(83, 71);
        let of = |threads: usize| {
            let mut map = map.clone();
            Crew::assemble(threads, |crew| Smoother::default().smooth(crew, &mut map, guide.view()));
            map
        };
        (2..9).for_each(|threads| assert!(of(threads) == of(1), "{threads} threads"));
    }

    #[test]
    fn pixels_without_a_value_and_steps_stay() {
        let mut map = DisparityMap::new(40, 20);
        map.validity.fill(0);
        for y in 0..20 {
            for x in 0..40 {
                map.values.row_mut(y)[x] = if x < 20 { 80 } else { 160 };
            }
        }
        map.values.row_mut(7)[9] = 83;
        map.validity.row_mut(7)[9] = Validity::SPECKLE;
        let before = map.clone();
        Crew::assemble(1, |crew| Smoother::default().smooth(crew, &mut map, Image::new(40, 20).view()));
        assert_eq!(map, before);
    }
}
