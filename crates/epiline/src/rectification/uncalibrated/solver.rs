//! Most probable rig for given matches: robust least squares with priors.

use nalgebra::{Cholesky, SMatrix};

use super::rig::{Lenses, Match, Prior, UNKNOWNS, Unknowns};

type Square = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// Where a minimisation ended.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub unknowns: Unknowns,
    /// Standard deviation of an inlier's vertical residual, pixels.
    pub sigma_px: f64,
    /// Residuals farther from zero than this count for nothing, pixels.
    pub cutoff_px: f64,
    /// Posterior covariance of the unknowns.
    pub covariance: Square,
}

/// Rounds of the robust fit; in each the cutoff follows the residuals' spread.
const ROUNDS: usize = 12;
const STEPS_PER_ROUND: usize = 3;
/// A round that moves no unknown by more than this share of its prior's sigma is the last.
const SETTLED: f64 = 1e-5;
/// A residual of this many standard deviations no longer counts.
const CUTOFF_SIGMAS: f64 = 4.0;
/// No match is known better than this, pixels: the floor under the noise that the residuals show.
const LEAST_SIGMA_PX: f64 = 0.05;

/// Tukey's biweight: `(1 - (r/cutoff)²)²` inside the cutoff, 0 outside.
fn weight(residual: f64, cutoff: f64) -> f64 {
    let t = residual / cutoff;
    if t.abs() >= 1.0 { 0.0 } else { (1.0 - t * t).powi(2) }
}

/// Fits from `start`, first with residuals up to `cutoff_px` counting, then with ever fewer until the cutoff is
/// that of the noise the inliers show.
pub(super) fn fit(lenses: &Lenses, matches: &[Match], start: &Unknowns, cutoff_px: f64) -> Fit {
    let prior = lenses.prior();
    let mut unknowns = *start;
    let mut cutoff = cutoff_px;
    let mut sigma = cutoff_px / CUTOFF_SIGMAS;
    for _ in 0..ROUNDS {
        let before = (unknowns, cutoff);
        for _ in 0..STEPS_PER_ROUND {
            unknowns = step(lenses, &prior, matches, &unknowns, sigma, cutoff);
        }
        let rig = lenses.rig(&unknowns);
        let mut inside: Vec<f64> = matches
            .iter()
            .filter_map(|points| rig.vertical_px(points))
            .map(f64::abs)
            .filter(|r| *r < cutoff)
            .collect();
        if inside.is_empty() {
            break;
        }
        let spread = 1.4826 * super::median(&mut inside);
        sigma = spread.max(LEAST_SIGMA_PX);
        // No faster than by half: a cutoff that runs ahead of the fit locks onto a part of the matches.
        cutoff = (CUTOFF_SIGMAS * sigma).clamp(0.5 * cutoff, cutoff);
        let change = (unknowns - before.0).component_div(&prior.sigma).abs().max();
        if change < SETTLED && cutoff > 0.99 * before.1 {
            break;
        }
    }
    let (normal, _) = normal_equations(lenses, &prior, matches, &unknowns, sigma, cutoff);
    let covariance = Cholesky::new(normal)
        .map_or_else(|| Square::from_diagonal(&prior.sigma.map(|s| s * s)), |c| c.inverse());
    Fit { unknowns, sigma_px: sigma, cutoff_px: cutoff, covariance }
}

/// The most probable of the fits from several starts, of which there is at least one.
pub(super) fn fit_best(lenses: &Lenses, matches: &[Match], starts: &[Unknowns], cutoff_px: f64) -> Fit {
    let fits: Vec<Fit> = starts.iter().map(|start| fit(lenses, matches, start, cutoff_px)).collect();
    // Compared at one noise, the least that any of them claims.
    let sigma = fits.iter().map(|fit| fit.sigma_px).fold(f64::INFINITY, f64::min);
    let prior = lenses.prior();
    let cost_of = |fit: &Fit| cost(lenses, &prior, matches, &fit.unknowns, sigma, CUTOFF_SIGMAS * sigma);
    let best = fits.into_iter().min_by(|a, b| cost_of(a).total_cmp(&cost_of(b)));
    best.expect("at least one start")
}

