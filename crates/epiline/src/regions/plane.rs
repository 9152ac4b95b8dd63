//! Planes in disparity: a plane in space has a disparity linear in column and row.

use std::ops::RangeInclusive;

use nalgebra::{Matrix3, Vector3};

use super::Region;
use super::profile::{ProfileParams, finite_range_m};
use super::u_disparity::UDisparity;
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;

/// Pixels this far off a plane do not belong to it, px.
pub(super) const TOLERANCE_PX: f64 = 0.75;
/// A column is on the plane if its pixels near it are no farther off in the mean, px.
const ON_PLANE_PX: f64 = 0.5;
/// Rows of a column looked at to see whether it continues a plane.
const ENOUGH_ROWS: usize = 64;
/// Pixels whose errors are alike, because they share most of their matching window.
const ALIKE_PX: f64 = 25.0;
/// A slope of fewer standard deviations is none.
const SIGNIFICANT: f64 = 2.0;

/// A pixel near a plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Member {
    pub x: usize,
    pub y: usize,
    pub disparity_px: f64,
    /// Smaller the farther it is off the plane it was held against.
    pub weight: f64,
}

/// `d = offset + by_x·(x - center.0) + by_y·(y - center.1)`, in columns and rows of the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    center: (f64, f64),
    coefficients: Vector3<f64>,
}

impl Plane {
    /// A plane of one disparity.
    pub fn level(disparity_px: f64) -> Self {
        Self { center: (0.0, 0.0), coefficients: Vector3::new(disparity_px, 0.0, 0.0) }
    }

    /// Disparity at a pixel, px.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f64 {
        let [offset, by_x, by_y] = self.coefficients.into();
        offset + by_x * (x as f64 - self.center.0) + by_y * (y as f64 - self.center.1)
    }

    /// Weighted least squares, level along x or y unless the pixels clearly say otherwise; `None` without pixels.
    ///
    /// A slope that is only noise would carry the nearest edge of a small surface too near.
    pub fn fit(members: &[Member], disparity_sigma_px: f64) -> Option<Self> {
        let total: f64 = members.iter().map(|m| m.weight).sum();
        if total <= 0.0 {
            return None;
        }
        let mean = |of: fn(&Member) -> f64| members.iter().map(|m| m.weight * of(m)).sum::<f64>() / total;
        let center = (mean(|m| m.x as f64), mean(|m| m.y as f64));
        let mut normal = Matrix3::zeros();
        let mut right_side = Vector3::zeros();
        for member in members {
            let row = Vector3::new(1.0, member.x as f64 - center.0, member.y as f64 - center.1);
            normal += member.weight * row * row.transpose();
            right_side += member.weight * member.disparity_px * row;
        }
        let solve = |level: [bool; 2]| {
            let (mut normal, mut right_side) = (normal, right_side);
            for i in (1..3).filter(|i| level[i - 1]) {
                normal.fill_row(i, 0.0);
                normal.fill_column(i, 0.0);
                (normal[(i, i)], right_side[i]) = (1.0, 0.0);
            }
            normal.cholesky().map(|factor| factor.solve(&right_side))
        };
        // A single row or column says nothing about its slope.
        let mut level = [1, 2].map(|i| normal[(i, i)] < 1.0);
        let slopes = solve(level)?;
        for i in 1..3 {
            let sigma = disparity_sigma_px * (ALIKE_PX / normal[(i, i)]).sqrt();
            level[i - 1] |= slopes[i].abs() < SIGNIFICANT * sigma;
        }
        solve(level).map(|coefficients| Self { center, coefficients })
    }
}

/// A region of one map, and how to read it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'a> {
    pub disparity: &'a DisparityMap,
    pub geometry: Option<&'a RectifiedGeometry>,
    pub region: &'a Region,
    pub params: &'a ProfileParams,
    /// Of the region.
    pub u_disparity: &'a UDisparity,
}

impl Scene<'_> {
    /// What is smaller where things are nearer: range in metres, or without geometry minus disparity. NaN where a
    /// disparity has no place in front of the cameras.
    #[inline]
    pub fn distance(&self, disparity_px: f64, x: f64, y: f64) -> f64 {
        self.geometry.map_or(-disparity_px, |geometry| finite_range_m(geometry, disparity_px, x, y))
    }

    /// Calls `visit` with each pixel of a column of the image that lies in every `row_step`th row of the region and near
    /// the plane: row, disparity, and how far that is off the plane.
    #[inline]
    fn for_each_member(
        &self,
        x: usize,
        plane: &Plane,
        tolerance_px: f64,
        row_step: usize,
        mut visit: impl FnMut(usize, f64, f64),
    ) {
        let rows = self.region.y..self.region.y + self.region.height;
        for y in rows.skip(row_step / 2).step_by(row_step) {
            let Some(disparity_px) = self.disparity.at(x, y).map(f64::from) else { continue };
            let residual_px = disparity_px - plane.at(x, y);
            if residual_px.abs() <= tolerance_px {
                visit(y, disparity_px, residual_px);
            }
        }
    }

    /// Lists pixels of some columns of the image that lie in the region and near the plane, and returns for how many
    /// each of them stands: where there are more than `enough`, only every so manieth column is looked at.
    pub fn collect(
        &self,
        columns: RangeInclusive<usize>,
        plane: &Plane,
        tolerance_px: f64,
        enough: usize,
        members: &mut Vec<Member>,
    ) -> usize {
        let pixels = (columns.end() + 1 - columns.start()) * self.region.height;
        let step = pixels.div_ceil(enough);
        members.clear();
        // In the middle of each group of columns, so that the ends are not favoured.
        for x in columns.skip(step / 2).step_by(step) {
            self.for_each_member(x, plane, tolerance_px, 1, |y, disparity_px, residual_px| {
                // Tukey's weight: what lies at the edge of the tolerance hardly pulls.
                let share = residual_px / tolerance_px;
                let inside = 1.0 - share * share;
                members.push(Member { x, y, disparity_px, weight: inside * inside });
            });
        }
        step
    }

    /// Whether a column continues the plane: enough pixels near it, and those on it in the mean. Of another surface
    /// just behind, only the near tail of the scatter is near, all on one side.
    pub fn column_holds(&self, x: usize, plane: &Plane) -> bool {
        let (mut count, mut sum_px) = (0_u32, 0.0);
        let row_step = self.region.height.div_ceil(ENOUGH_ROWS);
        self.for_each_member(x, plane, TOLERANCE_PX, row_step, |_, _, residual_px| {
            count += 1;
            sum_px += residual_px;
        });
        row_step * count as usize >= self.params.min_support
            && count > 0
            && sum_px.abs() <= ON_PLANE_PX * f64::from(count)
    }
}
