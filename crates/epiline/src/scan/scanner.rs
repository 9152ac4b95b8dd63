//! One pass over the disparities, a row of all directions at a time, from the lowest up.
//!
//! ```text
//! for each row from below, for each direction:
//!   g = disparity of the floor there
//!   floor    : d is the floor's        -> the floor is seen on, if its gap so far is too small to hide anything
//!   obstacle : d is of a height that matters -> counted by its distance ahead
//! for each direction:
//!   nearest  = the nearest distance with enough pixels
//!   free to  = where the floor was seen last, or the nearest if nothing fits in between
//! ```
//!
//! An obstacle of height `h` whose foot is at a disparity `g` hides `h·g/baseline` rows above it: a gap in the floor
//! of fewer rows hides nothing that high. A pixel at height `h` over a floor of disparity `g`, seen from the height
//! `H`, has the disparity `d` with `h = H·(1 - g/d)`; on a bent floor to first order in the bend.

use super::rays::{Rays, UNSEEN};
use super::{RobotFromCamera, Scan, ScanParams, Seen};
use crate::error::{Error, Result};
use crate::ground::GroundPlane;
use crate::matching::DisparityMap;
use crate::range::{check_size, depth_sigma_m};
use crate::rectification::RectifiedGeometry;

const SCALE: f64 = DisparityMap::SCALE as f64;
/// Sixteenths of a pixel in a bin of distances ahead: two bins are a window of 1 px.
const RAW_PER_BIN: i32 = 8;
/// In a cell of the histogram the count stands above the sum of what the disparities exceed their bin by.
const COUNT_SHIFT: u32 = 17;
const ONE_PIXEL: u32 = 1 << COUNT_SHIFT;
/// Bins behind the first with enough pixels where more may still be the same surface: the scatter of its near side.
const CLIMB: usize = 3;
/// Directions looked at together for whether any has an obstacle.
const BLOCK: usize = 16;
/// Standard deviations by which something stands out.
const CLEAR_SIGMAS: f64 = 3.0;
/// A row that no direction has reached.
const NO_ROW: f32 = f32::INFINITY;

/// Scans disparity maps; keeps its buffers from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Scanner {
    /// A row's disparities by direction, sixteenths of a pixel from infinity.
    line: Vec<f32>,
    /// Its obstacles by direction: disparity ahead, or -1.
    ahead: Vec<i32>,
    /// Obstacle pixels by distance ahead and direction.
    histogram: Vec<u32>,
    /// Nearest bin with enough pixels of each direction; 0 is none.
    nearest: Vec<u32>,
    /// Highest row that the floor was seen at without a gap, and the row by which it must be seen again.
    last_row: Vec<f32>,
    next_row: Vec<f32>,
    /// Disparity there, sixteenths of a pixel: of the pixel or of the floor, whichever is nearer.
    last_raw: Vec<f32>,
    /// Rows without a disparity: now, and at most.
    gap: Vec<u16>,
    longest_gap: Vec<u16>,
}

/// A value that changes linearly along a row, by direction.
#[derive(Debug, Clone, Copy)]
struct Linear {
    at_first: f32,
    per_line: f32,
}

impl Linear {
    fn between(first: f64, last: f64, count: usize) -> Self {
        let per_line = (last - first) / (count.max(2) - 1) as f64;
        Self { at_first: first as f32, per_line: per_line as f32 }
    }

    fn at(self, line: usize) -> f32 {
        self.at_first + self.per_line * line as f32
    }
}

/// The floor below the camera, as its disparities say where it is.
#[derive(Debug, Clone, Copy)]
struct Floor {
    camera_height_m: f64,
    /// `s(x, y) = by_x·x + by_y·y + at_origin`, px from infinity, of the plane; `bend` as in [`GroundPlane`].
    by_x: f64,
    by_y: f64,
    at_origin: f64,
    bend: f64,
}

