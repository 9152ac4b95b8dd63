//! From the outline of a part to an obstacle.

use std::sync::Arc;

use super::columns::Peak;
use super::polyline::{Outliner, Point};
use super::{Obstacle, ObstacleParams, PixelBox};
use crate::ground::GroundPlane;
use crate::range::depth_sigma_m;
use crate::rectification::RectifiedGeometry;
use crate::regions::Region;

/// Corners closer to a line than this are no corners of a part, px.
const CORNER_PX: f64 = 0.6;
/// Neighbouring columns share errors: so many count as one.
const ALIKE_COLUMNS: f64 = 6.0;
/// What averaging cannot remove of a disparity's error, as a share of its deviation: matchers prefer some fractions of
/// a pixel, and a surface's columns share its texture.
const SYSTEMATIC_SHARE: f64 = 0.58;
/// How surely the nearest point of a thing is told from its outline, as a share of its range: edges are blurred by the
/// matching window, round things have no edge.
const OUTLINE_SHARE: f64 = 0.007;
/// Of the columns, the share whose first or last row may lie outside of the box: lone mismatches of the right disparity.
const OUTSIDE: f64 = 0.25;
/// Where the image's lower edge is this near, more of a thing may lie beyond it, rows.
const EDGE: usize = 3;

/// Measures parts; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Part {
    fitted_px: Vec<f64>,
    rows: Vec<usize>,
}

/// The nearest point of an outline.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    x: f64,
    disparity_px: f64,
    range_m: f64,
    /// Range over depth.
    ray: f64,
}

impl Part {
    /// The obstacle that an outline shows, without its regions; `None` if there is too little of it.
    pub fn measure(
        &mut self,
        peaks: &[Peak],
        points: &[Point],
        outliner: &mut Outliner,
        geometry: &RectifiedGeometry,
        ground: Option<&GroundPlane>,
        params: &ObstacleParams,
    ) -> Option<Obstacle> {
        let support: usize = peaks.iter().map(|peak| peak.support).sum();
        if peaks.len() < params.min_columns || support < params.min_pixels {
            return None;
        }
        let nearest = self.nearest(peaks, points, outliner, geometry, params)?;
        let depth_m = geometry.depth_m(nearest.disparity_px);
        if ground.is_some() && support < params.area_px(geometry, depth_m) {
            return None;
        }
        let (left, right) = (peaks[0].column, peaks[peaks.len() - 1].column);
        let (top, bottom) =
            (self.row(peaks, |peak| peak.top, false), self.row(peaks, |peak| peak.bottom, true));
        let bounds =
            PixelBox { x: left, y: top, width: right + 1 - left, height: bottom + 1 - top.min(bottom) };
        if (support as f64) < ObstacleParams::LEAST_FILL * (bounds.width * bounds.height) as f64 {
            return None;
        }
        let pixel_m = depth_m / geometry.focal_px;
        let height_m = bounds.height as f64 * pixel_m;
        let height_above_ground_m =
            ground.map(|ground| ground.height_m(nearest.x, top as f64, nearest.disparity_px));
        let high_enough = match height_above_ground_m {
            Some(above_m) => {
                let low = above_m < ObstacleParams::LOW_M;
                let floats = above_m - height_m > ObstacleParams::FLOATS_M;
                let fill = support as f64 / (bounds.width * bounds.height) as f64;
                above_m >= params.step_m
                    && !(low && support < ObstacleParams::LOW_PIXELS)
                    && !(floats && fill < ObstacleParams::FLOATING_FILL)
            }
            None => bottom + EDGE >= geometry.height || height_m >= params.min_height_m,
        };
        if !high_enough || params.max_range_m.is_some_and(|limit_m| nearest.range_m > limit_m) {
            return None;
        }
        let random_px = params.disparity_sigma_px * (ALIKE_COLUMNS / peaks.len() as f64).min(1.0).sqrt();
        let sigma_px = random_px.hypot(SYSTEMATIC_SHARE * params.disparity_sigma_px);
        Some(Obstacle {
            id: 0,
            region: Arc::default(),
            regions: Vec::new(),
            bounds,
            range_m: nearest.range_m,
            depth_m,
            sigma_m: (nearest.ray * depth_sigma_m(geometry, depth_m, sigma_px))
                .hypot(OUTLINE_SHARE * nearest.range_m),
            bearing_rad: geometry.bearing_rad(nearest.x),
            width_m: bounds.width as f64 * pixel_m,
            height_m,
            height_above_ground_m,
            support,
        })
    }

