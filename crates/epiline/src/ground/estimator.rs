//! The ground of one frame after the other.

use nalgebra::{Matrix3, Vector3};

use super::elevation::ProfileFinder;
use super::plane::GroundPlane;
use super::plane_fit::{DisparityPlane, FittedPlane, refit};
use super::samples::{Sample, Samples};
use super::search::{Held, Search, held, tolerance_px};
use super::{Ground, GroundParams, NoGround};
use crate::error::Result;
use crate::matching::DisparityMap;
use crate::range::check_size;
use crate::rectification::RectifiedGeometry;

/// Samples that must lie on a plane.
const MIN_ON: usize = 120;
/// … and as a share of those seen where the plane is.
const MIN_ON_SHARE: f64 = 0.12;
/// Of these, the share along which disparity changes as on the plane: a wall crosses it.
const MIN_ALONG_SHARE: f64 = 0.35;
/// Samples below a plane, as a share of those on it, that make it something else than the ground.
const MAX_BELOW_SHARE: f64 = 0.25;
/// Disparity that the samples on a plane must span, px: a wall spans next to none.
const MIN_SPAN_PX: f64 = 2.5;
/// Columns and rows that they must span, as shares of the image's width and height: the lower edge of the image cuts
/// off a wall in a line of a plausible plane.
const MIN_ACROSS: f64 = 0.2;
const MIN_DOWN: f64 = 0.12;

/// How much the pose changes from frame to frame, one standard deviation: a vehicle nods more than it heaves.
const HEIGHT_WALK: f64 = 0.01;
const PITCH_WALK_RAD: f64 = 0.01;
const ROLL_WALK_RAD: f64 = 0.007;
/// What a fit cannot know of the pose, one standard deviation: lenses, alignment, and that no floor is quite plane.
const HEIGHT_FLOOR: f64 = 0.003;
const ANGLE_FLOOR_RAD: f64 = 0.0005;
/// Squared Mahalanobis distance beyond which a frame's plane is not the one followed: 1 in 10 000 by chance.
const GATE: f64 = 21.1;
/// … unless so many times as many samples lie on it: the camera has been moved.
const CLEARER: f64 = 1.3;
/// Frames in a row beyond the gate after which the new plane is believed.
const MAX_OUTSIDE: u32 = 3;
/// Frames without a plane that the last one is carried on for.
const MAX_MISSED: u32 = 5;

/// Finds the ground in each frame and follows it; keeps its memory.
///
/// The plane is filtered over time (a Kalman filter of its three numbers; a frame that disagrees with those before
/// is passed over unless the next ones confirm it); the profile over the plane is that of the frame.
#[derive(Debug, Clone, Default)]
pub struct GroundEstimator {
    params: GroundParams,
    samples: Samples,
    search: Search,
    profile: ProfileFinder,
    state: Option<FittedPlane>,
    missed: u32,
    outside: u32,
}

impl GroundEstimator {
    /// An estimator that has seen nothing.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a parameter out of range.
    pub fn new(params: GroundParams) -> Result<Self> {
        params.validate()?;
        Ok(Self { params, ..Self::default() })
    }

    /// The ground in the next frame.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`](crate::Error::SizeMismatch) if map and geometry differ in size,
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a cylinder.
    pub fn estimate(&mut self, disparity: &DisparityMap, geometry: &RectifiedGeometry) -> Result<Ground> {
        geometry.require_pinhole("the ground")?;
        check_size(disparity, geometry)?;
        self.samples.take(disparity, geometry);
        let measured = self.measure(geometry);
        Ok(self.follow(measured, geometry))
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        (self.state, self.missed, self.outside) = (None, 0, 0);
    }

