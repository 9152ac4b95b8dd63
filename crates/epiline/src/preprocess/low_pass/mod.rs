//! Gaussian low-pass, eq. 7 of the paper: as written, in the frequency domain, and as sums over neighbours.

mod bands;
mod frequency;
mod spatial;

use crate::error::{Error, Result};
use crate::image::{Image, ImageRef, check_sides};
use crate::kernels::magnitude::MagnitudeRow;
use crate::kernels::{Kernels, Level};
use frequency::FrequencyFilter;
use spatial::SpatialFilter;

/// Largest pixel accepted: sums over the longest line stay far from overflow.
const MAX_MAGNITUDE: f32 = 1e30;

/// Gaussian low-pass, eq. 7 of the paper: `H(u,v) = exp(-D²(u,v) / 2σ²)`.
///
/// `D(u,v)` is the distance of a frequency sample from the centre of the shifted spectrum and σ has the same unit:
/// frequency samples, that is, whole periods across the image's width (u) or height (v). A small σ blurs more. As
/// the discrete transform implies, the image continues periodically: its right edge blurs into its left.
///
/// `D² = u² + v²`, so `H(u,v) = h(u)·h(v)` with `h(k) = exp(-k² / 2σ²)`, and the filter separates likewise: one pass
/// along the rows and one along the columns are the two-dimensional filter.
///
/// Plans and buffers are kept: once `dst` has its size, [`apply`](Self::apply) allocates nothing.
pub struct GaussianLowPass {
    width: usize,
    height: usize,
    kernels: Kernels,
    way: Way,
}

enum Way {
    Frequency(Box<FrequencyFilter>),
    Spatial(Box<SpatialFilter>),
}

impl GaussianLowPass {
    /// A filter for images of one size; `sigma` is in frequency samples.
    ///
    /// Works by sums over neighbours where those are few (see [`is_spatial`](Self::is_spatial)), else in the frequency
    /// domain. The two differ by less than 1e-4 of the image's largest magnitude.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] unless `sigma` is positive and finite and the size is that of an image.
    pub fn new(width: usize, height: usize, sigma: f64) -> Result<Self> {
        check(width, height, sigma)?;
        match SpatialFilter::new(width, height, sigma) {
            Some(filter) => Ok(Self::by(width, height, Way::Spatial(Box::new(filter)))),
            None => Self::in_frequency_domain(width, height, sigma),
        }
    }

    /// The filter as the equation writes it, by Fourier transforms; exact to rounding, and several times slower.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn in_frequency_domain(width: usize, height: usize, sigma: f64) -> Result<Self> {
        check(width, height, sigma)?;
        Ok(Self::by(width, height, Way::Frequency(Box::new(FrequencyFilter::new(width, height, sigma)))))
    }

    fn by(width: usize, height: usize, way: Way) -> Self {
        Self { width, height, kernels: Kernels::new(Level::current()), way }
    }

    /// Whether it works by sums over neighbours.
    pub fn is_spatial(&self) -> bool {
        matches!(self.way, Way::Spatial(_))
    }

    /// Filters `src` into `dst`, which takes its size.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] unless `src` has the filter's size; [`Error::InvalidParameter`] if a pixel is not
    /// finite (one such pixel would spread over the whole image) or beyond 1e30.
    pub fn apply(&mut self, src: ImageRef<'_, f32>, dst: &mut Image<f32>) -> Result<()> {
        dst.resize(self.width, self.height);
        self.apply_to(src, dst.as_mut_slice())
    }

    /// Filters `src` into `dst`, which holds the rows one after the other.
    ///
    /// # Errors
    ///
    /// As [`apply`](Self::apply); [`Error::BufferTooSmall`] unless `dst` has width times height elements.
    pub fn apply_to(&mut self, src: ImageRef<'_, f32>, dst: &mut [f32]) -> Result<()> {
        if (src.width(), src.height()) != (self.width, self.height) {
            return Err(Error::SizeMismatch {
                first: "image",
                first_width: src.width(),
                first_height: src.height(),
                second: "the low-pass filter",
                second_width: self.width,
                second_height: self.height,
            });
        }
        let (width, height) = (self.width, self.height);
        if dst.len() != width * height {
            let (needed, actual) = (width * height, dst.len());
            return Err(Error::BufferTooSmall { name: "dst", width, height, stride: width, needed, actual });
        }
        self.check_pixels(src)?;
        match &mut self.way {
            Way::Frequency(filter) => filter.apply(&self.kernels, src, dst),
            Way::Spatial(filter) => filter.apply(&self.kernels, src, dst),
        }
        Ok(())
    }

    fn check_pixels(&self, src: ImageRef<'_, f32>) -> Result<()> {
        for (y, row) in src.rows().enumerate() {
            let mut magnitude = MagnitudeRow { pixels: row, largest: 0 };
            self.kernels.magnitude(&mut magnitude);
            if magnitude.largest > MAX_MAGNITUDE.to_bits() {
                let refused = |value: &f32| value.is_nan() || value.abs() > MAX_MAGNITUDE;
                let x = row.iter().position(refused).expect("one of them is the largest");
                let value = format!("{:e} at ({x}, {y})", row[x]);
                let expected = format!("every pixel must lie within plus or minus {MAX_MAGNITUDE:e}");
                return Err(Error::invalid("image", value, expected));
            }
        }
        Ok(())
    }
}

fn check(width: usize, height: usize, sigma: f64) -> Result<()> {
    check_sides("image", width, height)?;
    if sigma.is_finite() && sigma > 0.0 {
        return Ok(());
    }
    Err(Error::invalid("sigma", format!("{sigma} frequency samples"), "must be positive and finite"))
}
