//! Directions over the floor as lines of the image.

use nalgebra::Vector3;

use crate::error::{Error, Result};
use crate::rectification::RectifiedGeometry;

/// Bits of what is outside the image: anything but zero.
const OUTSIDE: u8 = 1;
/// Least share of a line of sight that may point forward over the floor, and least share of up that is up in the image.
const LEAST_FORWARD: f64 = 0.1;
const LEAST_UPRIGHT: f64 = 0.5;
/// Lines at most, as a multiple of the image's columns.
const MOST_LINES: f64 = 4.0;
/// One pixel, where positions in a row are counted.
const ONE: i64 = 1 << 32;
/// Elements copied at once.
const CHUNK: usize = 16;

/// Vertical planes through the camera, as the lines of the image they are seen as, from left to right.
///
/// Line `i` meets the row where the lines are widest apart, the top row of a camera that looks down, at column
/// `first + i`, and runs towards the point where all verticals meet. Each row of the image is the lines' order, scaled
/// and shifted: line `i` meets row `y` at column `scale(y)·(first + i) + shift(y)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rays {
    geometry: RectifiedGeometry,
    /// Up, and the directions over the floor that are ahead and to the left, in the camera's frame.
    up: Vector3<f64>,
    pub ahead: Vector3<f64>,
    left: Vector3<f64>,
    /// The row where lines are a column apart.
    widest_row: f64,
    first: f64,
    pub count: usize,
    /// Columns per row that a line runs to the right, at column 0 and more for each column on.
    slope: f64,
    slope_per_column: f64,
}