    /// The plane of this frame alone.
    fn measure(&mut self, geometry: &RectifiedGeometry) -> std::result::Result<FittedPlane, NoGround> {
        let samples = &self.samples;
        if samples.all.len() < MIN_ON {
            return Err(NoGround::TooFewPixels);
        }
        let of_mounting = self.params.mounting.map(|m| DisparityPlane::of_pose(&m.pose(), geometry));
        let known = self.state.map(|state| state.plane);
        let both = [known, of_mounting];
        let given = both.iter().flatten().count();
        let known: [DisparityPlane; 2] = match both {
            [Some(one), Some(other)] => [one, other],
            [Some(one), None] | [None, Some(one)] => [one, one],
            [None, None] => [DisparityPlane { by_u: 0.0, by_v: 0.0, at_center: 0.0 }; 2],
        };
        let start =
            self.search.best(samples, &known[..given], geometry, &self.params).ok_or(NoGround::NoPlane)?;
        let sigma_px = self.params.disparity_sigma_px;
        let fitted = refit(start, &samples.all, sigma_px).ok_or(NoGround::NoPlane)?;
        let fitted = FittedPlane { covariance: fitted.covariance + floor(&fitted.plane, geometry), ..fitted };
        if fitted.plane.by_v <= 0.0 || !self.params.is_plausible(&fitted.plane.pose(geometry)) {
            return Err(NoGround::NoPlane);
        }
        let tolerance_px = tolerance_px(sigma_px);
        let held = held(&fitted.plane, &samples.all, tolerance_px);
        let along = samples.count_along(|sample| {
            let plane_px = fitted.plane.at(sample);
            let is_on = plane_px > 1.0 && (f64::from(sample.seen_px) - plane_px).abs() < tolerance_px;
            is_on.then_some(plane_px as f32)
        });
        if held.count < MIN_ON
            || (along as f64) < MIN_ALONG_SHARE * held.count as f64
            || (held.count as f64) < MIN_ON_SHARE * held.looked_at as f64
            || !spans_enough(&fitted.plane, &samples.all, tolerance_px, geometry)
        {
            return Err(NoGround::NoPlane);
        }
        if held.below as f64 > MAX_BELOW_SHARE * held.count as f64 {
            return Err(NoGround::SomethingBelow);
        }
        Ok(fitted)
    }

    /// Takes a frame's plane, or its absence, into the plane that is followed.
    fn follow(
        &mut self,
        measured: std::result::Result<FittedPlane, NoGround>,
        geometry: &RectifiedGeometry,
    ) -> Ground {
        let predicted = self.state.map(|state| FittedPlane {
            covariance: state.covariance + walk(&state.plane, geometry),
            ..state
        });
        let followed = match (predicted, measured) {
            (None, Ok(measured)) => {
                (self.missed, self.outside) = (0, 0);
                self.start(measured, geometry)
            }
            (None, Err(reason)) => return Err(reason),
            (Some(predicted), Err(reason)) => {
                self.missed += 1;
                if self.missed > MAX_MISSED {
                    self.reset();
                    return Err(reason);
                }
                predicted
            }
            (Some(predicted), Ok(measured)) => {
                self.missed = 0;
                match update(&predicted, &measured) {
                    Some(updated) => {
                        self.outside = 0;
                        updated
                    }
                    None if self.outside < MAX_OUTSIDE && !self.is_clearer(&measured, &predicted) => {
                        self.outside += 1;
                        predicted
                    }
                    None => {
                        self.outside = 0;
                        self.start(measured, geometry)
                    }
                }
            }
        };
        self.state = Some(followed);
        Ok(self.describe(&followed, geometry))
    }

    /// Whether the samples of this frame speak for one plane rather than another.
    fn is_clearer(&self, one: &FittedPlane, other: &FittedPlane) -> bool {
        let tolerance_px = tolerance_px(self.params.disparity_sigma_px);
        let [one, other] = [one, other].map(|fitted| held(&fitted.plane, &self.samples.all, tolerance_px));
        one.on > CLEARER * other.on
    }

    /// The first plane: that of a frame, drawn toward the mounting if one was given.
    fn start(&self, measured: FittedPlane, geometry: &RectifiedGeometry) -> FittedPlane {
        let Some(mounting) = self.params.mounting else { return measured };
        let plane = DisparityPlane::of_pose(&mounting.pose(), geometry);
        let sigmas = [mounting.camera_height_sigma_m, mounting.pitch_sigma_rad, mounting.roll_sigma_rad];
        let covariance = in_disparity(&plane, geometry, sigmas);
        update(&FittedPlane { plane, covariance }, &measured).unwrap_or(measured)
    }

