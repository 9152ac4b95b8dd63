//! What a frame is looked at with: where the floor is, what heights matter, and what is out of reach.

use super::rays::Rays;
use super::{RobotFromCamera, ScanParams};
use crate::error::{Error, Result};
use crate::ground::GroundPlane;
use crate::kernels::floor::Linear;
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;

pub(super) const SCALE: f64 = DisparityMap::SCALE as f64;
/// Standard deviations by which something stands out.
const CLEAR_SIGMAS: f64 = 3.0;
/// Least share of the camera's height that the robot's is taken to differ from it.
const LEAST_DIFFERENCE: f64 = 1e-6;

/// One frame's camera, floor and parameters.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub geometry: &'a RectifiedGeometry,
    pub rays: Rays,
    pub floor: Option<GroundPlane>,
    pub mounting: RobotFromCamera,
    pub params: &'a ScanParams,
    /// Largest disparity searched, px from infinity; not positive if nothing is known of it.
    searched_px: f64,
    /// Disparity of the ground over that of its plane where the view begins.
    near_share: f64,
}

/// What tells floor and obstacles apart in a row; as the fields of [`FloorRow`](crate::kernels::floor::FloorRow).
pub(super) struct RowTerms {
    pub ground: Linear,
    pub low: f32,
    pub below: f32,
    pub least: Linear,
    pub most: Linear,
    pub per_forward: Linear,
    pub row: f32,
    pub hidden: Linear,
}

impl<'a> View<'a> {
    pub fn new(
        disparity: &DisparityMap,
        geometry: &'a RectifiedGeometry,
        ground: Option<&GroundPlane>,
        mounting: Option<&RobotFromCamera>,
        params: &'a ScanParams,
    ) -> Result<Self> {
        // A floor estimated so near that everything on it is low says nothing.
        let ground = ground.copied().filter(|ground| ground.camera_height_m > params.step_m);
        let (floor, mounting) = match (ground, mounting) {
            (Some(ground), Some(mounting)) => (Some(ground), *mounting),
            (Some(ground), None) => (Some(ground), RobotFromCamera::over(&ground)?),
            (None, Some(mounting)) => (Some(floor_below(mounting, geometry, params)?), *mounting),
            (None, None) => (None, RobotFromCamera::from_angles([0.0; 3], 0.0, 0.0, 0.0)?),
        };
        let down = floor.map_or_else(|| mounting.down(), |floor| floor.down());
        let near_share = floor.map_or(1.0, |floor| {
            let plane_px = floor.plane_px(geometry.cx_px, geometry.height as f64 - 1.0);
            let seen_px = floor.seen_px(plane_px, 0.0);
            if seen_px > 0.0 { seen_px / plane_px } else { 1.0 }
        });
        let count = disparity.num_disparities;
        let searched_px = (disparity.min_disparity + count) as f64 - 1.0 + geometry.doffs_px;
        Ok(Self {
            geometry,
            rays: Rays::new(geometry, &down)?,
            floor,
            mounting,
            params,
            searched_px: if count > 0 { searched_px } else { 0.0 },
            near_share,
        })
    }

    /// Distance ahead below which disparities were not searched, at a pixel.
    pub fn blind_m(&self, x: f64, y: f64) -> f64 {
        if self.searched_px > 0.0 { self.ahead_m(self.searched_px, x, y) } else { 0.0 }
    }

    /// Distance ahead of a disparity at a pixel, metres.
    pub fn ahead_m(&self, disparity_px: f64, x: f64, y: f64) -> f64 {
        self.focal_baseline() * self.rays.forward_per_depth(x, y) / disparity_px
    }

    /// Metres ahead times the disparity ahead in pixels.
    pub fn focal_baseline(&self) -> f64 {
        self.geometry.focal_px * self.geometry.baseline_m
    }

