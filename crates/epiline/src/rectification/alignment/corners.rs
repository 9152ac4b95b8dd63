//! Points that can be located in both directions, spread over the image.

use std::cmp::Reverse;

use crate::image::{Image, ImageRef};

/// Half side of the window over which gradients are gathered, pixels.
const RADIUS: usize = 3;
const WINDOW: usize = 2 * RADIUS + 1;
/// Weakest corner: a mean squared step of 5 grey levels across two pixels in the direction that has least of it.
const MIN_STRENGTH: f32 = 25.0 * (WINDOW * WINDOW) as f32;

/// How corners are spread: the strongest ones are taken from each cell of a grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    /// Number of cells along the longer side, at most 255.
    pub cells: usize,
    /// Smallest cell, pixels.
    pub min_cell_px: usize,
    /// A cell keeps one corner per this many square pixels.
    pub area_per_corner_px: usize,
}

/// A corner at a whole pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    pub x: u16,
    pub y: u16,
    /// Place among the corners of its cell, strongest first.
    pub rank: u16,
    cell: u16,
    strength: f32,
}

/// Finds corners after Shi & Tomasi, "Good features to track", 1994: local maxima of the smaller eigenvalue of
/// `Σ ∇I ∇Iᵀ` over a window. The sums are exact integers, so the same picture gives the same corners everywhere.
#[derive(Debug)]
pub(super) struct CornerDetector {
    spread: Spread,
    /// `gx²`, `gx·gy` and `gy²` of the last [`WINDOW`] rows, and their sums down each column. All sums stay below 2²⁴, so
    /// single precision holds them exactly, and vectors of it multiply faster than those of integers.
    products: Vec<[Vec<f32>; 3]>,
    columns: [Vec<f32>; 3],
    strength: Image<f32>,
    is_maximum: Vec<bool>,
    /// The corners found, from the top down and from left to right in each row.
    pub found: Vec<Corner>,
    /// Index into `found` of the first corner at or below each row; one entry more than there are rows.
    pub row_starts: Vec<usize>,
}

impl CornerDetector {
    pub fn new(spread: Spread) -> Self {
        Self {
            spread,
            products: Vec::new(),
            columns: Default::default(),
            strength: Image::default(),
            is_maximum: Vec::new(),
            found: Vec::new(),
            row_starts: Vec::new(),
        }
    }

    /// Finds the corners of an image. None lies nearer than `margin` to its edge or to a pixel that is 0 in `valid`.
    pub fn detect(&mut self, image: ImageRef<'_, u8>, valid: Option<ImageRef<'_, u8>>, margin: usize) {
        let (width, height) = (image.width(), image.height());
        self.found.clear();
        self.row_starts.clear();
        if width > 2 * margin && height > 2 * margin {
            self.measure_strength(image);
            self.collect_maxima(valid, margin);
            self.thin_out();
        }
        self.row_starts.resize(height + 1, 0);
        for (y, start) in self.row_starts.iter_mut().enumerate() {
            *start = self.found.partition_point(|corner| usize::from(corner.y) < y);
        }
    }

    /// Fills `strength` wherever the window and its gradients lie inside the image, and 0 elsewhere.
    fn measure_strength(&mut self, image: ImageRef<'_, u8>) {
        let (width, height) = (image.width(), image.height());
        self.strength.resize(width, height);
        self.strength.fill(0.0);
        self.products.resize_with(WINDOW, Default::default);
        for plane in self.products.iter_mut().flatten().chain(&mut self.columns) {
            plane.clear();
            plane.resize(width, 0.0);
        }
        for y in 1..height - 1 {
            let row = &mut self.products[y % WINDOW];
            for (column, old) in self.columns.iter_mut().zip(row.iter()) {
                column.iter_mut().zip(old).for_each(|(sum, old)| *sum -= old);
            }
            gradient_products(image, y, row);
            for (column, new) in self.columns.iter_mut().zip(row.iter()) {
                column.iter_mut().zip(new).for_each(|(sum, new)| *sum += new);
            }
            if y >= WINDOW {
                smaller_eigenvalues(&self.columns, self.strength.row_mut(y - RADIUS));
            }
        }
    }

    fn collect_maxima(&mut self, valid: Option<ImageRef<'_, u8>>, margin: usize) {
        let (width, height) = (self.strength.width(), self.strength.height());
        let cell_px = self.spread.cell_side_px(width, height);
        let cells_across = width.div_ceil(cell_px);
        self.is_maximum.clear();
        self.is_maximum.resize(width, false);
        for y in margin..height - margin {
            mark_maxima([y - 1, y, y + 1].map(|y| self.strength.row(y)), &mut self.is_maximum);
            for x in margin..width - margin {
                if self.is_maximum[x] && valid.is_none_or(|valid| is_valid_around(valid, x, y, margin)) {
                    let cell = (y / cell_px * cells_across + x / cell_px) as u16;
                    let strength = self.strength.row(y)[x];
                    self.found.push(Corner { x: x as u16, y: y as u16, rank: 0, cell, strength });
                }
            }
        }
    }

