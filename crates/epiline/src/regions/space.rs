//! Regions given in metres: what is so high above the ground, so far away and so far to the side.

use std::sync::Arc;

use super::{Region, Search};
use crate::error::{Error, Result};
use crate::matching::DisparityMap;
use crate::rectification::RectifiedGeometry;

/// How the left aligned camera stands over level ground.
///
/// Angles are those of REP 103's body frame (x forward, y left, z up): turned by `roll_rad` about x, then by `pitch_rad`
/// about y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraOverGround {
    /// Height of the camera's centre above the ground, metres, positive.
    pub height_m: f64,
    /// Positive looks down; between -π/2 and π/2.
    pub pitch_rad: f64,
    /// Positive lowers the right side; between -π/2 and π/2.
    pub roll_rad: f64,
}

impl CameraOverGround {
    /// A camera that looks straight ahead.
    pub fn level(height_m: f64) -> Self {
        Self { height_m, pitch_rad: 0.0, roll_rad: 0.0 }
    }

    /// Fails with the name and value of the first figure outside its range.
    pub fn validate(&self) -> Result<()> {
        if !(self.height_m.is_finite() && self.height_m > 0.0) {
            let value = format!("{} m", self.height_m);
            return Err(Error::invalid("camera height_m", value, "must be positive and finite"));
        }
        for (name, angle) in [("camera pitch_rad", self.pitch_rad), ("camera roll_rad", self.roll_rad)] {
            if angle.is_nan() || angle.abs() >= std::f64::consts::FRAC_PI_2 {
                let value = format!("{angle} rad");
                return Err(Error::invalid(name, value, "must lie between -pi/2 and pi/2"));
            }
        }
        Ok(())
    }

    /// Unit vector away from the ground, in the left aligned frame (x right, y down, z forward).
    pub fn up(&self) -> [f64; 3] {
        let ((sin_pitch, cos_pitch), (sin_roll, cos_roll)) =
            (self.pitch_rad.sin_cos(), self.roll_rad.sin_cos());
        [-cos_pitch * sin_roll, -cos_pitch * cos_roll, -sin_pitch]
    }

    /// Unit vector to the right along the ground, across the direction the camera looks in; same frame.
    pub fn right(&self) -> [f64; 3] {
        let (sin_roll, cos_roll) = self.roll_rad.sin_cos();
        [cos_roll, -sin_roll, 0.0]
    }
}

/// A part of space ahead of the rig: a layer over the ground between two ranges, of some width or any.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slab {
    /// Lowest and highest point above the ground, metres; negative is below the ground. Either end may be infinite.
    pub height_m: (f64, f64),
    /// Nearest and furthest Euclidean range from the left camera, metres; the furthest may be infinite.
    pub range_m: (f64, f64),
    /// Leftmost and rightmost, metres; positive is to the right of the camera. Either end may be infinite.
    pub lateral_m: (f64, f64),
}

impl Slab {
    /// A layer as wide as the view.
    pub fn new(height_m: (f64, f64), range_m: (f64, f64)) -> Self {
        Self { height_m, range_m, lateral_m: (f64::NEG_INFINITY, f64::INFINITY) }
    }

    /// Fails with the name and value of the first pair that is not in order.
    pub fn validate(&self) -> Result<()> {
        let ordered = |name, (low, high): (f64, f64)| {
            let value = format!("({low}, {high}) m");
            if low < high {
                Ok(())
            } else {
                Err(Error::invalid(name, value, "must be two distances in ascending order"))
            }
        };
        ordered("height_m", self.height_m)?;
        ordered("lateral_m", self.lateral_m)?;
        let (near_m, far_m) = self.range_m;
        if near_m > 0.0 && near_m < far_m {
            return Ok(());
        }
        let value = format!("({near_m}, {far_m}) m");
        Err(Error::invalid("range_m", value, "must be two distances, 0 < near < far"))
    }
}

