//! A plane in disparity, what pose of the camera it means, and how it is fitted.

use nalgebra::{Matrix3, Vector3};

use super::samples::Sample;
use crate::rectification::RectifiedGeometry;
use crate::regions::CameraOverGround;

/// Samples of one plane share errors: so many count as one.
const ALIKE: f64 = 4.0;
/// Rounds of reweighting.
const ROUNDS: usize = 5;

/// `p(u, v) = by_u·u + by_v·v + at_center`: disparity counted from infinity at a column and row counted from the
/// principal point, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DisparityPlane {
    pub by_u: f64,
    pub by_v: f64,
    pub at_center: f64,
}

impl DisparityPlane {
    pub fn at(&self, sample: &Sample) -> f64 {
        self.by_u * f64::from(sample.u) + self.by_v * f64::from(sample.v) + self.at_center
    }

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
/// determine one.
///
/// `sigma_px` is the deviation of a disparity; what is four of them off has no weight.
pub(super) fn refit(start: DisparityPlane, samples: &[Sample], sigma_px: f64) -> Option<FittedPlane> {
    let tolerance_px = (4.0 * sigma_px).max(0.5);
    let mut plane = start;
    let mut covariance = Matrix3::zeros();
    for _ in 0..ROUNDS {
        let mut normal = Matrix3::zeros();
        let mut squared = Matrix3::zeros();
        let mut right_side = Vector3::zeros();
        for sample in samples {
            let share = (f64::from(sample.seen_px) - plane.at(sample)) / tolerance_px;
            let inside = 1.0 - share * share;
            if inside <= 0.0 {
                continue;
            }
            // The nearer, the more it counts: what the camera stands on is near, a ramp may begin ahead.
            let weight = inside * inside * f64::from(sample.seen_px);
            let row = Vector3::new(f64::from(sample.u), f64::from(sample.v), 1.0);
            let weighted = weight * row;
            normal += weighted * row.transpose();
            squared += weighted * weighted.transpose();
            right_side += weighted * f64::from(sample.seen_px);
        }
        let factor = normal.cholesky()?;
        plane = DisparityPlane::from_vector(factor.solve(&right_side));
        let inverse = factor.inverse();
        covariance = inverse * squared * inverse * (ALIKE * sigma_px * sigma_px);
    }
    Some(FittedPlane { plane, covariance })
}
