//! The pixels that are asked where the ground is.

use super::plane_fit::DisparityPlane;
use crate::matching::{DisparityMap, Validity};
use crate::rectification::RectifiedGeometry;

/// Columns and rows looked at, at most.
pub(super) const COLUMNS: usize = 64;
const ROWS: usize = 80;
/// Stands for a disparity where there is none: nearer than everything, so that it is neither on nor below a plane.
pub(super) const NOTHING: f32 = 1.0e6;

/// A pixel with a disparity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    /// Column and row from the principal point, px.
    pub u: f32,
    pub v: f32,
    /// Disparity counted from infinity, px, positive.
    pub seen_px: f32,
}

/// A row of the grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    /// From the principal point, px.
    pub v: f32,
    /// Disparities counted from infinity, px, or [`NOTHING`].
    pub seen_px: [f32; COLUMNS],
}

/// A grid of pixels; keeps its memory.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    pub rows: Vec<Row>,
    /// Columns from the principal point, px.
    pub u: [f32; COLUMNS],
    /// How many of them are in the image.
    pub columns: usize,
    /// How many have a disparity.
    pub count: usize,
}

impl Default for Samples {
    fn default() -> Self {
        Self { rows: Vec::new(), u: [0.0; COLUMNS], columns: 0, count: 0 }
    }
}

impl Samples {
    /// Looks at a map of the geometry's size.
    pub fn take(&mut self, disparity: &DisparityMap, geometry: &RectifiedGeometry) {
        let (width, height) = (disparity.width(), disparity.height());
        let (across, down) = (width.div_ceil(COLUMNS), height.div_ceil(ROWS));
        let first = across / 2;
        self.columns = (width - first).div_ceil(across);
        self.u = std::array::from_fn(|column| ((first + column * across) as f64 - geometry.cx_px) as f32);
        let doffs_px = geometry.doffs_px as f32;
        self.rows.clear();
        self.count = 0;
        for y in (down / 2..height).step_by(down) {
            let (values, validity) = (&disparity.values.row(y)[first..], &disparity.validity.row(y)[first..]);
            let (mut raws, mut bits) = ([0_u16; COLUMNS], [Validity::BORDER; COLUMNS]);
            for column in 0..self.columns {
                raws[column] = values[column * across];
                bits[column] = validity[column * across];
            }
            let mut row = Row { v: (y as f64 - geometry.cy_px) as f32, seen_px: [NOTHING; COLUMNS] };
            let mut known = [0_u8; COLUMNS];
            for column in 0..COLUMNS {
                let counted_px = f32::from(raws[column]) * (1.0 / f32::from(DisparityMap::SCALE)) + doffs_px;
                let is_known = Validity::has_value(bits[column]) & (counted_px > 0.0);
                row.seen_px[column] = if is_known { counted_px } else { NOTHING };
                known[column] = u8::from(is_known);
            }
            self.count += known.iter().map(|&known| usize::from(known)).sum::<usize>();
            self.rows.push(row);
        }
    }

    /// Every so many rows, as far as a plane is seen there, with the plane's disparity at the principal column. Above
    /// its horizon nothing can be on a plane or below it.
    pub fn rows_of(&self, plane: &DisparityPlane, step: usize) -> impl Iterator<Item = (&Row, f32)> {
        let (by_v, at_center) = (plane.by_v as f32, plane.at_center as f32);
        let ends_px = [self.u[0], self.u[COLUMNS - 1]].map(|u| plane.by_u as f32 * u);
        let most_px = ends_px[0].max(ends_px[1]);
        let rows = self.rows.iter().step_by(step).map(move |row| (row, by_v * row.v + at_center));
        rows.filter(move |(_, plane_px)| plane_px + most_px > 0.0)
    }

    /// The first sample of a column at a row of the grid or below it.
    pub fn at_or_below(&self, column: usize, row: usize) -> Option<Sample> {
        self.rows[row..].iter().find_map(|row| self.sample(row, column))
    }

    /// The lowest sample of a column.
    pub fn lowest(&self, column: usize) -> Option<Sample> {
        self.rows.iter().rev().find_map(|row| self.sample(row, column))
    }

    fn sample(&self, row: &Row, column: usize) -> Option<Sample> {
        let seen_px = row.seen_px[column];
        (seen_px < NOTHING).then_some(Sample { u: self.u[column], v: row.v, seen_px })
    }
}
