//! From the covariance of a calibration to what users care about: single parameters, the baseline, depth.

use nalgebra::{DVector, Vector2, Vector3};

use super::calibration::{AlignedFrame, DepthVariance, StereoCalibration};
use super::model::CameraModel;

/// Parameters of a camera before its lens's coefficients.
const PINHOLE: usize = CameraModel::PINHOLE_PARAMETERS.len();

impl StereoCalibration {
    /// Standard deviation of the parameter of a name: pixels, 1, radians or metres; zero if held fixed, `None` if
    /// unknown or not one of [`parameter_names`](Self::parameter_names).
    pub fn sigma(&self, parameter: &str) -> Option<f64> {
        let index = self.parameter_names().iter().position(|name| name == parameter)?;
        Some(self.sigmas()?[index])
    }

    /// Standard deviations in the order of [`parameter_names`](Self::parameter_names); `None` if the covariance is
    /// unknown.
    pub fn sigmas(&self) -> Option<Vec<f64>> {
        let covariance = self.covariance.as_ref()?;
        Some(covariance.diagonal().iter().map(|variance| variance.max(0.0).sqrt()).collect())
    }

    /// First parameter of the right camera, first of the pose, and their number.
    pub(crate) fn layout(&self) -> [usize; 3] {
        let right = PINHOLE + self.left.lens.coefficient_names().len();
        let pose = right + PINHOLE + self.right.lens.coefficient_names().len();
        [right, pose, pose + Self::POSE_PARAMETERS.len()]
    }

    /// Standard deviation of the baseline's length, metres; NaN if unknown.
    pub fn baseline_sigma_m(&self) -> f64 {
        let direction = self.right_from_left.translation_m.normalize();
        let [_, pose, count] = self.layout();
        let mut by_parameter = DVector::zeros(count);
        by_parameter.fixed_rows_mut::<3>(pose + 3).copy_from(&direction);
        self.covariance_of(&by_parameter, &by_parameter).map_or(f64::NAN, |variance| variance.max(0.0).sqrt())
    }

    /// What the calibration's own uncertainty does to depth at the image centre; zero if the covariance is unknown.
    ///
    /// Two pixels triangulate to an inverse depth `w = (x_left - x_right)/baseline` in aligned normalised
    /// coordinates. To first order a change `δ` of the parameters moves it by `(pointing + w·scale)·δ`; the
    /// gradients are central differences of the whole chain from pixels to aligned rays, so that whatever a
    /// parameter does is in them. With `Z = 1/w`, `var(Z) = Z⁴ var(w)`.
    pub fn depth_variance(&self) -> DepthVariance {
        self.depth_gradients().and_then(|gradients| self.depth_variance_of(&gradients)).unwrap_or_default()
    }

    /// Standard deviation of depth at `depth_m` from the calibration alone, metres; NaN if the covariance is unknown.
    ///
    /// Matching adds `Z²·σ_d/(f·b)` of its own.
    pub fn range_sigma_m(&self, depth_m: f64) -> f64 {
        match self.covariance {
            Some(_) => self.depth_variance().at(depth_m).max(0.0).sqrt(),
            None => f64::NAN,
        }
    }

    fn depth_variance_of(&self, gradients: &DepthGradients) -> Option<DepthVariance> {
        let DepthGradients { pointing, scale } = gradients;
        Some(DepthVariance {
            z2: self.covariance_of(scale, scale)?,
            z3: 2.0 * self.covariance_of(scale, pointing)?,
            z4: self.covariance_of(pointing, pointing)?,
        })
    }

    /// `aᵀ C b`.
    fn covariance_of(&self, a: &DVector<f64>, b: &DVector<f64>) -> Option<f64> {
        Some(a.dot(&(self.covariance.as_ref()? * b)))
    }

    fn depth_gradients(&self) -> Option<DepthGradients> {
        let baseline_m = self.baseline_m();
        // Inverse depth is all but linear in the right pixel; its slope is read between infinity and ten baselines.
        let near = 0.1 / baseline_m;
        let far_pair = self.central_pair(0.0)?;
        let near_pair = self.central_pair(near)?;
        let [.., count] = self.layout();
        let (mut pointing, mut scale) = (DVector::zeros(count), DVector::zeros(count));
        for parameter in 0..count {
            let step = self.step_of(parameter);
            let (ahead, behind) = (self.perturbed(parameter, step), self.perturbed(parameter, -step));
            let slope = |pair: &PixelPair| {
                Some((ahead.inverse_depth(pair)? - behind.inverse_depth(pair)?) / (2.0 * step))
            };
            pointing[parameter] = slope(&far_pair)?;
            scale[parameter] = (slope(&near_pair)? - pointing[parameter]) / near;
        }
        Some(DepthGradients { pointing, scale })
    }

