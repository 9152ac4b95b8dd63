//! A plane in disparity, what pose of the camera it means, and how it is fitted.

use nalgebra::{Matrix3, Vector3};

use super::samples::Samples;
use super::sums::{Bend, Round, Sums};
use crate::rectification::RectifiedGeometry;
use crate::regions::CameraOverGround;

/// `p(u, v) = by_u·u + by_v·v + at_center`: disparity counted from infinity at a column and row counted from the
/// principal point, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DisparityPlane {
    pub by_u: f64,
    pub by_v: f64,
    pub at_center: f64,
}

impl DisparityPlane {
    /// The pose that sees this plane; of no meaning unless `by_v` is positive.
    pub fn pose(&self, geometry: &RectifiedGeometry) -> CameraOverGround {
        // (by_u, by_v, at_center / f) is the unit vector down times baseline / height.
        let n = Vector3::new(self.by_u, self.by_v, self.at_center / geometry.focal_px);
        let length = n.norm();
        CameraOverGround {
            height_m: geometry.baseline_m / length,
            pitch_rad: (n.z / length).asin(),
            roll_rad: n.x.atan2(n.y),
        }
    }

    /// The plane that a pose sees.
    pub fn of_pose(pose: &CameraOverGround, geometry: &RectifiedGeometry) -> Self {
        let per_m = geometry.baseline_m / pose.height_m;
        let (sin_pitch, cos_pitch) = pose.pitch_rad.sin_cos();
        let (sin_roll, cos_roll) = pose.roll_rad.sin_cos();
        Self {
            by_u: per_m * cos_pitch * sin_roll,
            by_v: per_m * cos_pitch * cos_roll,
            at_center: per_m * sin_pitch * geometry.focal_px,
        }
    }

    pub fn vector(&self) -> Vector3<f64> {
        Vector3::new(self.by_u, self.by_v, self.at_center)
    }

    pub fn from_vector(vector: Vector3<f64>) -> Self {
        Self { by_u: vector.x, by_v: vector.y, at_center: vector.z }
    }
}

/// A fitted plane and the covariance of its three numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FittedPlane {
    pub plane: DisparityPlane,
    pub covariance: Matrix3<f64>,
}

/// Robust least squares with Tukey's weights from a plane that is nearly right; `None` if the samples near it do not
/// determine one. `sigma_px` is the deviation of a disparity.
pub(super) fn refit(
    start: DisparityPlane,
    samples: &Samples,
    rounds: &[Round],
    sigma_px: f64,
) -> Option<FittedPlane> {
    let mut fitted = FittedPlane { plane: start, covariance: Matrix3::zeros() };
    for round in rounds {
        let plane = fitted.plane;
        let sums = Sums::over(&plane, Bend::NONE, samples, round.step, round.width_px(sigma_px), |_, _| {});
        let inverse = sums.weights.cholesky()?.inverse();
        fitted.plane = DisparityPlane::from_vector(plane.vector() + inverse * sums.off);
        fitted.covariance = sums.covariance(&inverse, sigma_px);
    }
    Some(fitted)
}
