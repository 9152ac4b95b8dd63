//! The ground of one frame after the other.

use super::bend::BendFinder;
use super::elevation::ProfileFinder;
use super::evidence::{MIN_ON, require_ground};
use super::plane::GroundPlane;
use super::plane_fit::{DisparityPlane, FittedPlane, refit};
use super::samples::Samples;
use super::search::{Held, SCORED_STEP, search, tolerance_px};
use super::sums::{Bend, Round};
use super::uncertainty::{bias, floor, in_disparity, sigmas_of_pose, walk};
use super::{Ground, GroundParams, NoGround};
use crate::error::Result;
use crate::matching::DisparityMap;
use crate::range::check_size;
use crate::rectification::RectifiedGeometry;

/// Planes that are drawn where none is known, where the one that was followed has got lost, and beside one that is
/// followed: in time a better one is met.
const DRAWS: usize = 120;
const DRAWS_WHEN_LOST: usize = 60;
const DRAWS_WHEN_FOLLOWED: usize = 6;
/// A plane that is followed has got lost when the samples on it are less than this share of what they used to be.
const KEPT: f64 = 0.8;
/// What they used to be is a mean over about so many frames.
const MEMORY: f64 = 8.0;
/// How a plane is fitted again: one that has just been drawn, one that lies as it did, and one that may have moved.
const FIT: [Round; 5] = [Round { width: 4.0, step: 2 }, FINE, FINE, FINE, FINE];
const FIT_STILL: [Round; 2] = [Round { width: 4.0, step: 2 }, FINE];
const FIT_MOVED: [Round; 5] =
    [Round { width: 16.0, step: 4 }, Round { width: 8.0, step: 4 }, FINE, FINE, FINE];
const FINE: Round = Round { width: 4.0, step: 1 };

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
    profile: ProfileFinder,
    bends: BendFinder,
    state: Option<FittedPlane>,
    /// How much of what could hold the plane that is followed does, as a rule.
    usual_share: f64,
    frames: u64,
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
        (self.state, self.usual_share) = (None, 0.0);
        (self.frames, self.missed, self.outside) = (0, 0, 0);
    }

    /// The plane of this frame: the one followed as it lies now, unless it has got lost or a better one is met.
    fn measure(&mut self, geometry: &RectifiedGeometry) -> std::result::Result<FittedPlane, NoGround> {
        if self.samples.count < MIN_ON {
            return Err(NoGround::TooFewPixels);
        }
        let sigma_px = self.params.disparity_sigma_px;
        let tolerance_px = tolerance_px(sigma_px);
        let samples = &self.samples;
        let hold = |plane: &DisparityPlane, step| Held::of(plane, Bend::NONE, samples, step, tolerance_px);
        let lies_as_usual = |held: &Held| held.share() >= KEPT * self.usual_share;
        let followed = self.state.and_then(|state| {
            let is_still = lies_as_usual(&hold(&state.plane, SCORED_STEP));
            let rounds = if is_still { &FIT_STILL[..] } else { &FIT_MOVED[..] };
            let fitted = refit(state.plane, samples, rounds, sigma_px)?;
            Some((fitted, hold(&fitted.plane, 1)))
        });
        let is_kept = followed.as_ref().is_some_and(|(_, held)| lies_as_usual(held));
        let draws = match (is_kept, self.state) {
            (true, _) => DRAWS_WHEN_FOLLOWED,
            (false, Some(_)) => DRAWS_WHEN_LOST,
            (false, None) => DRAWS,
        };
        let of_mounting = self.params.mounting.map(|m| DisparityPlane::of_pose(&m.pose(), geometry));
        let before =
            [followed.map(|(fitted, _)| fitted.plane), self.state.map(|state| state.plane), of_mounting];
        let known = before.into_iter().flatten();
        self.frames += 1;
        let best =
            search(samples, known, draws, self.frames, geometry, &self.params).ok_or(NoGround::NoPlane)?;
        let (single, held) = match followed {
            Some(followed) if best == followed.0.plane => followed,
            _ => {
                let fitted = refit(best, samples, &FIT, sigma_px).ok_or(NoGround::NoPlane)?;
                (fitted, hold(&fitted.plane, 1))
            }
        };
        let slope_px = geometry.focal_px * geometry.baseline_m / single.plane.pose(geometry).height_m;
        let bent = self.bends.refit(&single, samples, slope_px, sigma_px);
        let (fitted, held_with_bend) = bent.map_or((single, held), |(fitted, bend)| {
            (fitted, Held::of(&fitted.plane, bend, samples, 1, tolerance_px))
        });
        if fitted.plane.by_v <= 0.0 || !self.params.is_plausible(&fitted.plane.pose(geometry)) {
            return Err(NoGround::NoPlane);
        }
        require_ground(&fitted.plane, &held_with_bend, samples, tolerance_px, geometry)?;
        let fitted = FittedPlane { covariance: fitted.covariance + floor(&fitted.plane, geometry), ..fitted };
        let change = held.share() - self.usual_share;
        self.usual_share += if is_kept { change / MEMORY } else { change };
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
        let [one, other] =
            [one, other].map(|fitted| Held::of(&fitted.plane, Bend::NONE, &self.samples, 1, tolerance_px));
        one.on > CLEARER * other.on
    }

    /// The first plane: that of a frame, drawn toward the mounting if one was given.
    fn start(&self, measured: FittedPlane, geometry: &RectifiedGeometry) -> FittedPlane {
        let Some(mounting) = self.params.mounting else { return measured };
        let plane = DisparityPlane::of_pose(&mounting.pose(), geometry);
        let sigmas = [mounting.camera_height_sigma_m, mounting.pitch_sigma_rad, mounting.roll_sigma_rad];
        let covariance = in_disparity(&plane, geometry, sigmas);
        let biased = measured.covariance + bias(&measured.plane, geometry);
        update(&FittedPlane { plane, covariance }, &FittedPlane { covariance: biased, ..measured })
            .unwrap_or(measured)
    }

    fn describe(&mut self, fitted: &FittedPlane, geometry: &RectifiedGeometry) -> GroundPlane {
        let pose = fitted.plane.pose(geometry);
        let mut ground = GroundPlane::new(geometry, pose.height_m, pose.pitch_rad, pose.roll_rad);
        let sigma_px = self.params.disparity_sigma_px;
        ground.profile = self.profile.find(&ground, &fitted.plane, &self.samples, sigma_px);
        let held = Held::of(&fitted.plane, Bend::NONE, &self.samples, 1, tolerance_px(sigma_px));
        ground.support_share = held.count / self.samples.count.max(1) as f64;
        let covariance = fitted.covariance + bias(&fitted.plane, geometry);
        if let Some(sigmas) = sigmas_of_pose(&FittedPlane { covariance, ..*fitted }, geometry) {
            [ground.camera_height_sigma_m, ground.pitch_sigma_rad, ground.roll_sigma_rad] = sigmas;
        }
        ground
    }
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
