//! The profile of the ground over its plane: the way from near to far that most samples lie on.
//!
//! Dynamic programming over the knots of the profile. What a state, an elevation at a knot, gains are the samples at
//! about that depth and height, less those below it; from knot to knot the ground rises or falls no more than
//! [`STEEPEST`], and the less the better.

use super::plane::GroundPlane;
use super::plane_fit::DisparityPlane;
use super::profile::{KNOTS, Profile};
use super::samples::{COLUMNS, Samples};
use super::search::tolerance_px;

/// The ground rises or falls at most by so much per metre: 6.5°. What is steeper is an obstacle.
const STEEPEST: f64 = 0.114;
/// Elevations to choose from: so many up and as many down, in steps of this share of the camera's height.
const LEVELS: usize = 24;
const STEP: f64 = 0.02;
const STATES: usize = 2 * LEVELS + 1;
/// A knot with fewer samples says so much less.
const ENOUGH: f32 = 16.0;
/// What a change of elevation by the steepest slope costs, in shares of a knot's samples.
const CHANGE: f64 = 0.12;

/// Depths, from the first knot's nearest on, are told apart in so many steps of disparity.
const DEPTHS: usize = 4096;

/// Finds profiles; keeps its memory.
#[derive(Debug, Clone)]
pub(super) struct ProfileFinder {
    /// The knot of each step of disparity; the first knot's nearest disparity is [`DEPTHS`].
    knots: Vec<u8>,
    /// Samples about each knot and elevation; with [`LEVELS`] empty elevations to either side.
    votes: [[f32; STATES + 2 * LEVELS]; KNOTS],
    gains: [[f32; STATES]; KNOTS],
    from: [[i32; STATES]; KNOTS],
}

impl Default for ProfileFinder {
    fn default() -> Self {
        let place = |step: usize| Profile::places_between(step as f64 + 0.5, DEPTHS as f64) - 0.5;
        Self {
            knots: (0..DEPTHS).map(|step| place(step).round().clamp(0.0, KNOTS as f64) as u8).collect(),
            votes: [[0.0; STATES + 2 * LEVELS]; KNOTS],
            gains: [[0.0; STATES]; KNOTS],
            from: [[0; STATES]; KNOTS],
        }
    }
}

impl ProfileFinder {
    /// The profile over a level plane, which has the disparities of `seen`.
    pub fn find(
        &mut self,
        plane: &GroundPlane,
        seen: &DisparityPlane,
        samples: &Samples,
        sigma_px: f64,
    ) -> Profile {
        let height_m = plane.camera_height_m;
        let mut profile = Profile::level(height_m);
        self.count_votes(seen, plane.seen_at_m(profile.nearest_m()), samples);
        for knot in 0..KNOTS {
            self.rate(knot, reach(plane.seen_at_m(profile.depth_m(knot)), sigma_px));
        }
        let best = self.best_way(&profile, height_m);
        let refined: [f64; KNOTS] = std::array::from_fn(|knot| {
            let reach = reach(plane.seen_at_m(profile.depth_m(knot)), sigma_px);
            self.refine(knot, best[knot], reach)
        });
        let smooth: [f64; KNOTS] = std::array::from_fn(|knot| {
            let near = knot.saturating_sub(1)..=(knot + 1).min(KNOTS - 1);
            let count = near.clone().count() as f64;
            refined[near].iter().sum::<f64>() / count
        });
        profile.set(smooth.map(|state| (state - LEVELS as f64) * STEP * height_m));
        profile
    }

    fn count_votes(&mut self, plane: &DisparityPlane, nearest_px: f64, samples: &Samples) {
        self.votes = [[0.0; STATES + 2 * LEVELS]; KNOTS];
        let by_u = plane.by_u as f32;
        let per_px = (DEPTHS as f64 / nearest_px) as f32;
        for (row, at_u0) in samples.rows_of(plane, 1) {
            let (mut steps, mut states) = ([0_i32; COLUMNS], [0.0_f32; COLUMNS]);
            for (column, (step, state)) in steps.iter_mut().zip(&mut states).enumerate() {
                let seen_px = row.seen_px[column];
                let plane_px = at_u0 + by_u * samples.u[column];
                *step = (seen_px * per_px).min(DEPTHS as f32) as i32;
                // Half a step more, so that rounding down is rounding to the nearest.
                *state = (1.0 - plane_px / seen_px) * (1.0 / STEP as f32) + (LEVELS as f32 + 0.5);
            }
            for (step, state) in steps.into_iter().zip(states) {
                let knot = self.knots.get(step as usize).map_or(KNOTS, |&knot| usize::from(knot));
                if knot < KNOTS && (0.0..STATES as f32).contains(&state) {
                    self.votes[knot][LEVELS + state as usize] += 1.0;
                }
            }
        }
    }