    /// The nearest point of the outline in terms of range.
    fn nearest(
        &mut self,
        peaks: &[Peak],
        points: &[Point],
        outliner: &mut Outliner,
        geometry: &RectifiedGeometry,
        params: &ObstacleParams,
    ) -> Option<Nearest> {
        outliner.find_corners(points, CORNER_PX);
        outliner.fit(points, &mut self.fitted_px);
        if outliner.corners.len() == 2 {
            self.level_out(points, params);
        }
        let mut nearest: Option<Nearest> = None;
        let mut segment = 0;
        for (i, point) in points.iter().enumerate() {
            while segment + 2 < outliner.corners.len() && i > outliner.corners[segment + 1] {
                segment += 1;
            }
            let first = points[outliner.corners[segment]].x;
            let disparity_px = match self.fitted_px.get(segment + 1) {
                Some(end_px) => {
                    let last = points[outliner.corners[segment + 1]].x;
                    let share = (point.x - first) / (last - first);
                    self.fitted_px[segment] + share * (end_px - self.fitted_px[segment])
                }
                None => self.fitted_px[segment],
            };
            // Of an upright surface the row nearest to the horizon is the nearest.
            let y = geometry.cy_px.max(peaks[i].top as f64).min(peaks[i].bottom as f64);
            let ray = geometry.range_per_depth(point.x, y);
            let range_m = geometry.depth_m(disparity_px) * ray;
            let usable = range_m.is_finite() && range_m > 0.0;
            if usable && nearest.is_none_or(|nearest| range_m < nearest.range_m) {
                nearest = Some(Nearest { x: point.x, disparity_px, range_m, ray });
            }
        }
        nearest
    }

    /// Takes from the slope of a straight outline what noise alone would give it (James and Stein 1961): else every
    /// level surface would seem nearer, at one end or the other.
    fn level_out(&mut self, points: &[Point], params: &ObstacleParams) {
        let [first_px, last_px] = self.fitted_px[..] else { return };
        let total: f64 = points.iter().map(|point| point.weight).sum();
        let mean_x = points.iter().map(|point| point.weight * point.x).sum::<f64>() / total;
        let (first, last) = (points[0].x, points[points.len() - 1].x);
        let middle_px = first_px + (last_px - first_px) * (mean_x - first) / (last - first);
        let rise_px = last_px - first_px;
        // A slope over n independent points has the deviation σ·√(12/n) over their whole span.
        let independent = (points.len() as f64 / ALIKE_COLUMNS).max(1.0);
        let noise_px = params.disparity_sigma_px * (12.0 / independent).sqrt();
        let kept = (1.0 - (noise_px / rise_px).powi(2)).max(0.0);
        let kept = if rise_px == 0.0 { 0.0 } else { kept };
        for fitted in &mut self.fitted_px {
            *fitted = middle_px + kept * (*fitted - middle_px);
        }
    }

    /// A row that few columns reach beyond: above it, or below it.
    fn row(&mut self, peaks: &[Peak], of: impl Fn(&Peak) -> usize, beyond_is_below: bool) -> usize {
        self.rows.clear();
        self.rows.extend(peaks.iter().map(of));
        let outside = (OUTSIDE * peaks.len() as f64) as usize;
        let rank = if beyond_is_below { peaks.len() - 1 - outside } else { outside };
        *self.rows.select_nth_unstable(rank).1
    }
}

impl Obstacle {
    /// The same with the regions it stands in, in a list taken from `spare`; `None` if there is none.
    pub(super) fn in_regions(mut self, regions: &[Region], spare: &mut Vec<Vec<Arc<str>>>) -> Option<Self> {
        let PixelBox { x, y, width, height } = self.bounds;
        let stands_in = |region: &&Region| {
            let across = region.x < x + width && x < region.x + region.width;
            across && region.y < y + height && y < region.y + region.height
        };
        let mut names = spare.pop().unwrap_or_default();
        names.clear();
        names.extend(regions.iter().filter(stands_in).map(|region| region.name.clone()));
        let Some(first) = names.first() else {
            spare.push(names);
            return None;
        };
        self.region = first.clone();
        self.regions = names;
        Some(self)
    }
}
