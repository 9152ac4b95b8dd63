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
//! `H`, has the disparity `d` with `h = H·(1 - g/d)`.

use super::histogram::Histogram;
use super::view::{SCALE, View};
use super::{RobotFromCamera, Scan, ScanParams, Seen, refill};
use crate::error::Result;
use crate::ground::GroundPlane;
use crate::kernels::floor::{FloorRow, rounded_or_none};
use crate::kernels::{Kernels, Level};
use crate::matching::DisparityMap;
use crate::range::{check_size, depth_sigma_m};
use crate::rectification::RectifiedGeometry;

/// A row that no direction has reached.
const NO_ROW: f32 = f32::INFINITY;

/// Scans disparity maps; keeps its buffers from frame to frame.
#[derive(Debug, Clone)]
pub struct Scanner {
    kernels: Kernels,
    /// 0, 1, 2 …
    places: Vec<f32>,
    /// A row by direction: disparities, their bits, and disparities ahead of obstacles, or -1.
    raws: Vec<u16>,
    bits: Vec<u8>,
    ahead: Vec<i32>,
    histogram: Histogram,
    /// Highest row that the floor was seen in without a gap, and the disparity there: of the pixel or of the floor,
    /// whichever is nearer, sixteenths of a pixel.
    last_row: Vec<f32>,
    last_raw: Vec<f32>,
    /// The row by which it must be seen again.
    next_row: Vec<f32>,
    /// Rows without a disparity, up to the present one and at most.
    gap: Vec<u16>,
    longest_gap: Vec<u16>,
}

impl Default for Scanner {
    fn default() -> Self {
        Self {
            kernels: Kernels::new(Level::current()),
            places: Vec::new(),
            raws: Vec::new(),
            bits: Vec::new(),
            ahead: Vec::new(),
            histogram: Histogram::default(),
            last_row: Vec::new(),
            last_raw: Vec::new(),
            next_row: Vec::new(),
            gap: Vec::new(),
            longest_gap: Vec::new(),
        }
    }
}

