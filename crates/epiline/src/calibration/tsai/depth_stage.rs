//! Stage 2: f, Tz and kappa1, and for coplanar points which way the plane tilts (Tsai 1987).

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::radial_alignment::RadialAlignment;
use super::{METHOD, Sensor, sensor_points};
use crate::error::{Error, Result};

/// What stage 2 finds.
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthStage {
    /// R in the local frame, the sign of its depth direction settled.
    pub rotation: Matrix3<f64>,
    pub f_mm: f64,
    pub tz_mm: f64,
    pub kappa1: f64,
}

/// The largest standard deviation of f, relative to it, that is an answer at all.
const MAX_SIGMA_OF_F: f64 = 0.2;

/// A point in the camera's frame but for Tz, and its image on the sensor, mm.
struct Sighting {
    /// xc, yc, zc - Tz.
    point: Vector3<f64>,
    image: Vector2<f64>,
}

pub(super) fn solve(
    world_mm: &[[f64; 3]],
    pixels: &[[f64; 2]],
    sensor: &Sensor,
    radial: &RadialAlignment,
) -> Result<DepthStage> {
    let sightings = |rotation: &Matrix3<f64>| -> Vec<Sighting> {
        let shift = Vector3::new(radial.tx_mm, radial.ty_mm, 0.0);
        let local = radial.frame.apply(world_mm);
        let sighting = |(p, image)| Sighting { point: rotation * p + shift, image };
        local.into_iter().zip(sensor_points(pixels, sensor)).map(sighting).collect()
    };
    let mut rotation = radial.rotation;
    let mut seen = sightings(&rotation);
    let mut start = linear(&seen);
    if radial.coplanar && start.is_none_or(|(f_mm, _)| f_mm <= 0.0) {
        rotation = mirrored(&rotation);
        seen = sightings(&rotation);
        start = linear(&seen);
    }
    let (f_mm, tz_mm) = start.ok_or_else(|| {
        Error::degenerate(
            METHOD,
            "all points are at one depth, which leaves f and Tz inseparable; tilt the board",
        )
    })?;
    let in_front = seen.iter().all(|s| s.point.z + tz_mm > 0.0);
    if f_mm <= 0.0 || !in_front {
        // A plane has no handedness: what is wrong with it can only be its tilt, or the order.
        let cause = if radial.coplanar {
            "the plane is too nearly parallel to the image, which leaves f and Tz inseparable, or"
        } else {
            "the world coordinates are left-handed (seen from the camera x right, y down, z away is right-handed), or"
        };
        let reason = format!(
            "f = {f_mm:.3} mm, Tz = {tz_mm:.1} mm puts points behind the camera: {cause} points and pixels are not \
             listed in the same order"
        );
        return Err(Error::degenerate(METHOD, reason));
    }
    let (f_mm, tz_mm, kappa1) = refine(&seen, f_mm, tz_mm);
    if !(f_mm > 0.0 && f_mm.is_finite() && tz_mm.is_finite() && kappa1.is_finite()) {
        return Err(Error::degenerate(
            METHOD,
            "the refinement of f, Tz and kappa1 diverged; tilt the board more",
        ));
    }
    let uncertain = relative_sigma_of_f(&seen, &Vector3::new(f_mm, tz_mm, kappa1));
    if uncertain > MAX_SIGMA_OF_F {
        let percent = 100.0 * uncertain;
        let reason = format!(
            "f = {f_mm:.3} mm is uncertain by {percent:.0} %: it can hardly be told from Tz; tilt the board by 30 degrees or \
             more"
        );
        return Err(Error::degenerate(METHOD, reason));
    }
    Ok(DepthStage { rotation, f_mm, tz_mm, kappa1 })
}

/// The other of the two tilts that stage 1 cannot tell apart: r3, r6, r7 and r8 with their signs changed.
fn mirrored(rotation: &Matrix3<f64>) -> Matrix3<f64> {
    rotation.component_mul(&Matrix3::new(1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0))
}