/// Angles that put a few matches on rows, the lenses held; for samples of which most are wrong.
pub(super) fn fit_sample(lenses: &Lenses, sample: &[Match], start: &Unknowns) -> Unknowns {
    let prior = lenses.prior();
    let mut unknowns = *start;
    for _ in 0..4 {
        let (mut normal, mut descent) =
            normal_equations(lenses, &prior, sample, &unknowns, 1.0, f64::INFINITY);
        hold(&mut normal, &mut descent, super::rig::ANGLES);
        if let Some(change) = Cholesky::new(normal).map(|c| c.solve(&descent)) {
            unknowns += change;
        }
    }
    unknowns
}

fn step(
    lenses: &Lenses,
    prior: &Prior,
    matches: &[Match],
    unknowns: &Unknowns,
    sigma: f64,
    cutoff: f64,
) -> Unknowns {
    let (mut normal, mut descent) = normal_equations(lenses, prior, matches, unknowns, sigma, cutoff);
    hold(&mut normal, &mut descent, lenses.free());
    let before = cost(lenses, prior, matches, unknowns, sigma, cutoff);
    let mut damping = 1e-6;
    while damping < 1e6 {
        let mut damped = normal;
        for i in 0..UNKNOWNS {
            damped[(i, i)] *= 1.0 + damping;
        }
        if let Some(change) = Cholesky::new(damped).map(|c| c.solve(&descent)) {
            let moved = unknowns + change;
            if cost(lenses, prior, matches, &moved, sigma, cutoff) <= before {
                return moved;
            }
        }
        damping *= 30.0;
    }
    *unknowns
}

/// Keeps all unknowns from `free` on where they are.
fn hold(normal: &mut Square, descent: &mut Unknowns, free: usize) {
    for i in free..UNKNOWNS {
        normal.row_mut(i).fill(0.0);
        normal.column_mut(i).fill(0.0);
        normal[(i, i)] = 1.0;
        descent[i] = 0.0;
    }
}

fn normal_equations(
    lenses: &Lenses,
    prior: &Prior,
    matches: &[Match],
    unknowns: &Unknowns,
    sigma: f64,
    cutoff: f64,
) -> (Square, Unknowns) {
    let information = prior.sigma.map(|s| 1.0 / (s * s));
    let mut normal = Square::from_diagonal(&information);
    let mut descent = (prior.mean - unknowns).component_mul(&information);
    let rig = lenses.rig(unknowns);
    for points in matches {
        let Some((residual, gradient)) = lenses.vertical_and_gradient(&rig, points) else { continue };
        let w = weight(residual, cutoff) / (sigma * sigma);
        if w > 0.0 {
            normal += gradient.transpose() * gradient * w;
            descent -= gradient.transpose() * (residual * w);
        }
    }
    (normal, descent)
}

/// Minus the logarithm of the posterior: Tukey's biweight on the residuals, normal priors.
pub(super) fn cost(
    lenses: &Lenses,
    prior: &Prior,
    matches: &[Match],
    unknowns: &Unknowns,
    sigma: f64,
    cutoff: f64,
) -> f64 {
    let from_prior = (unknowns - prior.mean).component_div(&prior.sigma).norm_squared();
    let rig = lenses.rig(unknowns);
    let most = cutoff * cutoff / (6.0 * sigma * sigma);
    let of_match = |points: &Match| {
        let t = rig.vertical_px(points).map_or(1.0, |r| (r / cutoff).abs().min(1.0));
        most * (1.0 - (1.0 - t * t).powi(3))
    };
    0.5 * from_prior + matches.iter().map(of_match).sum::<f64>()
}
