//! Whether matches carry an alignment: every way in which they do not, in words.

use nalgebra::Vector2;

use super::consensus::Random;
use super::rig::{ANGLES, Gradient, Lenses, Match, Rig, Unknowns};
use super::solver::Fit;

/// Largest error that a trusted alignment may have somewhere in the view, by its own account, pixels.
const MAX_SIGMA_PX: f64 = 0.5;
/// Largest error that two halves of the matches let expect, which is that of the whole, pixels: its upper tenth, so
/// 1.6 times a sigma.
const MAX_APART_PX: f64 = 1.6 * MAX_SIGMA_PX;
/// Largest median vertical disparity of held-out matches, pixels.
const MAX_HELD_OUT_PX: f64 = 0.5;
/// Fewest matches, and fewest off the dominant plane.
pub(super) const MIN_MATCHES: usize = 30;
const MIN_OFF_PLANE: usize = 12;
/// Least share of the matches found in the aligned images that must lie on their rows.
const MIN_INLIER_SHARE: f64 = 0.5;
/// Least share of matches that must lie in front of both cameras, and the largest that may lie behind beyond the doubt about
/// where infinity is: with unknown lenses that is many pixels.
const MIN_IN_FRONT: f64 = 0.6;
const MAX_SURELY_BEHIND: f64 = 0.1;
/// Rows and columns of the grid on which errors are predicted, and of that on which coverage is counted.
const GRID: usize = 8;
const COVERAGE_GRID: usize = 6;
const MIN_COVERED: f64 = 0.25;

/// Everything that the verdict rests on.
pub(super) struct Evidence<'a> {
    pub lenses: &'a Lenses,
    pub fit: &'a Fit,
    /// Fits to each half of the matches.
    pub halves: [&'a Unknowns; 2],
    /// All matches found, right and wrong.
    pub matches: &'a [Match],
    /// Median vertical disparity of matches that a fit did not see, pixels.
    pub held_out_px: f64,
}

/// The verdict: figures, and the reasons against trusting them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Verdict {
    /// Standard deviation of the vertical disparity that nine tenths of the view stay below, pixels.
    pub sigma_px: f64,
    /// Empty if the alignment can be trusted.
    pub reasons: Vec<String>,
}

pub(super) fn judge(evidence: &Evidence<'_>) -> Verdict {
    let Evidence { lenses, fit, halves, matches, held_out_px } = evidence;
    let rig = lenses.rig(&fit.unknowns);
    let inliers: Vec<&Match> =
        matches.iter().filter(|m| rig.vertical_px(m).is_some_and(|r| r.abs() < fit.cutoff_px)).collect();
    let aligned: Vec<[Vector2<f64>; 2]> =
        inliers.iter().filter_map(|m| rig.align(m)).map(|points| points.map(|p| p * rig.focal_px)).collect();
    let mut reasons = Vec::new();
    if inliers.len() < MIN_MATCHES {
        reasons.push(format!("too few matches: {} (at least {MIN_MATCHES} needed)", inliers.len()));
        return Verdict { sigma_px: f64::NAN, reasons };
    }
    let share = inliers.len() as f64 / matches.len() as f64;
    if share < MIN_INLIER_SHARE {
        reasons.push(format!(
            "only {} of {} matches agree with one pair of cameras: different scenes, or one that repeats itself",
            inliers.len(),
            matches.len()
        ));
    }
    let doubt_px = 2.0 * infinity_sigma_px(lenses, fit, &inliers);
    let share = |condition: &dyn Fn(f64) -> bool| {
        aligned.iter().filter(|[l, r]| condition(l.x - r.x)).count() as f64 / aligned.len() as f64
    };
    let (in_front, surely_behind) = (share(&|d| d > 0.0), share(&|d| d < -doubt_px));
    // Without a lens the infinity of the photographs is unknown; side by side, cameras see things farther left in the
    // right image unless they converge in front of them.
    let mut shifts: Vec<f64> = inliers.iter().map(|[l, r]| l.x - r.x).collect();
    let reversed = lenses.free() > ANGLES && super::median(&mut shifts) <= 0.0;
    if in_front < MAX_SURELY_BEHIND {
        reasons.push("left and right look swapped: the scene would lie behind the cameras".into());
    } else if reversed {
        reasons.push(
            "left and right look swapped, or the cameras converge in front of the scene: only a known lens can tell"
                .into(),
        );
    } else if in_front < MIN_IN_FRONT || surely_behind > MAX_SURELY_BEHIND {
        reasons.push(format!(
            "{:.0} % of the matches would lie behind the cameras: a mirrored picture, or swapped or converging cameras",
            100.0 * (1.0 - in_front)
        ));
    }
    if let Some(reason) = plane_reason(&aligned, fit.sigma_px) {
        reasons.push(reason);
    }
    let covered = coverage(&inliers, lenses.size());
    if covered < MIN_COVERED {
        reasons.push(format!("the matches crowd in {:.0} % of the image", 100.0 * covered));
    }
    if held_out_px.is_nan() || *held_out_px > MAX_HELD_OUT_PX {
        reasons.push(format!(
            "matches that the fit did not see are {held_out_px:.2} px off their rows (at most {MAX_HELD_OUT_PX} px)"
        ));
    }
    let probes = probes(&rig, &aligned, lenses.size());
    let sigma_px = predicted_sigma_px(lenses, fit, &probes);
    if sigma_px.is_nan() || sigma_px > MAX_SIGMA_PX {
        reasons.push(format!(
            "the matches leave rows uncertain by {sigma_px:.2} px in parts of the view (at most {MAX_SIGMA_PX} px)"
        ));
    }
    // The difference of two halves has twice the standard deviation of the whole.
    let apart = 0.5 * difference_px(lenses, *halves, &probes);
    if apart.is_nan() || apart > MAX_APART_PX {
        reasons.push(format!(
            "unstable: halves of the matches give rows {:.2} px apart in parts of the view",
            2.0 * apart
        ));
    }
    Verdict { sigma_px: sigma_px.max(apart / 1.6), reasons }
}

