//! From a disparity map to obstacles.
//!
//! ```text
//! cells    = per column and bin of disparity, the pixels that stand on the ground          (u-disparity)
//! peaks    = per column, the nearest surface of each unbroken stretch with enough pixels
//! outlines = peaks of neighbouring columns linked where they touch and none is closer: one peak per column,
//!            as a line with few corners
//! parts    = outlines cut where they recede: a box beside a wall is not the wall, two faces of a box are one
//! measure each part from its outline; keep what is large and high enough
//! drop low ones that are the ground itself
//! sort by range
//! ```

use std::sync::Arc;

use super::cells::Cells;
use super::columns::{ColumnReader, Peak};
use super::footing::Footing;
use super::measure::Part;
use super::paper::BrightClusters;
use super::polyline::{Outliner, Point};
use super::standing::Standing;
use super::{Obstacle, ObstacleMethod, ObstacleParams};
use crate::error::Result;
use crate::ground::GroundPlane;
use crate::matching::DisparityMap;
use crate::range::check_size;
use crate::rectification::RectifiedGeometry;
use crate::regions::Region;

/// Columns from one peak to the next it may touch: one column may be missing between them.
const COLUMN_REACH: usize = 2;
/// The same without a ground, where the foot of a thing, which blends into a floor, may make columns seem to lean.
const COLUMN_REACH_UPRIGHT: usize = 6;
/// Bins of half a pixel that stretches may be apart and still touch, whatever that is in metres.
const BIN_REACH: usize = 2;
/// A part of fewer columns is a sliver if this many columns beside it there is something nearer.
const SLIVER: usize = 9;
const SLIVER_REACH: usize = 2;
/// A point farther than this from the points around it is moved to them, px.
const STEADY_PX: f64 = 0.75;
/// An outline has a corner where it leaves a straight line by more than this, px.
const CORNER_PX: f64 = 0.45;
/// It is cut at a corner that recedes by more than this, px, and more than this, metres.
const RECESS_PX: f64 = 0.28;
const RECESS_M: f64 = 0.08;
/// A plane that passes the camera at less than this, metres, is none: matching windows that see both of two surfaces lie
/// between them.
const STEEPEST_M: f64 = 0.2;

/// No peak.
const NONE: usize = usize::MAX;

/// Finds obstacles; keeps its buffers from frame to frame.
#[derive(Debug, Default)]
pub struct ObstacleFinder {
    standing: Standing,
    cells: Cells,
    columns: ColumnReader,
    peaks: Vec<Peak>,
    /// Where the peaks of each column begin, and the end of the last.
    column_starts: Vec<usize>,
    /// Per peak: the ones that it is linked with to the left and to the right, or [`NONE`].
    before: Vec<usize>,
    after: Vec<usize>,
    /// One outline's peaks, and the same as points.
    outline: Vec<Peak>,
    points: Vec<Point>,
    outliner: Outliner,
    fitted_px: Vec<f64>,
    parts: Vec<(usize, usize)>,
    part: Part,
    footing: Footing,
    bright: BrightClusters,
    spare_lists: Vec<Vec<Arc<str>>>,
}

impl ObstacleFinder {
    /// Fills `out` with the obstacles that stand in any of the regions, nearest first.
    ///
    /// With a ground, what is an obstacle is told by its height over it; without, by what a column sees upright.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`](crate::Error::SizeMismatch) if map and geometry differ in size,
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a cylinder, a region outside the map or
    /// parameters out of range.
    pub fn find(
        &mut self,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        ground: Option<&GroundPlane>,
        regions: &[Region],
        params: &ObstacleParams,
        out: &mut Vec<Obstacle>,
    ) -> Result<()> {
        params.validate()?;
        geometry.require_pinhole("find_obstacles")?;
        check_size(disparity, geometry)?;
        for region in regions {
            region.validate(disparity.width(), disparity.height())?;
        }
        // Lists of regions are used again, so that a warm finder allocates nothing.
        self.spare_lists.extend(out.drain(..).map(|obstacle| obstacle.regions));
        if regions.is_empty() {
            return Ok(());
        }
        match params.method {
            ObstacleMethod::UDisparity => {
                self.find_standing(disparity, geometry, ground, regions, params, out)
            }
            ObstacleMethod::Paper => self.find_bright(disparity, geometry, regions, params, out)?,
        }
        let order = |one: &Obstacle, other: &Obstacle| {
            one.range_m.total_cmp(&other.range_m).then(one.bounds.x.cmp(&other.bounds.x))
        };
        out.sort_unstable_by(order);
        for (id, obstacle) in out.iter_mut().enumerate() {
            obstacle.id = id;
        }
        Ok(())
    }

