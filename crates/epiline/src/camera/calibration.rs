//! A calibrated pair of cameras, and the frame in which their epipolar lines lie on scan-lines.

use nalgebra::{DMatrix, Matrix3, Rotation3, Unit, Vector2, Vector3};

use super::model::CameraModel;
use crate::error::{Error, Result};

/// A rigid motion: `point_to = rotation * point_from + translation_m`.
///
/// Variables are named `to_from_from`: `right_from_left` maps points of the left camera's frame to the right's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation matrix.
    pub rotation: Matrix3<f64>,
    /// Translation, metres.
    pub translation_m: Vector3<f64>,
}

impl Pose {
    /// The motion that moves nothing.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation_m: Vector3::zeros() }
    }

    /// The angle of the rotation, radians, 0 to π.
    pub fn angle_rad(&self) -> f64 {
        Rotation3::from_matrix_unchecked(self.rotation).angle()
    }

    /// Moves a point.
    pub fn apply(&self, point_m: Vector3<f64>) -> Vector3<f64> {
        self.rotation * point_m + self.translation_m
    }

    /// The motion back.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation_m: -(rotation * self.translation_m) }
    }

    /// The pose after a left increment: `exp([rotation]ₓ) R` and `T + translation_m`.
    pub fn moved(&self, rotation: Vector3<f64>, translation_m: Vector3<f64>) -> Self {
        let mut turned =
            Rotation3::from_scaled_axis(rotation) * Rotation3::from_matrix_unchecked(self.rotation);
        // Rounding of many small products must not add up to a matrix that is no rotation.
        turned.renormalize();
        Self { rotation: turned.into_inner(), translation_m: self.translation_m + translation_m }
    }

    /// First `first`, then `self`.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            translation_m: self.rotation * first.translation_m + self.translation_m,
        }
    }
}

/// What a calibration's own uncertainty does to depth: `var(Z) = z2·Z² + z3·Z³ + z4·Z⁴`, metres².
///
/// `z2` comes from scale (focal length, baseline), `z4` from the pointing of one camera against the other, `z3`
/// from their covariance. Zero everywhere if the uncertainty is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DepthVariance {
    /// Coefficient of Z².
    pub z2: f64,
    /// Coefficient of Z³.
    pub z3: f64,
    /// Coefficient of Z⁴.
    pub z4: f64,
}

impl DepthVariance {
    /// Variance of a depth, metres².
    pub fn at(&self, depth_m: f64) -> f64 {
        depth_m * depth_m * (self.z2 + depth_m * (self.z3 + depth_m * self.z4))
    }
}

/// How well one pair of photographs agrees with the calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewResidual {
    /// Root mean square distance of the left corners from their prediction, pixels; NaN if the left camera saw none.
    pub left_rms_px: f64,
    /// The same for the right corners.
    pub right_rms_px: f64,
    /// Pose of the board: `left_from_board`.
    pub left_from_board: Pose,
}

/// A corner that a calibration left out because it was mis-found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// Which view, counting from 0.
    pub view: usize,
    /// Whose photograph: `left` or `right`.
    pub side: &'static str,
    /// Which of the view's corners, counting from 0.
    pub corner: usize,
    /// Its distance from its prediction, pixels.
    pub residual_px: f64,
    /// What is usual there: standard deviation of one coordinate in this photograph or in all, whichever is larger.
    pub sigma_px: f64,
}

impl Outlier {
    /// Which corner of which photograph.
    pub fn place(&self) -> (usize, &'static str, usize) {
        (self.view, self.side, self.corner)
    }

    /// Why it was left out.
    pub fn reason(&self) -> String {
        let Self { residual_px, sigma_px, .. } = self;
        let times = residual_px / sigma_px;
        format!(
            "{residual_px:.2} px off its prediction, {times:.1} times the {sigma_px:.3} px that are usual there"
        )
    }
}

/// How far the middle of a board stands out of the plane of its corners: two parabolas, one along each side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardWarp {
    /// Along the board's x and y axis, metres; positive along the board's z axis, away from the cameras.
    pub height_m: [f64; 2],
    /// Their standard deviations, metres.
    pub sigma_m: [f64; 2],
}

