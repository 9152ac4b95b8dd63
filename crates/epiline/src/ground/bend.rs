//! The plane before a bend.
//!
//! Where the ground ahead has another slope than where the camera stands, as a ramp has, one plane for both would be
//! neither. What lies beyond is then given a slope of its own, which meets the plane in a line across:
//!
//! ```text
//! seen = p                       before the bend, p >= p_bend
//! seen = p + c·(1 - p/p_bend)    beyond it, with c = slope·f·b/h
//! ```
//!
//! As `p` is linear in the image, so is either part, and the least squares fit of the plane and `c` for a bend in any
//! row comes from the sums over the rows beyond it. The bend that explains the most is taken, if it is one of a ramp
//! and many more samples lie on it than on the plane without.

use nalgebra::{Matrix3, Vector3};

use super::plane_fit::{DisparityPlane, FittedPlane};
use super::samples::{COLUMNS, Samples};
use super::sums::{Bend, Round, Sums, total};

/// Slopes, per metre ahead, that a bend may have: what is less is fitted together, what is more is an obstacle.
const SLOPES: (f64, f64) = (0.03, 0.17);
/// The least it must be off at infinity, px: matchers see a level floor a little bent.
const MIN_BY_PX: f64 = 0.6;
/// So many times as many samples beyond it must lie on the ground with its bend than without.
const CLEARER: f64 = 1.3;
/// It is looked for roughly, then fitted.
const ROUNDS: [Round; 3] =
    [Round { width: 8.0, step: 4 }, Round { width: 6.0, step: 2 }, Round { width: 4.0, step: 1 }];
/// What lies on the ground beyond it, deviations of disparity.
const ON: Round = ROUNDS[2];

/// Finds bends; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct BendFinder {
    rows: Vec<Far>,
}

/// The sums beyond a row.
#[derive(Debug, Clone, Copy)]
struct Far {
    /// Disparity of the plane in the row.
    at_px: f64,
    weights: Matrix3<f64>,
    off: Vector3<f64>,
}

/// A bend with the plane before it.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    /// By how much the sum of squares is less than without.
    gain: f64,
    bend: Bend,
    change: Vector3<f64>,
    inverse: Matrix3<f64>,
}

impl BendFinder {
    /// The plane before a bend of what was fitted as one, and the bend; `None` without a clear bend. A slope of one is `slope_px` of
    /// disparity at infinity.
    pub fn refit(
        &mut self,
        single: &FittedPlane,
        samples: &Samples,
        slope_px: f64,
        sigma_px: f64,
    ) -> Option<(FittedPlane, Bend)> {
        let mut fitted = *single;
        let mut bend = Bend::NONE;
        for round in ROUNDS {
            let plane = fitted.plane;
            let rows = &mut self.rows;
            rows.clear();
            rows.reserve(samples.rows.len());
            let sums =
                Sums::over(&plane, bend, samples, round.step, round.width_px(sigma_px), |sums, at_px| {
                    // Near the horizon nothing can be told apart from what is far.
                    if at_px > 1.0 {
                        rows.push(Far { at_px, weights: sums.weights, off: sums.off });
                    }
                });
            let inverse = sums.weights.cholesky()?.inverse();
            let candidates = self.rows.iter().filter_map(|far| far.bend(&plane, &sums.off, &inverse));
            let best = candidates.max_by(|one, other| one.gain.total_cmp(&other.gain))?;
            bend = best.bend;
            if !(SLOPES.0..=SLOPES.1).contains(&(bend.by_px.abs() / slope_px)) || bend.by_px.abs() < MIN_BY_PX
            {
                return None;
            }
            fitted.plane = DisparityPlane::from_vector(plane.vector() + best.change);
            fitted.covariance = sums.covariance(&best.inverse, sigma_px);
        }
        let on = |plane, bend| count_beyond(plane, bend, samples, ON.width_px(sigma_px));
        let without = Bend { by_px: 0.0, ..bend };
        (on(&fitted.plane, bend) > CLEARER * on(&single.plane, without)).then_some((fitted, bend))
    }
}

impl Far {
    /// The best bend in this row, and what it changes of the plane; `off` and `inverse` are of all rows.
    fn bend(&self, plane: &DisparityPlane, off: &Vector3<f64>, inverse: &Matrix3<f64>) -> Option<Candidate> {
        // Beyond the row, seen is along·x off the plane for each pixel of c.
        let along = Vector3::z() - plane.vector() / self.at_px;
        let with_plane = self.weights * along;
        let taken = inverse * with_plane;
        // What is left of it, and of what it explains, when the plane has taken its part.
        let left = along.dot(&with_plane) - with_plane.dot(&taken);
        let by_px = (along.dot(&self.off) - taken.dot(off)) / left;
        (left > 0.0).then(|| Candidate {
            gain: by_px * by_px * left,
            bend: Bend { at_px: self.at_px, by_px },
            change: inverse * off - taken * by_px,
            inverse: inverse + taken * taken.transpose() / left,
        })
    }
}

/// How many samples beyond a bend lie on what is there.
fn count_beyond(plane: &DisparityPlane, bend: Bend, samples: &Samples, tolerance_px: f32) -> f64 {
    let (by_u, at_px) = (plane.by_u as f32, bend.at_px as f32);
    let (bend_px, per_bend) = (bend.by_px as f32, 1.0 / at_px);
    let mut counts = [0.0_f32; COLUMNS];
    for (row, at_u0) in samples.rows_of(plane, 1) {
        for (column, count) in counts.iter_mut().enumerate() {
            let plane_px = at_u0 + by_u * samples.u[column];
            let off_px = row.seen_px[column] - plane_px - bend_px * (1.0 - plane_px * per_bend);
            let is_on = (plane_px < at_px) & (plane_px > 0.0) & (off_px.abs() < tolerance_px);
            *count += if is_on { 1.0 } else { 0.0 };
        }
    }
    total(counts)
}
