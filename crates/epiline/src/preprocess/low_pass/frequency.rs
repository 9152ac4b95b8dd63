//! The filter as eq. 7 writes it: transform, multiply, transform back.

use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use crate::image::{Image, ImageRef};
use crate::kernels::Kernels;
use crate::kernels::transpose::Transpose;

/// `h(k) = exp(-k² / 2σ²)`.
pub(super) fn response(k: usize, sigma: f64) -> f64 {
    let in_sigmas = k as f64 / sigma;
    (-0.5 * in_sigmas * in_sigmas).exp()
}

/// A transform along the rows and one along the columns.
pub(super) struct FrequencyFilter {
    along_rows: LineFilter,
    along_columns: LineFilter,
    transposed: Image<f32>,
}

impl FrequencyFilter {
    pub fn new(width: usize, height: usize, sigma: f64) -> Self {
        let mut planner = RealFftPlanner::new();
        Self {
            along_rows: LineFilter::new(&mut planner, width, sigma),
            along_columns: LineFilter::new(&mut planner, height, sigma),
            transposed: Image::new(height, width),
        }
    }

    /// The image has the filter's size; `dst` holds its rows one after the other.
    pub fn apply(&mut self, kernels: &Kernels, src: ImageRef<'_, f32>, dst: &mut [f32]) {
        let (width, height) = (src.width(), src.height());
        for (row, filtered) in src.rows().zip(dst.chunks_exact_mut(width)) {
            filtered.copy_from_slice(row);
            self.along_rows.apply(filtered);
        }
        transpose(kernels, dst, self.transposed.as_mut_slice(), width);
        for x in 0..width {
            self.along_columns.apply(self.transposed.row_mut(x));
        }
        transpose(kernels, self.transposed.as_slice(), dst, height);
    }
}

/// Multiplies the spectrum of a line by `h(k)`.
struct LineFilter {
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
    /// `h(k)` for k = 0 to len/2, divided by the length, since neither transform normalises.
    response: Vec<f32>,
    spectrum: Vec<Complex<f32>>,
    scratch: Vec<Complex<f32>>,
}

impl LineFilter {
    fn new(planner: &mut RealFftPlanner<f32>, len: usize, sigma: f64) -> Self {
        let forward = planner.plan_fft_forward(len);
        let inverse = planner.plan_fft_inverse(len);
        let response = (0..=len / 2).map(|k| (response(k, sigma) / len as f64) as f32).collect();
        let scratch_len = forward.get_scratch_len().max(inverse.get_scratch_len());
        let spectrum = forward.make_output_vec();
        Self { forward, inverse, response, spectrum, scratch: vec![Complex::default(); scratch_len] }
    }

    fn apply(&mut self, line: &mut [f32]) {
        const PLANNED: &str = "the plan, the line and the buffers have one length";
        self.forward.process_with_scratch(line, &mut self.spectrum, &mut self.scratch).expect(PLANNED);
        for (sample, h) in self.spectrum.iter_mut().zip(&self.response) {
            *sample *= h;
        }
        self.inverse.process_with_scratch(&mut self.spectrum, line, &mut self.scratch).expect(PLANNED);
    }
}

/// Rows of `width` values to columns.
fn transpose(kernels: &Kernels, rows: &[f32], columns: &mut [f32], width: usize) {
    let height = rows.len() / width;
    kernels.transpose(&mut Transpose {
        rows,
        rows_stride: width,
        columns,
        columns_stride: height,
        width,
        height,
    });
}