/// Two cameras, the pose between them, and how far to trust both.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoCalibration {
    /// Left camera: the reference.
    pub left: CameraModel,
    /// Right camera.
    pub right: CameraModel,
    /// Maps points of the left camera's frame to the right camera's.
    pub right_from_left: Pose,
    /// Root mean square reprojection error over all corners of both cameras, pixels. NaN if unknown.
    pub rms_px: f64,
    /// Mean vertical disparity, after rectification, of corners in views the fit did not see, pixels. NaN if unknown.
    pub epipolar_error_px: f64,
    /// Covariance of the parameters in the order of [`parameter_names`](Self::parameter_names); a parameter held fixed
    /// has zeros. `None` if unknown.
    pub covariance: Option<DMatrix<f64>>,
    /// One entry per view used; empty if unknown.
    pub views: Vec<ViewResidual>,
    /// Corners that were left out.
    pub outliers: Vec<Outlier>,
    /// The board's bend, if it was solved for.
    pub board_warp: Option<BoardWarp>,
}

impl StereoCalibration {
    /// A rig whose uncertainty is unknown, as read from another system's file.
    pub fn new(left: CameraModel, right: CameraModel, right_from_left: Pose) -> Result<Self> {
        let calibration = Self {
            left,
            right,
            right_from_left,
            rms_px: f64::NAN,
            epipolar_error_px: f64::NAN,
            covariance: None,
            views: Vec::new(),
            outliers: Vec::new(),
            board_warp: None,
        };
        calibration.validate()?;
        Ok(calibration)
    }

    /// Names of the six parameters of the pose between the cameras: radians and metres.
    ///
    /// Rotation is a left increment on the rotation vector: `R(δ) = exp([δ]ₓ) R`.
    pub const POSE_PARAMETERS: [&'static str; 6] =
        ["rotation_x", "rotation_y", "rotation_z", "translation_x_m", "translation_y_m", "translation_z_m"];

    /// Names of all parameters in the order of the covariance: of the left camera `left_fx`, `left_fy`, `left_cx`,
    /// `left_cy` and its lens's coefficients, the same of the right camera, then
    /// [`POSE_PARAMETERS`](Self::POSE_PARAMETERS).
    pub fn parameter_names(&self) -> Vec<String> {
        let camera = |side: &'static str, camera: &CameraModel| {
            let names = CameraModel::PINHOLE_PARAMETERS.iter().chain(camera.lens.coefficient_names());
            names.map(move |name| format!("{side}_{name}")).collect::<Vec<_>>()
        };
        let mut names = camera("left", &self.left);
        names.extend(camera("right", &self.right));
        names.extend(Self::POSE_PARAMETERS.map(String::from));
        names
    }

    /// Distance between the two centres of projection, metres.
    pub fn baseline_m(&self) -> f64 {
        self.right_from_left.translation_m.norm()
    }

    /// Fails, naming the entry, unless the rig is one that could exist with the left camera on the left.
    pub fn validate(&self) -> Result<()> {
        self.left.validate()?;
        self.right.validate()?;
        let Pose { rotation, translation_m } = &self.right_from_left;
        if !rotation.iter().all(|v| v.is_finite()) {
            return Err(Error::invalid("rotation", "NaN or infinite", "every entry must be finite"));
        }
        let residual = (rotation.transpose() * rotation - Matrix3::identity()).abs().max();
        if residual > 1e-4 || rotation.determinant() < 0.0 {
            return Err(Error::invalid(
                "rotation",
                format!("off orthonormal by {residual:.2e}"),
                "must be a rotation matrix",
            ));
        }
        if !translation_m.iter().all(|v| v.is_finite()) {
            return Err(Error::invalid("translation_m", "NaN or infinite", "every entry must be finite"));
        }
        if translation_m.norm() < 1e-6 {
            let value = format!("{} m", translation_m.norm());
            return Err(Error::invalid("baseline_m", value, "the two cameras must be apart"));
        }
        let parameters = self.parameter_names().len();
        match &self.covariance {
            Some(covariance) if covariance.shape() != (parameters, parameters) => {
                let value = format!("{}x{}", covariance.nrows(), covariance.ncols());
                let expected = format!("the two lenses and the pose have {parameters} parameters");
                Err(Error::invalid("covariance", value, expected))
            }
            _ => Ok(()),
        }
    }
}

/// The common frame of an aligned pair: both views turned so that their epipolar lines are scan-lines.
///
/// The change of direction is shared: each camera turns by half of the rotation between them, then both turn
/// together until the x axis runs along the baseline (Bouguet's construction, described in the OpenCV
/// documentation of `stereoRectify` and in Fusiello, Trucco & Verri, 2000).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlignedFrame {
    /// Rotates left-camera directions into the aligned frame.
    pub aligned_from_left: Matrix3<f64>,
    /// Rotates right-camera directions into the aligned frame.
    pub aligned_from_right: Matrix3<f64>,
    /// Distance between the centres along the aligned x axis, metres; positive.
    pub baseline_m: f64,
}

