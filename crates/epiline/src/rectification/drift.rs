//! A rig that no longer points as it was calibrated: which angle moved, by how much, and how sure that is.

use nalgebra::{Matrix3, Matrix4, Matrix4xX, Rotation3, Vector2, Vector3, Vector4};

use super::alignment::PointMatch;
use super::geometry::RectifiedGeometry;
use crate::camera::{AlignedFrame, CameraView, Pose, StereoCalibration};
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
    /// Their standard deviations: noise of the matches, and what the calibration leaves uncertain of its own or, with a
    /// reference, the reference's noise. Infinite before anything was seen.
    pub sigma: [f64; 4],
    /// The part of `sigma` that the matches' noise makes.
    pub noise: [f64; 4],
    /// Pairs that spoke.
    pub frames: usize,
    /// Matches that spoke.
    pub matches: usize,
}

/// A value counts as drift beyond so many standard deviations.
const SIGNIFICANT: f64 = 3.5;

impl Drift {
    /// Before any pair was seen.
    pub const UNKNOWN: Self = Self {
        values: [0.0; 4],
        sigma: [f64::INFINITY; 4],
        noise: [f64::INFINITY; 4],
        frames: 0,
        matches: 0,
    };

    /// Whether this value is beyond doubt.
    pub fn is_significant(&self, axis: DriftAxis) -> bool {
        let i = axis as usize;
        self.values[i].abs() > SIGNIFICANT * self.sigma[i]
    }

    /// The angle or scale that moved most surely, if beyond doubt; `None` if the rig holds as far as can be seen.
    pub fn axis(&self) -> Option<DriftAxis> {
        let size = |axis: &DriftAxis| self.values[*axis as usize].abs() / self.sigma[*axis as usize];
        DriftAxis::ALL
            .into_iter()
            .filter(|&axis| self.is_significant(axis))
            .max_by(|a, b| size(a).total_cmp(&size(b)))
    }
}

/// Vertical error that a rig of unknown uncertainty is granted for pitch, yaw, roll and zoom, at half the image's width
/// and height, pixels: about what published rectified sequences show.
const GRANTED_PX: [f64; 4] = [0.08, 0.2, 0.15, 0.15];
/// What no model of cameras explains, there, pixels: added to a calibration's own uncertainty, and to a reference's.
const MODEL_ERROR_PX: f64 = 0.03;
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
    /// Variance of the values that the calibration is answerable for.
    granted: [f64; 4],
    reference: Option<Drift>,
    normal: Matrix4<f64>,
    right_side: Vector4<f64>,
    frames: usize,
    matches: usize,
    residuals: Vec<f64>,
}

impl DriftMeter {
    /// A meter for pairs of this geometry, whose calibration's uncertainty is unknown.
    pub fn new(geometry: &RectifiedGeometry) -> Self {
        Self {
            geometry: *geometry,
            granted: at_edge(geometry, GRANTED_PX).map(|sigma| sigma * sigma),
            reference: None,
            normal: Matrix4::zeros(),
            right_side: Vector4::zeros(),
            frames: 0,
            matches: 0,
            residuals: Vec::new(),
        }
    }

    /// A meter for pairs that a calibration aligned: what the calibration leaves uncertain, by its covariance, is not
    /// taken for drift.
    ///
    /// # Errors
    ///
    /// Those of [`AlignedFrame::of`].
    pub fn for_calibration(geometry: &RectifiedGeometry, calibration: &StereoCalibration) -> Result<Self> {
        let mut meter = Self::new(geometry);
        if let Some(own) = variance_of_calibration(geometry, calibration)? {
            let model = at_edge(geometry, [MODEL_ERROR_PX; 4]);
            meter.granted = std::array::from_fn(|i| own[i] + model[i] * model[i]);
        }
        Ok(meter)
    }

