//! The ground as a pose of the camera over it, and as what disparity it has at each pixel.

use nalgebra::Vector3;

use super::profile::Profile;
use crate::rectification::RectifiedGeometry;
use crate::regions::CameraOverGround;

/// The ground in front of the camera: a plane, and how the ground rises over it ahead.
///
/// With the unit vector `n` down onto the plane and the camera's height `h`, points of the plane have `n·P = h`. By
/// `P = (f·b / s)·ray` with `s = d + doffs_px` (eq. 2) its disparity is linear in the image:
///
/// ```text
/// p(x, y) = (b/h)·(n_x·(x - cx) + n_y·(y - cy) + n_z·f)
/// ```
///
/// and a pixel of disparity `d` lies `h·(s - p) / s` above the plane. Where the ground has the elevation `e(Z)`, it is
/// seen where that equals `e`, that is, at `p = g(s) = s·(1 - e(f·b/s) / h)`, the profile of v-disparity; a pixel then
/// lies `h·(g(s) - p) / s` above the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundPlane {
    /// Distance of the left camera's centre from the plane, metres, positive.
    pub camera_height_m: f64,
    /// How far the optical axis points below the plane's horizon, radians.
    pub pitch_rad: f64,
    /// How far the image's right side hangs lower than its left, radians.
    pub roll_rad: f64,
    /// How the ground rises and falls along the direction of view.
    pub profile: Profile,
    /// Standard deviation of `camera_height_m`, metres.
    pub camera_height_sigma_m: f64,
    /// Standard deviation of `pitch_rad`, radians.
    pub pitch_sigma_rad: f64,
    /// Standard deviation of `roll_rad`, radians.
    pub roll_sigma_rad: f64,
    /// Share of the pixels looked at in the frame that lie on it, 0 to 1; 0 for one carried over from earlier frames.
    pub support_share: f64,
    coefficients: Coefficients,
}

/// `p(x, y) = by_x·x + by_y·y + at_origin`, pixels, and what turns disparities into depths.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Coefficients {
    by_x: f64,
    by_y: f64,
    at_origin: f64,
    focal_baseline: f64,
    doffs_px: f64,
}

impl GroundPlane {
    /// A level plane known exactly; the camera's height is positive, the pitch less than a right angle.
    pub fn new(geometry: &RectifiedGeometry, camera_height_m: f64, pitch_rad: f64, roll_rad: f64) -> Self {
        let per_m = geometry.baseline_m / camera_height_m;
        let n = down(pitch_rad, roll_rad);
        let (by_x, by_y) = (per_m * n.x, per_m * n.y);
        let coefficients = Coefficients {
            by_x,
            by_y,
            at_origin: per_m * n.z * geometry.focal_px - by_x * geometry.cx_px - by_y * geometry.cy_px,
            focal_baseline: geometry.focal_px * geometry.baseline_m,
            doffs_px: geometry.doffs_px,
        };
        Self {
            camera_height_m,
            pitch_rad,
            roll_rad,
            profile: Profile::level(camera_height_m),
            camera_height_sigma_m: 0.0,
            pitch_sigma_rad: 0.0,
            roll_sigma_rad: 0.0,
            support_share: 0.0,
            coefficients,
        }
    }

    /// How the camera stands over the plane: what regions in metres are placed by.
    pub fn camera(&self) -> CameraOverGround {
        let Self { camera_height_m: height_m, pitch_rad, roll_rad, .. } = *self;
        CameraOverGround { height_m, pitch_rad, roll_rad }
    }

    /// The unit vector from the camera straight down onto the plane, in the left aligned frame.
    pub fn down(&self) -> Vector3<f64> {
        down(self.pitch_rad, self.roll_rad)
    }

    /// Disparity of the ground at a pixel of the left image, px; `None` above its horizon.
    pub fn disparity_px(&self, x: f64, y: f64) -> Option<f64> {
        let seen = self.seen_px(self.plane_px(x, y), 0.0);
        (seen > 0.0).then_some(seen - self.coefficients.doffs_px)
    }

    /// How high the point seen at a pixel with a disparity is above the ground, metres; negative below it. The
    /// disparity has a point in front of the cameras: `d + doffs_px > 0`.
    pub fn height_m(&self, x: f64, y: f64, disparity_px: f64) -> f64 {
        let Coefficients { focal_baseline, doffs_px, .. } = self.coefficients;
        let seen = disparity_px + doffs_px;
        let above_plane_m = self.camera_height_m * (1.0 - self.plane_px(x, y) / seen);
        above_plane_m - self.profile.elevation_m(focal_baseline / seen)
    }

    /// Depth of a disparity counted from infinity, metres.
    pub(crate) fn depth_m(&self, seen_px: f64) -> f64 {
        self.coefficients.focal_baseline / seen_px
    }

    /// Disparity of a depth, counted from infinity, px.
    pub(super) fn seen_at_m(&self, depth_m: f64) -> f64 {
        self.coefficients.focal_baseline / depth_m
    }

