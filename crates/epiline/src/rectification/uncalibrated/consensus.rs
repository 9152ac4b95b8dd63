//! A first rig from matches of which many are wrong.

use nalgebra::Vector3;

use super::rig::{Lenses, Match, Rig, Unknowns};
use super::solver::fit_sample;

/// Matches of a sample: one more than the angles, so that a wrong one shows.
const SAMPLE: usize = 6;
const SAMPLES: usize = 300;
/// A match within this of its row agrees, for images 640 pixels wide.
pub(super) const TOLERANCE_PX: f64 = 2.0;

/// Unknowns that a sample of matches proposed, and how well all agree with them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Proposal {
    pub unknowns: Unknowns,
    /// Sum over all matches of `1 - (r/tolerance)²` where positive.
    pub score: f64,
}

/// The best proposal of every start, best first: random samples (Fischler & Bolles, 1981) scored as by
/// Torr & Zisserman, "MLESAC", 2000. The samples are the same for the same matches.
pub(super) fn propose(lenses: &Lenses, matches: &[Match], tolerance_px: f64) -> Vec<Proposal> {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let samples: Vec<[Match; SAMPLE]> =
        (0..SAMPLES).map(|_| std::array::from_fn(|_| matches[random.below(matches.len())])).collect();
    let mut best: Vec<Proposal> = lenses
        .starts()
        .iter()
        .filter_map(|start| {
            // A sample turns the cameras and leaves the lenses, so rays are made once.
            let rig = lenses.rig(start);
            let rays: Vec<_> = matches.iter().filter_map(|points| rig.rays(points)).collect();
            let proposals = samples.iter().map(|sample| {
                let unknowns = fit_sample(lenses, sample, start);
                Proposal { unknowns, score: score(&lenses.rig(&unknowns), &rays, tolerance_px) }
            });
            proposals.max_by(|a, b| a.score.total_cmp(&b.score))
        })
        .collect();
    best.sort_by(|a, b| b.score.total_cmp(&a.score));
    best
}

fn score(rig: &Rig, rays: &[[Vector3<f64>; 2]], tolerance_px: f64) -> f64 {
    let of_match = |rays| {
        let [left, right] = rig.align_rays(rays)?;
        let t = rig.focal_px * (right.y - left.y) / tolerance_px;
        Some((1.0 - t * t).max(0.0))
    };
    rays.iter().filter_map(of_match).sum()
}

/// A linear congruential generator (Knuth's constants): reproducible on every machine.
pub(super) struct Random(pub u64);

impl Random {
    /// A whole number below `count`, which is not 0.
    pub fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % count
    }
}
