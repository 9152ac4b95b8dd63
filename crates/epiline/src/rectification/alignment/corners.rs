//! Points that can be located in both directions, spread over the image.

use std::ops::Range;

use crate::image::ImageRef;
use crate::kernels::Kernels;
use crate::kernels::alignment::corners::{GradientRow, MaximaRow, RADIUS, StrengthRow, WINDOW};

/// Weakest corner: a mean squared step of 5 grey levels across two pixels in the direction that has least of it.
const MIN_STRENGTH: f32 = 25.0 * (WINDOW * WINDOW) as f32;

/// How corners are spread: the strongest ones are taken from each cell of a grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    /// Number of cells along the longer side.
    pub cells: usize,
    /// Smallest cell, pixels.
    pub min_cell_px: usize,
    /// A cell keeps one corner per this many square pixels.
    pub area_per_corner_px: usize,
}

/// A corner at a whole pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corner {
    pub x: u16,
    pub y: u16,
    /// Place among the corners of its cell, strongest first.
    pub rank: u16,
    strength: f32,
}

/// Finds corners after Shi & Tomasi, "Good features to track", 1994: local maxima of the smaller eigenvalue of
/// `Σ ∇I ∇Iᵀ` over a window. The sums are exact integers, so the same picture gives the same corners everywhere.
#[derive(Debug)]
pub(super) struct CornerDetector {
    spread: Spread,
    kernels: Kernels,
    /// Products of the gradients of the last [`WINDOW`] rows, and their sums down each column.
    products: Vec<[Vec<f32>; 3]>,
    columns: [Vec<f32>; 3],
    /// Strengths of the last three rows.
    strength: [Vec<f32>; 3],
    marks: Vec<u8>,
    /// The strongest corners so far of every cell in a row of cells, strongest first.
    cells: Vec<Vec<Corner>>,
    /// The corners found, from the top down and from left to right in each row.
    pub found: Vec<Corner>,
    /// Index into `found` of the first corner at or below each row; one entry more than there are rows.
    pub row_starts: Vec<usize>,
}

impl CornerDetector {
    pub fn new(spread: Spread, kernels: Kernels) -> Self {
        Self {
            spread,
            kernels,
            products: Vec::new(),
            columns: Default::default(),
            strength: Default::default(),
            marks: Vec::new(),
            cells: Vec::new(),
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
            self.search(image, valid, margin);
        }
        self.row_starts.resize(height + 1, 0);
        let mut seen = 0;
        for (y, start) in self.row_starts.iter_mut().enumerate() {
            seen += self.found[seen..].iter().take_while(|corner| usize::from(corner.y) < y).count();
            *start = seen;
        }
    }

    /// Strengths row by row, and the strongest maxima of every cell.
    fn search(&mut self, image: ImageRef<'_, u8>, valid: Option<ImageRef<'_, u8>>, margin: usize) {
        let (width, height) = (image.width(), image.height());
        let cell_px = self.spread.cell_side_px(width, height);
        let per_cell = self.spread.corners_per_cell(width, height);
        self.cells.resize_with(self.cells.len().max(width.div_ceil(cell_px)), Vec::new);
        self.cells.iter_mut().for_each(|cell| cell.reserve(per_cell));
        self.marks.resize(width, 0);
        self.products.resize_with(WINDOW, Default::default);
        let planes = self.products.iter_mut().flatten().chain(&mut self.columns).chain(&mut self.strength);
        for plane in planes {
            plane.clear();
            plane.resize(width, 0.0);
        }
        // A maximum needs the row below it, that the window of that row, and that the gradients' neighbours.
        const BEHIND: usize = RADIUS + 1;
        for y in 1..height - 1 {
            self.kernels.gradient(&mut GradientRow {
                above: image.row(y - 1),
                here: image.row(y),
                below: image.row(y + 1),
                products: self.products[y % WINDOW].each_mut().map(Vec::as_mut_slice),
                columns: self.columns.each_mut().map(Vec::as_mut_slice),
            });
            if y >= WINDOW {
                let columns = self.columns.each_ref().map(Vec::as_slice);
                let strength = &mut self.strength[(y - RADIUS) % 3];
                self.kernels.strength(&mut StrengthRow { columns, strength });
            }
            if y >= BEHIND && (margin..height - margin).contains(&(y - BEHIND)) {
                self.collect_maxima(y - BEHIND, valid, margin, per_cell, cell_px);
                if (y - BEHIND + 1).is_multiple_of(cell_px) || y - BEHIND + 1 == height - margin {
                    self.close_cells();
                }
            }
        }
    }

    /// Collects the strongest maxima of a row.
    fn collect_maxima(
        &mut self,
        y: usize,
        valid: Option<ImageRef<'_, u8>>,
        margin: usize,
        per_cell: usize,
        cell_px: usize,
    ) {
        let Self { strength, marks, kernels, cells, .. } = self;
        let [above, here, below] = [y + 2, y, y + 1].map(|y| strength[y % 3].as_slice());
        kernels.maxima(&mut MaximaRow { above, here, below, least: MIN_STRENGTH, marks });
        for x in marked(marks, margin..here.len() - margin) {
            let strength = here[x];
            let cell = &mut cells[x / cell_px];
            if cell.len() == per_cell && cell[per_cell - 1].strength >= strength {
                continue;
            }
            let rank = cell.iter().take_while(|stronger| stronger.strength >= strength).count();
            if valid.is_none_or(|valid| is_valid_around(valid, x, y, margin)) {
                cell.truncate(per_cell - 1);
                cell.insert(rank, Corner { x: x as u16, y: y as u16, rank: 0, strength });
            }
        }
    }

    /// A row of cells is complete: its corners are handed over.
    fn close_cells(&mut self) {
        let first = self.found.len();
        for cell in &mut self.cells {
            for (rank, corner) in cell.drain(..).enumerate() {
                self.found.push(Corner { rank: rank as u16, ..corner });
            }
        }
        self.found[first..].sort_unstable_by_key(|corner| (corner.y, corner.x));
    }
}

impl Spread {
    pub fn cell_side_px(&self, width: usize, height: usize) -> usize {
        width.max(height).div_ceil(self.cells).max(self.min_cell_px)
    }

    /// Most corners that a cell keeps.
    fn corners_per_cell(&self, width: usize, height: usize) -> usize {
        self.cell_side_px(width, height).pow(2) / self.area_per_corner_px
    }

    /// How many cells there are.
    pub fn cell_count(&self, width: usize, height: usize) -> usize {
        let side = self.cell_side_px(width, height);
        width.div_ceil(side) * height.div_ceil(side)
    }
}

/// The columns in a range whose marks are not 0.
fn marked(marks: &[u8], range: Range<usize>) -> impl Iterator<Item = usize> {
    fn of(first: usize, marks: &[u8]) -> impl Iterator<Item = usize> {
        marks.iter().enumerate().filter(|(_, mark)| **mark != 0).map(move |(k, _)| first + k)
    }
    let first = range.start;
    // Few are marked: eight at a time are passed over.
    let (eights, rest) = marks[range].as_chunks::<8>();
    let somewhere = eights.iter().enumerate().filter(|(_, marks)| u64::from_ne_bytes(**marks) != 0);
    somewhere.flat_map(move |(i, marks)| of(first + 8 * i, marks)).chain(of(first + 8 * eights.len(), rest))
}

pub(super) fn is_valid_around(valid: ImageRef<'_, u8>, x: usize, y: usize, margin: usize) -> bool {
    (y - margin..=y + margin).all(|y| valid.row(y)[x - margin..=x + margin].iter().all(|&v| v != 0))
}
