//! The filter as weighted sums of neighbours.
//!
//! Columns are summed row by row, whole registers of neighbours at a time. Rows are summed likewise, after as many of
//! them as fill a few registers were turned into columns:
//!
//! ```text
//! columns, down       src → few rows                          (or all of them, where blur is small)
//! 64 rows at a time   turned, filtered, turned back
//! columns, up         few rows → dst
//! ```

use super::bands::{Axis, Bands};
use crate::image::{Image, ImageRef};
use crate::kernels::Kernels;
use crate::kernels::transpose::Transpose;
use crate::kernels::weighted::WeightedRows;

/// Rows filtered together.
const TOGETHER: usize = 32;
/// Values of the widest register.
const REGISTER: usize = 16;
/// What convolutions along the longer and the shorter side may leave out, as shares of the largest pixel.
const LEFT_OUT: [f64; 2] = [2e-5, 7e-5];
/// Products for a pixel that it costs as much as to turn it, and back.
const TURNS: f64 = 12.0;
/// Beyond so many products for a pixel the Fourier transform is not much slower.
const MAX_PRODUCTS: f64 = 128.0;

/// Both axes.
pub(super) struct SpatialFilter {
    columns: Axis,
    rows: RowFilter,
    /// Filtered along columns.
    upright: Image<f32>,
    starts: Vec<usize>,
}

impl SpatialFilter {
    /// `None` where it would not be fast: too little blur.
    pub fn new(width: usize, height: usize, sigma: f64) -> Option<Self> {
        // The shorter side is blurred less: most of what may be left out is of use there.
        let left_out = |longer| if longer { LEFT_OUT[0] } else { LEFT_OUT[1] };
        let along_rows = Axis::cheapest(width, sigma, left_out(width > height), 0.0);
        let for_row = (along_rows.products() / width) as f64 + TURNS;
        let columns = Axis::cheapest(height, sigma, left_out(height >= width), for_row);
        let products =
            columns.products() as f64 / height as f64 + for_row * columns.between() as f64 / height as f64;
        let upright = match &columns {
            Axis::Direct(_) => TOGETHER.min(height),
            Axis::Coarse(..) => columns.between(),
        };
        (products <= MAX_PRODUCTS).then(|| Self {
            rows: RowFilter::new(width, along_rows),
            columns,
            upright: Image::new(width, upright),
            starts: Vec::new(),
        })
    }

    /// `dst` holds the image's rows one after the other.
    pub fn apply(&mut self, kernels: &Kernels, src: ImageRef<'_, f32>, dst: &mut [f32]) {
        let Self { columns, rows, upright, starts } = self;
        let width = src.width();
        let (pixels, stride) = (src.elements_from(0, 0), src.stride());
        match columns {
            Axis::Direct(bands) => {
                begin(bands, stride, starts);
                for first in (0..bands.sums).step_by(TOGETHER) {
                    let end = (first + TOGETHER).min(bands.sums);
                    let some = &mut upright.as_mut_slice()[..(end - first) * width];
                    sum(kernels, bands, first..end, Lines { pixels, starts, width }, some, width);
                    rows.apply(kernels, some);
                    rows.turn_back(kernels, &mut dst[first * width..end * width]);
                }
            }
            Axis::Coarse(down, up) => {
                begin(down, stride, starts);
                sum(
                    kernels,
                    down,
                    0..down.sums,
                    Lines { pixels, starts, width },
                    upright.as_mut_slice(),
                    width,
                );
                for some in upright.as_mut_slice().chunks_mut(TOGETHER * width) {
                    rows.apply(kernels, some);
                    rows.turn_back(kernels, some);
                }
                begin(up, width, starts);
                sum(kernels, up, 0..up.sums, Lines { pixels: upright.as_slice(), starts, width }, dst, width);
            }
        }
    }
}

/// Where the samples of a band begin that are `stride` apart, those that go around too.
fn begin(bands: &Bands, stride: usize, starts: &mut Vec<usize>) {
    starts.clear();
    starts.extend((0..bands.samples + bands.longest()).map(|i| stride * (i % bands.samples)));
}

