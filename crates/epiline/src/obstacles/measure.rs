//! From the pixels of a cluster to an obstacle.

use super::{Obstacle, ObstacleParams, PixelBox};
use crate::matching::DisparityMap;
use crate::range::depth_sigma_m;
use crate::rectification::RectifiedGeometry;
use crate::regions::Region;

/// The near side reaches at least this far behind its nearest pixel: the scatter of one surface. Sixteenths of a pixel.
const SCATTER_RAW: usize = 32;
/// Share of an obstacle's pixels (one in so many) that its nearest pixel of disparity must hold to be its near side.
const NEAR_SHARE: usize = 50;

/// A pixel of a cluster: disparity in sixteenths of a pixel, column and row of the image.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ClusterPixel {
    pub raw: u16,
    pub x: u16,
    pub y: u16,
}

/// Where some pixels are.
#[derive(Debug, Clone, Copy)]
struct Extent {
    left: u16,
    right: u16,
    count: usize,
    sum_x: usize,
    sum_y: usize,
}

impl Default for Extent {
    fn default() -> Self {
        Self { left: u16::MAX, right: 0, count: 0, sum_x: 0, sum_y: 0 }
    }
}

impl Extent {
    fn add(&mut self, pixel: &ClusterPixel) {
        self.left = self.left.min(pixel.x);
        self.right = self.right.max(pixel.x);
        self.count += 1;
        self.sum_x += usize::from(pixel.x);
        self.sum_y += usize::from(pixel.y);
    }

    /// Columns from the first to the last; there is at least one pixel.
    fn width(&self) -> usize {
        usize::from(self.right - self.left) + 1
    }

    fn mean(&self) -> (f64, f64) {
        (self.sum_x as f64 / self.count as f64, self.sum_y as f64 / self.count as f64)
    }
}

/// Measures clusters; keeps its buffer.
#[derive(Debug, Clone, Default)]
pub(super) struct Measure {
    /// How many pixels have each disparity.
    histogram: Vec<usize>,
}

impl Measure {
    /// An obstacle from its pixels, of which there is at least one; they are put in another order.
    pub fn obstacle(
        &mut self,
        pixels: &mut [ClusterPixel],
        geometry: &RectifiedGeometry,
        region: &Region,
        params: &ObstacleParams,
    ) -> Obstacle {
        let support = pixels.len();
        let (farthest_raw, median_raw) = self.near_side(pixels, geometry, params);
        let mut near = Extent::default();
        let mut all = Extent::default();
        for pixel in &*pixels {
            all.add(pixel);
            if usize::from(pixel.raw) >= farthest_raw {
                near.add(pixel);
            }
        }
        let (x, y) = near.mean();
        let depth_m = geometry.depth_m(px(median_raw as f64));
        let ray = geometry.range_per_depth(x, y);

        // A share of pixels, not the outermost one: a lone mismatch of the right disparity does not make it taller.
        let outside = support / 50;
        let mut ranked_row = |rank: usize| pixels.select_nth_unstable_by_key(rank, |pixel| pixel.y).1.y;
        let (top, bottom) = (ranked_row(outside), ranked_row(support - 1 - outside));
        let bounds = PixelBox {
            x: usize::from(all.left),
            y: usize::from(top),
            width: all.width(),
            height: usize::from(bottom - top) + 1,
        };
        Obstacle {
            id: 0,
            region: region.name.clone(),
            bounds,
            range_m: depth_m * ray,
            depth_m,
            sigma_m: ray * depth_sigma_m(geometry, depth_m, params.disparity_sigma_px),
            bearing_rad: geometry.bearing_rad(x),
            width_m: near.width() as f64 * depth_m / geometry.focal_px,
            height_m: bounds.height as f64 * depth_m / geometry.focal_px,
            support,
        }
    }

    /// Smallest and median disparity of the near side, sixteenths of a pixel.
    ///
    /// It begins at the nearest 1-px window that holds a fair share of the pixels (a few strays of the floor before
    /// it do not make it nearer) and reaches as far behind as one thing may.
    fn near_side(
        &mut self,
        pixels: &[ClusterPixel],
        geometry: &RectifiedGeometry,
        params: &ObstacleParams,
    ) -> (usize, usize) {
        let scale = usize::from(DisparityMap::SCALE);
        let nearest = pixels.iter().map(|pixel| usize::from(pixel.raw)).fold(0, usize::max);
        self.histogram.clear();
        // One window more than there are values, so that the first windows are partly empty.
        self.histogram.resize(nearest + 1 + scale, 0);
        for pixel in pixels {
            self.histogram[usize::from(pixel.raw)] += 1;
        }
        let enough = params.min_pixels.max(pixels.len() / NEAR_SHARE).min(pixels.len());
        let mut window = 0;
        let mut begin = nearest;
        for low in (0..=nearest).rev() {
            window += self.histogram[low];
            window -= self.histogram[low + scale];
            if window >= enough {
                begin = (low + scale - 1).min(nearest);
                break;
            }
        }
        let limit_m = geometry.depth_m(px(begin as f64)) + params.range_gap_m;
        let of_gap = (geometry.disparity_px(limit_m) * scale as f64).max(0.0) as usize;
        let farthest = of_gap.min(begin.saturating_sub(SCATTER_RAW));
        let half = self.histogram[farthest..=nearest].iter().sum::<usize>().div_ceil(2);
        let mut passed = 0;
        let from_near = (farthest..=nearest).rev().find(|&raw| {
            passed += self.histogram[raw];
            passed >= half
        });
        (farthest, from_near.unwrap_or(begin))
    }
}

fn px(raw: f64) -> f64 {
    raw / f64::from(DisparityMap::SCALE)
}