impl Floor {
    fn new(ground: &GroundPlane, geometry: &RectifiedGeometry) -> Self {
        let RectifiedGeometry { focal_px, cx_px, cy_px, baseline_m, .. } = *geometry;
        let per_m = baseline_m / ground.camera_height_m;
        let down = ground.down();
        let (by_x, by_y) = (per_m * down.x, per_m * down.y);
        Self {
            camera_height_m: ground.camera_height_m,
            by_x,
            by_y,
            at_origin: per_m * down.z * focal_px - by_x * cx_px - by_y * cy_px,
            bend: 0.5 * ground.curvature_per_m * (focal_px * baseline_m).powi(2) / ground.camera_height_m,
        }
    }

    fn plane_px(&self, x: f64, y: f64) -> f64 {
        self.by_x * x + self.by_y * y + self.at_origin
    }

    /// Disparity from infinity, px; of the plane, and negative, where the floor is not in view.
    fn disparity_px(&self, x: f64, y: f64) -> f64 {
        let plane = self.plane_px(x, y);
        let root = plane * plane + 4.0 * self.bend;
        if self.bend == 0.0 || root < 0.0 || plane <= 0.0 {
            return plane;
        }
        0.5 * (plane + root.sqrt())
    }
}

/// Disparities that tell what is how high, as multiples of the floor's.
#[derive(Debug, Clone, Copy)]
struct Heights {
    /// At `min_height_m`.
    low: f32,
    /// At `max_height_m`; below the camera's height an upper limit, above it, negated, a lower one.
    high: f32,
    high_is_above_camera: bool,
    /// As far below the floor as `min_height_m` above.
    below: f32,
    /// By how much something must differ from the floor to stand out, sixteenths of a pixel.
    noise_raw: f32,
}

impl Heights {
    fn new(floor: &Floor, params: &ScanParams) -> Self {
        let height_m = floor.camera_height_m;
        let at = |above_m: f64| height_m / (height_m - above_m);
        let high_is_above_camera = params.max_height_m >= height_m;
        // Of an infinite height nothing is above: any disparity is below it.
        let high = if params.max_height_m.is_infinite() { 0.0 } else { at(params.max_height_m) };
        Self {
            low: at(params.min_height_m) as f32,
            high: high as f32,
            high_is_above_camera,
            below: at(-params.min_height_m) as f32,
            noise_raw: (SCALE * CLEAR_SIGMAS * params.disparity_sigma_px) as f32,
        }
    }
}

impl Scanner {
    /// Fills `out` with the scan of a map, keeping its memory.
    ///
    /// Without `mounting` the robot's frame lies on the floor below the camera, x where it looks; without `ground` the
    /// floor is where the mounting says; without either heights are not known, and the frame is the camera's own.
    /// Pixels that were filled, not measured, count as unseen.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] if map and geometry differ in size, [`Error::InvalidParameter`] for parameters out of
    /// range, a pair that is not pinhole, or a mounting lower than `min_height_m`; [`Error::Degenerate`] for a camera
    /// that is tilted so far that its columns do not rise from the floor.
    pub fn scan(
        &mut self,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        ground: Option<&GroundPlane>,
        mounting: Option<&RobotFromCamera>,
        params: &ScanParams,
        out: &mut Scan,
    ) -> Result<()> {
        params.validate()?;
        geometry.require_pinhole("scan")?;
        check_size(disparity, geometry)?;
        // A floor estimated so near that everything on it is low says nothing.
        let ground = ground.copied().filter(|ground| ground.camera_height_m > params.min_height_m);
        let (ground, mounting) = match (ground, mounting) {
            (ground, Some(mounting)) => {
                (Some(ground.map_or_else(|| floor_of(mounting, geometry, params), Ok)?), *mounting)
            }
            (Some(ground), None) => (Some(ground), RobotFromCamera::over(&ground)?),
            (None, None) => (None, RobotFromCamera::from_angles([0.0; 3], 0.0, 0.0, 0.0)?),
        };
        let down = ground.map_or_else(|| mounting.down(), |ground| ground.down());
        let rays = Rays::new(geometry, &down)?;
        let floor = ground.map(|ground| Floor::new(&ground, geometry));

        self.begin(disparity, geometry, &rays, floor.as_ref(), params);
        for y in (0..disparity.height()).rev() {
            rays.sample(y, disparity.values.row(y), disparity.validity.row(y), &mut self.line);
            match &floor {
                Some(floor) => self.read_row(y, &rays, geometry, floor, params),
                None => self.read_row_without_floor(),
            }
            self.count_obstacles();
        }
        self.find_nearest(rays.count, params.min_support as u32);
        let blind_px =
            disparity.min_disparity as f64 + disparity.num_disparities as f64 - 1.0 + geometry.doffs_px;
        let view =
            View { geometry, rays: &rays, floor: floor.as_ref(), mounting: &mounting, params, blind_px };
        self.describe(&view, out);
        Ok(())
    }