    /// The pixels at which a point at this inverse depth on the ray of the left image's centre is seen.
    fn central_pair(&self, inverse_depth: f64) -> Option<PixelPair> {
        let frame = AlignedFrame::of(&self.right_from_left).ok()?;
        let left = Vector2::new(0.5 * (self.left.width as f64 - 1.0), 0.5 * (self.left.height as f64 - 1.0));
        let aligned = frame.align_left(self.left.normalised_from_pixel(left)?);
        let aligned_right = aligned - Vector2::new(frame.baseline_m * inverse_depth, 0.0);
        let ray = frame.aligned_from_right.transpose() * aligned_right.push(1.0);
        Some(PixelPair { left, right: self.right.project(ray)? })
    }

    fn inverse_depth(&self, pair: &PixelPair) -> Option<f64> {
        let frame = AlignedFrame::of(&self.right_from_left).ok()?;
        let left = frame.align_left(self.left.normalised_from_pixel(pair.left)?);
        let right = frame.align_right(self.right.normalised_from_pixel(pair.right)?);
        Some((left.x - right.x) / frame.baseline_m)
    }

    /// The rig with one parameter moved, in the order and sense of [`parameter_names`](Self::parameter_names).
    pub(crate) fn perturbed(&self, parameter: usize, amount: f64) -> Self {
        let [right, pose, _] = self.layout();
        let mut moved = Self { covariance: None, views: Vec::new(), outliers: Vec::new(), ..*self };
        if parameter < right {
            perturb(&mut moved.left, parameter, amount);
        } else if parameter < pose {
            perturb(&mut moved.right, parameter - right, amount);
        } else {
            let mut increment = [Vector3::zeros(); 2];
            let axis = parameter - pose;
            increment[axis / 3][axis % 3] = amount;
            moved.right_from_left = self.right_from_left.moved(increment[0], increment[1]);
        }
        moved
    }

    /// Step of a central difference: pixels, coefficients, radians and metres.
    pub(crate) fn step_of(&self, parameter: usize) -> f64 {
        let [right, pose, _] = self.layout();
        let of_camera = if parameter < right { parameter } else { parameter - right };
        if parameter < pose && of_camera < PINHOLE { 1e-3 } else { 1e-6 }
    }
}

/// How inverse depth depends on the parameters: `pointing` at infinity, `scale` times itself.
struct DepthGradients {
    pointing: DVector<f64>,
    scale: DVector<f64>,
}

/// Where both cameras see one point, pixels.
struct PixelPair {
    left: Vector2<f64>,
    right: Vector2<f64>,
}

fn perturb(camera: &mut CameraModel, parameter: usize, amount: f64) {
    match parameter {
        0 | 1 => camera.focal_px[parameter] += amount,
        2 | 3 => camera.center_px[parameter - 2] += amount,
        _ => {
            let mut coefficients = camera.lens.coefficients();
            coefficients[parameter - PINHOLE] += amount;
            camera.lens = camera.lens.with_coefficients(&coefficients).expect("as many as there were");
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, Rotation3};

    use crate::camera::{Lens, Pose};

    use super::*;

    fn rig() -> StereoCalibration {
        let camera = CameraModel {
            focal_px: [500.0, 500.0],
            center_px: [319.5, 239.5],
            lens: Lens::default(),
            width: 640,
            height: 480,
        };
        let pose = Pose {
            rotation: Rotation3::identity().into_inner(),
            translation_m: Vector3::new(-0.1, 0.0, 0.0),
        };
        StereoCalibration::new(camera, camera, pose).expect("an ordinary rig")
    }

    fn only(parameter: &str, sigma: f64) -> StereoCalibration {
        let mut rig = rig();
        let names = rig.parameter_names();
        let index = names.iter().position(|name| name == parameter).expect("one of its parameters");
        let mut covariance = DMatrix::zeros(names.len(), names.len());
        covariance[(index, index)] = sigma * sigma;
        rig.covariance = Some(covariance);
        rig.validate().expect("as many as its parameters");
        rig
    }

    #[test]
    fn a_yaw_error_grows_with_the_square_of_depth() {
        // Z = f b / d, and a yaw of δ moves the right image by f δ at its centre: σ_Z = Z² δ / b.
        let rig = only("rotation_y", 1e-4);
        for depth_m in [1.0, 3.0, 10.0] {
            let expected = depth_m * depth_m * 1e-4 / 0.1;
            assert!((rig.range_sigma_m(depth_m) / expected - 1.0).abs() < 0.02, "at {depth_m} m");
        }
        assert_eq!(rig.sigma("rotation_y"), Some(1e-4));
        assert_eq!(rig.sigma("left_fx"), Some(0.0));
        assert_eq!(rig.sigma("left_k6"), None);
    }

    #[test]
    fn a_baseline_error_is_a_scale() {
        let rig = only("translation_x_m", 1e-4);
        for depth_m in [1.0, 3.0, 10.0] {
            assert!((rig.range_sigma_m(depth_m) / (depth_m * 1e-3) - 1.0).abs() < 1e-3, "at {depth_m} m");
        }
        assert!((rig.baseline_sigma_m() - 1e-4).abs() < 1e-12);
    }

    #[test]
    fn unknown_is_nan_and_not_zero() {
        let rig = rig();
        assert!(rig.range_sigma_m(3.0).is_nan() && rig.baseline_sigma_m().is_nan());
        assert_eq!(rig.sigma("left_fx"), None);
    }
}