    /// What stands on the ground, or upright where there is none.
    fn find_standing(
        &mut self,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        ground: Option<&GroundPlane>,
        regions: &[Region],
        params: &ObstacleParams,
        out: &mut Vec<Obstacle>,
    ) {
        let largest = disparity.values.as_slice().iter().copied().max().unwrap_or(0);
        self.standing.prepare(geometry, ground, largest, params);
        self.cells.count(disparity, &self.standing, largest);
        self.columns.read(&self.cells, geometry, ground.is_some(), params, &mut self.peaks);
        self.list_columns(disparity.width());
        let reach = if ground.is_some() { COLUMN_REACH } else { COLUMN_REACH_UPRIGHT };
        for distance in 1..=reach {
            self.link_peaks(distance, geometry, params);
        }
        for first in 0..self.peaks.len() {
            if self.before[first] != NONE {
                continue;
            }
            self.follow(first);
            self.cut(geometry, params);
            for index in 0..self.parts.len() {
                let (begin, end) = self.parts[index];
                let (peaks, points) = (&self.outline[begin..end], &self.points[begin..end]);
                let outliner = &mut self.outliner;
                let Some(found) = self.part.measure(peaks, points, outliner, geometry, ground, params) else {
                    continue;
                };
                let footing = &mut self.footing;
                if !ground.is_some_and(|ground| {
                    footing.is_ground(&found, peaks, disparity, geometry, ground, params)
                }) {
                    out.extend(found.in_regions(regions, &mut self.spare_lists));
                }
            }
        }
    }

    /// What is brighter than its neighbourhood: the paper's method.
    fn find_bright(
        &mut self,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        regions: &[Region],
        params: &ObstacleParams,
        out: &mut Vec<Obstacle>,
    ) -> Result<()> {
        let Self { bright, outline, points, outliner, part, spare_lists, .. } = self;
        let smallest_px = params.smallest_disparity_px(geometry) - geometry.doffs_px;
        bright.find(disparity, smallest_px, params, outline, |peaks| {
            list_points(peaks, points);
            if let Some(found) = part.measure(peaks, points, outliner, geometry, None, params) {
                out.extend(found.in_regions(regions, spare_lists));
            }
        })
    }

    /// Where each column's peaks are in the list.
    fn list_columns(&mut self, width: usize) {
        let Self { peaks, column_starts, before, after, .. } = self;
        column_starts.clear();
        column_starts.extend((0..=width).scan(0, |at, column| {
            *at += peaks[*at..].iter().take_while(|peak| peak.column < column).count();
            Some(*at)
        }));
        for links in [before, after] {
            links.clear();
            links.resize(peaks.len(), NONE);
        }
    }

    /// Links peaks so many columns apart that are not linked yet: each with the one closest to it in disparity, if they
    /// touch and it is the closest to that one too.
    fn link_peaks(&mut self, distance: usize, geometry: &RectifiedGeometry, params: &ObstacleParams) {
        let depth_m = |bin: usize| geometry.depth_m(Cells::center_px(bin));
        let touching = |one: &Peak, other: &Peak| {
            let (near, far) = if one.far >= other.far { (one, other) } else { (other, one) };
            near.far <= far.near + BIN_REACH || depth_m(far.near) - depth_m(near.far) <= params.range_gap_m
        };
        let Self { peaks, column_starts, before, after, .. } = self;
        let closest = |peak: &Peak, column: usize, links: &[usize]| {
            let free = (column_starts[column]..column_starts[column + 1])
                .filter(|&other| links[other] == NONE && touching(peak, &peaks[other]));
            let gap = |other: usize| (peaks[other].disparity_px - peak.disparity_px).abs();
            free.min_by(|&one, &other| gap(one).total_cmp(&gap(other)))
        };
        for left in 0..peaks.len() {
            let column = peaks[left].column + distance;
            if after[left] != NONE || column + 1 >= column_starts.len() {
                continue;
            }
            if let Some(right) = closest(&peaks[left], column, before)
                && closest(&peaks[right], peaks[left].column, after) == Some(left)
            {
                (after[left], before[right]) = (right, left);
            }
        }
    }