    fn begin(
        &mut self,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        rays: &Rays,
        floor: Option<&Floor>,
        params: &ScanParams,
    ) {
        let count = rays.count;
        let largest = disparity.values.as_slice().iter().copied().max().unwrap_or(0);
        let (right, bottom) = (geometry.width as f64 - 1.0, geometry.height as f64 - 1.0);
        let least_forward = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)]
            .map(|(x, y)| rays.forward_per_depth(x, y))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        let largest_ahead = (f64::from(largest) + SCALE * geometry.doffs_px).max(0.0) / least_forward;
        let bins = largest_ahead as usize / RAW_PER_BIN as usize + 2;
        refill(&mut self.line, count, UNSEEN);
        refill(&mut self.ahead, count, -1);
        refill(&mut self.histogram, bins * count, 0);
        refill(&mut self.gap, count, 0);
        refill(&mut self.longest_gap, count, 0);
        refill(&mut self.last_row, count, NO_ROW);
        refill(&mut self.last_raw, count, 0.0);
        self.next_row.clear();
        let Some(floor) = floor else { return };
        let searched_px =
            (disparity.min_disparity + disparity.num_disparities) as f64 - 1.0 + geometry.doffs_px;
        self.next_row.extend((0..count).map(|line| {
            // The floor must be seen from the lowest row on whose floor disparities were searched.
            let Some(lowest) = rays.lowest_row(line) else { return NO_ROW };
            let seen_px = |y: f64| floor.disparity_px(rays.column(line, y), y);
            let (top_px, lowest_px) = (seen_px(lowest - 1.0), seen_px(lowest));
            let above = (lowest_px - searched_px) / (lowest_px - top_px);
            let row =
                if disparity.num_disparities > 0 && above > 0.0 { lowest - above.ceil() } else { lowest };
            let seen_px = seen_px(row);
            (row - hidden_rows(rays, geometry, row, seen_px, params)) as f32
        }));
    }

    /// Follows the floor and picks out the obstacles of a row.
    fn read_row(
        &mut self,
        y: usize,
        rays: &Rays,
        geometry: &RectifiedGeometry,
        floor: &Floor,
        params: &ScanParams,
    ) {
        let row = y as f64;
        let count = rays.count;
        let columns = [rays.column(0, row), rays.column(count - 1, row)];
        let [first, last] = columns.map(|x| SCALE * floor.disparity_px(x, row));
        let ground = Linear::between(first, last, count);
        let heights = Heights::new(floor, params);
        if first.max(last) > 0.0 {
            let [a, b] = [first, last].map(|raw| hidden_rows(rays, geometry, row, raw / SCALE, params));
            self.follow_floor(row as f32, ground, Linear::between(a, b, count), heights);
        } else if !heights.high_is_above_camera {
            // Nothing above the horizon is as low as the robot is high.
            self.ahead.fill(-1);
            return;
        }
        let [first, last] = columns.map(|x| 1.0 / rays.forward_per_depth(x, row));
        self.pick_obstacles(ground, Linear::between(first, last, count), heights);
    }

    fn follow_floor(&mut self, row: f32, ground: Linear, hidden: Linear, heights: Heights) {
        let Heights { low, below, noise_raw, .. } = heights;
        let last = self.last_row.iter_mut().zip(&mut self.last_raw);
        let floor = self.line.iter().zip(&mut self.next_row).zip(last);
        for (line, ((&seen, next_row), (last_row, last_raw))) in floor.enumerate() {
            let ground = ground.at(line);
            // Only where what matters would stand out is the floor known to be the floor.
            let is_floor = (seen < ground * low)
                & (seen >= (ground * below).min(ground - noise_raw))
                & (ground * (low - 1.0) >= noise_raw);
            let goes_on = is_floor & (row >= *next_row);
            *last_row = if goes_on { row } else { *last_row };
            *last_raw = if goes_on { seen.max(ground) } else { *last_raw };
            *next_row = if goes_on { row - hidden.at(line) } else { *next_row };
        }
    }

    fn pick_obstacles(&mut self, ground: Linear, per_forward: Linear, heights: Heights) {
        let Heights { low, high, high_is_above_camera, noise_raw, .. } = heights;
        for (line, (&seen, ahead)) in self.line.iter().zip(&mut self.ahead).enumerate() {
            let ground = ground.at(line);
            let lowest = (ground * low).max(ground + noise_raw).max(1.0);
            // `high` is negative for a height above the camera, so this limit is positive above the horizon.
            let (lowest, highest) = if high_is_above_camera {
                (lowest.max(ground * high), f32::INFINITY)
            } else {
                (lowest, ground * high)
            };
            let is_obstacle = (seen >= lowest) & (seen <= highest);
            let raw = (seen * per_forward.at(line) + 0.5) as i32;
            *ahead = if is_obstacle { raw } else { -1 };
        }
    }

    /// Without a floor everything in view may be in the way, and every row without an answer may hide something.
    fn read_row_without_floor(&mut self) {
        let gaps = self.gap.iter_mut().zip(&mut self.longest_gap);
        for ((&seen, ahead), (gap, longest)) in self.line.iter().zip(&mut self.ahead).zip(gaps) {
            *gap = if seen == UNSEEN { *gap + 1 } else { 0 };
            *longest = (*longest).max(*gap);
            *ahead = if seen >= 1.0 { seen as i32 } else { -1 };
        }
    }

    fn count_obstacles(&mut self) {
        let count = self.ahead.len();
        for (block, aheads) in self.ahead.chunks(BLOCK).enumerate() {
            if aheads.iter().fold(-1, |all, &ahead| all & ahead) == -1 {
                continue;
            }
            for (i, &ahead) in aheads.iter().enumerate() {
                // Counted always, as nothing where there is nothing: which it is cannot be predicted.
                let raw = ahead.max(0);
                let one = if ahead < 0 { 0 } else { ONE_PIXEL + (raw % RAW_PER_BIN) as u32 };
                self.histogram[(raw / RAW_PER_BIN) as usize * count + block * BLOCK + i] += one;
            }
        }
    }

    /// For each direction the nearest two bins with enough pixels together, as the nearer of the two.
    fn find_nearest(&mut self, count: usize, min_support: u32) {
        refill(&mut self.nearest, count, 0);
        let bins = self.histogram.len() / count;
        for bin in 1..bins {
            let (farther, nearer) = self.histogram[(bin - 1) * count..(bin + 1) * count].split_at(count);
            for ((nearest, &nearer), &farther) in self.nearest.iter_mut().zip(nearer).zip(farther) {
                let enough = (nearer >> COUNT_SHIFT) + (farther >> COUNT_SHIFT) >= min_support;
                *nearest = if enough { bin as u32 } else { *nearest };
            }
        }
        // The first window to qualify may hold only the near tail of a surface's scatter.
        for line in 0..count {
            let first = self.nearest[line] as usize;
            let pixels = |bin: usize| {
                (self.histogram[bin * count + line] >> COUNT_SHIFT)
                    + (self.histogram[(bin - 1) * count + line] >> COUNT_SHIFT)
            };
            let mut bin = first;
            while bin > 1 && first - bin < CLIMB && 4 * pixels(bin - 1) > 5 * pixels(bin) {
                bin -= 1;
            }
            self.nearest[line] = bin as u32;
        }
    }

    /// Mean disparity ahead of a direction's nearest obstacle, px from infinity.
    fn nearest_px(&self, line: usize) -> Option<f64> {
        let bin = self.nearest[line] as usize;
        if bin == 0 {
            return None;
        }
        let count = self.nearest.len();
        let mut pixels = 0.0;
        let mut sum = 0.0;
        for bin in [bin - 1, bin] {
            let cell = self.histogram[bin * count + line];
            let here = f64::from(cell >> COUNT_SHIFT);
            pixels += here;
            sum += here * (bin * RAW_PER_BIN as usize) as f64 + f64::from(cell & (ONE_PIXEL - 1));
        }
        // Distances come in whole sixteenths that were rounded.
        Some(sum / pixels / SCALE)
    }

    fn describe(&self, view: &View<'_>, out: &mut Scan) {
        for values in [
            &mut out.angle_rad,
            &mut out.nearest_m,
            &mut out.sigma_m,
            &mut out.free_from_m,
            &mut out.free_to_m,
        ] {
            values.clear();
        }
        out.seen.clear();
        let View { geometry, rays, mounting, params, .. } = *view;
        let mut before_rad = f64::NEG_INFINITY;
        // Lines run from left to right, angles from right to left.
        for line in (0..rays.count).rev() {
            let direction = rays.direction(line);
            let per_ahead = direction.norm();
            let mut angle_rad = mounting.angle_rad(&direction);
            if angle_rad < before_rad {
                // A camera that looks backward: angles go on beyond half a turn.
                angle_rad += std::f64::consts::TAU;
            }
            before_rad = angle_rad;
            let stretch = self.stretch(view, line);
            let limit_m = params.max_range_m / per_ahead;
            let nearest_m = stretch.nearest_m.filter(|&nearest_m| nearest_m <= limit_m);
            let free = stretch.free_m.filter(|(from_m, to_m)| from_m < to_m);
            let seen = match (nearest_m, free) {
                (Some(_), _) => Seen::Obstacle,
                (None, Some((_, to_m))) if to_m >= limit_m => Seen::Nothing,
                _ => Seen::Unknown,
            };
            let metres = |ahead_m: Option<f64>| ahead_m.map_or(f32::NAN, |m| (m * per_ahead) as f32);
            out.angle_rad.push(angle_rad as f32);
            out.seen.push(seen as u8);
            out.nearest_m.push(metres(nearest_m));
            out.sigma_m
                .push(metres(nearest_m.map(|m| depth_sigma_m(geometry, m, params.disparity_sigma_px))));
            out.free_from_m.push(metres(free.map(|(from_m, _)| from_m)));
            out.free_to_m.push(metres(free.map(|(_, to_m)| to_m.min(limit_m))));
        }
        let position_m = mounting.translation_m();
        out.origin_m = [position_m.x, position_m.y];
        out.max_range_m = params.max_range_m;
        out.blind_m = view.blind_m(0.5 * geometry.width as f64, 0.5 * geometry.height as f64);
    }

    /// What a direction holds, metres ahead.
    fn stretch(&self, view: &View<'_>, line: usize) -> Stretch {
        let View { geometry, rays, floor, params, .. } = *view;
        let focal_baseline = geometry.focal_px * geometry.baseline_m;
        let nearest_px = self.nearest_px(line);
        let nearest_m = nearest_px.map(|px| focal_baseline / px);
        let Some(floor) = floor else {
            // A gap hides what is `min_height_m` high only from the distance on where it fits in.
            let hides_from_m =
                params.min_height_m * geometry.focal_px / (f64::from(self.longest_gap[line]) + f64::EPSILON);
            let blind_m = view.blind_m(rays.column(line, 0.0), 0.0);
            return Stretch { nearest_m, free_m: nearest_m.map(|m| (blind_m, m.min(hides_from_m))) };
        };
        let last_row = f64::from(self.last_row[line]);
        if !last_row.is_finite() {
            return Stretch { nearest_m, free_m: None };
        }
        let seen_px = |row: f64| {
            let x = rays.column(line, row);
            floor.disparity_px(x, row) / rays.forward_per_depth(x, row)
        };
        let last_px = f64::from(self.last_raw[line]) / SCALE;
        let floor_to_m =
            focal_baseline * rays.forward_per_depth(rays.column(line, last_row), last_row) / last_px;
        let to_m = match (nearest_px, nearest_m) {
            (Some(_), Some(nearest_m)) if nearest_m <= floor_to_m => nearest_m,
            // The floor ends where the obstacle's foot is: nothing fits in between.
            (Some(px), Some(nearest_m)) if view.foot_row(line, px) >= f64::from(self.next_row[line]) => {
                nearest_m
            }
            _ => floor_to_m,
        };
        let from_m = rays.lowest_row(line).map_or(f64::INFINITY, |lowest| {
            let view_m = focal_baseline / seen_px(lowest);
            view_m.max(view.blind_m(rays.column(line, lowest), lowest))
        });
        Stretch { nearest_m, free_m: Some((from_m, to_m)) }
    }
}