/// A slab, and how the camera stands that sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Space {
    /// What is looked at.
    pub slab: Slab,
    /// From where.
    pub camera: CameraOverGround,
}

/// A part of the image plane at depth 1, `u = (x - cx)/f`, `v = (y - cy)/f`: of a pixel's centre only, or all of it.
#[derive(Debug, Clone, Copy)]
struct Rays {
    u: (f64, f64),
    v: (f64, f64),
}

impl Rays {
    /// The rays within `half_px` pixels of (x, y).
    fn near(geometry: &RectifiedGeometry, x: usize, y: usize, half_px: f64) -> Self {
        let around = |at: usize, center: f64| {
            let at = at as f64 - center;
            ((at - half_px) / geometry.focal_px, (at + half_px) / geometry.focal_px)
        };
        Self { u: around(x, geometry.cx_px), v: around(y, geometry.cy_px) }
    }

    /// Least and greatest scalar product of `direction` with the rays `(u, v, 1)`.
    fn along(&self, direction: [f64; 3]) -> (f64, f64) {
        let span = |factor: f64, (low, high): (f64, f64)| {
            if factor < 0.0 { (factor * high, factor * low) } else { (factor * low, factor * high) }
        };
        let (by_u, by_v) = (span(direction[0], self.u), span(direction[1], self.v));
        (by_u.0 + by_v.0 + direction[2], by_u.1 + by_v.1 + direction[2])
    }

    /// Least and greatest length.
    fn length(&self) -> (f64, f64) {
        let least =
            |(low, high): (f64, f64)| if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
        let most = |(low, high): (f64, f64)| low.abs().max(high.abs());
        let length = |u: f64, v: f64| (1.0 + u * u + v * v).sqrt();
        (length(least(self.u), least(self.v)), length(most(self.u), most(self.v)))
    }
}

/// Keeps of a span of positive depths those with `slope·Z <= bound`.
fn clip((near, far): (f64, f64), slope: f64, bound: f64) -> (f64, f64) {
    if bound == f64::INFINITY {
        (near, far)
    } else if slope > 0.0 {
        (near, far.min(bound / slope))
    } else if slope < 0.0 {
        (near.max(bound / slope), far)
    } else if bound >= 0.0 {
        (near, far)
    } else {
        (f64::INFINITY, 0.0)
    }
}

impl Space {
    /// Depths Z at which a point on these rays may lie in the slab, metres; `None` where none does.
    ///
    /// On a single ray these are exactly the slab's. Over a pixel, each of its bounds is taken where it is widest, so
    /// that nothing of the slab is missed.
    fn depths_m(&self, rays: &Rays) -> Option<(f64, f64)> {
        let Self { slab, camera } = self;
        let (shortest, longest) = rays.length();
        let mut span = (slab.range_m.0 / longest, slab.range_m.1 / shortest);
        let (least, most) = rays.along(camera.up());
        span = clip(span, least, slab.height_m.1 - camera.height_m);
        span = clip(span, -most, camera.height_m - slab.height_m.0);
        let (least, most) = rays.along(camera.right());
        span = clip(span, least, slab.lateral_m.1);
        span = clip(span, -most, -slab.lateral_m.0);
        (span.0 <= span.1).then_some(span)
    }

    /// Smallest and largest disparity, 1/16 px, of a point of the slab seen at a pixel's centre; `None` without one.
    /// Rounded outward by half a step, so that a point on the slab's face belongs to it.
    fn raw_at(&self, geometry: &RectifiedGeometry, x: usize, y: usize) -> Option<(u16, u16)> {
        let (near_m, far_m) = self.depths_m(&Rays::near(geometry, x, y, 0.0))?;
        let scale = f64::from(DisparityMap::SCALE);
        let (low, high) = (scale * geometry.disparity_px(far_m), scale * geometry.disparity_px(near_m));
        // `as` cuts off what no disparity can be.
        (high >= -0.5).then(|| ((low - 0.5).ceil() as u16, (high + 0.5).floor() as u16))
    }

