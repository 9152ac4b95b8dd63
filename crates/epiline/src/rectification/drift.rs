//! A rig that no longer points as it was calibrated: which angle moved, by how much, and how sure that is.

mod evidence;

use nalgebra::{Matrix3, Matrix4, Matrix4xX, Rotation3, Vector2, Vector3, Vector4};

use self::evidence::{Evidence, Prior};
use super::alignment::PointMatch;
use super::geometry::RectifiedGeometry;
use super::projection::Projection;
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
///
/// A yaw of the camera changes all disparities by `f·yaw` besides, which no pair shows that has no known distance in
/// it; only the bend of rows towards the corners gives it away, and lenses that were not modelled exactly, or shutters
/// that did not open together on a rig that moves, bend rows as much as a yaw of a twentieth of a degree does. Its sigma
/// says so: a small yaw is not named.
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
    /// Of each value, by how much twice the log-likelihood grows if it alone has moved.
    gain: [f64; 4],
    evidence: Evidence,
}

/// A value counts as drift beyond so many standard deviations.
const SIGNIFICANT: f64 = 3.5;
/// One value is named before another if it alone explains the rows better by so much: odds of twenty to one.
const NAMED_BEFORE: f64 = 6.0;

impl Drift {
    /// Before any pair was seen.
    pub const UNKNOWN: Self = Self {
        values: [0.0; 4],
        sigma: [f64::INFINITY; 4],
        noise: [f64::INFINITY; 4],
        frames: 0,
        matches: 0,
        gain: [0.0; 4],
        evidence: Evidence::NONE,
    };

    /// Whether this value is beyond doubt.
    pub fn is_significant(&self, axis: DriftAxis) -> bool {
        let i = axis as usize;
        self.values[i].abs() > SIGNIFICANT * self.sigma[i]
    }

    /// The angle or scale that moved most surely, if beyond doubt; `None` if the rig holds as far as can be seen, or if
    /// something moved that one value explains about as well as another.
    pub fn axis(&self) -> Option<DriftAxis> {
        let gain = |axis: DriftAxis| self.gain[axis as usize];
        let significant = DriftAxis::ALL.into_iter().filter(|&axis| self.is_significant(axis));
        let named = significant.max_by(|&a, &b| gain(a).total_cmp(&gain(b)))?;
        let rivals = DriftAxis::ALL.into_iter().filter(|&axis| axis != named && !self.is_significant(axis));
        rivals.into_iter().all(|axis| gain(named) >= gain(axis) + NAMED_BEFORE).then_some(named)
    }
}

/// Vertical error that a rig of unknown uncertainty is granted for pitch, yaw, roll and zoom, at half the image's width
/// and height, pixels: about what published rectified sequences show.
const GRANTED_PX: [f64; 4] = [0.08, 0.2, 0.15, 0.15];
/// What differs from one set of pairs to another on rigs that hold, there, pixels: added to a calibration's own
/// uncertainty, and to a reference's. A yaw's is what shutters make that are a millisecond apart on a car.
const MODEL_ERROR_PX: [f64; 4] = [0.04, 0.08, 0.04, 0.04];
/// Pairs that the estimate remembers: older ones fade.
const MEMORY_FRAMES: f64 = 50.0;
/// Fewest matches with which a pair speaks.
const MIN_MATCHES: usize = 12;

