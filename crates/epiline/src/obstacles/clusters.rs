//! Supported clusters in u-disparity.
//!
//! ```text
//! for each region:
//!   runs     = per column, unbroken stretches of disparity with enough pixels in 1 px
//!   clusters = runs joined where they touch: next to each other in columns, no gap in depth   (union–find)
//!   measure each cluster from its pixels
//! sort by range
//! ```

use super::measure::{ClusterPixel, Measure};
use super::{Obstacle, ObstacleParams};
use crate::error::Result;
use crate::image::Image;
use crate::matching::{DisparityMap, Validity};
use crate::range::check_size;
use crate::rectification::RectifiedGeometry;
use crate::regions::{Region, UDisparity};

/// Columns from one run to the next it may touch: one column may be missing between them.
const COLUMN_REACH: usize = 2;
/// Bins of half a pixel that runs may be apart and still touch, whatever that is in metres.
const BIN_REACH: usize = 2;
/// An unbroken stretch of supported bins in one column of a region.
#[derive(Debug, Clone, Copy)]
struct Run {
    column: usize,
    /// Largest bin: the near end.
    near: usize,
    /// Smallest bin.
    far: usize,
    /// Union–find: index of another run of the cluster, or its own at the root.
    parent: usize,
}

/// Runs that touch.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    /// Columns that have a run, and the last of them.
    columns: usize,
    right: usize,
    /// Pixels; stays 0 for a cluster of too few columns.
    support: usize,
    /// Where its pixels begin in the finder's list, and how many have been put there.
    offset: usize,
    filled: usize,
}

impl Cluster {
    const EMPTY: Self = Self { columns: 0, right: usize::MAX, support: 0, offset: 0, filled: 0 };
}

/// Finds obstacles; keeps its buffers from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct ObstacleFinder {
    u_disparity: UDisparity,
    runs: Vec<Run>,
    /// The open run of each column while bins are visited, as index into `runs`.
    open: Vec<Option<usize>>,
    clusters: Vec<Cluster>,
    /// Cluster of each root run.
    cluster_of_root: Vec<Option<usize>>,
    /// Cluster + 1 of each cell of the histogram; 0 is none.
    labels: Image<u32>,
    /// The pixels of every cluster, cluster by cluster.
    pixels: Vec<ClusterPixel>,
    measure: Measure,
}

impl ObstacleFinder {
    /// Fills `out` with the obstacles of all regions, nearest first.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`](crate::Error::SizeMismatch) if map and geometry differ in size,
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a region outside the map or parameters out of
    /// range.
    pub fn find(
        &mut self,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        regions: &[Region],
        params: &ObstacleParams,
        out: &mut Vec<Obstacle>,
    ) -> Result<()> {
        params.validate()?;
        check_size(disparity, geometry)?;
        for region in regions {
            region.validate(disparity.width(), disparity.height())?;
        }
        out.clear();
        for region in regions {
            self.u_disparity.count(disparity, region);
            self.find_runs(geometry, params);
            self.join_runs(geometry, params);
            self.form_clusters();
            self.label_cells(params);
            self.gather_pixels(disparity, region);
            for cluster in self.clusters.iter().filter(|c| c.support >= params.min_pixels.max(1)) {
                let pixels = &mut self.pixels[cluster.offset..cluster.offset + cluster.support];
                let obstacle = self.measure.obstacle(pixels, geometry, region, params);
                if params.wants(&obstacle, region) {
                    out.push(obstacle);
                }
            }
        }
        out.sort_by(|one, other| one.range_m.total_cmp(&other.range_m));
        for (id, obstacle) in out.iter_mut().enumerate() {
            obstacle.id = id;
        }
        Ok(())
    }

    fn find_runs(&mut self, geometry: &RectifiedGeometry, params: &ObstacleParams) {
        let counts = self.u_disparity.counts();
        let smallest_px = params.smallest_disparity_px(geometry);
        self.runs.clear();
        self.open.clear();
        self.open.resize(counts.width(), None);
        let is_too_far = |bin: usize| UDisparity::center_px(bin) + geometry.doffs_px < smallest_px;
        for bin in (0..counts.height()).rev().take_while(|&bin| !is_too_far(bin)) {
            let here = counts.row(bin);
            let nearer = (bin + 1 < counts.height()).then(|| counts.row(bin + 1));
            // What lies beyond the range must not support what lies before it: a wall there would hold up the floor.
            let farther = (bin > 0 && !is_too_far(bin - 1)).then(|| counts.row(bin - 1));
            for (column, &count) in here.iter().enumerate() {
                if count == 0 {
                    continue;
                }
                let with =
                    |row: Option<&[u16]>| usize::from(count) + row.map_or(0, |r| usize::from(r[column]));
                if with(nearer).max(with(farther)) < params.min_support {
                    continue;
                }
                match self.open[column] {
                    Some(run) if self.runs[run].far == bin + 1 => self.runs[run].far = bin,
                    _ => {
                        self.open[column] = Some(self.runs.len());
                        self.runs.push(Run { column, near: bin, far: bin, parent: 0 });
                    }
                }
            }
        }
        self.runs.sort_unstable_by_key(|run| (run.column, std::cmp::Reverse(run.near)));
        for (index, run) in self.runs.iter_mut().enumerate() {
            run.parent = index;
        }
    }