/// What a direction holds, metres ahead.
struct Stretch {
    nearest_m: Option<f64>,
    /// From, to.
    free_m: Option<(f64, f64)>,
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
    /// [`Error::SizeMismatch`](crate::Error::SizeMismatch) if map and geometry differ in size,
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for parameters out of range, a pair that is not
    /// pinhole, or a mounting lower than `step_m`; [`Error::Degenerate`](crate::Error::Degenerate) for a camera that is
    /// tilted so far that its columns do not rise from the floor.
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
        let view = View::new(disparity, geometry, ground, mounting, params)?;
        let largest_ahead = self.begin(disparity, &view);
        for y in (0..disparity.height()).rev() {
            let (raws, bits) = (disparity.values.row(y), disparity.validity.row(y));
            view.rays.sample(y, raws, bits, &mut self.raws, &mut self.bits);
            match &view.floor {
                Some(floor) => self.read_row(&view, floor, y, largest_ahead),
                None => self.read_row_without_floor(&view, largest_ahead),
            }
            self.histogram.count(&self.ahead);
        }
        self.histogram.find_nearest(params.min_support as u32);
        self.describe(&view, out);
        Ok(())
    }

    /// Sets the buffers up; returns the largest disparity ahead that is counted.
    fn begin(&mut self, disparity: &DisparityMap, view: &View<'_>) -> f32 {
        let count = view.rays.count;
        // A fold, for `max` of an iterator does not use vectors.
        let largest = disparity.values.as_slice().iter().fold(0, |largest: u16, &raw| largest.max(raw));
        if self.places.len() != count {
            self.places.clear();
            self.places.extend((0..count).map(|place| place as f32));
        }
        refill(&mut self.raws, count, 0);
        refill(&mut self.bits, count, 0);
        refill(&mut self.ahead, count, -1);
        refill(&mut self.last_row, count, NO_ROW);
        refill(&mut self.last_raw, count, 0.0);
        refill(&mut self.gap, count, 0);
        refill(&mut self.longest_gap, count, 0);
        self.next_row.clear();
        if let Some(floor) = &view.floor {
            self.next_row.extend((0..count).map(|line| view.first_row(floor, line) as f32));
        }
        self.histogram.begin(count, view.largest_ahead(largest))
    }

    fn read_row(&mut self, view: &View<'_>, floor: &GroundPlane, y: usize, largest_ahead: f32) {
        let Some(terms) = view.row_terms(floor, y) else {
            self.ahead.fill(-1);
            return;
        };
        self.kernels.floor(&mut FloorRow {
            raws: &self.raws,
            bits: &self.bits,
            places: &self.places,
            doffs_raw: (SCALE * view.geometry.doffs_px) as f32,
            ground: terms.ground,
            low: terms.low,
            below: terms.below,
            noise_raw: view.noise_raw(),
            least: terms.least,
            most: terms.most,
            per_forward: terms.per_forward,
            largest_ahead,
            row: terms.row,
            hidden: terms.hidden,
            last_row: &mut self.last_row,
            last_raw: &mut self.last_raw,
            next_row: &mut self.next_row,
            ahead: &mut self.ahead,
        });
    }

    /// Without a floor everything in view may be in the way, and every row without an answer may hide something.
    fn read_row_without_floor(&mut self, view: &View<'_>, largest_ahead: f32) {
        let doffs_raw = (SCALE * view.geometry.doffs_px) as f32;
        let gaps = self.gap.iter_mut().zip(&mut self.longest_gap);
        let pixels = self.raws.iter().zip(&self.bits).zip(&mut self.ahead);
        for (((&raw, &bits), ahead), (gap, longest)) in pixels.zip(gaps) {
            let seen = f32::from(raw) + doffs_raw;
            let is_measured = bits == 0;
            *gap = if is_measured { 0 } else { *gap + 1 };
            *longest = (*longest).max(*gap);
            let is_in_front = is_measured & (seen > 0.0) & (seen <= largest_ahead);
            *ahead = rounded_or_none(seen, is_in_front);
        }
    }

    fn describe(&self, view: &View<'_>, out: &mut Scan) {
        let metres = [
            &mut out.angle_rad,
            &mut out.nearest_m,
            &mut out.sigma_m,
            &mut out.free_from_m,
            &mut out.free_to_m,
        ];
        metres.into_iter().for_each(Vec::clear);
        out.seen.clear();
        let View { geometry, params, .. } = *view;
        let mut before_rad = f64::NEG_INFINITY;
        // Lines run from left to right, angles from right to left.
        for line in (0..view.rays.count).rev() {
            let direction = view.rays.direction(line);
            let per_ahead = direction.norm();
            let mut angle_rad = view.mounting.angle_rad(&direction);
            if angle_rad < before_rad {
                // A camera that looks backward: angles go on beyond half a turn.
                angle_rad += std::f64::consts::TAU;
            }
            before_rad = angle_rad;
            let stretch = self.stretch(view, line);
            let limit_m = params.max_range_m / per_ahead;
            let nearest_m = stretch.nearest_m.filter(|&nearest_m| nearest_m <= limit_m);
            let free_m = stretch.free_m.filter(|(from_m, to_m)| from_m < to_m);
            let seen = match (nearest_m, free_m) {
                (Some(_), _) => Seen::Obstacle,
                (None, Some((_, to_m))) if to_m >= limit_m => Seen::Nothing,
                _ => Seen::Unknown,
            };
            let sigma_m = nearest_m.map(|m| depth_sigma_m(geometry, m, params.disparity_sigma_px));
            let metres = |ahead_m: Option<f64>| ahead_m.map_or(f32::NAN, |m| (m * per_ahead) as f32);
            out.angle_rad.push(angle_rad as f32);
            out.seen.push(seen as u8);
            out.nearest_m.push(metres(nearest_m));
            out.sigma_m.push(metres(sigma_m));
            out.free_from_m.push(metres(free_m.map(|(from_m, _)| from_m)));
            out.free_to_m.push(metres(free_m.map(|(_, to_m)| to_m.min(limit_m))));
        }
        let position_m = view.mounting.translation_m();
        out.origin_m = [position_m.x, position_m.y];
        out.max_range_m = params.max_range_m;
        out.blind_m = view.blind_m(geometry.cx_px, geometry.cy_px);
    }

    fn stretch(&self, view: &View<'_>, line: usize) -> Stretch {
        let nearest_px = self.histogram.nearest_px(line);
        let nearest_m = nearest_px.map(|px| view.focal_baseline() / px);
        let free_m = match &view.floor {
            Some(floor) => self.free_over_floor(view, floor, line, nearest_px),
            None => nearest_m.map(|nearest_m| {
                // A gap hides what is `step_m` high only from the distance on where that fits in.
                let rows = f64::from(self.longest_gap[line]);
                let hides_from_m = view.params.step_m * view.geometry.focal_px / rows;
                (view.blind_m(view.rays.column(line, 0.0), 0.0), nearest_m.min(hides_from_m))
            }),
        };
        Stretch { nearest_m, free_m }
    }

    fn free_over_floor(
        &self,
        view: &View<'_>,
        floor: &GroundPlane,
        line: usize,
        nearest_px: Option<f64>,
    ) -> Option<(f64, f64)> {
        let last_row = f64::from(self.last_row[line]);
        if !last_row.is_finite() {
            return None;
        }
        let x = view.rays.column(line, last_row);
        let floor_to_m = view.ahead_m(f64::from(self.last_raw[line]) / SCALE, x, last_row);
        let to_m = nearest_px.map_or(floor_to_m, |px| {
            let nearest_m = view.focal_baseline() / px;
            if nearest_m <= floor_to_m {
                return nearest_m;
            }
            // The floor ends where the obstacle's foot is: nothing fits in between, unless something was seen there.
            let meets = view.foot_row(floor, line, px) >= f64::from(self.next_row[line]);
            let floor_to_px = view.focal_baseline() / floor_to_m;
            match self.histogram.stray_px(line, floor_to_px) {
                None if meets => nearest_m,
                Some(stray_px) if meets => floor_to_m.max(view.focal_baseline() / stray_px),
                _ => floor_to_m,
            }
        });
        Some((view.begin_m(floor, line), to_m))
    }
}