/// What is summed.
struct Lines<'a> {
    pixels: &'a [f32],
    starts: &'a [usize],
    width: usize,
}

/// Some sums of a band, from one that is the first of a group on, `stride` apart.
fn sum(
    kernels: &Kernels,
    bands: &Bands,
    sums: std::ops::Range<usize>,
    lines: Lines<'_>,
    out: &mut [f32],
    stride: usize,
) {
    let groups = bands.groups(sums.start, sums.end);
    let Lines { pixels, starts, width } = lines;
    let out = &mut out[..(sums.len() - 1) * stride + width];
    kernels.weighted(&mut WeightedRows { pixels, starts, groups, width, out, stride });
}

/// The filter along up to [`TOGETHER`] rows.
struct RowFilter {
    len: usize,
    axis: Axis,
    starts: [Vec<usize>; 2],
    /// The rows, each sample of all of them side by side.
    turned: Cells,
    /// Coarse samples, or the filtered rows.
    filtered: Cells,
}

impl RowFilter {
    fn new(len: usize, axis: Axis) -> Self {
        let mut starts = [Vec::new(), Vec::new()];
        let between = match &axis {
            Axis::Direct(bands) => {
                begin(bands, TOGETHER, &mut starts[0]);
                len
            }
            Axis::Coarse(down, up) => {
                begin(down, TOGETHER, &mut starts[0]);
                begin(up, TOGETHER, &mut starts[1]);
                down.sums
            }
        };
        Self {
            len,
            axis,
            starts,
            turned: Cells::new(len * TOGETHER),
            filtered: Cells::new(between * TOGETHER),
        }
    }

    /// Filters rows, which stay turned.
    fn apply(&mut self, kernels: &Kernels, rows: &[f32]) {
        let Self { len, axis, starts: [starts, starts_up], turned, filtered } = self;
        let height = rows.len() / *len;
        let columns = turned.cells();
        let (rows_stride, columns_stride) = (*len, TOGETHER);
        kernels.transpose(&mut Transpose { rows, rows_stride, columns, columns_stride, width: *len, height });
        // Whole registers; what stands beside the rows is summed too, and not read.
        let width = height.next_multiple_of(REGISTER);
        let lines = Lines { pixels: turned.cells(), starts, width };
        match axis {
            Axis::Direct(bands) => sum(kernels, bands, 0..bands.sums, lines, filtered.cells(), TOGETHER),
            Axis::Coarse(down, up) => {
                sum(kernels, down, 0..down.sums, lines, filtered.cells(), TOGETHER);
                let lines = Lines { pixels: filtered.cells(), starts: starts_up, width };
                sum(kernels, up, 0..up.sums, lines, turned.cells(), TOGETHER);
            }
        }
    }

    fn turn_back(&mut self, kernels: &Kernels, rows: &mut [f32]) {
        let filtered = match self.axis {
            Axis::Direct(_) => &mut self.filtered,
            Axis::Coarse(..) => &mut self.turned,
        };
        kernels.transpose(&mut Transpose {
            rows: filtered.cells(),
            rows_stride: TOGETHER,
            width: rows.len() / self.len,
            height: self.len,
            columns_stride: self.len,
            columns: rows,
        });
    }
}

/// Memory whose rows of [`TOGETHER`] begin where lines of the cache do.
struct Cells {
    memory: Vec<f32>,
    len: usize,
}

impl Cells {
    const LINE_BYTES: usize = 64;

    fn new(len: usize) -> Self {
        Self { memory: vec![0.0; len + Self::LINE_BYTES / size_of::<f32>()], len }
    }

    fn cells(&mut self) -> &mut [f32] {
        let before = self.memory.as_ptr().align_offset(Self::LINE_BYTES).min(self.memory.len() - self.len);
        &mut self.memory[before..before + self.len]
    }
}
