//! Which pixels stand in the way: higher over the ground than a step, lower than what can be passed under.
//!
//! With the ground's profile `g` (see [`GroundPlane`]) a pixel of disparity `s`, counted from infinity, at which the
//! plane has the disparity `p`, lies `h·(g(s) - p) / s` above the ground. So for each disparity there is an interval of
//! `p` in which a pixel stands in the way, and all intervals together are one small table:
//!
//! ```text
//! s·(1 - (e + headroom) / h)  <=  p  <=  min( s·(1 - (e + step) / h),  g(s) - margin )
//! ```
//!
//! where the margin keeps the ground's noise out.

use super::ObstacleParams;
use crate::ground::GroundPlane;
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;

/// Fractions of a pixel of the plane's disparity in whole numbers, and how many more while a row is walked along.
const FRACTION_BITS: u32 = 8;
const WALK_BITS: u32 = 12;

/// The table for one frame; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Standing {
    /// For each raw disparity the disparities of the plane at which it stands in the way.
    intervals: Vec<Interval>,
    /// The plane's disparity at the origin, per column, per row; px.
    at_origin: f64,
    by_x: f64,
    by_y: f64,
}

/// From `least` on, so many more: one comparison tells what is in it.
#[derive(Debug, Clone, Copy)]
struct Interval {
    least: i32,
    more: u32,
}

impl Interval {
    const ALL: Self = Self { least: i32::MIN, more: u32::MAX };
    /// No plane has a disparity that large.
    const NONE: Self = Self { least: i32::MAX, more: 0 };

    fn between(least: i32, most: i32) -> Self {
        if least <= most { Self { least, more: most.wrapping_sub(least) as u32 } } else { Self::NONE }
    }

    #[inline]
    fn contains(self, plane: i32) -> bool {
        plane.wrapping_sub(self.least) as u32 <= self.more
    }
}

/// The plane's disparity along a row.
pub(super) struct Walk {
    at: i64,
    step: i64,
}

impl Walk {
    /// At the next column, in units of the table.
    #[inline]
    pub fn next(&mut self) -> i32 {
        let here = self.at >> WALK_BITS;
        self.at += self.step;
        here as i32
    }
}

impl Standing {
    /// Makes the table for a ground, or for none: then everything stands that is not too far.
    pub fn prepare(
        &mut self,
        geometry: &RectifiedGeometry,
        ground: Option<&GroundPlane>,
        largest_raw: u16,
        params: &ObstacleParams,
    ) {
        let smallest_px = params.smallest_disparity_px(geometry);
        self.intervals.clear();
        (self.at_origin, self.by_x, self.by_y) = ground.map_or((0.0, 0.0, 0.0), |ground| {
            let at = |x: f64, y: f64| ground.plane_px(x, y);
            (at(0.0, 0.0), at(1.0, 0.0) - at(0.0, 0.0), at(0.0, 1.0) - at(0.0, 0.0))
        });
        for raw in 0..=largest_raw {
            let seen_px = f64::from(raw) / f64::from(DisparityMap::SCALE) + geometry.doffs_px;
            let interval = if seen_px < smallest_px {
                Interval::NONE
            } else {
                ground.map_or(Interval::ALL, |ground| interval(ground, seen_px, params))
            };
            self.intervals.push(interval);
        }
    }

    /// The plane's disparity along a row of the image.
    pub fn row(&self, y: usize) -> Walk {
        let unit = f64::from(1_u32 << (FRACTION_BITS + WALK_BITS));
        Walk { at: ((self.at_origin + self.by_y * y as f64) * unit) as i64, step: (self.by_x * unit) as i64 }
    }

    /// Whether a pixel stands in the way: its disparity, and the plane's in units of the table.
    #[inline]
    pub fn holds(&self, raw: u16, plane: i32) -> bool {
        self.intervals[usize::from(raw)].contains(plane)
    }
}

/// Between which disparities of the plane something of a disparity stands in the way.
fn interval(ground: &GroundPlane, seen_px: f64, params: &ObstacleParams) -> Interval {
    let height_m = ground.camera_height_m;
    let elevation_m = ground.profile.elevation_m(ground.depth_m(seen_px));
    let at = |above_m: f64| seen_px * (1.0 - (elevation_m + above_m) / height_m);
    let unit = f64::from(1_u32 << FRACTION_BITS);
    let margin_px = ObstacleParams::MARGIN_SIGMAS * params.disparity_sigma_px;
    let most = at(ObstacleParams::STANDS_FROM * params.step_m).min(at(0.0) - margin_px);
    Interval::between((at(params.headroom_m) * unit).ceil() as i32, (most * unit).floor() as i32)
}
