//! Tsai's calibration of one camera from one set of known points, coplanar or not, and of a pair from board views.
//!
//! R. Y. Tsai, "A versatile camera calibration technique for high-accuracy 3D machine vision metrology using
//! off-the-shelf TV cameras and lenses", IEEE J. Robotics and Automation RA-3(4), 1987; names as in R. Willson's
//! implementation. The model is
//!
//! ```text
//! (xc, yc, zc) = R (xw, yw, zw) + T          Xu = f xc/zc,  Yu = f yc/zc            mm on the sensor
//! Xu = Xd (1 + kappa1 r²)                    Yu = Yd (1 + kappa1 r²)                r² = Xd² + Yd²
//! Xf = sx Xd/dpx + Cx                        Yf = Yd/dpy + Cy                       pixels
//! ```
//!
//! It maps distorted to undistorted points, the other way round than Brown's: to first order `k1 = -kappa1 f²`.
//!
//! Stage 1 finds R, Tx and Ty (and sx if the points are not coplanar) from the direction of the image points alone
//! (`radial_alignment`); stage 2 finds f, Tz and kappa1 (`depth_stage`). [`calibrate`] can then minimise the
//! squared distances in pixels over everything the points determine, with the solver of the bundle adjustment.

mod depth_stage;
mod full;
mod lens;
mod pair;
mod radial_alignment;
#[cfg(test)]
mod tests;

pub use lens::brown_from_tsai;
pub use pair::calibrate_rig;

use nalgebra::{Matrix3, Rotation3, SVector, Vector2, Vector3};

use crate::camera::{Pose, distorted_radius};
use crate::error::{Error, Result};

/// What is known of the sensor before: pixel pitch, principal point, horizontal scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Effective width of a frame-buffer pixel, `dx·Ncx/Nfx`, mm.
    pub dpx_mm: f64,
    /// Effective height, `dy`, mm.
    pub dpy_mm: f64,
    /// Principal point, column, pixels.
    pub cx: f64,
    /// Principal point, row, pixels.
    pub cy: f64,
    /// Horizontal scale factor of frame grabbers; 1 for digital cameras.
    pub sx: f64,
}

/// A camera in Tsai's model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TsaiCamera {
    /// Effective focal length, mm.
    pub f_mm: f64,
    /// First radial distortion coefficient, 1/mm².
    pub kappa1: f64,
    /// Pixel pitch, principal point and horizontal scale.
    pub sensor: Sensor,
    /// Maps world points to the camera's frame; metres.
    pub camera_from_world: Pose,
}

impl TsaiCamera {
    /// Where a world point (millimetres) appears, pixels; `None` behind the camera or beyond the barrel limit.
    pub fn project(&self, world_mm: [f64; 3]) -> Option<[f64; 2]> {
        let p = self.camera_from_world.apply(Vector3::from(world_mm) * M_PER_MM);
        let undistorted = (p.z > 0.0).then(|| p.xy() * (self.f_mm / p.z))?;
        let radius = undistorted.norm();
        let shrink = if radius > 0.0 { distorted_radius(radius, self.kappa1)? / radius } else { 1.0 };
        let Sensor { dpx_mm, dpy_mm, cx, cy, sx } = self.sensor;
        Some([sx * undistorted.x * shrink / dpx_mm + cx, undistorted.y * shrink / dpy_mm + cy])
    }

    /// From Tx, Ty, Tz (mm) and Rx, Ry, Rz (radians) of `R = Rz·Ry·Rx`.
    pub fn with_pose(self, translation_mm: [f64; 3], [rx, ry, rz]: [f64; 3]) -> Self {
        let rotation = Rotation3::from_euler_angles(rx, ry, rz).into_inner();
        let translation_m = Vector3::from(translation_mm) * M_PER_MM;
        Self { camera_from_world: Pose { rotation, translation_m }, ..self }
    }

    /// Tx, Ty, Tz, mm.
    pub fn translation_mm(&self) -> [f64; 3] {
        (self.camera_from_world.translation_m / M_PER_MM).into()
    }

    /// Rx, Ry, Rz of `R = Rz·Ry·Rx`, radians.
    pub fn angles(&self) -> [f64; 3] {
        angles(&self.camera_from_world.rotation)
    }
}