/// What a direction holds, metres ahead.
struct Stretch {
    nearest_m: Option<f64>,
    /// From, to.
    free_m: Option<(f64, f64)>,
}

/// What one frame is looked at with.
#[derive(Clone, Copy)]
struct View<'a> {
    geometry: &'a RectifiedGeometry,
    rays: &'a Rays,
    floor: Option<&'a Floor>,
    mounting: &'a RobotFromCamera,
    params: &'a ScanParams,
    /// Largest disparity searched, px from infinity.
    blind_px: f64,
}

impl View<'_> {
    /// Distance ahead below which disparities were not searched, at a pixel.
    fn blind_m(&self, x: f64, y: f64) -> f64 {
        let Self { geometry, rays, blind_px, .. } = self;
        if *blind_px > 0.0 {
            geometry.focal_px * geometry.baseline_m * rays.forward_per_depth(x, y) / blind_px
        } else {
            0.0
        }
    }

    /// The row where something at a disparity ahead stands on the floor.
    fn foot_row(&self, line: usize, ahead_px: f64) -> f64 {
        let Some(floor) = self.floor else { return f64::NEG_INFINITY };
        // Plane and distance ahead are linear along the line; the bend is taken at its foot, in two rounds.
        let at = |y: f64| {
            let x = self.rays.column(line, y);
            (floor.plane_px(x, y), self.rays.forward_per_depth(x, y))
        };
        let ((plane, forward), (plane_1, forward_1)) = (at(0.0), at(1.0));
        let (plane_step, forward_step) = (plane_1 - plane, forward_1 - forward);
        let mut row = 0.0;
        for _ in 0..2 {
            let bend_px = floor.bend / (ahead_px * (forward + forward_step * row));
            row = (ahead_px * forward - bend_px - plane) / (plane_step - ahead_px * forward_step);
        }
        row
    }
}