/// f and Tz without distortion: `yc f - Yd Tz = zc' Yd`, and the same in x. `None` if the columns are parallel.
fn linear(seen: &[Sighting]) -> Option<(f64, f64)> {
    let mut normal = Matrix2::zeros();
    let mut right_side = Vector2::zeros();
    for Sighting { point, image } in seen {
        for axis in 0..2 {
            let row = Vector2::new(point[axis], -image[axis]);
            normal += row * row.transpose();
            right_side += row * (point.z * image[axis]);
        }
    }
    // Correlation of the columns: exactly 1 for a plane parallel to the image.
    let correlation = normal.m12 * normal.m12 / (normal.m11 * normal.m22);
    if correlation.is_nan() || correlation > 1.0 - 1e-12 {
        return None;
    }
    let solution = normal.try_inverse()? * right_side;
    Some((solution.x, solution.y))
}

/// Levenberg–Marquardt on f, Tz and kappa1; residuals on the undistorted sensor plane, as in Willson's code.
fn refine(seen: &[Sighting], f_mm: f64, tz_mm: f64) -> (f64, f64, f64) {
    const MAX_ITERATIONS: usize = 200;
    let residuals = |p: &Vector3<f64>| -> f64 { seen.iter().map(|s| residual(s, p).norm_squared()).sum() };
    let mut best = Vector3::new(f_mm, tz_mm, 0.0);
    let mut cost = residuals(&best);
    let mut damping = 1e-6;
    for _ in 0..MAX_ITERATIONS {
        let (normal, gradient) = normal_equations(seen, &best);
        // Unit diagonal: f in mm, Tz in thousands of mm and kappa1 in 1e-4/mm² then weigh alike.
        let scale = normal.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
        let mut scaled = Matrix3::from_fn(|r, c| normal[(r, c)] * scale[r] * scale[c]);
        for i in 0..3 {
            scaled[(i, i)] += damping;
        }
        let Some(factor) = scaled.cholesky() else {
            damping *= 10.0;
            continue;
        };
        let step = factor.solve(&gradient.component_mul(&scale)).component_mul(&scale);
        let trial = best - step;
        let trial_cost = residuals(&trial);
        if trial_cost < cost {
            let done = cost - trial_cost <= 1e-14 * cost;
            (best, cost) = (trial, trial_cost);
            damping = (damping * 0.1).max(1e-15);
            if done {
                break;
            }
        } else {
            if damping > 1e12 {
                break;
            }
            damping *= 10.0;
        }
    }
    (best.x, best.y, best.z)
}

/// `JᵀJ` and `Jᵀe` of the residuals by f, Tz and kappa1.
fn normal_equations(seen: &[Sighting], at: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
    let mut normal = Matrix3::zeros();
    let mut gradient = Vector3::zeros();
    for s in seen {
        let error = residual(s, at);
        let depth = s.point.z + at.y;
        let r2 = s.image.norm_squared();
        for axis in 0..2 {
            let ideal = s.point[axis] / depth;
            let row = Vector3::new(ideal, -at.x * ideal / depth, -s.image[axis] * r2);
            normal += row * row.transpose();
            gradient += row * error[axis];
        }
    }
    (normal, gradient)
}

/// Standard deviation of f over f, R being right; infinite where f cannot be told from the others.
fn relative_sigma_of_f(seen: &[Sighting], at: &Vector3<f64>) -> f64 {
    let (normal, _) = normal_equations(seen, at);
    let freedom = (2 * seen.len()).saturating_sub(3).max(1) as f64;
    let variance = seen.iter().map(|s| residual(s, at).norm_squared()).sum::<f64>() / freedom;
    let scale = normal.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
    let scaled = Matrix3::from_fn(|r, c| normal[(r, c)] * scale[r] * scale[c]);
    let inverse = scaled.try_inverse().map_or(f64::INFINITY, |inverse| inverse.m11);
    (variance * inverse).sqrt() * scale.x / at.x
}

fn residual(s: &Sighting, p: &Vector3<f64>) -> Vector2<f64> {
    let [f_mm, tz_mm, kappa1] = (*p).into();
    s.point.xy() * (f_mm / (s.point.z + tz_mm)) - s.image * (1.0 + kappa1 * s.image.norm_squared())
}