    /// Lists the outline that begins with a peak.
    fn follow(&mut self, first: usize) {
        self.outline.clear();
        let mut peak = first;
        while peak != NONE {
            self.outline.push(self.peaks[peak]);
            peak = self.after[peak];
        }
        list_points(&self.outline, &mut self.points);
        self.outliner.steady(&mut self.points, STEADY_PX);
    }

    /// Where the outline is cut into parts: first and end of each.
    fn cut(&mut self, geometry: &RectifiedGeometry, params: &ObstacleParams) {
        self.outliner.find_corners(&self.points, CORNER_PX);
        self.outliner.fit(&self.points, &mut self.fitted_px);
        self.parts.clear();
        let corners = &self.outliner.corners;
        let mut begin = 0;
        for corner in 1..corners.len() {
            let (before, at) = (corners[corner - 1], corners[corner]);
            let rise_px = (self.fitted_px[corner] - self.fitted_px[corner - 1]).abs();
            let across = self.points[at].x - self.points[before].x;
            let depths_m = [corner - 1, corner].map(|corner| geometry.depth_m(self.fitted_px[corner]));
            let gap_m = (depths_m[0] - depths_m[1]).abs();
            if rise_px * STEEPEST_M > geometry.baseline_m * across && gap_m > params.range_gap_m {
                // Between two surfaces, not one.
                if before > begin {
                    self.parts.push((begin, before));
                }
                begin = at;
                continue;
            }
            if corner + 1 == corners.len() {
                continue;
            }
            let recess_px = self.outliner.recess_px(&self.points, &self.fitted_px, corner);
            let disparity_px = self.fitted_px[corner];
            let recess_m = geometry.depth_m(disparity_px) * recess_px / (disparity_px + geometry.doffs_px);
            if recess_px > RECESS_PX && recess_m > RECESS_M {
                self.parts.push((begin, at));
                begin = at;
            }
        }
        self.parts.push((begin, self.points.len()));
        self.drop_slivers();
    }

    /// Drops parts narrower than a matching window that lie beside something nearer in the same rows: windows that see
    /// the edge of that.
    fn drop_slivers(&mut self) {
        let Self { parts, outline, peaks, column_starts, .. } = self;
        let nearer_in = |peak: &Peak, column: usize| {
            peaks[column_starts[column]..column_starts[column + 1]].iter().any(|other| {
                other.disparity_px > peak.disparity_px && other.top <= peak.bottom && peak.top <= other.bottom
            })
        };
        let last_column = column_starts.len().saturating_sub(2);
        parts.retain(|&(begin, end)| {
            let (first, last) = (&outline[begin], &outline[end - 1]);
            let left = first.column.saturating_sub(SLIVER_REACH)..first.column;
            let right = last.column + 1..(last.column + SLIVER_REACH).min(last_column) + 1;
            end - begin >= SLIVER
                || !(left.into_iter().any(|column| nearer_in(first, column))
                    || right.into_iter().any(|column| nearer_in(last, column)))
        });
    }
}

/// The outline that peaks of different columns are points of.
fn list_points(peaks: &[Peak], points: &mut Vec<Point>) {
    points.clear();
    points.extend(peaks.iter().map(|peak| Point {
        x: peak.column as f64,
        disparity_px: peak.disparity_px,
        weight: peak.support as f64,
    }));
}
