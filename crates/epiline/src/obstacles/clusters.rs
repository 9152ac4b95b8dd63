//! Supported clusters in u-disparity.
//!
//! ```text
//! for each region:
//!   runs     = per column, unbroken stretches of disparity with enough pixels in 1 px
//!   clusters = runs joined where they touch: next to each other in columns, no gap in depth   (union–find)
//!   measure each cluster from its pixels
//! sort by range
//! ```

use super::{Obstacle, ObstacleParams, PixelBox, check_size};
use crate::error::Result;
use crate::image::Image;
use crate::matching::{DisparityMap, Validity};
use crate::range::depth_sigma_m;
use crate::rectification::RectifiedGeometry;
use crate::regions::{Region, UDisparity};

/// Columns from one run to the next it may touch: one column may be missing between them.
const COLUMN_REACH: usize = 2;
/// Bins of half a pixel that runs may be apart and still touch, whatever that is in metres.
const BIN_REACH: usize = 2;
/// Bins below a cluster's nearest that belong to its near side at least: the scatter of one surface.
const SCATTER_BINS: usize = 3;

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
#[derive(Debug, Clone)]
struct Cluster {
    /// Pixels; stays 0 for a cluster of too few columns.
    support: usize,
    /// Columns that have a run, and the first and last of them.
    columns: usize,
    left: usize,
    right: usize,
    /// Largest bin, and the smallest that still belongs to the near side.
    near: usize,
    near_side: usize,
    /// Pixels of the near side, and the sum of their columns.
    near_support: usize,
    near_column_sum: usize,
    /// Extent across the optical axis, metres.
    left_m: f64,
    right_m: f64,
    /// Where its pixels begin in the finder's lists, and how many have been put there.
    offset: usize,
    filled: usize,
}

impl Cluster {
    /// A cluster before its first run, which is in this column: runs come column by column.
    fn starting_at(column: usize) -> Self {
        Self {
            support: 0,
            columns: 0,
            left: column,
            right: usize::MAX,
            near: 0,
            near_side: 0,
            near_support: 0,
            near_column_sum: 0,
            left_m: f64::INFINITY,
            right_m: f64::NEG_INFINITY,
            offset: 0,
            filled: 0,
        }
    }

    fn add(&mut self, run: &Run, geometry: &RectifiedGeometry, region: &Region) {
        self.columns += usize::from(self.right != run.column);
        self.right = run.column;
        self.near = self.near.max(run.near);
        for (bin, edge) in [(run.near, -0.5), (run.near, 0.5), (run.far, -0.5), (run.far, 0.5)] {
            let x = (region.x + run.column) as f64 + edge;
            let across_m = depth_m(geometry, bin) * (x - geometry.cx_px) / geometry.focal_px;
            self.left_m = self.left_m.min(across_m);
            self.right_m = self.right_m.max(across_m);
        }
    }

    /// Decides how far the near side goes, once the nearest bin is known.
    fn set_near_side(&mut self, geometry: &RectifiedGeometry, range_gap_m: f64) {
        let limit_m = depth_m(geometry, self.near) + range_gap_m;
        let in_gap = (0..self.near).rev().take_while(|&bin| depth_m(geometry, bin) <= limit_m).count();
        self.near_side = self.near.saturating_sub(in_gap.max(SCATTER_BINS));
    }
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
    /// Disparity and row of every pixel of every cluster, cluster by cluster.
    raws: Vec<u16>,
    rows: Vec<u16>,
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
            self.form_clusters(geometry, region, params);
            self.label_cells(params);
            self.gather_pixels(disparity, region);
            for cluster in self.clusters.iter().filter(|cluster| cluster.support > 0) {
                let pixels = cluster.offset..cluster.offset + cluster.support;
                let (raws, rows) = (&mut self.raws[pixels.clone()], &mut self.rows[pixels]);
                let obstacle = measure(cluster, raws, rows, geometry, region, params);
                if params.max_range_m.is_none_or(|limit_m| obstacle.range_m <= limit_m) {
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
        for bin in (0..counts.height()).rev() {
            if UDisparity::center_px(bin) + geometry.doffs_px < smallest_px {
                break;
            }
            let here = counts.row(bin);
            let nearer = (bin + 1 < counts.height()).then(|| counts.row(bin + 1));
            let farther = (bin > 0).then(|| counts.row(bin - 1));
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

    fn form_clusters(&mut self, geometry: &RectifiedGeometry, region: &Region, params: &ObstacleParams) {
        self.clusters.clear();
        self.cluster_of_root.clear();
        self.cluster_of_root.resize(self.runs.len(), None);
        for i in 0..self.runs.len() {
            let (run, root) = (self.runs[i], self.root(i));
            let index = *self.cluster_of_root[root].get_or_insert_with(|| {
                self.clusters.push(Cluster::starting_at(run.column));
                self.clusters.len() - 1
            });
            self.clusters[index].add(&run, geometry, region);
        }
        for cluster in &mut self.clusters {
            cluster.set_near_side(geometry, params.range_gap_m);
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
                let count = usize::from(self.u_disparity.counts().at(run.column, bin));
                cluster.support += count;
                if bin >= cluster.near_side {
                    cluster.near_support += count;
                    cluster.near_column_sum += count * run.column;
                }
                self.labels.row_mut(bin)[run.column] = index as u32 + 1;
            }
        }
    }

    /// Lists disparity and row of each cluster's pixels.
    fn gather_pixels(&mut self, disparity: &DisparityMap, region: &Region) {
        let mut total = 0;
        for cluster in &mut self.clusters {
            (cluster.offset, cluster.filled) = (total, 0);
            total += cluster.support;
        }
        self.raws.resize(total, 0);
        self.rows.resize(total, 0);
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
                    self.raws[cluster.offset + cluster.filled] = raw;
                    self.rows[cluster.offset + cluster.filled] = y as u16;
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

/// An obstacle from its pixels' disparities and rows, which are put in another order.
fn measure(
    cluster: &Cluster,
    raws: &mut [u16],
    rows: &mut [u16],
    geometry: &RectifiedGeometry,
    region: &Region,
    params: &ObstacleParams,
) -> Obstacle {
    let mut ranked_row = |rank: usize| usize::from(*rows.select_nth_unstable(rank).1);
    // A share of pixels, not the outermost one: a lone mismatch of the right disparity does not make it taller.
    let outside = cluster.support / 50;
    let (top, bottom) = (ranked_row(outside), ranked_row(cluster.support - 1 - outside));
    // The near side holds the largest disparities: its median is the pixel half its number from the top.
    let (_, &mut median_raw, _) = raws.select_nth_unstable(cluster.support - 1 - cluster.near_support / 2);

    let depth_m = geometry.depth_m(f64::from(median_raw) / f64::from(DisparityMap::SCALE));
    let column = region.x as f64 + cluster.near_column_sum as f64 / cluster.near_support as f64;
    let ray = geometry.range_per_depth(column, 0.5 * (top + bottom) as f64);
    let bounds = PixelBox {
        x: region.x + cluster.left,
        y: top,
        width: cluster.right - cluster.left + 1,
        height: bottom - top + 1,
    };
    Obstacle {
        id: 0,
        region: region.name.clone(),
        bounds,
        range_m: depth_m * ray,
        depth_m,
        sigma_m: ray * depth_sigma_m(geometry, depth_m, params.disparity_sigma_px),
        bearing_rad: geometry.bearing_rad(column),
        width_m: cluster.right_m - cluster.left_m,
        height_m: bounds.height as f64 * depth_m / geometry.focal_px,
        support: cluster.support,
    }
}