    /// Copies a region's box of `disparity` into `inside` without the pixels whose points lie outside the slab.
    pub(super) fn select(
        &self,
        disparity: &DisparityMap,
        geometry: &RectifiedGeometry,
        region: &Region,
        inside: &mut DisparityMap,
        outside: u8,
    ) {
        inside.resize(disparity.width(), disparity.height());
        (inside.min_disparity, inside.num_disparities) = (disparity.min_disparity, disparity.num_disparities);
        let columns = region.x..region.x + region.width;
        for y in region.y..region.y + region.height {
            inside.values.row_mut(y)[columns.clone()]
                .copy_from_slice(&disparity.values.row(y)[columns.clone()]);
            let raws = &disparity.values.row(y)[columns.clone()];
            let bits = disparity.validity.row(y)[columns.clone()].iter().zip(raws);
            let selected = &mut inside.validity.row_mut(y)[columns.clone()];
            for ((x, selected), (&bits, raw)) in columns.clone().zip(selected).zip(bits) {
                let holds = self.raw_at(geometry, x, y).is_some_and(|(low, high)| (low..=high).contains(raw));
                *selected = if holds { bits } else { outside };
            }
        }
    }
}

impl Region {
    /// The pixels that see a part of space, and the disparities of points in it.
    ///
    /// The box holds every pixel that any point of the slab falls on, and no row or column more than one beyond those;
    /// its search holds the disparities of all those points and one pixel beyond, so that the ends can be refined. A
    /// profile of the region reads only pixels whose points lie in the slab.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for bounds that are not in order, a camera that stands in no way, a cylindrical pair,
    /// or a slab that no pixel sees.
    pub fn in_space(
        name: impl Into<Arc<str>>,
        slab: Slab,
        camera: CameraOverGround,
        geometry: &RectifiedGeometry,
    ) -> Result<Self> {
        let name = name.into();
        let of_region = |error| match error {
            Error::InvalidParameter { name: parameter, value, expected } => {
                Error::invalid(parameter, format!("{value} of region '{name}'"), expected)
            }
            other => other,
        };
        slab.validate().map_err(of_region)?;
        camera.validate().map_err(of_region)?;
        geometry.require_pinhole("a region in metres")?;
        let space = Space { slab, camera };
        let (mut left, mut top, mut right, mut bottom) = (usize::MAX, usize::MAX, 0, 0);
        let mut depths_m = (f64::INFINITY, 0.0_f64);
        for y in 0..geometry.height {
            for x in 0..geometry.width {
                let Some((near_m, far_m)) = space.depths_m(&Rays::near(geometry, x, y, 0.5)) else {
                    continue;
                };
                (left, right) = (left.min(x), right.max(x));
                (top, bottom) = (top.min(y), bottom.max(y));
                depths_m = (depths_m.0.min(near_m), depths_m.1.max(far_m));
            }
        }
        let limit = geometry.width as f64 - 1.0;
        let last = geometry.disparity_px(depths_m.0).ceil() + 1.0;
        if left == usize::MAX || last < 0.0 {
            let Slab { height_m, range_m, .. } = slab;
            let value = format!(
                "'{name}', {} to {} m above the ground at {} to {} m",
                height_m.0, height_m.1, range_m.0, range_m.1
            );
            return Err(Error::invalid("region", value, "must be in view: no pixel sees it"));
        }
        let first = (geometry.disparity_px(depths_m.1).floor() - 1.0).clamp(0.0, limit);
        let last = last.clamp(0.0, limit);
        let search = Search::Disparities { first: first as usize, count: (last - first) as usize + 1 };
        let (width, height) = (right - left + 1, bottom - top + 1);
        Ok(Self { name, x: left, y: top, width, height, search: Some(search), space: Some(space) })
    }
}
