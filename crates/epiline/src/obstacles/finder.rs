//! From a disparity map to obstacles.
//!
//! ```text
//! cells    = per column and bin of disparity, the pixels that stand on the ground          (u-disparity)
//! peaks    = per column, the nearest surface of each unbroken stretch with enough pixels
//! clusters = peaks joined where they touch: next to each other in columns, no gap in depth (union–find)
//! outline  = per cluster, its nearest peak in each column, as a line with few corners
//! parts    = outlines cut where they recede: a box beside a wall is not the wall, two faces of a box are one
//! measure each part from its outline; keep what is large and high enough
//! drop low ones that lie in the ground
//! sort by range
//! ```

use std::sync::Arc;

use super::cells::Cells;
use super::columns::{ColumnReader, Peak};
use super::measure::Part;
use super::paper::BrightClusters;
use super::polyline::{Outliner, Point};
use super::standing::{Standing, lies};
use super::{Obstacle, ObstacleMethod, ObstacleParams};
use crate::error::Result;
use crate::ground::GroundPlane;
use crate::matching::DisparityMap;
use crate::range::check_size;
use crate::rectification::RectifiedGeometry;
use crate::regions::Region;

/// Columns from one peak to the next it may touch: one column may be missing between them.
const COLUMN_REACH: usize = 2;
/// Bins of half a pixel that stretches may be apart and still touch, whatever that is in metres.
const BIN_REACH: usize = 2;
/// A part of fewer columns is a sliver if this many columns beside it there is something nearer.
const SLIVER: usize = 9;
const SLIVER_REACH: usize = 2;
/// Of two peaks in a column of a cluster, the farther one counts if it has more than so many times the pixels.
const OUTWEIGHED: usize = 8;
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

/// Peaks of one cluster.
#[derive(Debug, Clone, Copy, Default)]
struct Cluster {
    /// How many, and where they begin in the list by clusters.
    peaks: usize,
    offset: usize,
}

/// Finds obstacles; keeps its buffers from frame to frame.
#[derive(Debug, Default)]
pub struct ObstacleFinder {
    standing: Standing,
    cells: Cells,
    columns: ColumnReader,
    peaks: Vec<Peak>,
    /// Union–find: index of another peak of the cluster, or its own at the root.
    parents: Vec<usize>,
    /// Cluster of each root peak.
    cluster_of_root: Vec<usize>,
    clusters: Vec<Cluster>,
    /// Peaks cluster by cluster, in order of their columns, near ones first.
    by_cluster: Vec<Peak>,
    /// One cluster's nearest peak per column, and the same as points of its outline.
    nearest: Vec<Peak>,
    points: Vec<Point>,
    outliner: Outliner,
    fitted_px: Vec<f64>,
    parts: Vec<(usize, usize)>,
    part: Part,
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
        self.join_peaks(geometry, params);
        self.form_clusters();
        for index in 0..self.clusters.len() {
            self.outline(index);
            self.cut(geometry, params);
            for index in 0..self.parts.len() {
                let (begin, end) = self.parts[index];
                let (peaks, points) = (&self.nearest[begin..end], &self.points[begin..end]);
                let outliner = &mut self.outliner;
                if let Some(found) = self.part.measure(peaks, points, outliner, geometry, ground, params) {
                    if !ground.is_some_and(|ground| lies(&found, peaks, disparity, ground, params)) {
                        out.extend(found.in_regions(regions, &mut self.spare_lists));
                    }
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
        let Self { bright, nearest, points, outliner, part, spare_lists, .. } = self;
        let smallest_px = params.smallest_disparity_px(geometry) - geometry.doffs_px;
        bright.find(disparity, smallest_px, params, nearest, |peaks| {
            list_points(peaks, points);
            if let Some(found) = part.measure(peaks, points, outliner, geometry, None, params) {
                out.extend(found.in_regions(regions, spare_lists));
            }
        })
    }

    fn join_peaks(&mut self, geometry: &RectifiedGeometry, params: &ObstacleParams) {
        self.parents.clear();
        self.parents.extend(0..self.peaks.len());
        let depth_m = |bin: usize| geometry.depth_m(Cells::center_px(bin));
        for i in 0..self.peaks.len() {
            for j in i + 1..self.peaks.len() {
                let (one, other) = (self.peaks[i], self.peaks[j]);
                if other.column > one.column + COLUMN_REACH {
                    break;
                }
                let (near, far) = if one.far >= other.far { (one, other) } else { (other, one) };
                let touching = near.far <= far.near + BIN_REACH
                    || depth_m(far.near) - depth_m(near.far) <= params.range_gap_m;
                if touching {
                    let (one, other) = (self.root(i), self.root(j));
                    self.parents[one.max(other)] = one.min(other);
                }
            }
        }
    }

    fn root(&mut self, mut peak: usize) -> usize {
        while self.parents[peak] != peak {
            // Halving the path keeps later walks short.
            self.parents[peak] = self.parents[self.parents[peak]];
            peak = self.parents[peak];
        }
        peak
    }

    /// Lists the peaks cluster by cluster.
    fn form_clusters(&mut self) {
        const NEW: usize = usize::MAX;
        self.clusters.clear();
        self.cluster_of_root.clear();
        self.cluster_of_root.resize(self.peaks.len(), NEW);
        for i in 0..self.peaks.len() {
            let root = self.root(i);
            if self.cluster_of_root[root] == NEW {
                self.cluster_of_root[root] = self.clusters.len();
                self.clusters.push(Cluster::default());
            }
            self.clusters[self.cluster_of_root[root]].peaks += 1;
        }
        let mut total = 0;
        for cluster in &mut self.clusters {
            cluster.offset = total;
            total += std::mem::take(&mut cluster.peaks);
        }
        let Some(&any) = self.peaks.first() else { return };
        self.by_cluster.clear();
        self.by_cluster.resize(total, any);
        for i in 0..self.peaks.len() {
            let root = self.root(i);
            let cluster = &mut self.clusters[self.cluster_of_root[root]];
            self.by_cluster[cluster.offset + cluster.peaks] = self.peaks[i];
            cluster.peaks += 1;
        }
    }

    /// The nearest peak of a cluster in each of its columns, unless what stands behind it there has many times its pixels.
    fn outline(&mut self, index: usize) {
        let Cluster { peaks, offset } = self.clusters[index];
        self.nearest.clear();
        for peak in &self.by_cluster[offset..offset + peaks] {
            match self.nearest.last_mut() {
                Some(nearest) if nearest.column == peak.column => {
                    if peak.support > OUTWEIGHED * nearest.support {
                        *nearest = *peak;
                    }
                }
                _ => self.nearest.push(*peak),
            }
        }
        list_points(&self.nearest, &mut self.points);
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

    /// Drops parts narrower than a matching window that lie beside a nearer one: windows that see the edge of that.
    fn drop_slivers(&mut self) {
        let Self { parts, points, .. } = self;
        if parts.len() < 2 {
            return;
        }
        let nearer_beside = |at: usize, beside: Option<usize>| {
            beside.and_then(|index| points.get(index)).is_some_and(|other| {
                let near = (other.x - points[at].x).abs() <= COLUMN_REACH as f64 + 1.0;
                near && other.disparity_px > points[at].disparity_px
            })
        };
        parts.retain(|&(begin, end)| {
            let before = begin.checked_sub(SLIVER_REACH);
            end - begin >= SLIVER
                || !(nearer_beside(begin, before) || nearer_beside(end - 1, Some(end - 1 + SLIVER_REACH)))
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