/// Scene points all over the view, as the fit would image them: at every place of a grid, the disparities of the
/// nearest matches.
fn probes(rig: &Rig, aligned: &[[Vector2<f64>; 2]], size: [usize; 2]) -> Vec<Match> {
    const NEAREST: usize = 5;
    let inside = |p: &Vector2<f64>| {
        (0.0..=size[0] as f64 - 1.0).contains(&p.x) && (0.0..=size[1] as f64 - 1.0).contains(&p.y)
    };
    let mut by_distance: Vec<(f64, f64)> = Vec::new();
    let mut probes = Vec::new();
    for i in 0..GRID * GRID {
        let fraction = |k: usize| (k as f64 + 0.5) / GRID as f64;
        let pixel = Vector2::new(fraction(i % GRID) * size[0] as f64, fraction(i / GRID) * size[1] as f64);
        let Some([place, _]) = rig.align(&[pixel, pixel]) else { continue };
        by_distance.clear();
        by_distance.extend(aligned.iter().map(|[l, r]| ((l - place * rig.focal_px).norm(), l.x - r.x)));
        by_distance.sort_by(|a, b| a.0.total_cmp(&b.0));
        let scene_points = by_distance.iter().take(NEAREST);
        let scene_points = scene_points.filter_map(|(_, d)| rig.scene_point(place, d / rig.focal_px));
        probes.extend(scene_points.filter(|[_, right]| inside(right)));
    }
    probes
}

/// What nine tenths of the probes stay below: standard deviation of their vertical disparity, pixels.
fn predicted_sigma_px(lenses: &Lenses, fit: &Fit, probes: &[Match]) -> f64 {
    let rig = lenses.rig(&fit.unknowns);
    let sigma = |points: &Match| {
        let (_, gradient) = lenses.vertical_and_gradient(&rig, points)?;
        Some((gradient * fit.covariance * gradient.transpose())[0].max(0.0).sqrt())
    };
    upper_tenth(probes.iter().filter_map(sigma).collect())
}

