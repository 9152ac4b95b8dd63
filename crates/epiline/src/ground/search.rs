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
use super::samples::{COLUMNS, NOTHING, Sample, Samples};
use super::sums::{Bend, total};
use crate::rectification::RectifiedGeometry;

/// Three samples are drawn at most so many times for each plausible plane.
const PATIENCE: usize = 50;
/// A plane is scored on every so many rows of the grid.
pub(super) const SCORED_STEP: usize = 3;
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
    /// What that would be if all samples where the plane is seen lay on it.
    pub possible: f64,
    /// Samples below it, weighted by disparity.
    pub under: f64,
    /// How many samples lie on it, and where it is seen, on it or not.
    pub count: f64,
    pub looked_at: f64,
}

impl Held {
    /// How a plane with a bend and the samples of every `step`th row agree.
    pub fn of(plane: &DisparityPlane, bend: Bend, samples: &Samples, step: usize, tolerance_px: f64) -> Self {
        let by_u = plane.by_u as f32;
        let (bend_px, per_bend) = (bend.by_px as f32, 1.0 / bend.at_px as f32);
        let per_tolerance = 1.0 / tolerance_px as f32;
        let [mut on, mut possible, mut under, mut count, mut looked_at] = [[0.0_f32; COLUMNS]; 5];
        for (row, at_u0) in samples.rows_of(plane, step) {
            for column in 0..COLUMNS {
                let plane_px = at_u0 + by_u * samples.u[column];
                let beyond_px = bend_px * (1.0 - plane_px * per_bend).max(0.0);
                let share = (row.seen_px[column] - plane_px - beyond_px) * per_tolerance;
                let inside = (1.0 - share * share).max(0.0);
                // Near the horizon nothing can be told apart from what is far.
                let is_seen = (plane_px > 1.0) & (row.seen_px[column] < NOTHING);
                let is_below = share < -1.5;
                on[column] += if is_seen { inside * plane_px } else { 0.0 };
                possible[column] += if is_seen { plane_px } else { 0.0 };
                under[column] += if is_below { plane_px } else { 0.0 };
                count[column] += if is_seen & (inside > 0.0) { 1.0 } else { 0.0 };
                looked_at[column] += if is_seen { 1.0 } else { 0.0 };
            }
        }
        let [on, possible, under, count, looked_at] = [on, possible, under, count, looked_at].map(total);
        Self { on, possible, under, count, looked_at }
    }

    pub fn score(&self) -> f64 {
        self.on - self.under
    }

    /// The share of what could hold the plane that does.
    pub fn share(&self) -> f64 {
        self.score() / self.possible.max(1.0)
    }
}

/// The best of `known` planes and of `draws` plausible ones drawn from the samples; `None` if there is none. The same
/// `seed` draws the same.
pub(super) fn search(
    samples: &Samples,
    known: impl Iterator<Item = DisparityPlane>,
    draws: usize,
    seed: u64,
    geometry: &RectifiedGeometry,
    params: &GroundParams,
) -> Option<DisparityPlane> {
    let tolerance_px = tolerance_px(params.disparity_sigma_px);
    let mut best: Option<(DisparityPlane, f64)> = None;
    let mut consider = |plane: DisparityPlane| {
        let score = Held::of(&plane, Bend::NONE, samples, SCORED_STEP, tolerance_px).score();
        if best.is_none_or(|(_, highest)| score > highest) {
            best = Some((plane, score));
        }
    };
    known.for_each(&mut consider);
    let mut random = Draw(seed);
    let mut plausible = 0;
    for drawn in 0..PATIENCE * draws {
        if plausible == draws {
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
    best.map(|(plane, _)| plane)
}

/// A plane within this of a disparity holds it.
pub(super) fn tolerance_px(sigma_px: f64) -> f64 {
    (3.0 * sigma_px).max(0.5)
}

/// Two samples of one column, well apart, and a third beside them.
fn of_column(random: &mut Draw, samples: &Samples, geometry: &RectifiedGeometry) -> Option<[Sample; 3]> {
    let column = random.below(samples.columns)?;
    let aside = random.below(samples.columns)?;
    let mut in_column = |column| samples.at_or_below(column, random.below(samples.rows.len())?);
    let (one, other, third) = (in_column(column)?, in_column(column)?, in_column(aside)?);
    let apart = (one.v - other.v).abs() >= APART_DOWN * geometry.height as f32;
    let aside = (third.u - one.u).abs() >= APART_ACROSS * geometry.width as f32;
    (apart && aside).then_some([one, other, third])
}

/// The lowest samples of three columns, well apart.
fn of_feet(random: &mut Draw, samples: &Samples, geometry: &RectifiedGeometry) -> Option<[Sample; 3]> {
    let mut foot = || samples.lowest(random.below(samples.columns)?);
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
