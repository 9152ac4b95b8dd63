//! A rig that no longer points as it was calibrated: which angle moved, by how much, and how sure that is.

use nalgebra::{Matrix4, Rotation3, Vector3, Vector4};

use super::alignment::PointMatch;
use super::geometry::RectifiedGeometry;
use crate::camera::{AlignedFrame, Parameter, Pose, StereoCalibration};
use crate::error::{Error, Result};

/// What can have moved, in the order of [`Drift::values`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DriftAxis {
    /// The right camera turned about the aligned x axis: all rows shift alike.
    Pitch,
    /// It turned about the aligned y axis: rows shift with `x·y`, weakly.
    Yaw,
    /// It turned about the optical axis: rows shift with `x`.
    Roll,
    /// The right focal length changed against the left: rows shift with `y`.
    Zoom,
}

impl DriftAxis {
    /// All of them, in order.
    pub const ALL: [Self; 4] = [Self::Pitch, Self::Yaw, Self::Roll, Self::Zoom];

    /// The name that users see.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pitch => "pitch",
            Self::Yaw => "yaw",
            Self::Roll => "roll",
            Self::Zoom => "zoom",
        }
    }
}

/// How the right camera has moved against the left since calibration, as far as rows tell.
///
/// `dy = y_right - y_left` of an aligned pair changes, to first order, by
/// `f·((1 + v²)·pitch - u·v·yaw - u·roll + v·zoom)` with `(u, v)` the right image point in units of the focal
/// length. A turn is one of the camera: right-handed about the axes of the aligned frame (x right, y down, z forward).
/// A yaw of the camera changes all disparities by `f·yaw` besides, which no pair shows that has no known distance in
/// it; only the bend of rows towards the corners gives it away. Its sigma says how well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Pitch, yaw and roll of the right camera, radians, and the relative change of its focal length.
    pub values: [f64; 4],
    /// Their standard deviations: noise of the matches and what a calibration leaves of its own. Infinite before
    /// anything was seen.
    pub sigma: [f64; 4],
    /// Pairs that spoke.
    pub frames: usize,
    /// Matches that spoke.
    pub matches: usize,
}

/// A value counts as drift beyond so many standard deviations.
const SIGNIFICANT: f64 = 4.0;

impl Drift {
    /// Before any pair was seen.
    pub const UNKNOWN: Self = Self { values: [0.0; 4], sigma: [f64::INFINITY; 4], frames: 0, matches: 0 };

    /// Whether this value is beyond doubt.
    pub fn is_significant(&self, axis: DriftAxis) -> bool {
        let i = axis as usize;
        self.values[i].abs() > SIGNIFICANT * self.sigma[i]
    }

    /// The angle or scale that moved most among those beyond doubt; `None` if the rig holds as far as can be seen.
    pub fn axis(&self) -> Option<DriftAxis> {
        let size = |axis: &DriftAxis| self.values[*axis as usize].abs();
        DriftAxis::ALL
            .into_iter()
            .filter(|&axis| self.is_significant(axis))
            .max_by(|a, b| size(a).total_cmp(&size(b)))
    }
}

/// Vertical error that a good calibration leaves in each of the four patterns at the image's edge, pixels. Below it nothing
/// is drift.
const CALIBRATION_FLOOR_PX: f64 = 0.05;
/// Pairs that the estimate remembers: older ones fade.
const MEMORY_FRAMES: f64 = 50.0;
/// Fewest matches with which a pair speaks.
const MIN_MATCHES: usize = 12;
/// No match's row is known better, pixels.
const LEAST_SIGMA_PX: f64 = 0.05;

/// Accumulates the vertical residuals of aligned pairs into a [`Drift`].
#[derive(Debug, Clone)]
pub struct DriftMeter {
    geometry: RectifiedGeometry,
    normal: Matrix4<f64>,
    right_side: Vector4<f64>,
    frames: usize,
    matches: usize,
    residuals: Vec<f64>,
}

impl DriftMeter {
    /// A meter for pairs of this geometry.
    pub fn new(geometry: &RectifiedGeometry) -> Self {
        Self {
            geometry: *geometry,
            normal: Matrix4::zeros(),
            right_side: Vector4::zeros(),
            frames: 0,
            matches: 0,
            residuals: Vec::new(),
        }
    }

    /// Forgets all pairs.
    pub fn reset(&mut self) {
        *self = Self::new(&self.geometry);
    }

    /// Takes in the matches of a pair and tells what is known now. A pair with fewer than twelve matches changes nothing.
    pub fn add(&mut self, matches: &[PointMatch]) -> Drift {
        if matches.len() >= MIN_MATCHES {
            let fade = 1.0 - 1.0 / MEMORY_FRAMES;
            self.normal *= fade;
            self.right_side *= fade;
            let (normal, right_side) = self.robust_normal_equations(matches);
            self.normal += normal;
            self.right_side += right_side;
            self.frames += 1;
            self.matches += matches.len();
        }
        self.drift()
    }

    /// What is known so far.
    pub fn drift(&self) -> Drift {
        let Some(covariance) = self.normal.try_inverse().filter(|_| self.frames > 0) else {
            return Drift::UNKNOWN;
        };
        let values = covariance * self.right_side;
        let floor = self.floor();
        let sigma = std::array::from_fn(|i| (covariance[(i, i)].max(0.0) + floor[i] * floor[i]).sqrt());
        Drift { values: values.into(), sigma, frames: self.frames, matches: self.matches }
    }