/// Standard deviation of the disparity of infinity, pixels: of where a match lies along its row.
fn infinity_sigma_px(lenses: &Lenses, fit: &Fit, inliers: &[&Match]) -> f64 {
    let step = lenses.prior().sigma * 1e-4;
    let disparity = |unknowns: &Unknowns, points: &Match| {
        let rig = lenses.rig(unknowns);
        rig.align(points).map(|[l, r]| rig.focal_px * (l.x - r.x))
    };
    let sigma = |points: &Match| {
        let mut gradient = Gradient::zeros();
        for i in 0..lenses.free() {
            let [mut below, mut above] = [fit.unknowns; 2];
            (below[i], above[i]) = (below[i] - step[i], above[i] + step[i]);
            gradient[i] = (disparity(&above, points)? - disparity(&below, points)?) / (2.0 * step[i]);
        }
        Some((gradient * fit.covariance * gradient.transpose())[0].max(0.0).sqrt())
    };
    let some = inliers.iter().step_by(inliers.len().div_ceil(20));
    let mut sigmas: Vec<f64> = some.filter_map(|points| sigma(points)).collect();
    super::median(&mut sigmas)
}

/// What nine tenths of the probes stay below: how far apart two rigs put their rows, pixels.
fn difference_px(lenses: &Lenses, rigs: [&Unknowns; 2], probes: &[Match]) -> f64 {
    let [a, b] = rigs.map(|unknowns| lenses.rig(unknowns));
    let apart = |points: &Match| Some((a.vertical_px(points)? - b.vertical_px(points)?).abs());
    upper_tenth(probes.iter().filter_map(apart).collect())
}

fn upper_tenth(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    values[(0.9 * (values.len() - 1) as f64).round() as usize]
}

/// Share of the cells of the left image that hold a match.
fn coverage(inliers: &[&Match], size: [usize; 2]) -> f64 {
    let mut seen = [false; COVERAGE_GRID * COVERAGE_GRID];
    for [left, _] in inliers {
        let cell =
            |v: f64, side: usize| ((v / side as f64 * COVERAGE_GRID as f64) as usize).min(COVERAGE_GRID - 1);
        seen[cell(left.y, size[1]) * COVERAGE_GRID + cell(left.x, size[0])] = true;
    }
    seen.iter().filter(|&&s| s).count() as f64 / seen.len() as f64
}

/// In an aligned pair the disparity of a plane is linear in the image position, and so is that of a camera which only
/// turned. `None` if enough matches lie off the plane that most lie on, and bear each other out.
fn plane_reason(aligned: &[[Vector2<f64>; 2]], sigma_px: f64) -> Option<String> {
    const SAMPLES: usize = 300;
    let tolerance = (4.0 * sigma_px).max(1.0);
    let disparity = |i: usize| aligned[i][0].x - aligned[i][1].x;
    let mut random = Random(1);
    let mut best: (usize, Option<nalgebra::Vector3<f64>>) = (0, None);
    for _ in 0..SAMPLES {
        let sample: [usize; 3] = std::array::from_fn(|_| random.below(aligned.len()));
        let system = nalgebra::Matrix3::from_fn(|r, c| if c == 2 { 1.0 } else { aligned[sample[r]][0][c] });
        let Some(inverse) = system.try_inverse() else { continue };
        let plane = inverse * nalgebra::Vector3::from(sample.map(disparity));
        let on = (0..aligned.len())
            .filter(|&i| (plane.dot(&aligned[i][0].push(1.0)) - disparity(i)).abs() < tolerance)
            .count();
        if on > best.0 {
            best = (on, Some(plane));
        }
    }
    let plane = best.1?;
    let off: Vec<usize> = (0..aligned.len())
        .filter(|&i| (plane.dot(&aligned[i][0].push(1.0)) - disparity(i)).abs() >= tolerance)
        .collect();
    // A wrong match along its row stands alone; a real surface has neighbours of like disparity.
    let borne_out = |&i: &usize| {
        let support = off.iter().filter(|&&j| {
            let apart = (aligned[i][0] - aligned[j][0]).norm();
            j != i && apart < 60.0 && (disparity(i) - disparity(j)).abs() < 2.0 + 0.05 * apart
        });
        support.count() >= 2
    };
    let supported = off.iter().filter(|i| borne_out(i)).count();
    (supported < MIN_OFF_PLANE).then(|| {
        format!(
            "one plane explains the matches ({supported} of {} lie off it): a flat scene, a camera that only \
             turned, or one picture twice",
            aligned.len()
        )
    })
}
