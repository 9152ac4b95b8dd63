//! Whether something low rises from the ground before it, or is the ground itself.
//!
//! No plane with a profile is quite the ground: roads are crowned, lawns slope. What is a step higher than it may be
//! reached without one. So the front of something low is held against what is seen of the ground just before it, in the
//! same columns.

use super::columns::Peak;
use crate::ground::GroundPlane;
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;

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

/// Measures rises; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Rise {
    before_m: Vec<f64>,
    rises_m: Vec<f64>,
}

impl Rise {
    /// By how much the top of the front stands over the ground before it, less what ground may rise by itself, metres, in
    /// the middle of its columns; `None` where too few of them see that ground.
    pub fn measure(
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

/// The upper median; at least one value.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
