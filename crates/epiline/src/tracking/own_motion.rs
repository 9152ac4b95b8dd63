//! The camera's own motion, from what is seen of things that stand still.
//!
//! ```text
//! for each obstacle of this frame and each of the frame before that may be the same (size, direction):
//!   vote for the difference of their depths
//! motion = the difference that most votes are for, as sharply as their sigmas allow
//! ```
//!
//! True pairs agree on one difference, wrong ones on none; so no pair needs to be known. A vote that is far from what
//! was driven before counts only if the next one is for the same.

use super::{Detection, EgoMotion};

/// Fastest camera that is looked for, m/s.
const FASTEST_MPS: f64 = 30.0;
/// What two views of one thing may differ by: logarithms of height and of width.
const HEIGHT_RATIO_LN: f64 = 0.4;
const WIDTH_RATIO_LN: f64 = 0.7;
/// How far to the side a thing may move from frame to frame: metres, and as a share of its depth.
const SIDEWAYS_M: f64 = 0.3;
const SIDEWAYS_SHARE: f64 = 0.05;
/// Scatter of a difference besides the sigmas of its depths, metres: other parts are seen of a thing each time.
const PARTS_M: f64 = 0.15;
/// Pairs that must agree.
const LEAST_VOTES: usize = 5;
/// Speeds this close are one, m/s.
const TOLERANCE_MPS: f64 = 2.5;
/// Weight of a new speed in the smoothed one.
const SPEED_WEIGHT: f64 = 0.4;

/// Follows the camera's speed; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct OwnMotion {
    before: Vec<Detection>,
    /// Differences of depth and their sigmas, metres.
    votes: Vec<(f64, f64)>,
    speed_mps: Option<f64>,
    /// The last speed that was far from the smoothed one.
    dissent_mps: Option<f64>,
}

impl OwnMotion {
    /// Forgets everything.
    pub fn reset(&mut self) {
        self.before.clear();
        (self.speed_mps, self.dissent_mps) = (None, None);
    }

    /// How far the camera drove ahead in the `elapsed_s` since the frame before, as far as this frame can tell.
    pub fn estimate(&mut self, detections: &[Detection], elapsed_s: f64) -> EgoMotion {
        if elapsed_s > 0.0
            && let Some(forward_m) = self.vote(detections, FASTEST_MPS * elapsed_s)
        {
            self.follow(forward_m / elapsed_s);
        }
        self.before.clear();
        self.before.extend_from_slice(detections);
        let forward_m = self.speed_mps.unwrap_or(0.0) * elapsed_s;
        EgoMotion { forward_m, ..EgoMotion::default() }
    }

    fn follow(&mut self, speed_mps: f64) {
        let near = |other_mps: f64| (speed_mps - other_mps).abs() < TOLERANCE_MPS;
        match (self.speed_mps, self.dissent_mps) {
            (Some(smoothed_mps), _) if near(smoothed_mps) => {
                self.speed_mps = Some(smoothed_mps + SPEED_WEIGHT * (speed_mps - smoothed_mps));
                self.dissent_mps = None;
            }
            (Some(_), Some(dissent_mps)) if !near(dissent_mps) => self.dissent_mps = Some(speed_mps),
            (Some(_), None) => self.dissent_mps = Some(speed_mps),
            (None, _) | (Some(_), Some(_)) => {
                self.speed_mps = Some(speed_mps);
                self.dissent_mps = None;
            }
        }
    }

    /// How far ahead most pairs say that the camera drove, metres; `None` if too few agree.
    fn vote(&mut self, detections: &[Detection], farthest_m: f64) -> Option<f64> {
        self.votes.clear();
        for now in detections {
            for before in &self.before {
                let forward_m = before.depth_m - now.depth_m;
                if may_be_one(before, now) && forward_m.abs() <= farthest_m {
                    let sigma_m = PARTS_M.hypot(before.sigma_m.hypot(now.sigma_m));
                    self.votes.push((forward_m, sigma_m));
                }
            }
        }
        // The kernel of each vote is a parabola two sigmas wide on either side, of the area of a vote.
        let weight = |at_m: f64, &(forward_m, sigma_m): &(f64, f64)| {
            let off = 0.5 * (forward_m - at_m) / sigma_m;
            (1.0 - off * off).max(0.0) / sigma_m
        };
        let density = |at_m: f64| self.votes.iter().map(|vote| weight(at_m, vote)).sum::<f64>();
        let (_, peak_m) = self
            .votes
            .iter()
            .map(|&(forward_m, _)| (density(forward_m), forward_m))
            .max_by(|one, other| one.0.total_cmp(&other.0))?;
        let supporters = self.votes.iter().filter(|vote| weight(peak_m, vote) > 0.0);
        let (count, total, sum_m) = supporters.fold((0, 0.0, 0.0), |(count, total, sum_m), vote| {
            let weight = weight(peak_m, vote);
            (count + 1, total + weight, sum_m + weight * vote.0)
        });
        (count >= LEAST_VOTES).then(|| sum_m / total)
    }
}

/// Whether two detections of successive frames may be of one thing that stands still.
fn may_be_one(before: &Detection, now: &Detection) -> bool {
    let alike = |a: f64, b: f64, limit: f64| a == b || (a / b).ln().abs() <= limit;
    let sideways_m = (before.position_m().x - now.position_m().x).abs();
    alike(before.height_m, now.height_m, HEIGHT_RATIO_LN)
        && alike(before.width_m, now.width_m, WIDTH_RATIO_LN)
        && sideways_m <= SIDEWAYS_M + SIDEWAYS_SHARE * before.depth_m
}
