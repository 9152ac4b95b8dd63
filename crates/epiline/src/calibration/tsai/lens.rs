//! Tsai's lens in the solver, and the Brown–Conrady lens that does the same.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector3};

use super::{Intrinsics, Sensor, TsaiCamera};
use crate::calibration::lens::{Lens, Projected};
use crate::camera::{Brown, LensFormula, LensImage, Pose, Tsai, distorted_radius};

/// Tsai's model for the solver: f (mm), kappa1 (1/mm²), Cx, Cy (pixels), sx.
pub(super) struct TsaiLens {
    pub dpx_mm: f64,
    pub dpy_mm: f64,
}

impl TsaiLens {
    pub fn pack(camera: &TsaiCamera) -> Intrinsics {
        let Sensor { cx, cy, sx, .. } = camera.sensor;
        SVector::from([camera.f_mm, camera.kappa1, cx, cy, sx])
    }

    pub fn unpack(&self, intrinsics: &Intrinsics, camera_from_world: Pose) -> TsaiCamera {
        let [f_mm, kappa1, cx, cy, sx] = (*intrinsics).into();
        let sensor = Sensor { dpx_mm: self.dpx_mm, dpy_mm: self.dpy_mm, cx, cy, sx };
        TsaiCamera { f_mm, kappa1, sensor, camera_from_world }
    }
}

impl Lens<5> for TsaiLens {
    fn project(&self, intrinsics: &Intrinsics, point_m: &Vector3<f64>) -> Option<Projected<5>> {
        let [f_mm, kappa1, cx, cy, sx] = (*intrinsics).into();
        let lens = Tsai { kappa1: kappa1 * f_mm * f_mm };
        let LensImage { at, by_ray, by_coefficient } = lens.image(point_m)?;
        let to_pixels = Matrix2::from_diagonal(&Vector2::new(sx / self.dpx_mm, 1.0 / self.dpy_mm));
        let mut by_intrinsics = SMatrix::<f64, 2, 5>::zeros();
        by_intrinsics.set_column(0, &(to_pixels * (at + by_coefficient * (2.0 * lens.kappa1))));
        by_intrinsics.set_column(1, &(to_pixels * by_coefficient * f_mm.powi(3)));
        by_intrinsics[(0, 2)] = 1.0;
        by_intrinsics[(1, 3)] = 1.0;
        by_intrinsics[(0, 4)] = f_mm * at.x / self.dpx_mm;
        Some(Projected {
            pixel: to_pixels * at * f_mm + Vector2::new(cx, cy),
            by_point: to_pixels * by_ray * f_mm,
            by_intrinsics,
        })
    }
}

/// The radial coefficients k1, k2, k3 of Brown's model that do what `kappa1_f2 = kappa1 f²` does, out to a radius.
///
/// Tsai's distorted radius is the inverse of a cubic, so no polynomial equals it; this one is the least-squares fit
/// of `d/u - 1 = k1 u² + k2 u⁴ + k3 u⁶` over the undistorted radii u up to that of `largest_distorted`, all in
/// units of the focal length. `None` if that radius lies beyond the barrel limit.
pub fn brown_from_tsai(kappa1_f2: f64, largest_distorted: f64) -> Option<Brown> {
    const SAMPLES: usize = 64;
    if kappa1_f2 < 0.0 && largest_distorted >= (-1.0 / (3.0 * kappa1_f2)).sqrt() {
        return None;
    }
    let largest = largest_distorted * (1.0 + kappa1_f2 * largest_distorted * largest_distorted);
    let mut normal = SMatrix::<f64, 3, 3>::zeros();
    let mut right_side = Vector3::zeros();
    for i in 1..=SAMPLES {
        let u = i as f64 / SAMPLES as f64;
        let ratio = distorted_radius(u * largest, kappa1_f2)? / (u * largest);
        // Weighted by u: pixels are displaced by u times the ratio. Powers of the relative radius stay near one.
        let row = Vector3::new(u * u, u.powi(4), u.powi(6)) * u;
        normal += row * row.transpose();
        right_side += row * (u * (ratio - 1.0));
    }
    let k = normal.cholesky()?.solve(&right_side);
    let scale = 1.0 / (largest * largest);
    Some(Brown {
        k1: k.x * scale,
        k2: k.y * scale * scale,
        k3: k.z * scale * scale * scale,
        ..Brown::default()
    })
}