impl AlignedFrame {
    /// The aligned frame of a rig.
    ///
    /// # Errors
    ///
    /// [`Error::Degenerate`] if the right camera sits left of the left one (swapped cameras, or both upside down), or
    /// the baseline runs along the viewing direction: no rotation of the views puts their epipolar lines on scan-lines
    /// then without turning the pictures over. A rig one above the other is rolled by up to a right angle.
    pub fn of(right_from_left: &Pose) -> Result<Self> {
        let full_turn = Rotation3::from_matrix_unchecked(right_from_left.rotation);
        let half_turn = Rotation3::from_scaled_axis(full_turn.scaled_axis() * 0.5);
        // In the half-way frame the right camera's centre lies at -R½ᵀ T.
        let right_center = -(half_turn.inverse() * right_from_left.translation_m);
        let baseline_m = right_center.norm();
        let [x, y, z] = right_center.into();
        if right_center.xy().norm() < 0.5 * baseline_m {
            return Err(Error::degenerate(
                "rectification",
                format!(
                    "the baseline ({x:.4}, {y:.4}, {z:.4}) m runs along the viewing direction: more than 60 degrees off \
                     the image plane"
                ),
            ));
        }
        // Just past vertical is still a rolled rig; well past it, to level the baseline would turn the pictures over.
        if x < -0.2 * baseline_m {
            return Err(Error::degenerate(
                "rectification",
                format!(
                    "the right camera is {:.4} m to the left of the left camera; the two are swapped, or mounted \
                     upside down: then turn both pictures first",
                    -x
                ),
            ));
        }
        let direction = Unit::new_normalize(right_center);
        // The smallest rotation that carries the baseline onto the x axis.
        let level =
            Rotation3::rotation_between(&direction, &Vector3::x_axis()).unwrap_or_else(Rotation3::identity);
        Ok(Self {
            aligned_from_left: (level * half_turn).into_inner(),
            aligned_from_right: (level * half_turn.inverse()).into_inner(),
            baseline_m,
        })
    }

    /// Focal length shared by both aligned views, pixels: the mean of the vertical ones, so that rows keep their scale.
    pub fn common_focal_px(left: &CameraModel, right: &CameraModel) -> f64 {
        0.5 * (left.focal_px[1] + right.focal_px[1])
    }

    /// Where a left-camera direction (normalised image point) falls in the aligned frame, normalised.
    pub fn align_left(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        turn(&self.aligned_from_left, ideal)
    }

    /// Where a right-camera direction (normalised image point) falls in the aligned frame, normalised.
    pub fn align_right(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        turn(&self.aligned_from_right, ideal)
    }
}

fn turn(rotation: &Matrix3<f64>, ideal: Vector2<f64>) -> Vector2<f64> {
    let ray = rotation * ideal.push(1.0);
    ray.xy() / ray.z
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(angles: [f64; 3], translation_m: [f64; 3]) -> Pose {
        Pose {
            rotation: Rotation3::from_scaled_axis(Vector3::from(angles)).into_inner(),
            translation_m: Vector3::from(translation_m),
        }
    }

    #[test]
    fn aligned_rows_agree_and_disparity_is_positive() {
        let right_from_left = pose([0.02, -0.03, 0.015], [-0.12, 0.004, -0.006]);
        let frame = AlignedFrame::of(&right_from_left).expect("an ordinary rig");
        for point in [[0.3, -0.2, 1.4], [-0.5, 0.4, 3.0], [0.0, 0.0, 0.8]] {
            let in_left = Vector3::from(point);
            let in_right = right_from_left.apply(in_left);
            let left = frame.align_left(in_left.xy() / in_left.z);
            let right = frame.align_right(in_right.xy() / in_right.z);
            assert!((left.y - right.y).abs() < 1e-12, "rows differ: {left:?} {right:?}");
            let depth_m = (frame.aligned_from_left * in_left).z;
            assert!(((left.x - right.x) - frame.baseline_m / depth_m).abs() < 1e-12);
        }
    }

    #[test]
    fn swapped_cameras_are_refused() {
        let error = AlignedFrame::of(&pose([0.0; 3], [0.12, 0.0, 0.0])).expect_err("swapped");
        assert!(error.to_string().contains("swapped"), "{error}");
    }

    #[test]
    fn poses_compose_and_invert() {
        let a = pose([0.1, 0.2, -0.3], [1.0, 2.0, 3.0]);
        let b = pose([-0.2, 0.05, 0.4], [-0.4, 0.1, 0.7]);
        let p = Vector3::new(0.3, -0.7, 2.0);
        assert!((a.after(&b).apply(p) - a.apply(b.apply(p))).norm() < 1e-12);
        assert!((a.inverse().apply(a.apply(p)) - p).norm() < 1e-12);
    }
}