/// The floor below a camera that is mounted so.
fn floor_of(mounting: &RobotFromCamera, geometry: &RectifiedGeometry, params: &ScanParams) -> Result<GroundPlane> {
    let height_m = mounting.translation_m().z;
    if height_m <= params.min_height_m {
        let expected = format!("must be below the camera's height, {height_m} m");
        return Err(Error::invalid("min_height_m", format!("{} m", params.min_height_m), expected));
    }
    let down = mounting.down();
    Ok(GroundPlane::new(geometry, height_m, down.z.asin(), down.x.atan2(down.y)))
}

/// Rows of floor that something of the lowest height that matters hides at least, less what the matcher may blur; its
/// foot is seen in a row, at a disparity.
fn hidden_rows(
    rays: &Rays,
    geometry: &RectifiedGeometry,
    row: f64,
    disparity_px: f64,
    params: &ScanParams,
) -> f64 {
    let slope = params.min_height_m * disparity_px / (geometry.focal_px * geometry.baseline_m);
    // Where the top is farther than the foot it is seen lower; where it is nearer, higher, and this is the least.
    let farther = 1.0 + (slope * rays.top_depth_per_height()).max(0.0);
    slope * rays.rows_per_slope(row) / farther - params.gap_guard_px
}

fn refill<T: Clone>(values: &mut Vec<T>, length: usize, value: T) {
    values.clear();
    values.resize(length, value);
}