/// Standard deviations of a full optimisation; zero for what was held fixed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "named and measured as in TsaiCamera; lengths in mm, angles in radians")]
pub struct TsaiSigma {
    pub f_mm: f64,
    pub kappa1: f64,
    pub cx: f64,
    pub cy: f64,
    pub sx: f64,
    pub translation_mm: [f64; 3],
    pub angles: [f64; 3],
}

/// The result of [`calibrate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TsaiCalibration {
    /// The camera.
    pub camera: TsaiCamera,
    /// Sum of squared distances between the points and their prediction, px².
    pub sse_px2: f64,
    /// Condition number of the column-scaled system of stage 1; a few for a good set of points.
    pub condition: f64,
    /// Whether the points were taken as coplanar: then sx cannot be estimated.
    pub coplanar: bool,
    /// By how much the angle between the image's axes differs from a right one, radians, as stage 1 sees it; NaN if
    /// unknown: of coplanar points. Tsai's model has none: beyond its noise it tells of wrong points.
    pub skew_rad: f64,
    /// Standard deviations; `None` after the two stages alone.
    pub sigma: Option<TsaiSigma>,
}

const M_PER_MM: f64 = 1e-3;

/// What errors call the computation.
const METHOD: &str = "Tsai calibration";

/// Points a full optimisation needs, as in Willson's.
const MIN_POINTS_FULL: usize = 11;

/// Calibrates one camera from points whose world position is known.
///
/// `world_mm` and `pixels` belong together entry by entry. With `full`, everything the points determine is refined
/// to the minimum of the squared pixel distances: f, kappa1, R, T, the principal point unless f would become
/// uncertain by more than 10 % with it, and sx unless coplanar. What was held has a standard deviation of zero.
///
/// # Errors
///
/// [`InvalidParameter`](Error::InvalidParameter) for numbers that are not finite or a sensor that cannot be,
/// [`NotEnoughData`](Error::NotEnoughData) below 5 (coplanar), 7 or 11 (full) points, and
/// [`Degenerate`](Error::Degenerate) with the reason where the points do not determine the camera: a plane parallel
/// to the image, points along a line, no depth, a left-handed world.
pub fn calibrate(
    world_mm: &[[f64; 3]],
    pixels: &[[f64; 2]],
    sensor: &Sensor,
    full: bool,
) -> Result<TsaiCalibration> {
    check(world_mm, pixels, sensor)?;
    let two_stage = two_stage(world_mm, pixels, sensor)?;
    let camera_and_sigma = if full {
        require_enough(world_mm)?;
        let (camera, sigma) = full::solve(world_mm, pixels, &two_stage)?;
        (camera, Some(sigma))
    } else {
        (two_stage.camera, None)
    };
    let (camera, sigma) = camera_and_sigma;
    let sse_px2 = sum_of_squares(&camera, world_mm, pixels).ok_or_else(sees_not_all)?;
    Ok(TsaiCalibration {
        camera,
        sse_px2,
        condition: two_stage.condition,
        coplanar: two_stage.coplanar,
        skew_rad: two_stage.skew_rad,
        sigma,
    })
}

/// The full optimisation alone, from a camera that is known about: within 20 % in every parameter is near enough.
///
/// # Errors
///
/// As [`calibrate`] with `full`; [`Degenerate`](Error::Degenerate) also where the start sees no image of a point.
pub fn refine(world_mm: &[[f64; 3]], pixels: &[[f64; 2]], start: &TsaiCamera) -> Result<TsaiCalibration> {
    check(world_mm, pixels, &start.sensor)?;
    if !(start.f_mm.is_finite() && start.f_mm > 0.0) {
        return Err(Error::invalid("f", format!("{} mm", start.f_mm), "must be positive and finite"));
    }
    require_enough(world_mm)?;
    // Its condition and the shape of the points are worth knowing, whatever the start.
    let radial = radial_alignment::solve(world_mm, pixels, &start.sensor)?;
    let start = TwoStage {
        camera: *start,
        condition: radial.condition,
        coplanar: radial.coplanar,
        skew_rad: radial.skew_rad,
    };
    let (camera, sigma) = full::solve(world_mm, pixels, &full::approached(world_mm, pixels, start)?)?;
    let sse_px2 = sum_of_squares(&camera, world_mm, pixels).ok_or_else(sees_not_all)?;
    Ok(TsaiCalibration {
        camera,
        sse_px2,
        condition: radial.condition,
        coplanar: radial.coplanar,
        skew_rad: radial.skew_rad,
        sigma: Some(sigma),
    })
}

