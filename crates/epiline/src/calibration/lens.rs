//! Camera models as the solver sees them: the pixel of a point, and how it moves with everything.

use std::marker::PhantomData;

use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};

use crate::camera::{CameraModel, LensFormula, LensImage};

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

/// A camera behind a lens of formula `F` with `N` coefficients: fx, fy, cx, cy and those, `K = N + 4` parameters in the
/// order of [`StereoCalibration::parameter_names`](crate::camera::StereoCalibration::parameter_names).
pub(super) struct PixelCamera<F, const N: usize>(PhantomData<F>);

impl<F: LensFormula<N>, const N: usize> PixelCamera<F, N> {
    pub const NEW: Self = Self(PhantomData);
}

/// The intrinsic parameters of a camera, `K` of them.
pub(super) fn pack<const K: usize>(camera: &CameraModel) -> SVector<f64, K> {
    let pinhole = camera.focal_px.into_iter().chain(camera.center_px);
    SVector::from_iterator(pinhole.chain(camera.lens.coefficients()))
}

/// The camera with other intrinsic parameters.
pub(super) fn unpack<const K: usize>(intrinsics: &SVector<f64, K>, of: &CameraModel) -> CameraModel {
    let values = intrinsics.as_slice();
    CameraModel {
        focal_px: [values[0], values[1]],
        center_px: [values[2], values[3]],
        lens: of.lens.with_coefficients(&values[4..]).expect("as many as the lens has"),
        ..*of
    }
}

impl<F: LensFormula<N>, const N: usize, const K: usize> Lens<K> for PixelCamera<F, N> {
    fn project(&self, intrinsics: &SVector<f64, K>, point_m: &Vector3<f64>) -> Option<Projected<K>> {
        const { assert!(K == N + 4) };
        let [fx, fy, cx, cy] = [0, 1, 2, 3].map(|i| intrinsics[i]);
        let lens = F::from_array(std::array::from_fn(|i| intrinsics[4 + i]));
        let LensImage { at, by_ray, by_coefficient } = lens.image(point_m)?;
        let mut by_intrinsics = SMatrix::<f64, 2, K>::zeros();
        by_intrinsics[(0, 0)] = at.x;
        by_intrinsics[(1, 1)] = at.y;
        by_intrinsics[(0, 2)] = 1.0;
        by_intrinsics[(1, 3)] = 1.0;
        for c in 0..N {
            by_intrinsics[(0, 4 + c)] = fx * by_coefficient[(0, c)];
            by_intrinsics[(1, 4 + c)] = fy * by_coefficient[(1, c)];
        }
        let mut by_point = by_ray;
        by_point.row_mut(0).scale_mut(fx);
        by_point.row_mut(1).scale_mut(fy);
        Some(Projected { pixel: Vector2::new(fx * at.x + cx, fy * at.y + cy), by_point, by_intrinsics })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::camera::{Brown, KannalaBrandt, Rational, ThinPrism};

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
    fn derivatives_match_central_differences() {
        let pinhole = [533.0, 536.0, 342.0, 235.0];
        let ray = Vector3::new(0.11, -0.08, 0.31);
        let brown = [-0.29, 0.11, 1.3e-3, -4e-4, 0.02];
        let (denominator, prism) = ([0.05, -0.03, 0.01], [1e-3, -5e-4, 2e-3, 3e-4]);
        let with = |coefficients: &[f64]| {
            pinhole.into_iter().chain(coefficients.iter().copied()).collect::<Vec<_>>()
        };
        let rational = [&brown[..], &denominator].concat();
        let thin_prism = [&rational[..], &prism].concat();
        check_derivatives(&PixelCamera::<Brown, 5>::NEW, SVector::<f64, 9>::from_vec(with(&brown)), ray);
        check_derivatives(
            &PixelCamera::<Rational, 8>::NEW,
            SVector::<f64, 12>::from_vec(with(&rational)),
            ray,
        );
        check_derivatives(
            &PixelCamera::<ThinPrism, 12>::NEW,
            SVector::<f64, 16>::from_vec(with(&thin_prism)),
            ray,
        );
        let fisheye = SVector::<f64, 8>::from_vec(with(&[0.03, -0.02, 0.01, -0.004]));
        check_derivatives(&PixelCamera::<KannalaBrandt, 4>::NEW, fisheye, ray);
        check_derivatives(&PixelCamera::<KannalaBrandt, 4>::NEW, fisheye, Vector3::new(0.3, 0.2, -0.05));
    }
}