    /// Largest disparity ahead that one of `raw` sixteenths can be, sixteenths of a pixel.
    pub fn largest_ahead(&self, raw: u16) -> f64 {
        let seen = f64::from(raw) + SCALE * self.geometry.doffs_px;
        let (right, bottom) = (self.geometry.width as f64 - 1.0, self.geometry.height as f64 - 1.0);
        let corners = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)];
        let least =
            corners.map(|(x, y)| self.rays.forward_per_depth(x, y)).into_iter().fold(f64::INFINITY, f64::min);
        seen.max(0.0) / least
    }

    /// What disparities may differ by though nothing is there, sixteenths of a pixel.
    pub fn noise_raw(&self) -> f32 {
        (SCALE * CLEAR_SIGMAS * self.params.disparity_sigma_px) as f32
    }

    /// The row by which the floor must first be seen in a direction: from the lowest row on whose floor disparities
    /// were searched; infinite for a direction that is not in view.
    pub fn first_row(&self, floor: &GroundPlane, line: usize) -> f64 {
        let Some(lowest) = self.rays.lowest_row(line) else { return f64::INFINITY };
        let seen_px = |row: f64| self.near_share * floor.plane_px(self.rays.column(line, row), row);
        let (lowest_px, above_px) = (seen_px(lowest), seen_px(lowest - 1.0));
        let beyond = (lowest_px - self.searched_px) / (lowest_px - above_px);
        let row = if self.searched_px > 0.0 && beyond > 0.0 { lowest - beyond.ceil() } else { lowest };
        row - self.hidden_rows(row, seen_px(row))
    }

    /// Where a direction's view of the floor begins, metres ahead.
    pub fn begin_m(&self, floor: &GroundPlane, line: usize) -> f64 {
        self.rays.lowest_row(line).map_or(f64::INFINITY, |row| {
            let x = self.rays.column(line, row);
            self.ahead_m(self.near_share * floor.plane_px(x, row), x, row).max(self.blind_m(x, row))
        })
    }

    /// The terms of a row; `None` where nothing on it matters.
    pub fn row_terms(&self, floor: &GroundPlane, y: usize) -> Option<RowTerms> {
        let row = y as f64;
        let count = self.rays.count;
        let columns = [self.rays.column(0, row), self.rays.column(count - 1, row)];
        let plane_px = columns.map(|x| floor.plane_px(x, row));
        // The ground's elevation is taken in the middle: it depends on depth alone, which is nearly one along a row.
        let middle_px = 0.5 * (plane_px[0] + plane_px[1]);
        let seen_px = floor.seen_px(middle_px, 0.0);
        let per_plane = if seen_px > 0.0 { seen_px / middle_px } else { 1.0 };
        let height_m = floor.camera_height_m / per_plane;
        // Ground as high as the camera: nothing on it can be told.
        if height_m <= self.params.step_m {
            return None;
        }
        let ground_px = plane_px.map(|px| px * per_plane);
        let in_view = ground_px[0].max(ground_px[1]) > 0.0;
        let over_camera_m = self.params.headroom_m - height_m;
        if !in_view && over_camera_m < 0.0 {
            // Nothing above the horizon is as low as the robot is high.
            return None;
        }
        let ground = linear(ground_px.map(|px| SCALE * px), count);
        let hidden = ground_px.map(|px| self.hidden_rows(row, px));
        // Something at the robot's height has `height / (height - headroom)` times the floor's disparity: at most, if
        // the camera is higher; if it is lower, at least, above the horizon, where the floor's is negative.
        let (least, most) = if over_camera_m >= 0.0 {
            let times = -height_m / over_camera_m.max(LEAST_DIFFERENCE * height_m);
            (ground.times(times as f32), Linear::constant(f32::INFINITY))
        } else {
            (Linear::constant(0.0), ground.times((height_m / -over_camera_m) as f32))
        };
        Some(RowTerms {
            ground,
            low: (height_m / (height_m - self.params.step_m)) as f32,
            below: (height_m / (height_m + self.params.step_m)) as f32,
            least,
            most,
            per_forward: linear(columns.map(|x| 1.0 / self.rays.forward_per_depth(x, row)), count),
            row: if in_view { row as f32 } else { f32::NEG_INFINITY },
            hidden: linear(hidden, count),
        })
    }

    /// The row where something at a disparity ahead stands on the floor.
    pub fn foot_row(&self, floor: &GroundPlane, line: usize, ahead_px: f64) -> f64 {
        // Plane and distance ahead are linear along the line. Where the ground is not level the plane's disparity at the
        // foot is the foot's times `1 - elevation / height`; a second round takes the elevation at the foot.
        let at = |y: f64| {
            let x = self.rays.column(line, y);
            (floor.plane_px(x, y), self.rays.forward_per_depth(x, y))
        };
        let ((plane, forward), (plane_1, forward_1)) = (at(0.0), at(1.0));
        let (plane_step, forward_step) = (plane_1 - plane, forward_1 - forward);
        let mut share = 1.0;
        let mut row = 0.0;
        for _ in 0..2 {
            let plane_px = share * ahead_px;
            row = (plane_px * forward - plane) / (plane_step - plane_px * forward_step);
            let seen_px = ahead_px * (forward + forward_step * row);
            share = 1.0 - floor.profile.elevation_m(floor.depth_m(seen_px)) / floor.camera_height_m;
        }
        row
    }

    /// Rows of floor that something of the lowest height that matters hides at least, less what the matcher may blur;
    /// its foot is seen in a row, at a disparity from infinity.
    fn hidden_rows(&self, row: f64, disparity_px: f64) -> f64 {
        let slope = self.params.step_m * disparity_px / self.focal_baseline();
        // Where the top is farther than the foot it is seen lower; where it is nearer, higher, and this is the least.
        let farther = 1.0 + (slope * self.rays.top_depth_per_height()).max(0.0);
        slope * self.rays.rows_per_slope(row) / farther - self.params.gap_guard_px
    }
}

/// Between the values at the first and the last of `count` places.
fn linear([first, last]: [f64; 2], count: usize) -> Linear {
    let per_place = (last - first) / (count.max(2) - 1) as f64;
    Linear { at_first: first as f32, per_place: per_place as f32 }
}

/// The floor below a camera that is mounted so.
fn floor_below(
    mounting: &RobotFromCamera,
    geometry: &RectifiedGeometry,
    params: &ScanParams,
) -> Result<GroundPlane> {
    let height_m = mounting.translation_m().z;
    if height_m <= params.step_m {
        let expected = format!("must be below the camera's height, {height_m} m");
        return Err(Error::invalid("step_m", format!("{} m", params.step_m), expected));
    }
    let down = mounting.down();
    Ok(GroundPlane::new(geometry, height_m, down.z.asin(), down.x.atan2(down.y)))
}
