//! Gaussian low-pass filter in the frequency domain.

use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use crate::error::{Error, Result};
use crate::image::{Image, ImageRef, check_sides};

/// Largest pixel accepted: sums over the longest line stay far from overflow.
const MAX_MAGNITUDE: f32 = 1e30;

/// Gaussian low-pass in the frequency domain, eq. 7 of the paper: `H(u,v) = exp(-D²(u,v) / 2σ²)`.
///
/// `D(u,v)` is the distance of a frequency sample from the centre of the shifted spectrum and σ has the same unit:
/// frequency samples, that is, whole periods across the image's width (u) or height (v). A small σ blurs more. As
/// the discrete transform implies, the image continues periodically: its right edge blurs into its left.
///
/// `D² = u² + v²`, so `H(u,v) = h(u)·h(v)` with `h(k) = exp(-k² / 2σ²)`, and the transform separates likewise: one
/// pass along the rows and one along the columns are the two-dimensional filter.
///
/// Plans and buffers are kept: once `dst` has its size, [`apply`](Self::apply) allocates nothing.
pub struct GaussianLowPass {
    along_rows: LineFilter,
    along_columns: LineFilter,
    transposed: Image<f32>,
}

impl GaussianLowPass {
    /// A filter for images of one size; `sigma` is in frequency samples.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] unless `sigma` is positive and finite and the size is that of an image.
    pub fn new(width: usize, height: usize, sigma: f64) -> Result<Self> {
        check_sides("image", width, height)?;
        if !(sigma.is_finite() && sigma > 0.0) {
            let value = format!("{sigma} frequency samples");
            return Err(Error::invalid("sigma", value, "must be positive and finite"));
        }
        let mut planner = RealFftPlanner::new();
        Ok(Self {
            along_rows: LineFilter::new(&mut planner, width, sigma),
            along_columns: LineFilter::new(&mut planner, height, sigma),
            transposed: Image::new(height, width),
        })
    }

    /// Filters `src` into `dst`, which takes its size.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] unless `src` has the filter's size; [`Error::InvalidParameter`] if a pixel is not
    /// finite (one such pixel would spread over the whole image) or beyond 1e30.
    pub fn apply(&mut self, src: ImageRef<'_, f32>, dst: &mut Image<f32>) -> Result<()> {
        let (width, height) = (self.transposed.height(), self.transposed.width());
        if (src.width(), src.height()) != (width, height) {
            return Err(Error::SizeMismatch {
                first: "image",
                first_width: src.width(),
                first_height: src.height(),
                second: "the low-pass filter",
                second_width: width,
                second_height: height,
            });
        }
        for (y, row) in src.rows().enumerate() {
            if let Some(x) = row.iter().position(|value| value.is_nan() || value.abs() > MAX_MAGNITUDE) {
                let value = format!("{:e} at ({x}, {y})", row[x]);
                let expected = format!("every pixel must lie within plus or minus {MAX_MAGNITUDE:e}");
                return Err(Error::invalid("image", value, expected));
            }
        }
        dst.resize(src.width(), src.height());
        for (y, row) in src.rows().enumerate() {
            let filtered = dst.row_mut(y);
            filtered.copy_from_slice(row);
            self.along_rows.apply(filtered);
        }
        transpose(dst, &mut self.transposed);
        for x in 0..self.transposed.height() {
            self.along_columns.apply(self.transposed.row_mut(x));
        }
        transpose(&self.transposed, dst);
        Ok(())
    }
}

/// Multiplies the spectrum of a line by `h(k) = exp(-k² / 2σ²)`.
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
        let response = (0..=len / 2)
            .map(|k| {
                let in_sigmas = k as f64 / sigma;
                ((-0.5 * in_sigmas * in_sigmas).exp() / len as f64) as f32
            })
            .collect();
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

/// `dst[(y, x)] = src[(x, y)]`, in tiles that stay in the cache.
fn transpose(src: &Image<f32>, dst: &mut Image<f32>) {
    const TILE: usize = 16;
    let (width, height) = (src.width(), src.height());
    for top in (0..height).step_by(TILE) {
        for left in (0..width).step_by(TILE) {
            for x in left..(left + TILE).min(width) {
                let column = &mut dst.row_mut(x)[top..(top + TILE).min(height)];
                for (value, y) in column.iter_mut().zip(top..) {
                    *value = src.row(y)[x];
                }
            }
        }
    }
}