    /// The calibration floor in units of each value.
    fn floor(&self) -> [f64; 4] {
        let RectifiedGeometry { width, height, focal_px, .. } = self.geometry;
        let [u, v] = [width, height].map(|side| 0.5 * side as f64 / focal_px);
        [1.0, u * v, u, v].map(|reach| CALIBRATION_FLOOR_PX / (focal_px * reach))
    }

    /// Normal equations of one pair, weighted by Tukey's biweight about the pair's own best fit.
    fn robust_normal_equations(&mut self, matches: &[PointMatch]) -> (Matrix4<f64>, Vector4<f64>) {
        let mut fit = Vector4::zeros();
        // Starts from the middle of the residuals: a pitch beyond the cutoff must not hide all matches.
        self.residuals.clear();
        self.residuals.extend(matches.iter().map(PointMatch::vertical_px));
        let shift = super::alignment::median(&mut self.residuals);
        fit[0] = shift / self.geometry.focal_px;
        for _ in 0..6 {
            let (normal, right_side) = self.weighted(matches, &fit);
            if let Some(inverse) = normal.try_inverse() {
                fit = inverse * right_side;
            }
        }
        self.weighted(matches, &fit)
    }

    fn weighted(&mut self, matches: &[PointMatch], fit: &Vector4<f64>) -> (Matrix4<f64>, Vector4<f64>) {
        let geometry = self.geometry;
        self.residuals.clear();
        self.residuals.extend(matches.iter().map(|m| (m.vertical_px() - pattern(&geometry, m).dot(fit)).abs()));
        let sigma = (1.4826 * super::alignment::median(&mut self.residuals)).max(LEAST_SIGMA_PX);
        let mut normal = Matrix4::zeros();
        let mut right_side = Vector4::zeros();
        for found in matches {
            let row = pattern(&geometry, found);
            let dy = found.vertical_px();
            let t = (dy - row.dot(fit)) / (4.0 * sigma);
            if t.abs() < 1.0 {
                let w = (1.0 - t * t).powi(2) / (sigma * sigma);
                normal += row * row.transpose() * w;
                right_side += row * (dy * w);
            }
        }
        (normal, right_side)
    }
}

/// Change of `dy` at a match, pixels, by pitch, yaw, roll and zoom of the right camera.
fn pattern(geometry: &RectifiedGeometry, found: &PointMatch) -> Vector4<f64> {
    let RectifiedGeometry { focal_px, cx_px, cy_px, doffs_px, .. } = *geometry;
    let [x, y] = found.right_px;
    let (u, v) = ((x - cx_px - doffs_px) / focal_px, (y - cy_px) / focal_px);
    // A camera that turns by ω sees a ray turn by -ω: (u, v) moves by the image of -ω × (u, v, 1).
    Vector4::new(1.0 + v * v, -u * v, -u, v) * focal_px
}

/// The calibration with the right camera turned as the drift says, and the uncertainty of that added.
///
/// Angles that are not [significant](Drift::is_significant) stay as calibrated; their sigma is added all the same where it
/// is finite and below what the angle can have moved unseen. The right camera's centre stays where it is.
///
/// # Errors
///
/// [`Error::Degenerate`] if nothing was seen yet; those of [`AlignedFrame::of`].
pub fn realign(calibration: &StereoCalibration, drift: &Drift) -> Result<StereoCalibration> {
    if drift.frames == 0 {
        return Err(Error::degenerate("realign", "no pair with enough matches was seen yet"));
    }
    let frame = AlignedFrame::of(&calibration.right_from_left)?;
    let moved = DriftAxis::ALL.map(|axis| if drift.is_significant(axis) { drift.values[axis as usize] } else { 0.0 });
    let [pitch, yaw, roll, zoom] = moved;
    let turn = Rotation3::from_scaled_axis(Vector3::new(pitch, yaw, roll)).into_inner();
    let right_from_aligned = frame.aligned_from_right.transpose();
    // Rays of the turned camera are carried into the aligned frame by the turn, then by what was calibrated.
    let rotation = right_from_aligned * turn.transpose() * frame.aligned_from_left;
    let right_center = -(calibration.right_from_left.rotation.transpose() * calibration.right_from_left.translation_m);
    let mut corrected = calibration.clone();
    corrected.right_from_left = Pose { rotation, translation_m: -(rotation * right_center) };
    for focal_px in &mut corrected.right.focal_px {
        *focal_px *= 1.0 + zoom;
    }
    corrected.epipolar_error_px = f64::NAN;
    if let Some(covariance) = &mut corrected.covariance {
        let variance = nalgebra::Matrix3::from_diagonal(&Vector3::from_fn(|i, _| drift.sigma[i].powi(2)));
        let in_right = right_from_aligned * variance * right_from_aligned.transpose();
        let first = Parameter::RotationX as usize;
        let mut block = covariance.fixed_view_mut::<3, 3>(first, first);
        block += in_right;
        for (parameter, focal_px) in [Parameter::RightFx, Parameter::RightFy].into_iter().zip(corrected.right.focal_px) {
            covariance[(parameter as usize, parameter as usize)] += (focal_px * drift.sigma[3]).powi(2);
        }
    }
    corrected.validate()?;
    Ok(corrected)
}