fn require_enough(world_mm: &[[f64; 3]]) -> Result<()> {
    if world_mm.len() < MIN_POINTS_FULL {
        return Err(Error::NotEnoughData {
            what: "points for a full optimisation",
            actual: world_mm.len(),
            needed: MIN_POINTS_FULL,
        });
    }
    Ok(())
}

fn sees_not_all() -> Error {
    Error::degenerate(
        METHOD,
        "the camera found does not see all points: check kappa1 and the order of the points",
    )
}

/// The result of both closed-form stages.
struct TwoStage {
    camera: TsaiCamera,
    condition: f64,
    coplanar: bool,
    skew_rad: f64,
}

fn two_stage(world_mm: &[[f64; 3]], pixels: &[[f64; 2]], sensor: &Sensor) -> Result<TwoStage> {
    let radial = radial_alignment::solve(world_mm, pixels, sensor)?;
    let sensor = Sensor { sx: radial.sx, ..*sensor };
    let depth = depth_stage::solve(world_mm, pixels, &sensor, &radial)?;
    let local_mm = Vector3::new(radial.tx_mm, radial.ty_mm, depth.tz_mm);
    let (rotation, translation_mm) = radial.frame.world_pose(&depth.rotation, local_mm);
    let camera_from_world = Pose { rotation, translation_m: translation_mm * M_PER_MM };
    let camera = TsaiCamera { f_mm: depth.f_mm, kappa1: depth.kappa1, sensor, camera_from_world };
    Ok(TwoStage { camera, condition: radial.condition, coplanar: radial.coplanar, skew_rad: radial.skew_rad })
}

fn check(world_mm: &[[f64; 3]], pixels: &[[f64; 2]], sensor: &Sensor) -> Result<()> {
    let Sensor { dpx_mm, dpy_mm, cx, cy, sx } = *sensor;
    for (name, value) in [("dpx_mm", dpx_mm), ("dpy_mm", dpy_mm), ("sx", sx)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::invalid(name, value, "must be positive and finite"));
        }
    }
    for (name, value) in [("cx", cx), ("cy", cy)] {
        if !value.is_finite() {
            return Err(Error::invalid(name, format!("{value} px"), "must be finite"));
        }
    }
    if world_mm.len() != pixels.len() {
        let expected = format!("pixels has {}; the lists must have one length", pixels.len());
        return Err(Error::invalid("world_mm", format!("{} points", world_mm.len()), expected));
    }
    for (i, (world, pixel)) in world_mm.iter().zip(pixels).enumerate() {
        if !world.iter().all(|v| v.is_finite()) {
            return Err(Error::invalid("world_mm", format!("{world:?} at point {i}"), "must be finite"));
        }
        if !pixel.iter().all(|v| v.is_finite()) {
            return Err(Error::invalid("pixels", format!("{pixel:?} at point {i}"), "must be finite"));
        }
    }
    Ok(())
}

fn sum_of_squares(camera: &TsaiCamera, world_mm: &[[f64; 3]], pixels: &[[f64; 2]]) -> Option<f64> {
    world_mm.iter().zip(pixels).try_fold(0.0, |sum, (world, pixel)| {
        let [x, y] = camera.project(*world)?;
        Some(sum + (x - pixel[0]).powi(2) + (y - pixel[1]).powi(2))
    })
}

/// Rx, Ry, Rz of `R = Rz·Ry·Rx`, radians.
fn angles(rotation: &Matrix3<f64>) -> [f64; 3] {
    let rz = rotation.m21.atan2(rotation.m11);
    let (sine, cosine) = rz.sin_cos();
    [
        (rotation.m13 * sine - rotation.m23 * cosine).atan2(rotation.m22 * cosine - rotation.m12 * sine),
        (-rotation.m31).atan2(rotation.m11 * cosine + rotation.m21 * sine),
        rz,
    ]
}

/// Image points as lengths on the sensor from its principal point: (Xd, Yd), mm.
fn sensor_points<'a>(
    pixels: &'a [[f64; 2]],
    sensor: &Sensor,
) -> impl Iterator<Item = Vector2<f64>> + Clone + use<'a> {
    let Sensor { dpx_mm, dpy_mm, cx, cy, sx } = *sensor;
    pixels.iter().map(move |[x, y]| Vector2::new(dpx_mm * (x - cx) / sx, dpy_mm * (y - cy)))
}

/// Parameters of the model in the solver: f, kappa1, Cx, Cy, sx.
type Intrinsics = SVector<f64, 5>;