    /// The disparity, counted from infinity, at which something `height_m` above the ground is seen where the plane has
    /// the disparity `plane_px`: where the line of sight, which falls `h·p / (f·b)` per metre ahead, meets `e(Z) +
    /// height`. By Newton's method: exact once the knots are found between which it does, for there `e` is straight.
    /// Zero where there is none, above the horizon of that height.
    pub(crate) fn seen_px(&self, plane_px: f64, height_m: f64) -> f64 {
        const STEPS: usize = 8;
        let clearance_m = self.camera_height_m - height_m;
        let fall = self.camera_height_m * plane_px / self.coefficients.focal_baseline;
        let mut depth_m = clearance_m / fall;
        for _ in 0..STEPS {
            if !(depth_m > 0.0 && depth_m.is_finite()) {
                return 0.0;
            }
            let (elevation_m, slope) = self.profile.elevation_and_slope(depth_m);
            let met_m = (clearance_m - elevation_m + slope * depth_m) / (fall + slope);
            if met_m == depth_m {
                break;
            }
            depth_m = met_m;
        }
        if depth_m > 0.0 && depth_m.is_finite() { self.seen_at_m(depth_m) } else { 0.0 }
    }

    /// Disparity of the plane, counted from infinity; negative above the horizon.
    pub(crate) fn plane_px(&self, x: f64, y: f64) -> f64 {
        let Coefficients { by_x, by_y, at_origin, .. } = self.coefficients;
        by_x * x + by_y * y + at_origin
    }
}

/// The unit vector down onto a plane below a camera of this pitch and roll.
fn down(pitch_rad: f64, roll_rad: f64) -> Vector3<f64> {
    let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
    let (sin_roll, cos_roll) = roll_rad.sin_cos();
    Vector3::new(cos_pitch * sin_roll, cos_pitch * cos_roll, sin_pitch)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geometry() -> RectifiedGeometry {
        RectifiedGeometry::new(640, 480, 500.0, 311.0, 242.0, 3.0, 0.11).expect("a rig")
    }

    /// The point of a plane that a pixel sees, by intersection of the ray.
    fn on_plane_m(geometry: &RectifiedGeometry, plane: &GroundPlane, x: f64, y: f64) -> Option<Vector3<f64>> {
        let ray = Vector3::new(
            (x - geometry.cx_px) / geometry.focal_px,
            (y - geometry.cy_px) / geometry.focal_px,
            1.0,
        );
        let toward = plane.down().dot(&ray);
        (toward > 0.0).then(|| ray * (plane.camera_height_m / toward))
    }

    #[test]
    fn disparities_are_those_of_rays_that_meet_the_plane() {
        let geometry = geometry();
        let plane = GroundPlane::new(&geometry, 0.7, 0.2, -0.1);
        for (x, y) in [(0.0, 470.0), (320.0, 300.0), (639.0, 250.0), (100.0, 20.0)] {
            let expected = on_plane_m(&geometry, &plane, x, y).map(|p| geometry.disparity_px(p.z));
            match (plane.disparity_px(x, y), expected) {
                (Some(got), Some(expected)) => assert!((got - expected).abs() < 1e-9, "{got} {expected}"),
                (got, expected) => assert_eq!(got, expected),
            }
        }
    }

    #[test]
    fn heights_are_distances_from_the_profile() {
        let geometry = geometry();
        let mut plane = GroundPlane::new(&geometry, 0.7, 0.1, 0.05);
        // A ramp of 1 in 12 from 2 m to 5 m.
        plane.profile = Profile::from_fn(0.7, |depth_m| (depth_m - 2.0).clamp(0.0, 3.0) / 12.0);
        for (x, y, z) in [(40.0, 400.0, 1.5), (600.0, 100.0, 6.0), (320.0, 240.0, 3.0)] {
            let point = geometry.point_m(x, y, geometry.disparity_px(z)).expect("in front");
            let expected = 0.7 - plane.down().dot(&point) - (z - 2.0_f64).clamp(0.0, 3.0) / 12.0;
            let got = plane.height_m(x, y, geometry.disparity_px(z));
            // Straight between the knots of the profile.
            assert!((got - expected).abs() < 0.01, "{got} {expected}");
        }
        for y in [245.0, 260.0, 300.0, 400.0, 470.0] {
            let ground_px = plane.disparity_px(320.0, y).expect("below the horizon");
            assert!(plane.height_m(320.0, y, ground_px).abs() < 2e-3, "row {y}");
        }
    }

    #[test]
    fn a_camera_that_looks_down_has_positive_pitch_and_one_that_leans_right_positive_roll() {
        let geometry = geometry();
        let plane = GroundPlane::new(&geometry, 1.0, 0.3, 0.0);
        let horizon = geometry.cy_px - geometry.focal_px * 0.3_f64.tan();
        assert!(plane.disparity_px(320.0, horizon - 1.0).is_none());
        assert!(plane.disparity_px(320.0, horizon + 1.0).is_some());
        let leaning = GroundPlane::new(&geometry, 1.0, 0.0, 0.1);
        assert!(leaning.disparity_px(600.0, 400.0) > leaning.disparity_px(20.0, 400.0));
    }
}
