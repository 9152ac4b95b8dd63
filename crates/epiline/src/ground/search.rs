//! Planes that could be the ground, and which of them holds the most without anything below it.
//!
//! ```text
//! repeat:
//!   two samples of one column -> a line of v-disparity; its slope and horizon must be plausible
//!   a third sample, well beside them -> roll; it must be plausible
//!   score the plane: samples on it count for it, samples below it against it
//! ```
//!
//! A table top has the floor below it, and a wall is no plane that a camera of plausible pose sees below itself.

use super::GroundParams;
use super::plane_fit::DisparityPlane;
use super::samples::{Sample, Samples};
use crate::rectification::RectifiedGeometry;

/// Plausible planes that are scored.
const HYPOTHESES: usize = 160;
/// Draws for them, at most.
const DRAWS: usize = 6000;
/// Samples a plane is scored on, at most.
const SCORED: usize = 1200;
/// Smallest distance of two samples of a column, as a share of the image's height.
const APART_DOWN: f32 = 0.06;
/// Smallest distance of the third sample from them, as a share of the image's width.
const APART_ACROSS: f32 = 0.15;

/// What holds a plane to the samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Held {
    /// Samples on it, each weighted by how near it is.
    pub on: f64,
    /// Samples on it, counted.
    pub count: usize,
    /// Samples below it.
    pub below: usize,
    /// Samples where the plane is seen, on it or not.
    pub looked_at: usize,
}

impl Held {
    fn score(&self) -> f64 {
        self.on - self.below as f64
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
        let mut random = Draw(0x9e37_79b9_7f4a_7c15);
        let mut plausible = 0;
        for _ in 0..DRAWS {
            if plausible == HYPOTHESES {
                break;
            }
            if let Some(plane) = draw(&mut random, samples, geometry, params) {
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
    let mut on = 0.0;
    for sample in samples {
        let plane_px = by_u * sample.u + by_v * sample.v + at_center;
        let share = (sample.seen_px - plane_px) * per_tolerance;
        let inside = (1.0 - share * share).max(0.0);
        // Near the horizon nothing can be told apart from what is far.
        let below_horizon = plane_px > 1.0;
        if below_horizon {
            on += inside;
        }
        held.looked_at += usize::from(below_horizon);
        held.count += usize::from(below_horizon && inside > 0.0);
        held.below += usize::from(share < -1.5);
    }
    held.on = f64::from(on);
    held
}

/// A plausible plane through three samples, if that is what was drawn.
fn draw(
    random: &mut Draw,
    samples: &Samples,
    geometry: &RectifiedGeometry,
    params: &GroundParams,
) -> Option<DisparityPlane> {
    let column = samples.column(random.below(samples.columns())?);
    let one = column[random.below(column.len())?];
    let other = column[random.below(column.len())?];
    let (upper, lower) = if one.v < other.v { (one, other) } else { (other, one) };
    let apart = lower.v - upper.v;
    let step = lower.seen_px - upper.seen_px;
    if apart < APART_DOWN * geometry.height as f32 || step <= 0.0 {
        return None;
    }
    let by_v = f64::from(step / apart);
    // The steepest plausible slope is that of the lowest camera.
    if by_v > geometry.baseline_m / params.camera_height_m.0 {
        return None;
    }
    let third = samples.all[random.below(samples.all.len())?];
    let aside = third.u - lower.u;
    if aside.abs() < APART_ACROSS * geometry.width as f32 {
        return None;
    }
    let expected = f64::from(lower.seen_px) + by_v * f64::from(third.v - lower.v);
    let by_u = (f64::from(third.seen_px) - expected) / f64::from(aside);
    let at_center = f64::from(lower.seen_px) - by_u * f64::from(lower.u) - by_v * f64::from(lower.v);
    let plane = DisparityPlane { by_u, by_v, at_center };
    params.is_plausible(&plane.pose(geometry)).then_some(plane)
}

/// The same numbers every time (xorshift64).
struct Draw(u64);

impl Draw {
    /// A number below a limit; `None` if the limit is zero.
    fn below(&mut self, limit: usize) -> Option<usize> {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 11) as usize).checked_rem(limit)
    }
}
