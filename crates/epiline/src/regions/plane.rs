//! Planes in disparity: a plane in space has a disparity linear in column and row.

use super::Region;
use super::profile::{ProfileParams, finite_range_m};
use super::tiles::Tiles;
use crate::kernels::planes::TilePlane;
use crate::rectification::RectifiedGeometry;

/// Pixels whose errors are alike, because they share most of their matching window.
const ALIKE_PX: f64 = 25.0;
/// A slope of fewer standard deviations is none.
const SIGNIFICANT: f64 = 2.0;

/// `d = offset + by_x·(x - center.0) + by_y·(y - center.1)`, in columns and rows of the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub center: (f64, f64),
    pub offset: f64,
    pub by_x: f64,
    pub by_y: f64,
}

impl Plane {
    /// A plane of one disparity.
    pub fn level(disparity_px: f64) -> Self {
        Self { center: (0.0, 0.0), offset: disparity_px, by_x: 0.0, by_y: 0.0 }
    }

    /// Disparity at a pixel, px.
    #[inline]
    pub fn at(&self, x: f64, y: f64) -> f64 {
        self.offset + self.by_x * (x - self.center.0) + self.by_y * (y - self.center.1)
    }

    /// As seen from a tile whose lane 0 is column `x` of the image and whose row 0 is row `y`.
    pub fn of_tile(&self, x: usize, y: f64) -> TilePlane {
        TilePlane {
            at_origin: self.at(x as f64, y) as f32,
            per_lane: self.by_x as f32,
            per_row: self.by_y as f32,
        }
    }
}

/// Sums over pixels near a plane, as weighted least squares ask for them: `r` is a pixel's disparity less the plane's,
/// `x` and `y` are counted from a place that the caller chooses.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    /// Pixels.
    pub count: f64,
    pub w: f64,
    pub wx: f64,
    pub wy: f64,
    pub wxx: f64,
    pub wxy: f64,
    pub wyy: f64,
    pub wr: f64,
    pub wxr: f64,
    pub wyr: f64,
}

impl Moments {
    /// The plane through the pixels near `plane`, of each `step` of which one was looked at; `origin` is where x and y
    /// are counted from. With the slopes of `prior` unless the pixels clearly say otherwise; `None` without pixels.
    ///
    /// A slope that is only noise would carry the nearest edge of a small surface too near.
    pub fn fit(
        &self,
        plane: &Plane,
        prior: &Plane,
        origin: (f64, f64),
        step: usize,
        disparity_sigma_px: f64,
    ) -> Option<Plane> {
        if self.w <= 0.0 {
            return None;
        }
        let (x, y, r) = (self.wx / self.w, self.wy / self.w, self.wr / self.w);
        let center = (origin.0 + x, origin.1 + y);
        // About the centre, where the offset does not depend on the slopes.
        let [xx, xy, yy] = [self.wxx - x * self.wx, self.wxy - x * self.wy, self.wyy - y * self.wy];
        // What is left by the plane, and what that has beyond the prior's slopes.
        let (more_x, more_y) = (plane.by_x - prior.by_x, plane.by_y - prior.by_y);
        let xd = self.wxr - x * self.wr + more_x * xx + more_y * xy;
        let yd = self.wyr - y * self.wr + more_x * xy + more_y * yy;
        // A single row or column says nothing about its slope.
        let (has_x, has_y) = (xx * step as f64 >= 1.0, yy * step as f64 >= 1.0);
        let slopes = |has_x: bool, has_y: bool| match (has_x, has_y) {
            (true, true) => {
                let determinant = xx * yy - xy * xy;
                (determinant > 1e-9 * xx * yy)
                    .then(|| ((xd * yy - yd * xy) / determinant, (yd * xx - xd * xy) / determinant))
            }
            (true, false) => Some((xd / xx, 0.0)),
            (false, true) => Some((0.0, yd / yy)),
            (false, false) => Some((0.0, 0.0)),
        };
        let (by_x, by_y) = slopes(has_x, has_y)?;
        let is_clear = |slope: f64, spread: f64| {
            let sigma = disparity_sigma_px * (ALIKE_PX / (spread * step as f64)).sqrt();
            slope.abs() >= SIGNIFICANT * sigma
        };
        let (by_x, by_y) = slopes(has_x && is_clear(by_x, xx), has_y && is_clear(by_y, yy))?;
        Some(Plane {
            center,
            offset: plane.at(center.0, center.1) + r,
            by_x: prior.by_x + by_x,
            by_y: prior.by_y + by_y,
        })
    }
}

/// A region of one map, and how to read it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'a> {
    pub tiles: &'a Tiles,
    pub geometry: Option<&'a RectifiedGeometry>,
    pub region: &'a Region,
    pub params: &'a ProfileParams,
}

impl Scene<'_> {
    /// What is smaller where things are nearer: range in metres, or without geometry minus disparity. NaN where a
    /// disparity has no place in front of the cameras.
    #[inline]
    pub fn distance(&self, disparity_px: f64, x: f64, y: f64) -> f64 {
        self.geometry.map_or(-disparity_px, |geometry| finite_range_m(geometry, disparity_px, x, y))
    }

    /// The same in the middle row of a column of the region.
    pub fn distance_of_column(&self, column: usize, disparity_px: f64) -> f64 {
        self.distance(disparity_px, (self.region.x + column) as f64, self.middle_row())
    }

    /// Of the region, in rows of the image.
    pub fn middle_row(&self) -> f64 {
        self.region.y as f64 + 0.5 * (self.region.height - 1) as f64
    }

    /// `u` of the rays of a column of the image. Without geometry all rays are alike.
    pub fn slope_of_column(&self, x: usize) -> f64 {
        self.geometry.map_or(0.0, |geometry| (x as f64 - geometry.cx_px) / geometry.focal_px)
    }

    /// `v` of the rays of a row of the image, and how much more that is for each row on.
    pub fn slopes_of_rows(&self, y: usize) -> (f64, f64) {
        self.geometry.map_or((0.0, 0.0), |geometry| {
            ((y as f64 - geometry.cy_px) / geometry.focal_px, 1.0 / geometry.focal_px)
        })
    }

    /// What a disparity exceeds that at infinity by, less the disparity. Without geometry something positive, so that
    /// every disparity is in front of the cameras.
    pub fn doffs_px(&self) -> f64 {
        self.geometry.map_or(1.0, |geometry| geometry.doffs_px)
    }
}