    fn join_runs(&mut self, geometry: &RectifiedGeometry, params: &ObstacleParams) {
        for i in 0..self.runs.len() {
            for j in i + 1..self.runs.len() {
                let (one, other) = (self.runs[i], self.runs[j]);
                if other.column > one.column + COLUMN_REACH {
                    break;
                }
                let (near_one, far_one) = if one.far >= other.far { (one, other) } else { (other, one) };
                let touching = near_one.far <= far_one.near + BIN_REACH || {
                    let gap_m = depth_m(geometry, far_one.near) - depth_m(geometry, near_one.far);
                    gap_m <= params.range_gap_m
                };
                if touching {
                    let (one, other) = (self.root(i), self.root(j));
                    self.runs[one.max(other)].parent = one.min(other);
                }
            }
        }
    }

    fn root(&mut self, mut run: usize) -> usize {
        while self.runs[run].parent != run {
            // Halving the path keeps later walks short.
            self.runs[run].parent = self.runs[self.runs[run].parent].parent;
            run = self.runs[run].parent;
        }
        run
    }

    fn form_clusters(&mut self) {
        self.clusters.clear();
        self.cluster_of_root.clear();
        self.cluster_of_root.resize(self.runs.len(), None);
        for i in 0..self.runs.len() {
            let (column, root) = (self.runs[i].column, self.root(i));
            let index = *self.cluster_of_root[root].get_or_insert_with(|| {
                self.clusters.push(Cluster::EMPTY);
                self.clusters.len() - 1
            });
            // Runs come column by column.
            let cluster = &mut self.clusters[index];
            cluster.columns += usize::from(cluster.right != column);
            cluster.right = column;
        }
    }

    /// Counts the pixels of all clusters of enough columns and writes their numbers into the cells.
    fn label_cells(&mut self, params: &ObstacleParams) {
        self.labels.resize(self.u_disparity.counts().width(), self.u_disparity.counts().height());
        self.labels.fill(0);
        for i in 0..self.runs.len() {
            let (run, root) = (self.runs[i], self.root(i));
            let Some(index) = self.cluster_of_root[root] else { continue };
            let cluster = &mut self.clusters[index];
            if cluster.columns < params.min_columns {
                continue;
            }
            for bin in run.far..=run.near {
                cluster.support += usize::from(self.u_disparity.counts().at(run.column, bin));
                self.labels.row_mut(bin)[run.column] = index as u32 + 1;
            }
        }
    }

    /// Lists each cluster's pixels.
    fn gather_pixels(&mut self, disparity: &DisparityMap, region: &Region) {
        let mut total = 0;
        for cluster in &mut self.clusters {
            (cluster.offset, cluster.filled) = (total, 0);
            total += cluster.support;
        }
        self.pixels.resize(total, ClusterPixel::default());
        let columns = region.x..region.x + region.width;
        for y in region.y..region.y + region.height {
            let raws = &disparity.values.row(y)[columns.clone()];
            let bits = &disparity.validity.row(y)[columns.clone()];
            for (column, (&raw, &bits)) in raws.iter().zip(bits).enumerate() {
                if !Validity::has_value(bits) {
                    continue;
                }
                let label = self.labels.row(UDisparity::bin(raw))[column];
                if label > 0 {
                    let cluster = &mut self.clusters[label as usize - 1];
                    let pixel = ClusterPixel { raw, x: (region.x + column) as u16, y: y as u16 };
                    self.pixels[cluster.offset + cluster.filled] = pixel;
                    cluster.filled += 1;
                }
            }
        }
    }
}

/// Depth at the middle of a bin, metres; the runs hold only bins where it is positive and finite.
fn depth_m(geometry: &RectifiedGeometry, bin: usize) -> f64 {
    geometry.depth_m(UDisparity::center_px(bin))
}
