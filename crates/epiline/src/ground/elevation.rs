//! The profile of the ground over its plane: the way from near to far that most samples lie on.
//!
//! Dynamic programming over the knots of the profile. What a state, an elevation at a knot, gains are the samples at
//! about that depth and height, less those below it; from knot to knot the ground rises or falls no more than
//! [`STEEPEST`], and the less the better.

use super::plane::GroundPlane;
use super::profile::{KNOTS, Profile};
use super::samples::Sample;
use super::search::tolerance_px;

/// The ground rises or falls at most by so much per metre: 6.5°. What is steeper is an obstacle.
const STEEPEST: f64 = 0.114;
/// Elevations to choose from: so many up and as many down, in steps of this share of the camera's height.
const LEVELS: usize = 24;
const STEP: f64 = 0.02;
const STATES: usize = 2 * LEVELS + 1;
/// A knot with fewer samples says so much less.
const ENOUGH: f64 = 24.0;
/// What a change of elevation by the steepest slope costs, in shares of a knot's samples.
const CHANGE: f64 = 0.12;

/// Finds profiles; keeps its memory.
#[derive(Debug, Clone)]
pub(super) struct ProfileFinder {
    votes: [[f32; STATES]; KNOTS],
    gains: [[f64; STATES]; KNOTS],
    from: [[u8; STATES]; KNOTS],
}

impl Default for ProfileFinder {
    fn default() -> Self {
        Self { votes: [[0.0; STATES]; KNOTS], gains: [[0.0; STATES]; KNOTS], from: [[0; STATES]; KNOTS] }
    }
}

impl ProfileFinder {
    /// The profile over a level plane; `at_px` gives the plane's disparity, counted from infinity, at a sample.
    pub fn find(
        &mut self,
        plane: &GroundPlane,
        at_px: impl Fn(&Sample) -> f64,
        samples: &[Sample],
        sigma_px: f64,
    ) -> Profile {
        let height_m = plane.camera_height_m;
        let mut profile = Profile::level(height_m);
        self.count_votes(plane, &profile, at_px, samples);
        for knot in 0..KNOTS {
            self.rate(knot, plane.seen_at_m(profile.depth_m(knot)), sigma_px);
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

    /// The mean of the samples about a state of the best way.
    fn refine(&self, knot: usize, state: usize, reach: f64) -> f64 {
        let near = state.saturating_sub(reach as usize)..=(state + reach as usize).min(STATES - 1);
        // A few samples at the state itself, so that none is needed.
        let (mut total, mut sum) = (1.0, state as f64);
        for other in near {
            let share = other.abs_diff(state) as f64 / (reach + 1.0);
            let weight = f64::from(self.votes[knot][other]) * (1.0 - share * share);
            total += weight;
            sum += weight * other as f64;
        }
        sum / total
    }

    fn count_votes(
        &mut self,
        plane: &GroundPlane,
        profile: &Profile,
        at_px: impl Fn(&Sample) -> f64,
        samples: &[Sample],
    ) {
        self.votes = [[0.0; STATES]; KNOTS];
        for sample in samples {
            let seen_px = f64::from(sample.seen_px);
            let knot = profile.place(plane.depth_m(seen_px)).round();
            let state = (1.0 - at_px(sample) / seen_px) / STEP + LEVELS as f64;
            if (0.0..KNOTS as f64).contains(&knot) && (0.0..STATES as f64 - 0.5).contains(&state) {
                self.votes[knot as usize][state.round() as usize] += 1.0;
            }
        }
    }

    /// What each elevation at a knot gains.
    fn rate(&mut self, knot: usize, seen_px: f64, sigma_px: f64) {
        let votes = &self.votes[knot];
        let total: f64 = votes.iter().map(|&n| f64::from(n)).sum();
        let reach = reach(seen_px, sigma_px);
        let weight = total / (total + ENOUGH) / total.max(1.0);
        let mut below = 0.0;
        let mut behind = 0;
        for state in 0..STATES {
            // Below is what the noise cannot have put there.
            while behind < state && (state - behind) as f64 > 1.5 * reach {
                below += f64::from(votes[behind]);
                behind += 1;
            }
            let near = state.saturating_sub(reach as usize)..=(state + reach as usize).min(STATES - 1);
            let on: f64 = near
                .map(|other| {
                    let share = other.abs_diff(state) as f64 / (reach + 1.0);
                    f64::from(votes[other]) * (1.0 - share * share)
                })
                .sum();
            self.gains[knot][state] = weight * (on - below);
        }
    }

    /// The state at each knot of the way that gains most.
    fn best_way(&mut self, profile: &Profile, height_m: f64) -> [usize; KNOTS] {
        for knot in 1..KNOTS {
            let ahead_m = profile.depth_m(knot) - profile.depth_m(knot - 1);
            let reach = STEEPEST * ahead_m / (STEP * height_m);
            for state in 0..STATES {
                let (low, high) =
                    (state.saturating_sub(reach as usize), (state + reach as usize).min(STATES - 1));
                let gain = |from: usize| {
                    let change = from.abs_diff(state) as f64 / reach.max(1.0);
                    self.gains[knot - 1][from] - CHANGE * change
                };
                // Of two that gain as much, the one without change.
                let mut best = state;
                for from in low..=high {
                    if gain(from) > gain(best) {
                        best = from;
                    }
                }
                let gained = gain(best);
                self.from[knot][state] = best as u8;
                self.gains[knot][state] += gained;
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
            state = usize::from(self.from[knot][state]);
        }
        way
    }
}

/// How far the noise of disparity carries, in states.
fn reach(seen_px: f64, sigma_px: f64) -> f64 {
    (tolerance_px(sigma_px) / (seen_px * STEP)).clamp(1.0, LEVELS as f64)
}