    /// Drift counts from `reference` on, measured when the rig was known to hold: what the calibration leaves uncertain
    /// of its own then cancels. All pairs so far are forgotten.
    pub fn set_reference(&mut self, reference: Drift) {
        let (geometry, granted) = (self.geometry, self.granted);
        *self = Self { granted, reference: Some(reference), ..Self::new(&geometry) };
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
        let mut values: [f64; 4] = (covariance * self.right_side).into();
        let noise: [f64; 4] = std::array::from_fn(|i| covariance[(i, i)].max(0.0).sqrt());
        let mut granted = self.granted;
        if let Some(reference) = &self.reference {
            let model = at_edge(&self.geometry, [MODEL_ERROR_PX; 4]);
            for i in 0..4 {
                values[i] -= reference.values[i];
                granted[i] = reference.noise[i].powi(2) + model[i].powi(2);
            }
        }
        let sigma = std::array::from_fn(|i| (noise[i] * noise[i] + granted[i]).sqrt());
        Drift { values, sigma, noise, frames: self.frames, matches: self.matches }
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
        self.residuals
            .extend(matches.iter().map(|m| (m.vertical_px() - pattern(&geometry, m).dot(fit)).abs()));
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

/// Values whose vertical error at half the image's width and height is so many pixels.
fn at_edge(geometry: &RectifiedGeometry, error_px: [f64; 4]) -> [f64; 4] {
    let RectifiedGeometry { width, height, focal_px, .. } = *geometry;
    let [u, v] = [width, height].map(|side| 0.5 * side as f64 / focal_px);
    let reach = [1.0, u * v, u, v];
    std::array::from_fn(|i| error_px[i] / (focal_px * reach[i]))
}

/// Variance of pitch, yaw, roll and zoom that a calibration's covariance implies: each parameter's effect on the rows of
/// far points all over the view, projected on the four patterns. `None` without a covariance.
fn variance_of_calibration(
    geometry: &RectifiedGeometry,
    calibration: &StereoCalibration,
) -> Result<Option<[f64; 4]>> {
    const GRID: usize = 7;
    let Some(covariance) = &calibration.covariance else { return Ok(None) };
    let frame = AlignedFrame::of(&calibration.right_from_left)?;
    let mut normal = Matrix4::zeros();
    let parameters = covariance.nrows();
    let mut by_parameter = Matrix4xX::zeros(parameters);
    let fraction = |k: usize| (k as f64 + 0.5) / GRID as f64;
    let all_moved = |sign: f64| -> Result<Vec<MovedRig>> {
        (0..parameters)
            .map(|p| MovedRig::new(&calibration.perturbed(p, sign * calibration.step_of(p))))
            .collect()
    };
    let (below, above) = (all_moved(-1.0)?, all_moved(1.0)?);
    for i in 0..GRID * GRID {
        let [x, y] =
            [fraction(i % GRID) * geometry.width as f64, fraction(i / GRID) * geometry.height as f64];
        let far = Vector3::new(
            (x - geometry.cx_px) / geometry.focal_px,
            (y - geometry.cy_px) / geometry.focal_px,
            1.0,
        );
        let pixel = |camera: &CameraView, turn: &Matrix3<f64>| camera.project(&(turn.transpose() * far));
        let (Some(left), Some(right)) = (
            pixel(&calibration.left.view(), &frame.aligned_from_left),
            pixel(&calibration.right.view(), &frame.aligned_from_right),
        ) else {
            continue;
        };
        let row = pattern(geometry, &PointMatch { left_px: [x, y], right_px: [x, y] });
        normal += row * row.transpose();
        for parameter in 0..parameters {
            let vertical = |rig: &MovedRig| Some(geometry.focal_px * rig.row_difference(left, right)?);
            let (Some(a), Some(b)) = (vertical(&below[parameter]), vertical(&above[parameter])) else {
                continue;
            };
            let slope = (b - a) / (2.0 * calibration.step_of(parameter));
            for k in 0..4 {
                by_parameter[(k, parameter)] += row[k] * slope;
            }
        }
    }
    let Some(inverse) = normal.try_inverse() else { return Ok(None) };
    let effect = inverse * by_parameter;
    let variance = &effect * covariance * effect.transpose();
    Ok(Some(std::array::from_fn(|i| variance[(i, i)].max(0.0))))
}

/// A rig with one parameter moved, and its aligned frame.
struct MovedRig {
    left: CameraView,
    right: CameraView,
    frame: AlignedFrame,
}

impl MovedRig {
    fn new(rig: &StereoCalibration) -> Result<Self> {
        Ok(Self {
            left: rig.left.view(),
            right: rig.right.view(),
            frame: AlignedFrame::of(&rig.right_from_left)?,
        })
    }

    /// `y_right - y_left` of two pixels, aligned and normalised by the focal length.
    fn row_difference(&self, left: Vector2<f64>, right: Vector2<f64>) -> Option<f64> {
        let left = self.frame.align_left(self.left.normalised_from_pixel(left)?);
        let right = self.frame.align_right(self.right.normalised_from_pixel(right)?);
        Some(right.y - left.y)
    }
}

/// The calibration with the right camera turned as the drift says, and the uncertainty of that added.
///
/// Values that are not [significant](Drift::is_significant) stay as calibrated; the noise of all is added to the
/// covariance. The right camera's centre stays where it is.
///
/// # Errors
///
/// [`Error::Degenerate`] if nothing was seen yet; those of [`AlignedFrame::of`].
pub fn realign(calibration: &StereoCalibration, drift: &Drift) -> Result<StereoCalibration> {
    if drift.frames == 0 {
        return Err(Error::degenerate("realign", "no pair with enough matches was seen yet"));
    }
    let frame = AlignedFrame::of(&calibration.right_from_left)?;
    let moved =
        DriftAxis::ALL.map(|axis| if drift.is_significant(axis) { drift.values[axis as usize] } else { 0.0 });
    let [pitch, yaw, roll, zoom] = moved;
    let turn = Rotation3::from_scaled_axis(Vector3::new(pitch, yaw, roll)).into_inner();
    let right_from_aligned = frame.aligned_from_right.transpose();
    // Rays of the turned camera are carried into the aligned frame by the turn, then by what was calibrated.
    let rotation = right_from_aligned * turn.transpose() * frame.aligned_from_left;
    let right_center =
        -(calibration.right_from_left.rotation.transpose() * calibration.right_from_left.translation_m);
    let mut corrected = calibration.clone();
    corrected.right_from_left = Pose { rotation, translation_m: -(rotation * right_center) };
    for focal_px in &mut corrected.right.focal_px {
        *focal_px *= 1.0 + zoom;
    }
    corrected.epipolar_error_px = f64::NAN;
    if let Some(covariance) = &mut corrected.covariance {
        let variance = Matrix3::from_diagonal(&Vector3::from_fn(|i, _| drift.noise[i].powi(2)));
        let in_right = right_from_aligned * variance * right_from_aligned.transpose();
        let [right, pose, _] = calibration.layout();
        let mut block = covariance.fixed_view_mut::<3, 3>(pose, pose);
        block += in_right;
        // A camera's parameters begin with its focal lengths.
        for (parameter, focal_px) in (right..).zip(corrected.right.focal_px) {
            covariance[(parameter, parameter)] += (focal_px * drift.noise[3]).powi(2);
        }
    }
    corrected.validate()?;
    Ok(corrected)
}
