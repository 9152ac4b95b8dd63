//! A tile of disparities against a plane, which is linear in column and row.

use super::portable;
use super::sort::LANES;
use super::tile::{NO_VALUE, Row};

/// Values of a tile are sixteenths of a pixel.
const PX_PER_VALUE: f32 = 1.0 / 16.0;
/// Lanes whose sums fit the registers.
const HALF: usize = LANES / 2;

/// `at_origin + per_lane·lane + per_row·row`, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TilePlane {
    /// At lane 0 of row 0.
    pub at_origin: f32,
    /// More for each lane on.
    pub per_lane: f32,
    /// More for each row on.
    pub per_row: f32,
}

impl TilePlane {
    #[inline(always)]
    fn lane(&self, lane: usize) -> f32 {
        self.at_origin + self.per_lane * lane as f32
    }
}

/// What least squares ask of each column's pixels near a plane: `r` is a pixel's disparity less the plane's, px, `y` its
/// row, `w` its weight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlaneSums {
    /// How many pixels.
    pub count: [f32; LANES],
    /// Σ r.
    pub r: [f32; LANES],
    /// Σ w.
    pub w: [f32; LANES],
    /// Σ w·r.
    pub wr: [f32; LANES],
    /// Σ w·y.
    pub wy: [f32; LANES],
    /// Σ w·y².
    pub wyy: [f32; LANES],
    /// Σ w·y·r.
    pub wyr: [f32; LANES],
}

/// Sums over the pixels near a plane.
///
/// ```text
/// near:  |r| <= tolerance and plane >= least
/// w    = (1 - (r / tolerance)²)²         Tukey's: what lies at the edge of the tolerance hardly pulls
/// ```
#[derive(Debug)]
pub struct PlaneTile<'a> {
    /// Rows.
    pub rows: &'a [Row],
    /// Every so manieth of them is looked at, from the middle of the first group on; at least 1.
    pub step: usize,
    /// Number of the first row: `y` of the sums, and of the plane.
    pub first_row: f32,
    /// The plane.
    pub plane: TilePlane,
    /// How far off it pixels may be, px.
    pub tolerance_px: f32,
    /// Where the plane has less disparity than that, px, pixels are not looked at.
    pub least_px: f32,
    /// Out.
    pub sums: &'a mut PlaneSums,
}

impl PlaneTile<'_> {
    pub(super) fn check(&self) {
        assert!(self.step > 0, "a step of rows");
    }
}

#[inline(always)]
pub(super) fn plane_tile(tile: &mut PlaneTile<'_>) {
    for first in [0, HALF] {
        half_tile(tile, first);
    }
}

#[inline(always)]
fn half_tile(tile: &mut PlaneTile<'_>, first: usize) {
    let (plane, least) = (tile.plane, tile.least_px);
    let (tolerance, per_tolerance) = (tile.tolerance_px, 1.0 / tile.tolerance_px);
    let mut in_row_0 = [0.0; HALF];
    for (lane, at) in in_row_0.iter_mut().enumerate() {
        *at = plane.lane(first + lane);
    }
    let mut sums = [[0.0_f32; HALF]; 7];
    for (i, row) in tile.rows.iter().enumerate().skip(tile.step / 2).step_by(tile.step) {
        let y = tile.first_row + i as f32;
        let lift = plane.per_row * y;
        let values: &[u16; HALF] = row[first..first + HALF].try_into().expect("half of the lanes");
        for lane in 0..HALF {
            let at = in_row_0[lane] + lift;
            let r = f32::from(values[lane]) * PX_PER_VALUE - at;
            let is_near = (values[lane] != NO_VALUE) & (r.abs() <= tolerance) & (at >= least);
            let share = r * per_tolerance;
            let inside = 1.0 - share * share;
            let w = if is_near { inside * inside } else { 0.0 };
            let (wr, wy) = (w * r, w * y);
            sums[0][lane] += if is_near { 1.0 } else { 0.0 };
            sums[1][lane] += if is_near { r } else { 0.0 };
            sums[2][lane] += w;
            sums[3][lane] += wr;
            sums[4][lane] += wy;
            sums[5][lane] += wy * y;
            sums[6][lane] += wr * y;
        }
    }
    let PlaneSums { count, r, w, wr, wy, wyy, wyr } = &mut *tile.sums;
    for (out, sums) in [count, r, w, wr, wy, wyy, wyr].into_iter().zip(sums) {
        out[first..first + HALF].copy_from_slice(&sums);
    }
}

/// Picks out pixels near a plane whose place on it is near the camera.
///
/// With `D = plane + doffs` of a place, its Euclidean range is proportional to `sqrt(1 + u² + v²) / D`.
///
/// ```text
/// masks[i] has bit x:  |values[i][x] - plane| <= tolerance,
///                      and of the place `below` rows under it: plane >= least, D > 0, D² >= nearness·(1 + u² + v²)
/// ```
#[derive(Debug)]
pub struct NearTile<'a> {
    /// Rows of values.
    pub rows: &'a [Row],
    /// Number of the first one, for the plane.
    pub first_row: f32,
    /// How many rows under a value's pixel its place lies.
    pub below: f32,
    /// The plane.
    pub plane: TilePlane,
    /// How far off it values may be, px.
    pub tolerance_px: f32,
    /// See above, px.
    pub least_px: f32,
    /// Disparity of infinity, negative, px.
    pub doffs_px: f32,
    /// `1 + u²` of each lane.
    pub column_terms: &'a [f32; LANES],
    /// `v` of row 0, and how much more for each row on.
    pub v: (f32, f32),
    /// See above, px².
    pub nearness: f32,
    /// Out: one for each row.
    pub masks: &'a mut [u32],
}

impl NearTile<'_> {
    pub(super) fn check(&self) {
        assert!(self.rows.len() == self.masks.len(), "a mask for each row");
    }
}

#[inline(always)]
pub(super) fn near_tile(tile: &mut NearTile<'_>) {
    let plane = tile.plane;
    let mut in_row_0 = [0.0; LANES];
    for (lane, at) in in_row_0.iter_mut().enumerate() {
        *at = plane.lane(lane);
    }
    for (i, (row, mask)) in tile.rows.iter().zip(&mut *tile.masks).enumerate() {
        let y = tile.first_row + i as f32;
        let place = y + tile.below;
        let (lift, place_lift) = (plane.per_row * y, plane.per_row * place);
        let v = tile.v.0 + tile.v.1 * place;
        let row_term = v * v;
        let mut bits = [0_u32; LANES];
        for lane in 0..LANES {
            let r = f32::from(row[lane]) * PX_PER_VALUE - (in_row_0[lane] + lift);
            let at = in_row_0[lane] + place_lift;
            let from_infinity = at + tile.doffs_px;
            let is_near = (row[lane] != NO_VALUE)
                & (r.abs() <= tile.tolerance_px)
                & (at >= tile.least_px)
                & (from_infinity > 0.0)
                & (from_infinity * from_infinity >= tile.nearness * (tile.column_terms[lane] + row_term));
            bits[lane] = if is_near { 1 << lane } else { 0 };
        }
        let mut all = 0;
        for bit in bits {
            all |= bit;
        }
        *mask = all;
    }
}

portable!(sums, plane_tile, PlaneTile<'_>);
portable!(near, near_tile, NearTile<'_>);
