//! Full optimisation: the minimum of the squared pixel distances over everything the points determine.

use nalgebra::{Matrix3, Matrix6, Vector2, Vector3};

use super::lens::TsaiLens;
use super::{M_PER_MM, METHOD, TsaiCamera, TsaiSigma, TwoStage, angles, sum_of_squares};
use crate::calibration::solver::{Bundle, Estimate, Freedom, Huber, View};
use crate::camera::Pose;
use crate::error::{Error, Result};

/// The minimum itself: the flat valley between f and Tz makes small steps matter.
const TOLERANCE: f64 = 1e-14;

/// The largest standard deviation of f, relative to it, that is an answer.
///
/// A plane seen without much perspective hardly tells the principal point from the tilt, and f suffers: then the
/// sensor's principal point is better than the fitted one.
const MAX_FOCAL_SIGMA: f64 = 0.10;

/// Refines both stages' camera: bundle adjustment of one camera and one view, with its standard deviations.
pub(super) fn solve(
    world_mm: &[[f64; 3]],
    pixels: &[[f64; 2]],
    start: &TwoStage,
) -> Result<(TsaiCamera, TsaiSigma)> {
    let is_answer = |(camera, sigma): &(TsaiCamera, TsaiSigma)| sigma.f_mm <= MAX_FOCAL_SIGMA * camera.f_mm;
    let (best, center_held) = (free_of(true, start.coplanar), free_of(false, start.coplanar));
    if let Some(found) = minimise(world_mm, pixels, start, best).filter(is_answer) {
        return Ok(found);
    }
    let (camera, sigma) = minimise(world_mm, pixels, start, center_held).ok_or_else(|| {
        Error::degenerate(METHOD, "the full optimisation did not converge; use full=False or more points")
    })?;
    if !is_answer(&(camera, sigma)) {
        let reason = format!(
            "f = {:.3} ± {:.3} mm: the points leave f and Tz inseparable; tilt the plane by 30 degrees or more",
            camera.f_mm, sigma.f_mm
        );
        return Err(Error::degenerate(METHOD, reason));
    }
    Ok((camera, sigma))
}

/// f, kappa1, Cx, Cy, sx.
fn free_of(center: bool, coplanar: bool) -> [bool; 5] {
    [true, true, center, center, !coplanar]
}

/// A start brought near, from far: the pose first, then f with it, then kappa1.
pub(super) fn approached(world_mm: &[[f64; 3]], pixels: &[[f64; 2]], start: TwoStage) -> Result<TwoStage> {
    if sum_of_squares(&start.camera, world_mm, pixels).is_none() {
        let reason = "the start does not see all points: they are behind it or beyond its lens";
        return Err(Error::degenerate(METHOD, reason));
    }
    let mut near = start;
    for free in [[false; 5], [true, false, false, false, false], [true, true, false, false, false]] {
        if let Some((camera, _)) = minimise(world_mm, pixels, &near, free) {
            near.camera = camera;
        }
    }
    Ok(near)
}

/// `None` if there is no minimum, or no certainty about it.
fn minimise(
    world_mm: &[[f64; 3]],
    pixels: &[[f64; 2]],
    start: &TwoStage,
    free_camera: [bool; 5],
) -> Option<(TsaiCamera, TsaiSigma)> {
    let camera = &start.camera;
    let world_m: Vec<[f64; 3]> = world_mm.iter().map(|p| p.map(|v| v * M_PER_MM)).collect();
    let views = [View { board_m: &world_m, pixels: [pixels, &[]] }];
    let lens = TsaiLens { dpx_mm: camera.sensor.dpx_mm, dpy_mm: camera.sensor.dpy_mm };
    let free: Vec<bool> = free_camera.into_iter().chain([false; 5 + Freedom::POSE_AND_WARP]).collect();
    let freedom = Freedom::new(&free, &[]);
    let bundle = Bundle::new(&lens, &views, &freedom);
    let estimate = Estimate {
        intrinsics: [TsaiLens::pack(camera); 2],
        right_from_left: Pose::identity(),
        left_from_board: vec![camera.camera_from_world],
        board_warp_m: Vector2::zeros(),
    };
    let minimum = bundle.minimise(estimate, Huber::SQUARED, TOLERANCE);
    if !minimum.converged {
        return None;
    }
    let best = &minimum.estimate;
    let camera = lens.unpack(&best.intrinsics[0], best.left_from_board[0]);
    let (intrinsics, poses) = bundle.inverse_normals(best)?;
    let freedom = 2.0 * pixels.len() as f64 - bundle.parameter_count() as f64;
    let variance = sum_of_squares(&camera, world_mm, pixels)? / freedom.max(1.0);
    let sigma = |v: f64| (v.max(0.0) * variance).sqrt();
    let at = |i: usize| sigma(intrinsics[(i, i)]);
    let pose = &poses[0];
    let sigma = TsaiSigma {
        f_mm: at(0),
        kappa1: at(1),
        cx: at(2),
        cy: at(3),
        sx: at(4),
        translation_mm: std::array::from_fn(|i| sigma(pose[(3 + i, 3 + i)]) / M_PER_MM),
        angles: angle_variances(&camera.camera_from_world, pose).map(sigma),
    };
    Some((camera, sigma))
}

/// Variances of Rx, Ry, Rz from those of a left increment on the rotation vector, by central differences.
fn angle_variances(pose: &Pose, covariance: &Matrix6<f64>) -> [f64; 3] {
    const STEP: f64 = 1e-6;
    let rotation: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
    std::array::from_fn(|i| {
        let gradient: Vector3<f64> = Vector3::from_fn(|axis, _| {
            let at = |step: f64| angles(&pose.moved(Vector3::ith(axis, step), Vector3::zeros()).rotation)[i];
            (at(STEP) - at(-STEP)) / (2.0 * STEP)
        });
        gradient.dot(&(rotation * gradient))
    })
}
