//! Patches between pixels, and their sums of products with the columns of a model.

use super::{LANES, SIDE};
use crate::kernels::portable;

/// Neighbours, in each direction, that interpolation combines.
pub const TAPS: usize = 6;
/// Rows that an interpolated patch reads.
pub const ROWS: usize = SIDE + TAPS - 1;
/// Columns of a model.
pub const COLUMNS: usize = 6;

/// Levels of a patch; lanes beyond [`SIDE`] have no meaning, but are finite.
pub type Levels = [[f32; LANES]; SIDE];

/// The columns of a model of how a patch changes, from the patch itself.
///
/// In this order, 0 beyond [`SIDE`] lanes: the derivatives along the row and down the column, by central differences; the
/// levels less their mean; ones; and the derivative along the row times the distance from the middle column and from the
/// middle row, in halves of the patch.
#[derive(Debug)]
pub struct ModelColumns<'a> {
    /// Elements of the image from the pixel above and left of the patch on; of `SIDE + 2` rows, `LANES + 2` elements are
    /// read.
    pub image: &'a [u8],
    /// Elements from one row to the next.
    pub stride: usize,
    /// Out.
    pub columns: &'a mut [Levels; COLUMNS],
}

/// 1 in the lanes that count.
const COUNTS: [f32; LANES] = {
    let mut counts = [0.0; LANES];
    let mut x = 0;
    while x < SIDE {
        counts[x] = 1.0;
        x += 1;
    }
    counts
};

/// Distance of row or column `i` from the middle, in halves of the patch.
#[inline(always)]
fn from_middle(i: usize) -> f32 {
    const HALF: f32 = (SIDE / 2) as f32;
    (i as f32 - HALF) / HALF
}

#[inline(always)]
pub(in crate::kernels) fn model_columns(call: &mut ModelColumns<'_>) {
    const READ: usize = LANES + 2;
    let mut rows = [[0f32; READ]; SIDE + 2];
    let mut sums = [0f32; LANES];
    for (y, row) in rows.iter_mut().enumerate() {
        let source: &[u8; READ] = call.image[y * call.stride..].first_chunk().expect("a patch lies inside");
        for x in 0..READ {
            row[x] = f32::from(source[x]);
        }
        if (1..=SIDE).contains(&y) {
            for x in 0..LANES {
                sums[x] += COUNTS[x] * row[x + 1];
            }
        }
    }
    let mean = sum(&sums) / (SIDE * SIDE) as f32;
    let [along_x, along_y, levels, ones, slope_x, slope_y] = &mut *call.columns;
    for y in 0..SIDE {
        let [above, here, below] = [&rows[y], &rows[y + 1], &rows[y + 2]];
        for x in 0..LANES {
            let derivative = COUNTS[x] * 0.5 * (here[x + 2] - here[x]);
            along_x[y][x] = derivative;
            along_y[y][x] = COUNTS[x] * 0.5 * (below[x + 1] - above[x + 1]);
            levels[y][x] = COUNTS[x] * (here[x + 1] - mean);
            ones[y][x] = COUNTS[x];
            slope_x[y][x] = from_middle(x) * derivative;
            slope_y[y][x] = from_middle(y) * derivative;
        }
    }
}

/// A patch between pixels: the weighted sum of [`TAPS`] neighbours in each direction.
#[derive(Debug)]
pub struct Interpolate<'a> {
    /// Elements of the image from the first neighbour on; of [`ROWS`] rows, `LANES + TAPS - 1` elements are read.
    pub image: &'a [u8],
    /// Elements from one row to the next.
    pub stride: usize,
    /// Weights along the rows,
    pub across: [f32; TAPS],
    /// and along the columns.
    pub down: [f32; TAPS],
    /// Out.
    pub patch: &'a mut Levels,
}

#[inline(always)]
pub(in crate::kernels) fn interpolate(call: &mut Interpolate<'_>) {
    const READ: usize = LANES + TAPS - 1;
    let mut rows = [[0f32; LANES]; ROWS];
    for (y, row) in rows.iter_mut().enumerate() {
        let source: &[u8; READ] = call.image[y * call.stride..].first_chunk().expect("a patch lies inside");
        for (tap, weight) in call.across.iter().enumerate() {
            for x in 0..LANES {
                row[x] += weight * f32::from(source[x + tap]);
            }
        }
    }
    for (out, taps) in call.patch.iter_mut().zip(rows.windows(TAPS)) {
        let mut sum = [0f32; LANES];
        for (weight, row) in call.down.iter().zip(taps) {
            for x in 0..LANES {
                sum[x] += weight * row[x];
            }
        }
        *out = sum;
    }
}

/// Sums of products of a patch with each column of a model.
#[derive(Debug)]
pub struct Project<'a> {
    /// 0 in the lanes beyond [`SIDE`].
    pub columns: &'a [Levels; COLUMNS],
    /// The patch.
    pub patch: &'a Levels,
    /// Out.
    pub sums: [f32; COLUMNS],
}

#[inline(always)]
pub(in crate::kernels) fn project(call: &mut Project<'_>) {
    let mut lanes = [[0f32; LANES]; COLUMNS];
    for y in 0..SIDE {
        let patch = &call.patch[y];
        for (lanes, column) in lanes.iter_mut().zip(call.columns) {
            for x in 0..LANES {
                lanes[x] += column[y][x] * patch[x];
            }
        }
    }
    call.sums = lanes.map(|lanes| sum(&lanes));
}

/// Sums of products of a model's columns with each other.
#[derive(Debug)]
pub struct Gram<'a> {
    /// 0 in the lanes beyond [`SIDE`].
    pub columns: &'a [Levels; COLUMNS],
    /// Out: symmetric.
    pub products: [[f32; COLUMNS]; COLUMNS],
}

#[inline(always)]
pub(in crate::kernels) fn gram(call: &mut Gram<'_>) {
    for (i, a) in call.columns.iter().enumerate() {
        for (j, b) in call.columns[..=i].iter().enumerate() {
            let mut lanes = [0f32; LANES];
            for (a, b) in a.iter().zip(b) {
                for x in 0..LANES {
                    lanes[x] += a[x] * b[x];
                }
            }
            let product = sum(&lanes);
            (call.products[i][j], call.products[j][i]) = (product, product);
        }
    }
}

/// The sum of all lanes, by halves.
#[inline(always)]
fn sum(lanes: &[f32; LANES]) -> f32 {
    let mut sums = *lanes;
    let mut half = LANES / 2;
    while half > 0 {
        for x in 0..half {
            sums[x] += sums[x + half];
        }
        half /= 2;
    }
    sums[0]
}

portable!(columns, model_columns, ModelColumns<'_>);
portable!(interpolated, interpolate, Interpolate<'_>);
portable!(projected, project, Project<'_>);
portable!(products, gram, Gram<'_>);
