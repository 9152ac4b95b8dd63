//! The disparity map: values in sixteenths of a pixel and, per pixel, the reasons it cannot be trusted.

use crate::error::{Error, Result};
use crate::image::Image;

/// Reasons, OR-ed together, why a pixel has no answer (or has one that was not measured: [`FILLED`](Validity::FILLED)).
///
/// A pixel is *valid* when its bits are zero, or only [`FILLED`](Validity::FILLED) is set.
pub struct Validity;

impl Validity {
    /// No candidate: every disparity asked for lies outside the right image, or the pixel outside every region asked for.
    pub const BORDER: u8 = 1 << 0;
    /// The rectified pixel, or its window's centre in the right image, has no source pixel.
    pub const NO_SOURCE: u8 = 1 << 1;
    /// Another, not neighbouring, disparity fits almost as well.
    pub const NOT_UNIQUE: u8 = 1 << 2;
    /// The right image's own best match points elsewhere.
    pub const LEFT_RIGHT: u8 = 1 << 3;
    /// Too little texture in the window.
    pub const LOW_TEXTURE: u8 = 1 << 4;
    /// Part of a small island of disparity.
    pub const SPECKLE: u8 = 1 << 5;
    /// Over- or under-exposed.
    pub const SATURATED: u8 = 1 << 6;
    /// The value was taken from neighbours, not measured.
    pub const FILLED: u8 = 1 << 7;

    /// The bits of pixels that have no candidate at all.
    pub(crate) const NO_CANDIDATE: u8 = Self::BORDER | Self::NO_SOURCE;

    /// Whether a pixel with these bits carries a value.
    #[inline]
    pub fn has_value(bits: u8) -> bool {
        bits & !Self::FILLED == 0
    }
}

/// Disparities of the left image.
///
/// `values[(x, y)]` is the disparity `d = x_left - x_right >= 0` in sixteenths of a pixel; it means something only
/// where [`Validity::has_value`] holds for `validity[(x, y)]`. Rejected pixels keep the value they had: a viewer may
/// show what was rejected, but nothing downstream reads it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DisparityMap {
    /// Disparity, 1/16 px.
    pub values: Image<u16>,
    /// Bits of [`Validity`].
    pub validity: Image<u8>,
    /// Smallest disparity searched, px.
    pub min_disparity: usize,
    /// How many whole disparities were searched.
    pub num_disparities: usize,
}

impl DisparityMap {
    /// Steps of one pixel in [`values`](Self::values).
    pub const SCALE: u16 = 16;

    /// A map of the given size whose every pixel is [`Validity::BORDER`].
    pub fn new(width: usize, height: usize) -> Self {
        let mut validity = Image::new(width, height);
        validity.fill(Validity::BORDER);
        Self { values: Image::new(width, height), validity, min_disparity: 0, num_disparities: 0 }
    }

    /// A map from disparities in 1/16 px and their [`Validity`] bits.
    ///
    /// Fails if the two differ in size or if the range reaches [`MAX_DISPARITY`](super::MatcherParams::MAX_DISPARITY).
    pub fn from_parts(
        values: Image<u16>,
        validity: Image<u8>,
        min_disparity: usize,
        num_disparities: usize,
    ) -> Result<Self> {
        values.view().require_same_size("raw", &validity.view(), "validity")?;
        let limit = super::MatcherParams::MAX_DISPARITY;
        if min_disparity.saturating_add(num_disparities) > limit {
            return Err(Error::invalid(
                "min_disparity + num_disparities",
                format!("{min_disparity} + {num_disparities} px"),
                format!("must not exceed {limit} px"),
            ));
        }
        Ok(Self { values, validity, min_disparity, num_disparities })
    }

    /// Width, pixels.
    pub fn width(&self) -> usize {
        self.values.width()
    }

    /// Height, pixels.
    pub fn height(&self) -> usize {
        self.values.height()
    }

    /// Gives the map a size, keeping its memory where that suffices; contents are unspecified afterwards.
    pub fn resize(&mut self, width: usize, height: usize) {
        self.values.resize(width, height);
        self.validity.resize(width, height);
    }

    /// The disparity at `(x, y)` in pixels, or `None` where there is none.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> Option<f32> {
        Validity::has_value(self.validity.row(y)[x])
            .then(|| f32::from(self.values.row(y)[x]) / f32::from(Self::SCALE))
    }

    /// Share of pixels that carry a value, 0 to 1.
    pub fn density(&self) -> f64 {
        let bits = self.validity.as_slice();
        let answered = bits.iter().filter(|&&b| Validity::has_value(b)).count();
        answered as f64 / bits.len().max(1) as f64
    }

    /// Disparities in pixels; NaN where there is none.
    pub fn to_f32(&self) -> Image<f32> {
        Image::from_fn(self.width(), self.height(), |x, y| self.at(x, y).unwrap_or(f32::NAN))
    }

    /// OpenCV's representation: `16·d`, and `16·(min_disparity - 1)` where there is no disparity.
    ///
    /// Fails if the range does not fit 16 bits with a sign.
    pub fn to_opencv(&self) -> Result<Image<i16>> {
        let end = self.min_disparity + self.num_disparities;
        if end > 2048 {
            let expected = "must not exceed 2048 px, beyond which OpenCV's 16-bit disparities cannot reach";
            return Err(Error::invalid("min_disparity + num_disparities", format!("{end} px"), expected));
        }
        let invalid = (self.min_disparity as i16 - 1) * 16;
        Ok(Image::from_fn(self.width(), self.height(), |x, y| {
            let bits = self.validity.row(y)[x];
            // A value given from outside may lie beyond its range; it is cut off, not wrapped.
            if Validity::has_value(bits) {
                self.values.row(y)[x].min(i16::MAX as u16) as i16
            } else {
                invalid
            }
        }))
    }
}