    fn describe(&mut self, fitted: &FittedPlane, geometry: &RectifiedGeometry) -> GroundPlane {
        let pose = fitted.plane.pose(geometry);
        let mut ground = GroundPlane::new(geometry, pose.height_m, pose.pitch_rad, pose.roll_rad);
        let sigma_px = self.params.disparity_sigma_px;
        let samples = &self.samples.all;
        ground.profile = self.profile.find(&ground, |sample| fitted.plane.at(sample), samples, sigma_px);
        let Held { count, .. } = held(&fitted.plane, samples, tolerance_px(sigma_px));
        ground.support_share = count as f64 / samples.len().max(1) as f64;
        let jacobian = jacobian(&fitted.plane, geometry);
        if let Some(inverse) = jacobian.try_inverse() {
            let covariance = inverse * fitted.covariance * inverse.transpose();
            let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt();
            ground.camera_height_sigma_m = sigma(0);
            ground.pitch_sigma_rad = sigma(1);
            ground.roll_sigma_rad = sigma(2);
        }
        ground
    }
}

/// Whether the samples on a plane span enough columns, rows and disparity.
fn spans_enough(
    plane: &DisparityPlane,
    samples: &[Sample],
    tolerance_px: f64,
    geometry: &RectifiedGeometry,
) -> bool {
    let (mut count, mut sums, mut squares) = (0.0, [0.0; 3], [0.0; 3]);
    for sample in samples {
        let plane_px = plane.at(sample);
        if plane_px > 1.0 && (f64::from(sample.seen_px) - plane_px).abs() < tolerance_px {
            count += 1.0;
            for (i, value) in [f64::from(sample.u), f64::from(sample.v), plane_px].into_iter().enumerate() {
                sums[i] += value;
                squares[i] += value * value;
            }
        }
    }
    // What is spread evenly has a deviation of its span over √12.
    let span = |i: usize| {
        let mean: f64 = sums[i] / count;
        (12.0 * (squares[i] / count - mean * mean).max(0.0)).sqrt()
    };
    count > 0.0
        && span(0) >= MIN_ACROSS * geometry.width as f64
        && span(1) >= MIN_DOWN * geometry.height as f64
        && span(2) >= MIN_SPAN_PX
}

/// The filter's step; `None` outside the gate.
fn update(predicted: &FittedPlane, measured: &FittedPlane) -> Option<FittedPlane> {
    let residual = measured.plane.vector() - predicted.plane.vector();
    let inverse = (predicted.covariance + measured.covariance).try_inverse()?;
    if (residual.transpose() * inverse * residual).x > GATE {
        return None;
    }
    let gain = predicted.covariance * inverse;
    let covariance = predicted.covariance - gain * predicted.covariance;
    Some(FittedPlane {
        plane: DisparityPlane::from_vector(predicted.plane.vector() + gain * residual),
        covariance: 0.5 * (covariance + covariance.transpose()),
    })
}

/// What height, pitch and roll do to the plane's three numbers, column by column.
fn jacobian(plane: &DisparityPlane, geometry: &RectifiedGeometry) -> Matrix3<f64> {
    let pose = plane.pose(geometry);
    let per_m = geometry.baseline_m / pose.height_m;
    let (sin_pitch, cos_pitch) = pose.pitch_rad.sin_cos();
    let (sin_roll, cos_roll) = pose.roll_rad.sin_cos();
    let focal_px = geometry.focal_px;
    Matrix3::from_columns(&[
        -plane.vector() / pose.height_m,
        per_m * Vector3::new(-sin_pitch * sin_roll, -sin_pitch * cos_roll, cos_pitch * focal_px),
        per_m * Vector3::new(cos_pitch * cos_roll, -cos_pitch * sin_roll, 0.0),
    ])
}

/// Covariance of a plane's three numbers from deviations of height (m), pitch and roll (radians).
fn in_disparity(plane: &DisparityPlane, geometry: &RectifiedGeometry, sigmas: [f64; 3]) -> Matrix3<f64> {
    let jacobian = jacobian(plane, geometry);
    let variances = Vector3::from(sigmas.map(|sigma| sigma * sigma));
    jacobian * Matrix3::from_diagonal(&variances) * jacobian.transpose()
}

fn walk(plane: &DisparityPlane, geometry: &RectifiedGeometry) -> Matrix3<f64> {
    let height_m = plane.pose(geometry).height_m;
    in_disparity(plane, geometry, [HEIGHT_WALK * height_m, PITCH_WALK_RAD, ROLL_WALK_RAD])
}

fn floor(plane: &DisparityPlane, geometry: &RectifiedGeometry) -> Matrix3<f64> {
    let height_m = plane.pose(geometry).height_m;
    in_disparity(plane, geometry, [HEIGHT_FLOOR * height_m, ANGLE_FLOOR_RAD, ANGLE_FLOOR_RAD])
}