impl Rays {
    /// The lines of a camera for which `down` points down; a unit vector.
    pub fn new(geometry: &RectifiedGeometry, down: &Vector3<f64>) -> Result<Self> {
        let up = -down;
        let refuse = |reason: &str| Err(Error::degenerate("scan", reason.to_string()));
        if -up.y < LEAST_UPRIGHT {
            return refuse(
                "the camera leans or tilts too far: its columns do not run from the ceiling to the floor",
            );
        }
        let ahead = (Vector3::z() - up * up.z).normalize();
        let left = up.cross(&ahead);
        let bottom = geometry.height as f64 - 1.0;
        let widest_row = if up.z > 0.0 { bottom } else { 0.0 };
        let toward_zenith = geometry.focal_px * up.y - (widest_row - geometry.cy_px) * up.z;
        let mut rays = Self {
            geometry: *geometry,
            up,
            ahead,
            left,
            widest_row,
            first: 0.0,
            count: geometry.width,
            slope: (geometry.focal_px * up.x + geometry.cx_px * up.z) / toward_zenith,
            slope_per_column: -up.z / toward_zenith,
        };
        let right = geometry.width as f64 - 1.0;
        let corners = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)];
        let steep = corners.iter().any(|&(x, y)| {
            !(rays.forward_per_depth(x, y) >= LEAST_FORWARD && rays.scale(y) >= LEAST_FORWARD)
        });
        if steep {
            return refuse("the camera looks down too steeply: directions over the floor meet in its view");
        }
        let at_widest = corners.map(|(x, y)| (x - rays.shift(y)) / rays.scale(y));
        let first = at_widest.into_iter().fold(f64::INFINITY, f64::min);
        let last = at_widest.into_iter().fold(f64::NEG_INFINITY, f64::max);
        if last - first > MOST_LINES * geometry.width as f64 {
            return refuse("the camera looks down too steeply: its view is too wide over the floor");
        }
        // A camera that is level to within rounding has its columns, no more.
        rays.first = (first + 1e-6).floor();
        rays.count = ((last - 1e-6).ceil() - rays.first) as usize + 1;
        Ok(rays)
    }

    fn scale(&self, y: f64) -> f64 {
        1.0 + (y - self.widest_row) * self.slope_per_column
    }

    fn shift(&self, y: f64) -> f64 {
        (y - self.widest_row) * self.slope
    }

    /// Column where a line meets a row.
    pub fn column(&self, line: usize, y: f64) -> f64 {
        self.scale(y) * (self.first + line as f64) + self.shift(y)
    }

    /// The lowest row of the image that a line meets; `None` if it meets none.
    pub fn lowest_row(&self, line: usize) -> Option<f64> {
        let (width, bottom) = (self.geometry.width as f64, self.geometry.height as f64 - 1.0);
        let slope = self.column(line, 1.0) - self.column(line, 0.0);
        let at_bottom = self.column(line, bottom);
        let edge = if at_bottom < -0.5 {
            -0.5
        } else if at_bottom >= width - 0.5 {
            width - 0.5
        } else {
            return Some(bottom);
        };
        let row = (bottom - (at_bottom - edge) / slope).floor();
        (row >= 0.0 && row < bottom).then_some(row)
    }

    /// Distance ahead over the floor per depth Z of a pixel. Its inverse is linear along a row but for terms of
    /// second order in roll times pitch.
    pub fn forward_per_depth(&self, x: f64, y: f64) -> f64 {
        self.ahead.dot(&self.ray(x, y))
    }

    /// The horizontal direction of a line, in the camera's frame: one unit ahead.
    pub fn direction(&self, line: usize) -> Vector3<f64> {
        let ray = self.ray(self.column(line, self.widest_row), self.widest_row);
        self.ahead + self.left * (self.left.dot(&ray) / self.ahead.dot(&ray))
    }

    /// Rows by which the top of something is above its foot, per metre of its height over its depth, at a row.
    pub fn rows_per_slope(&self, y: f64) -> f64 {
        self.geometry.focal_px * (self.up.z * (y - self.geometry.cy_px) / self.geometry.focal_px - self.up.y)
    }

    /// How much nearer the top of something is than its foot, metres per metre of its height; negative if farther.
    pub fn top_depth_per_height(&self) -> f64 {
        self.up.z
    }

    fn ray(&self, x: f64, y: f64) -> Vector3<f64> {
        let RectifiedGeometry { focal_px, cx_px, cy_px, .. } = self.geometry;
        Vector3::new((x - cx_px) / focal_px, (y - cy_px) / focal_px, 1.0)
    }

    /// The disparities of a row where the lines meet it, and their bits; `OUTSIDE` where that is outside the image.
    /// There is an element per line.
    pub fn sample(&self, y: usize, raws: &[u16], bits: &[u8], line_raws: &mut [u16], line_bits: &mut [u8]) {
        let step = ((self.scale(y as f64) * ONE as f64) as i64).min(ONE);
        // Half a pixel more: cutting off what is behind the point then rounds.
        let mut at = ((self.column(0, y as f64) + 0.5) * ONE as f64) as i64;
        let outside = if at < 0 { (at.unsigned_abs().div_ceil(step.unsigned_abs())) as usize } else { 0 };
        let outside = outside.min(line_bits.len());
        line_bits[..outside].fill(OUTSIDE);
        at += outside as i64 * step;
        let mut begin = outside;
        while begin < line_bits.len() {
            let x = (at >> 32) as usize;
            if x >= raws.len() {
                line_bits[begin..].fill(OUTSIDE);
                break;
            }
            // As long as rounding takes neighbouring columns, they are copied at once.
            let run = if step == ONE { raws.len() } else { ((at & (ONE - 1)) / (ONE - step)) as usize + 1 };
            let run = run.min(line_bits.len() - begin).min(raws.len() - x);
            copy_run(&raws[x..], &mut line_raws[begin..], run);
            copy_run(&bits[x..], &mut line_bits[begin..], run);
            begin += run;
            at += run as i64 * step;
        }
    }
}

/// Copies at least the first `run` elements, of which both have that many. Whole chunks take less time than a count of
/// elements does, and those too many are written over by the run that follows.
fn copy_run<T: Copy>(from: &[T], to: &mut [T], run: usize) {
    let mut at = 0;
    while at < run {
        let (Some(chunk), Some(place)) =
            (from[at..].first_chunk::<CHUNK>(), to[at..].first_chunk_mut::<CHUNK>())
        else {
            to[at..run].copy_from_slice(&from[at..run]);
            return;
        };
        *place = *chunk;
        at += CHUNK;
    }
}
