//! Planes that could be the ground, and which of them holds the most without anything below it.
//!
//! ```text
//! repeat:
//!   two samples of one column and a third, well beside them, or the lowest samples of three columns -> a plane
//!   its pose must be plausible
//!   score the plane: samples on it count for it, samples below it against it
//! ```
//!
//! The lowest samples are the feet of walls and things: where a floor has no texture, they tell where it is.
//!
//! A table top has the floor below it, and a wall is no plane that a camera of plausible pose sees below itself.

use super::GroundParams;
use super::plane_fit::DisparityPlane;
use super::samples::{Sample, Samples};
use crate::rectification::RectifiedGeometry;

/// Plausible planes that are scored; fewer where one is known from the frames before.
const HYPOTHESES: usize = 120;
const HYPOTHESES_BESIDE_KNOWN: usize = 40;
/// Draws for them, at most.
const DRAWS: usize = 6000;
/// Samples a plane is scored on, at most.
const SCORED: usize = 900;
/// Smallest distance of two samples of a column, as a share of the image's height.
const APART_DOWN: f32 = 0.06;
/// Smallest distance of the third sample from them, as a share of the image's width.
const APART_ACROSS: f32 = 0.15;

/// What holds a plane to the samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Held {
    /// Samples on it, each weighted by how near it is to the plane, and by its disparity: what the camera stands on is
    /// near, a ramp ahead may be larger.
    pub on: f64,
    /// Samples on it, counted.
    pub count: usize,
    /// Samples below it, with the same weight, and counted.
    pub under: f64,
    pub below: usize,
    /// Samples where the plane is seen, on it or not.
    pub looked_at: usize,
}

impl Held {
    fn score(&self) -> f64 {
        self.on - self.under
    }
}

/// Draws planes and scores them; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Search {
    scored: Vec<Sample>,
}

impl Search {
    /// The best of the planes drawn from the samples and of `known` ones; `None` if none is plausible.
    pub fn best(
        &mut self,
        samples: &Samples,
        known: &[DisparityPlane],
        geometry: &RectifiedGeometry,
        params: &GroundParams,
    ) -> Option<DisparityPlane> {
        let step = samples.all.len().div_ceil(SCORED).max(1);
        self.scored.clear();
        self.scored.extend(samples.all.iter().step_by(step));
        let tolerance_px = tolerance_px(params.disparity_sigma_px);

        let mut best: Option<(f64, DisparityPlane)> = None;
        let mut consider = |plane: DisparityPlane| {
            let score = held(&plane, &self.scored, tolerance_px).score();
            if best.is_none_or(|(highest, _)| score > highest) {
                best = Some((score, plane));
            }
        };
        known.iter().copied().for_each(&mut consider);
        let mut random = Draw(0);
        let mut plausible = 0;
        let enough = if known.is_empty() { HYPOTHESES } else { HYPOTHESES_BESIDE_KNOWN };
        for drawn in 0..DRAWS {
            if plausible == enough {
                break;
            }
            let three = if drawn % 2 == 0 {
                of_column(&mut random, samples, geometry)
            } else {
                of_feet(&mut random, samples, geometry)
            };
            let plane = three.and_then(through).filter(|plane| {
                // A plane that gets farther downward is a ceiling.
                plane.by_v > 0.0 && params.is_plausible(&plane.pose(geometry))
            });
            if let Some(plane) = plane {
                plausible += 1;
                consider(plane);
            }
        }
        best.map(|(_, plane)| plane)
    }
}

/// A plane within this of a disparity holds it.
pub(super) fn tolerance_px(sigma_px: f64) -> f64 {
    (3.0 * sigma_px).max(0.5)
}

/// How a plane and samples agree.
pub(super) fn held(plane: &DisparityPlane, samples: &[Sample], tolerance_px: f64) -> Held {
    let (by_u, by_v, at_center) = (plane.by_u as f32, plane.by_v as f32, plane.at_center as f32);
    let per_tolerance = 1.0 / tolerance_px as f32;
    let mut held = Held::default();
    let (mut on, mut under) = (0.0, 0.0);
    for sample in samples {
        let plane_px = by_u * sample.u + by_v * sample.v + at_center;
        let share = (sample.seen_px - plane_px) * per_tolerance;
        let inside = (1.0 - share * share).max(0.0);
        // Near the horizon nothing can be told apart from what is far.
        let below_horizon = plane_px > 1.0;
        if below_horizon {
            on += inside * plane_px;
        }
        held.looked_at += usize::from(below_horizon);
        held.count += usize::from(below_horizon && inside > 0.0);
        let is_below = share < -1.5;
        if is_below {
            under += plane_px;
        }
        held.below += usize::from(is_below);
    }
    (held.on, held.under) = (f64::from(on), f64::from(under));
    held
}

/// Two samples of one column, well apart, and a third beside them.
fn of_column(random: &mut Draw, samples: &Samples, geometry: &RectifiedGeometry) -> Option<[Sample; 3]> {
    let column = samples.column(random.below(samples.columns())?);
    let one = column[random.below(column.len())?];
    let other = column[random.below(column.len())?];
    let third = samples.all[random.below(samples.all.len())?];
    let apart = (one.v - other.v).abs() >= APART_DOWN * geometry.height as f32;
    let aside = (third.u - one.u).abs() >= APART_ACROSS * geometry.width as f32;
    (apart && aside).then_some([one, other, third])
}

/// The lowest samples of three columns, well apart.
fn of_feet(random: &mut Draw, samples: &Samples, geometry: &RectifiedGeometry) -> Option<[Sample; 3]> {
    let mut foot = || samples.column(random.below(samples.columns())?).last().copied();
    let three = [foot()?, foot()?, foot()?];
    let us = three.map(|sample| sample.u);
    let aside = [us[0] - us[1], us[1] - us[2], us[2] - us[0]];
    let far_enough = APART_ACROSS * geometry.width as f32;
    aside.iter().all(|apart| apart.abs() >= far_enough).then_some(three)
}

/// The plane through three samples; `None` if they are in line.
fn through([one, other, third]: [Sample; 3]) -> Option<DisparityPlane> {
    let from_one =
        |sample: Sample| [sample.u - one.u, sample.v - one.v, sample.seen_px - one.seen_px].map(f64::from);
    let ([u1, v1, d1], [u2, v2, d2]) = (from_one(other), from_one(third));
    let area = u1 * v2 - u2 * v1;
    if area.abs() < 1.0 {
        return None;
    }
    let (by_u, by_v) = ((d1 * v2 - d2 * v1) / area, (u1 * d2 - u2 * d1) / area);
    let at_center = f64::from(one.seen_px) - by_u * f64::from(one.u) - by_v * f64::from(one.v);
    Some(DisparityPlane { by_u, by_v, at_center })
}

/// The same numbers every time (SplitMix64; Steele, Lea and Flood 2014).
struct Draw(u64);

impl Draw {
    /// A number below a limit; `None` if the limit is zero.
    fn below(&mut self, limit: usize) -> Option<usize> {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^= mixed >> 31;
        // The upper half of the product is even over the numbers below the limit.
        (limit > 0).then(|| ((u128::from(mixed) * limit as u128) >> 64) as usize)
    }
}
