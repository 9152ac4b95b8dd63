//! Borrowed, strided views of images, an owned one, and a pair of them.
//!
//! `(0, 0)` is the centre of the top-left pixel; `x` counts columns to the right, `y` rows downward.

use std::ops::Range;

use crate::error::{Error, Result};

/// The largest width or height accepted anywhere, in pixels.
///
/// Kernels index with 32-bit lanes and buffers are `width * height`; this bound keeps both far from overflow.
pub const MAX_SIDE_PX: usize = 16_384;

/// A read-only view of `height` rows of `width` elements that start `stride` elements apart.
#[derive(Debug)]
pub struct ImageRef<'a, T> {
    data: &'a [T],
    width: usize,
    height: usize,
    stride: usize,
}

// Derived impls would demand `T: Copy`; a view is a pointer and three numbers whatever it looks at.
impl<T> Clone for ImageRef<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for ImageRef<'_, T> {}

/// Fails, naming the image, unless both sides are 1 to [`MAX_SIDE_PX`].
pub(crate) fn check_sides(name: &'static str, width: usize, height: usize) -> Result<()> {
    if width == 0 || height == 0 || width > MAX_SIDE_PX || height > MAX_SIDE_PX {
        return Err(Error::invalid(
            name,
            format!("{width}x{height} px"),
            format!("each side must be 1 to {MAX_SIDE_PX} px"),
        ));
    }
    Ok(())
}

fn check_extent(name: &'static str, width: usize, height: usize, stride: usize, actual: usize) -> Result<()> {
    check_sides(name, width, height)?;
    let needed =
        if stride < width { usize::MAX } else { stride.saturating_mul(height - 1).saturating_add(width) };
    if actual < needed {
        return Err(Error::BufferTooSmall { name, width, height, stride, needed, actual });
    }
    Ok(())
}

impl<'a, T> ImageRef<'a, T> {
    /// A view of contiguous rows. `name` is what an error calls the image.
    pub fn new(name: &'static str, data: &'a [T], width: usize, height: usize) -> Result<Self> {
        Self::with_stride(name, data, width, height, width)
    }

    /// A view of rows that start `stride` elements apart.
    pub fn with_stride(
        name: &'static str,
        data: &'a [T],
        width: usize,
        height: usize,
        stride: usize,
    ) -> Result<Self> {
        check_extent(name, width, height, stride, data.len())?;
        Ok(Self { data, width, height, stride })
    }

    /// Width in pixels.
    #[inline]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    #[inline]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The elements of row `y`, `width` of them.
    #[inline]
    pub fn row(&self, y: usize) -> &'a [T] {
        &self.data[y * self.stride..y * self.stride + self.width]
    }

    /// Elements from the start of one row to the start of the next.
    pub(crate) fn stride(&self) -> usize {
        self.stride
    }

    /// Everything from column `x` of row `y` on, rows [`stride`](Self::stride) apart: for kernels, which see slices.
    pub(crate) fn elements_from(&self, x: usize, y: usize) -> &'a [T] {
        &self.data[y * self.stride + x..]
    }

    /// All rows from the top.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &'a [T]> + '_ {
        (0..self.height).map(|y| self.row(y))
    }

    /// The part of it in some columns and rows, which are not empty and lie inside.
    pub(crate) fn crop(&self, columns: Range<usize>, rows: Range<usize>) -> Self {
        let first = rows.start * self.stride + columns.start;
        let end = (rows.end - 1) * self.stride + columns.end;
        let data = &self.data[first..end];
        Self { data, width: columns.len(), height: rows.len(), stride: self.stride }
    }

    /// Fails with both names and sizes unless `other` has this image's size.
    pub fn require_same_size<U>(
        &self,
        name: &'static str,
        other: &ImageRef<'_, U>,
        other_name: &'static str,
    ) -> Result<()> {
        if (self.width, self.height) == (other.width, other.height) {
            return Ok(());
        }
        Err(Error::SizeMismatch {
            first: name,
            first_width: self.width,
            first_height: self.height,
            second: other_name,
            second_width: other.width,
            second_height: other.height,
        })
    }
}

impl<T: Copy> ImageRef<'_, T> {
    /// The element at column `x` of row `y`.
    pub fn at(&self, x: usize, y: usize) -> T {
        self.row(y)[x]
    }
}

/// An owned image with contiguous rows; the buffer behind every stage.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Image<T> {
    data: Vec<T>,
    width: usize,
    height: usize,
}

impl<T: Copy + Default> Image<T> {
    /// An image of default values. Sides are not limited here: views of it are checked.
    pub fn new(width: usize, height: usize) -> Self {
        Self { data: vec![T::default(); width * height], width, height }
    }

    /// An image whose element at `(x, y)` is `f(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> T) -> Self {
        let data = (0..width * height).map(|i| f(i % width, i / width)).collect();
        Self { data, width, height }
    }

    /// Takes over a buffer of exactly `width * height` elements.
    pub fn from_vec(name: &'static str, data: Vec<T>, width: usize, height: usize) -> Result<Self> {
        check_extent(name, width, height, width, data.len())?;
        if data.len() != width * height {
            return Err(Error::BufferTooSmall {
                name,
                width,
                height,
                stride: width,
                needed: width * height,
                actual: data.len(),
            });
        }
        Ok(Self { data, width, height })
    }

    /// Gives the image a size, keeping its memory where it suffices; contents are unspecified afterwards.
    pub fn resize(&mut self, width: usize, height: usize) {
        self.data.resize(width * height, T::default());
        (self.width, self.height) = (width, height);
    }

    /// Width in pixels.
    #[inline]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    #[inline]
    pub fn height(&self) -> usize {
        self.height
    }

    /// A read-only view.
    #[inline]
    pub fn view(&self) -> ImageRef<'_, T> {
        ImageRef { data: &self.data, width: self.width, height: self.height, stride: self.width }
    }

    /// The elements of row `y`.
    #[inline]
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// The elements of row `y`, to write.
    #[inline]
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.width..(y + 1) * self.width]
    }

    /// All elements, row after row.
    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    /// All elements, row after row, to write.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The buffer itself.
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// Sets every element.
    pub fn fill(&mut self, value: T) {
        self.data.fill(value);
    }
}

/// Two grey images that belong together, as they came from the cameras.
#[derive(Debug, Clone, Copy)]
pub struct StereoPair<'a> {
    /// Left image, 8-bit grey: the reference of everything downstream.
    pub left: ImageRef<'a, u8>,
    /// Right image, same size.
    pub right: ImageRef<'a, u8>,
    /// Running number of the pair.
    pub seq: u64,
    /// When the left image was exposed, nanoseconds on the source's clock.
    pub left_stamp_nanos: i64,
    /// When the right image was exposed, same clock.
    pub right_stamp_nanos: i64,
}

impl<'a> StereoPair<'a> {
    /// A pair without time stamps. Fails unless both images have one size.
    pub fn new(left: ImageRef<'a, u8>, right: ImageRef<'a, u8>) -> Result<Self> {
        left.require_same_size("left", &right, "right")?;
        Ok(Self { left, right, seq: 0, left_stamp_nanos: 0, right_stamp_nanos: 0 })
    }

    /// Width of both images, pixels.
    #[inline]
    pub fn width(&self) -> usize {
        self.left.width()
    }

    /// Height of both images, pixels.
    #[inline]
    pub fn height(&self) -> usize {
        self.left.height()
    }
}
