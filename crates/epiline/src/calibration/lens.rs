//! Camera models as the solver sees them: the pixel of a point, and how it moves with everything.

use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};

use crate::camera::{Brown, CameraModel, LensFormula, LensImage};

/// A projected point with its derivatives.
pub(super) struct Projected<const K: usize> {
    pub pixel: Vector2<f64>,
    /// By the point, pixels per metre.
    pub by_point: Matrix2x3<f64>,
    /// By the intrinsic parameters.
    pub by_intrinsics: SMatrix<f64, 2, K>,
}

/// A camera model with `K` intrinsic parameters that bundle adjustment can solve for.
pub(super) trait Lens<const K: usize> {
    /// Projects a point of the camera's frame; `None` where the model has no image of it.
    fn project(&self, intrinsics: &SVector<f64, K>, point_m: &Vector3<f64>) -> Option<Projected<K>>;
}

/// Pinhole with Brown–Conrady distortion: fx, fy, cx, cy, k1, k2, p1, p2, k3, the order of
/// [`StereoCalibration::parameter_names`](crate::camera::StereoCalibration::parameter_names).
pub(super) struct BrownConrady;

impl BrownConrady {
    pub const PARAMETERS: usize = 9;

    /// Of a camera without distortion.
    pub fn pack_pinhole(focal_px: [f64; 2], center_px: [f64; 2]) -> SVector<f64, 9> {
        let ([fx, fy], [cx, cy]) = (focal_px, center_px);
        SVector::from([fx, fy, cx, cy, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    pub fn unpack(intrinsics: &SVector<f64, 9>, (width, height): (usize, usize)) -> CameraModel {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = (*intrinsics).into();
        CameraModel {
            focal_px: [fx, fy],
            center_px: [cx, cy],
            lens: Brown { k1, k2, p1, p2, k3 }.into(),
            width,
            height,
        }
    }
}

impl Lens<9> for BrownConrady {
    fn project(&self, intrinsics: &SVector<f64, 9>, point_m: &Vector3<f64>) -> Option<Projected<9>> {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = (*intrinsics).into();
        let lens = Brown { k1, k2, p1, p2, k3 };
        let LensImage { at: distorted, by_ray, by_coefficient } = lens.image(point_m)?;
        let mut by_intrinsics = SMatrix::<f64, 2, 9>::zeros();
        by_intrinsics[(0, 0)] = distorted.x;
        by_intrinsics[(1, 1)] = distorted.y;
        by_intrinsics[(0, 2)] = 1.0;
        by_intrinsics[(1, 3)] = 1.0;
        for c in 0..5 {
            by_intrinsics[(0, 4 + c)] = fx * by_coefficient[(0, c)];
            by_intrinsics[(1, 4 + c)] = fy * by_coefficient[(1, c)];
        }
        let mut by_point = by_ray;
        by_point.row_mut(0).scale_mut(fx);
        by_point.row_mut(1).scale_mut(fy);
        Some(Projected {
            pixel: Vector2::new(fx * distorted.x + cx, fy * distorted.y + cy),
            by_point,
            by_intrinsics,
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Compares a lens's derivatives with central differences.
    pub fn check_derivatives<const K: usize>(
        lens: &impl Lens<K>,
        intrinsics: SVector<f64, K>,
        point: Vector3<f64>,
    ) {
        let at = lens.project(&intrinsics, &point).expect("in view");
        for column in 0..3 {
            let h = 1e-6;
            let mut step = Vector3::zeros();
            step[column] = h;
            let ahead = lens.project(&intrinsics, &(point + step)).expect("in view").pixel;
            let behind = lens.project(&intrinsics, &(point - step)).expect("in view").pixel;
            let numeric = (ahead - behind) / (2.0 * h);
            let analytic = at.by_point.column(column);
            assert!((analytic - numeric).norm() < 1e-6 * (1.0 + numeric.norm()), "point {column}");
        }
        for column in 0..K {
            let h = 1e-6 * intrinsics[column].abs().max(1e-3);
            let mut step = SVector::<f64, K>::zeros();
            step[column] = h;
            let ahead = lens.project(&(intrinsics + step), &point).expect("in view").pixel;
            let behind = lens.project(&(intrinsics - step), &point).expect("in view").pixel;
            let numeric = (ahead - behind) / (2.0 * h);
            let analytic = at.by_intrinsics.column(column);
            assert!((analytic - numeric).norm() < 1e-5 * (1.0 + numeric.norm()), "intrinsic {column}");
        }
    }

    #[test]
    fn brown_conrady_derivatives_match_central_differences() {
        let intrinsics = SVector::from([533.0, 536.0, 342.0, 235.0, -0.29, 0.11, 1.3e-3, -4e-4, 0.02]);
        check_derivatives(&BrownConrady, intrinsics, Vector3::new(0.11, -0.08, 0.31));
        assert!(
            BrownConrady.project(&intrinsics, &Vector3::new(0.1, 0.1, -0.3)).is_none(),
            "behind the camera"
        );
    }
}
