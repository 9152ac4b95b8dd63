//! Whether something low stands on the ground, or is the ground itself.
//!
//! No plane with a profile is quite the ground: roads are crowned, lawns slope. What is a step higher than it may be
//! reached without one. So the front of something low is held against what is seen of the ground just before it, in the
//! same columns. And floors of little texture are matched at one disparity over some rows: half of such a patch lies
//! under the ground.

use super::columns::Peak;
use super::{Obstacle, ObstacleParams};
use crate::ground::GroundPlane;
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;

/// What is higher than this, metres, is no ground.
const LOW_M: f64 = 0.4;
/// What rises by less than this share of a step from the ground before it is the ground.
const LEAST_RISE: f64 = 0.4;
/// Pixels of the front differ from its disparity by no more than this, px.
const FRONT_PX: f64 = 1.0;
/// The ground before it: so much nearer at least, metres and px (the matcher's window sees the edge itself at less), and
/// no more than so much.
const LEAST_BEFORE: (f64, f64) = (0.12, 1.5);
const MOST_BEFORE: (f64, f64) = (0.6, 4.0);
/// Ground rises by this much per metre by itself.
const SLOPE: f64 = 0.045;
/// Columns in which both must be seen, as a share.
const SHARE_SEEN: f64 = 0.4;
/// Disparities closer than this are those of one thing, px.
const SAME_PX: f64 = 0.75;
/// Of what is under the ground, more than this share of what is over it makes a patch of floor: windows that see the
/// foot of a thing carry it a little down.
const UNDER_SHARE: f64 = 0.5;

/// Judges low things; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Footing {
    before_m: Vec<f64>,
    rises_m: Vec<f64>,
}

impl Footing {
    /// Whether what was found is a part of the ground.
    pub fn is_ground(
        &mut self,
        found: &Obstacle,
        peaks: &[Peak],
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        ground: &GroundPlane,
        params: &ObstacleParams,
    ) -> bool {
        is_patch(found, peaks, disparity, ground, params)
            || found.height_m < LOW_M
                && self
                    .rise_m(peaks, disparity, geometry, ground)
                    .is_some_and(|rise_m| rise_m < LEAST_RISE * params.step_m)
    }

    /// By how much the top of the front stands over the ground before it, less what ground may rise by itself, metres, in
    /// the middle of its columns; `None` where too few of them see that ground.
    fn rise_m(
        &mut self,
        peaks: &[Peak],
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        ground: &GroundPlane,
    ) -> Option<f64> {
        self.rises_m.clear();
        for peak in peaks {
            if let Some(rise_m) = self.in_column(peak, disparity, geometry, ground) {
                self.rises_m.push(rise_m);
            }
        }
        let enough = self.rises_m.len() as f64 >= SHARE_SEEN * peaks.len() as f64;
        (enough && !self.rises_m.is_empty()).then(|| median(&mut self.rises_m))
    }

    fn in_column(
        &mut self,
        peak: &Peak,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        ground: &GroundPlane,
    ) -> Option<f64> {
        let x = peak.column;
        let height_m = |y: usize, disparity_px: f64| ground.height_m(x as f64, y as f64, disparity_px);
        let seen_px = |y: usize| disparity.at(x, y).map(f64::from);
        let (front, front_px) = (peak.top..=peak.bottom).find_map(|y| {
            seen_px(y)
                .filter(|seen_px| (seen_px - peak.disparity_px).abs() <= FRONT_PX)
                .map(|seen_px| (y, seen_px))
        })?;
        let depth_m = geometry.depth_m(peak.disparity_px);
        self.before_m.clear();
        for y in front + 1..disparity.height() {
            let Some(seen_px) = seen_px(y) else { continue };
            let nearer = (depth_m - geometry.depth_m(seen_px), seen_px - peak.disparity_px);
            if nearer.0 > MOST_BEFORE.0 && nearer.1 > MOST_BEFORE.1 {
                break;
            }
            if nearer.0 >= LEAST_BEFORE.0 && nearer.1 >= LEAST_BEFORE.1 {
                self.before_m.push(height_m(y, seen_px) + SLOPE * nearer.0);
            }
        }
        (!self.before_m.is_empty()).then(|| height_m(front, front_px) - median(&mut self.before_m))
    }
}

/// Whether something low is a patch of the floor, matched at one disparity: as much of it lies under the ground as over
/// it, where what stands on the ground ends.
fn is_patch(
    found: &Obstacle,
    peaks: &[Peak],
    disparity: &DisparityMap,
    ground: &GroundPlane,
    params: &ObstacleParams,
) -> bool {
    if found.height_above_ground_m.is_none_or(|above_m| above_m >= ObstacleParams::LOW_M) {
        return false;
    }
    let margin_px = ObstacleParams::MARGIN_SIGMAS * params.disparity_sigma_px;
    let row_px = ground.plane_px(0.0, 1.0) - ground.plane_px(0.0, 0.0);
    let (mut under, mut over) = (0, 0);
    for peak in peaks {
        let x = peak.column as f64;
        let height_m = |y: f64| ground.height_m(x, y, peak.disparity_px);
        // Heights of one disparity are linear in rows.
        let foot = height_m(0.0) / (height_m(0.0) - height_m(1.0));
        let top = peak.top as f64;
        let pixels = |first: f64, last: f64| {
            let rows =
                (first.max(0.0).ceil() as usize)..((last + 1.0).max(0.0) as usize).min(disparity.height());
            rows.filter(|&y| {
                let seen_px = disparity.at(peak.column, y).map(f64::from);
                seen_px.is_some_and(|seen_px| (seen_px - peak.disparity_px).abs() < SAME_PX)
            })
            .count()
        };
        over += pixels(top, foot - margin_px / row_px);
        under += pixels(foot + margin_px / row_px, 2.0 * foot - top);
    }
    under as f64 > UNDER_SHARE * over as f64
}

/// The upper median; at least one value.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