/// Accumulates the vertical residuals of aligned pairs into a [`Drift`].
///
/// An information filter with forgetting, whose state is the four values and the coefficients of a smooth field that
/// calibration has left (terms of second and third order, and with disparity), to which a prior of a few hundredths of a
/// pixel keeps.
#[derive(Debug, Clone)]
pub struct DriftMeter {
    geometry: RectifiedGeometry,
    /// Variance of the values that the calibration is answerable for.
    granted: [f64; 4],
    reference: Evidence,
    seen: Evidence,
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
            reference: Evidence::NONE,
            seen: Evidence::NONE,
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
            let model = at_edge(geometry, MODEL_ERROR_PX);
            meter.granted = std::array::from_fn(|i| own[i] + model[i] * model[i]);
        }
        Ok(meter)
    }

    /// Drift counts from `reference` on, measured when the rig was known to hold: what the calibration leaves uncertain
    /// of its own, and its field, then cancel as far as the reference knows them. All pairs so far are forgotten.
    pub fn set_reference(&mut self, reference: Drift) {
        let (geometry, granted) = (self.geometry, self.granted);
        *self = Self { granted, reference: reference.evidence, ..Self::new(&geometry) };
    }

    /// Takes in the matches of a pair and tells what is known now. A pair with fewer than twelve matches changes nothing.
    pub fn add(&mut self, matches: &[PointMatch]) -> Drift {
        if matches.len() >= MIN_MATCHES {
            let pair = Evidence::of_pair(&self.geometry, matches, &mut self.residuals);
            self.seen.fade(1.0 - 1.0 / MEMORY_FRAMES);
            self.seen.add(&pair);
            self.frames += 1;
            self.matches += matches.len();
        }
        self.drift()
    }

    /// What is known so far.
    pub fn drift(&self) -> Drift {
        self.solve().unwrap_or(Drift::UNKNOWN)
    }

    fn solve(&self) -> Option<Drift> {
        if self.frames == 0 {
            return None;
        }
        let calibration = Prior::about_zero(self.granted);
        let before = if self.reference.is_none() {
            calibration
        } else {
            let model = at_edge(&self.geometry, MODEL_ERROR_PX).map(|sigma| sigma * sigma);
            calibration.after(&self.reference)?.widened(model)
        };
        let (information, right_side) = self.seen.about_shift(&before)?;
        let covariance = information.try_inverse()?;
        let (of_matches, _) = self.seen.about_shift(&Prior::about_zero([0.0; 4]))?;
        let noise = of_matches.try_inverse()?;
        let deviations = |variance: Matrix4<f64>| std::array::from_fn(|i| variance[(i, i)].max(0.0).sqrt());
        Some(Drift {
            values: (covariance * right_side).into(),
            sigma: deviations(covariance),
            noise: deviations(noise),
            frames: self.frames,
            matches: self.matches,
            gain: std::array::from_fn(|i| right_side[i] * right_side[i] / information[(i, i)]),
            evidence: self.seen,
        })
    }
}

/// Change of `dy` at a match, pixels, by pitch, yaw, roll and zoom of the right camera.
fn pattern(geometry: &RectifiedGeometry, found: &PointMatch) -> Vector4<f64> {
    let RectifiedGeometry { focal_px, cx_px, cy_px, doffs_px, .. } = *geometry;
    let [x, y] = found.right_px;
    let (u, v) = ((x - cx_px - doffs_px) / focal_px, (y - cy_px) / focal_px);
    // A camera that turns by ω sees a ray turn by -ω: its row moves by that of the image of -ω × ray.
    let per_focal = match geometry.projection {
        Projection::Pinhole => Vector4::new(1.0 + v * v, -u * v, -u, v),
        Projection::Cylindrical => {
            let (sin, cos) = v.sin_cos();
            Vector4::new(1.0, -u.tan() * sin, -u.tan() * cos, sin * cos)
        }
    };
    per_focal * focal_px
}

/// Values whose vertical error at half the image's width and height is so many pixels.
fn at_edge(geometry: &RectifiedGeometry, error_px: [f64; 4]) -> [f64; 4] {
    let RectifiedGeometry { width, height, focal_px, .. } = *geometry;
    let [u, v] = [width, height].map(|side| 0.5 * side as f64 / focal_px);
    let [across, down] = match geometry.projection {
        Projection::Pinhole => [u, v],
        // Short of a right angle, where a row's own direction is lost.
        Projection::Cylindrical => [u.min(1.4).tan(), v.min(1.4).tan()],
    };
    let reach = [1.0, across * down, across, down];
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
        let flat = Vector2::new(x - geometry.cx_px, y - geometry.cy_px) / geometry.focal_px;
        let Some(far) = geometry.projection.ray(flat) else { continue };
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
            let vertical = |rig: &MovedRig| {
                Some(geometry.focal_px * rig.row_difference(geometry.projection, left, right)?)
            };
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
    fn row_difference(&self, on: Projection, left: Vector2<f64>, right: Vector2<f64>) -> Option<f64> {
        let left = on.flat(&(self.frame.aligned_from_left * self.left.direction(left)?))?;
        let right = on.flat(&(self.frame.aligned_from_right * self.right.direction(right)?))?;
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