    /// What each elevation at a knot gains.
    fn rate(&mut self, knot: usize, reach: f64) {
        let votes = &self.votes[knot];
        let of_states = &votes[LEVELS..LEVELS + STATES];
        let total: f32 = of_states.iter().sum();
        let gains = &mut self.gains[knot];
        *gains = [0.0; STATES];
        if total == 0.0 {
            return;
        }
        let within = reach as usize;
        for offset in 0..=2 * within {
            let near = nearness(offset.abs_diff(within), reach) as f32;
            let others = &votes[LEVELS - within + offset..][..STATES];
            for (gain, &count) in gains.iter_mut().zip(others) {
                *gain += near * count;
            }
        }
        let weight = total / (total + ENOUGH) / total;
        let mut below = 0.0;
        let mut behind = 0;
        for (state, gain) in gains.iter_mut().enumerate() {
            // Below is what the noise cannot have put there.
            while behind < state && (state - behind) as f64 > 1.5 * reach {
                below += of_states[behind];
                behind += 1;
            }
            *gain = weight * (*gain - below);
        }
    }

    /// The state at each knot of the way that gains most; of ways that gain as much, the one with the least change.
    fn best_way(&mut self, profile: &Profile, height_m: f64) -> [usize; KNOTS] {
        for knot in 1..KNOTS {
            let ahead_m = profile.depth_m(knot) - profile.depth_m(knot - 1);
            let reach = STEEPEST * ahead_m / (STEP * height_m);
            let before = &self.gains[knot - 1];
            let from = &mut self.from[knot];
            let mut best = *before;
            *from = std::array::from_fn(|state| state as i32);
            // Where nothing is seen before, there is nothing to be gained by change.
            let most = if before.iter().all(|&gain| gain == 0.0) { 0 } else { reach as usize };
            for change in 1..=most.min(STATES - 1) {
                let cost = (CHANGE * change as f64 / reach.max(1.0)) as f32;
                let kept = STATES - change;
                offer(&mut best[..kept], &mut from[..kept], &before[change..], change, cost);
                offer(&mut best[change..], &mut from[change..], &before[..kept], 0, cost);
            }
            for (gain, gained) in self.gains[knot].iter_mut().zip(best) {
                *gain += gained;
            }
        }
        let last = &self.gains[KNOTS - 1];
        let nearest_level = |state: &usize| state.abs_diff(LEVELS);
        let mut state = (0..STATES)
            .max_by(|a, b| last[*a].total_cmp(&last[*b]).then(nearest_level(b).cmp(&nearest_level(a))))
            .unwrap_or(LEVELS);
        let mut way = [LEVELS; KNOTS];
        for knot in (0..KNOTS).rev() {
            way[knot] = state;
            state = self.from[knot][state] as usize;
        }
        way
    }

    /// The mean of the samples about a state of the best way.
    fn refine(&self, knot: usize, state: usize, reach: f64) -> f64 {
        let near = state.saturating_sub(reach as usize)..=(state + reach as usize).min(STATES - 1);
        // A few samples at the state itself, so that none is needed.
        let (mut total, mut sum) = (1.0, state as f64);
        for other in near {
            let weight = f64::from(self.votes[knot][LEVELS + other]) * nearness(other.abs_diff(state), reach);
            total += weight;
            sum += weight * other as f64;
        }
        sum / total
    }
}

/// Takes for each state another one's gain less a cost where that is better; the others begin with `first`.
fn offer(best: &mut [f32], from: &mut [i32], others: &[f32], first: usize, cost: f32) {
    for (i, ((best, from), other)) in best.iter_mut().zip(from).zip(others).enumerate() {
        let gain = other - cost;
        let is_better = gain > *best;
        *best = if is_better { gain } else { *best };
        *from = if is_better { (first + i) as i32 } else { *from };
    }
}

/// How much a sample some states off counts.
fn nearness(states: usize, reach: f64) -> f64 {
    let share = states as f64 / (reach + 1.0);
    1.0 - share * share
}

/// How far the noise of disparity carries, in states.
fn reach(seen_px: f64, sigma_px: f64) -> f64 {
    (tolerance_px(sigma_px) / (seen_px * STEP)).clamp(1.0, LEVELS as f64)
}