    /// Keeps the strongest corners of every cell.
    fn thin_out(&mut self) {
        let cell_px = self.spread.cell_side_px(self.strength.width(), self.strength.height());
        let per_cell = (cell_px * cell_px / self.spread.area_per_corner_px) as u16;
        // Strengths are positive: their bits sort as they do.
        self.found.sort_unstable_by_key(|c| (c.cell, Reverse(c.strength.to_bits()), c.y, c.x));
        let mut previous = None;
        let mut rank = 0;
        for corner in &mut self.found {
            rank = if previous == Some(corner.cell) { rank + 1 } else { 0 };
            previous = Some(corner.cell);
            corner.rank = rank;
        }
        self.found.retain(|corner| corner.rank < per_cell);
        self.found.sort_unstable_by_key(|c| (c.y, c.x));
    }
}

impl Spread {
    /// At most `cells`² cells, so that a cell's number fits 16 bits whatever the image.
    fn cell_side_px(&self, width: usize, height: usize) -> usize {
        width.max(height).div_ceil(self.cells).max(self.min_cell_px)
    }
}

/// Marks where the middle row is strong and no neighbour is stronger; of two equal ones the earlier counts.
fn mark_maxima([above, here, below]: [&[f32]; 3], is_maximum: &mut [bool]) {
    let inner = here.len() - 2;
    let [north_west, north, north_east] = [0, 1, 2].map(|x| &above[x..x + inner]);
    let [west, center, east] = [0, 1, 2].map(|x| &here[x..x + inner]);
    let [south_west, south, south_east] = [0, 1, 2].map(|x| &below[x..x + inner]);
    let marks = &mut is_maximum[1..=inner];
    // No short circuit: whole vectors at a time beat a branch that textured pictures make unpredictable.
    for i in 0..inner {
        let it = center[i];
        marks[i] = (it > MIN_STRENGTH)
            & (it > north_west[i])
            & (it > north[i])
            & (it > north_east[i])
            & (it > west[i])
            & (it >= east[i])
            & (it >= south_west[i])
            & (it >= south[i])
            & (it >= south_east[i]);
    }
}

pub(super) fn is_valid_around(valid: ImageRef<'_, u8>, x: usize, y: usize, margin: usize) -> bool {
    (y - margin..=y + margin).all(|y| valid.row(y)[x - margin..=x + margin].iter().all(|&v| v != 0))
}

/// Products of the central differences of row `y`; 0 in the first and last column.
fn gradient_products(image: ImageRef<'_, u8>, y: usize, [xx, xy, yy]: &mut [Vec<f32>; 3]) {
    let (above, here, below) = (image.row(y - 1), image.row(y), image.row(y + 1));
    let inner = 1..here.len() - 1;
    let across = here.iter().zip(&here[2..]);
    let down = above[inner.clone()].iter().zip(&below[inner.clone()]);
    let outputs = xx[inner.clone()].iter_mut().zip(&mut xy[inner.clone()]).zip(&mut yy[inner]);
    for (((west, east), (north, south)), ((xx, xy), yy)) in across.zip(down).zip(outputs) {
        let gx = f32::from(*east) - f32::from(*west);
        let gy = f32::from(*south) - f32::from(*north);
        (*xx, *xy, *yy) = (gx * gx, gx * gy, gy * gy);
    }
}

/// The smaller eigenvalue of the window around every pixel of a row whose window lies inside.
fn smaller_eigenvalues(columns: &[Vec<f32>; 3], strength: &mut [f32]) {
    let inner = strength.len().saturating_sub(2 * RADIUS);
    // Equal lengths known beforehand: whole vectors at a time.
    let [xx, xy, yy] = columns.each_ref().map(|column| -> [&[f32]; WINDOW] {
        std::array::from_fn(|k| column.get(k..k + inner).unwrap_or_default())
    });
    if xx.iter().any(|part| part.len() != inner) {
        return;
    }
    let sum = |c: &[&[f32]; WINDOW], i: usize| {
        ((c[0][i] + c[1][i]) + (c[2][i] + c[3][i])) + ((c[4][i] + c[5][i]) + c[6][i])
    };
    for (i, strength) in strength[RADIUS..RADIUS + inner].iter_mut().enumerate() {
        let (xx, xy, yy) = (sum(&xx, i), sum(&xy, i), sum(&yy, i));
        let half_difference = 0.5 * (xx - yy);
        *strength = 0.5 * (xx + yy) - (half_difference * half_difference + xy * xy).sqrt();
    }
}
