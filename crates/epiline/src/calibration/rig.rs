//! The joint fit of both cameras, whatever their lens model, and the verdict on it.

use nalgebra::{DMatrix, Vector2};

use super::input::MIN_CORNERS;
use super::lens::Lens;
use super::solver::{Bundle, Estimate, Freedom, Huber, Minimum, View};
use super::{BoardView, CAMERAS, Loss};
use crate::camera::{AlignedFrame, BoardWarp, CameraModel, Outlier, Pose, StereoCalibration, ViewResidual};
use crate::error::{Error, Result};

/// Costs that differ by less than this part of themselves are one minimum.
const TOLERANCE: f64 = 1e-12;

/// A corner's noise that a calibration must at least be able to cope with, pixels.
///
/// Whether views determine the focal length is judged with it, so that noise-free corners of a bad set of views
/// are refused like noisy ones.
const TYPICAL_NOISE_PX: f64 = 0.1;

/// The largest standard deviation of a focal length, relative to it, that is an answer at all.
const MAX_FOCAL_SIGMA: f64 = 0.05;

/// Intrinsic parameters of a camera beyond which a lens model may ask too much of ordinary views: those of Brown's.
const MODEST_LENS: usize = 9;

/// A rig in the parameters of its lens model.
pub(super) struct RigFit<const K: usize> {
    pub estimate: Estimate<K>,
    /// Of left intrinsics, right intrinsics, rotation, translation: `2K + 6` square.
    pub covariance: DMatrix<f64>,
    /// Of the board's two warps, metres; `None` if they were not solved for.
    pub warp_sigma_m: Option<[f64; 2]>,
    /// Corners left out.
    pub outliers: Vec<Outlier>,
    /// Over all other corners of both cameras.
    pub rms_px: f64,
    /// Left and right rms of each view, pixels; NaN where a camera saw nothing.
    pub view_rms_px: Vec<[f64; 2]>,
}

/// Borrows the views as the solver takes them.
pub(super) fn solver_views(views: &[BoardView]) -> Vec<View<'_>> {
    views.iter().map(|v| View { board_m: &v.board_m, pixels: [&v.left_px, &v.right_px] }).collect()
}

/// Fits everything jointly from a start, without corners that turn out to be mis-found.
///
/// What is left out is judged anew after each fit, from all corners, until it stays the same: a corner that only a
/// first, bent fit put far off comes back.
pub(super) fn fit<L: Lens<K>, const K: usize>(
    lens: &L,
    views: &[BoardView],
    start: Estimate<K>,
    freedom: &Freedom,
    loss: Loss,
) -> Result<RigFit<K>> {
    const MAX_ROUNDS: usize = 10;
    let everything = solver_views(views);
    let all = Bundle::new(lens, &everything, freedom);
    let mut kept = views.to_vec();
    let mut outliers = Vec::new();
    let mut estimate = start;
    for _ in 0..MAX_ROUNDS {
        let (minimum, _) = minimise(&Bundle::new(lens, &solver_views(&kept), freedom), estimate, loss);
        estimate = minimum.estimate;
        let Loss::Huber { outlier_sigmas, .. } = loss else { break };
        let found = outliers_of(&all, &estimate, outlier_sigmas);
        let same = found.iter().map(Outlier::place).eq(outliers.iter().map(Outlier::place));
        outliers = found;
        if same {
            break;
        }
        kept = without(views, &outliers);
    }
    let seen = solver_views(&kept);
    conclude(&Bundle::new(lens, &seen, freedom), estimate, loss, outliers)
}

/// The last minimisation, and how certain it is.
fn conclude<L: Lens<K>, const K: usize>(
    bundle: &Bundle<'_, L, K>,
    start: Estimate<K>,
    loss: Loss,
    outliers: Vec<Outlier>,
) -> Result<RigFit<K>> {
    let (minimum, huber) = minimise(bundle, start, loss);
    let Minimum { estimate, converged } = minimum;
    let undetermined = || Error::degenerate("calibration", undetermined_reason(&estimate.left_from_board, K));
    // A valley without a bottom also ends as "not converged"; its cause is the more useful message.
    let (mut covariance, _) = bundle.inverse_normals(&estimate).ok_or_else(undetermined)?;
    for (camera, intrinsics) in estimate.intrinsics.iter().enumerate() {
        let focal_px = intrinsics[0];
        let variance = covariance[(camera * K, camera * K)];
        if focal_px <= 0.0 || TYPICAL_NOISE_PX * variance.sqrt() > MAX_FOCAL_SIGMA * focal_px {
            return Err(undetermined());
        }
    }
    if !converged {
        let reason = "the fit did not converge; are the corners of both cameras listed in the same order, \
                      and is each view one moment?";
        return Err(Error::degenerate("calibration", reason));
    }
    let residuals = Residuals::of(bundle, &estimate, huber).ok_or_else(undetermined)?;
    covariance *= residuals.variance(bundle.parameter_count());
    let warp = [2 * K + 6, 2 * K + 7].map(|i| covariance[(i, i)].max(0.0).sqrt());
    Ok(RigFit {
        rms_px: residuals.rms_px(),
        view_rms_px: residuals.view_rms_px(),
        estimate,
        covariance: covariance.resize(2 * K + 6, 2 * K + 6, 0.0),
        warp_sigma_m: (warp[0] > 0.0).then_some(warp),
        outliers,
    })
}

/// Corners far off their prediction for their photograph's noise and that of all of them.
fn outliers_of<L: Lens<K>, const K: usize>(
    bundle: &Bundle<'_, L, K>,
    estimate: &Estimate<K>,
    outlier_sigmas: f64,
) -> Vec<Outlier> {
    let mut photographs = vec![[Vec::new(), Vec::new()]; estimate.left_from_board.len()];
    let visit = |view: usize, camera: usize, corner: usize, residual: Vector2<f64>| {
        photographs[view][camera].push((corner, residual.norm()));
    };
    if bundle.visit_residuals(estimate, visit).is_none() {
        return Vec::new();
    }
    let noise_of_all = spread_px(photographs.iter().flatten().flatten().map(|(_, length)| *length));
    let mut outliers = Vec::new();
    for (view, cameras) in photographs.iter().enumerate() {
        for (camera, corners) in cameras.iter().enumerate() {
            let sigma_px = noise_of_all.max(spread_px(corners.iter().map(|(_, length)| *length)));
            let far = corners.iter().filter(|(_, length)| *length > outlier_sigmas * sigma_px);
            let far: Vec<Outlier> = far
                .map(|&(corner, residual_px)| Outlier {
                    view,
                    side: CAMERAS[camera],
                    corner,
                    residual_px,
                    sigma_px,
                })
                .collect();
            // A photograph of which next to nothing would be left is another matter than a stray corner.
            if corners.len() - far.len() >= MIN_CORNERS {
                outliers.extend(far);
            }
        }
    }
    outliers
}

/// The views with some corners unseen.
fn without(views: &[BoardView], outliers: &[Outlier]) -> Vec<BoardView> {
    let mut kept = views.to_vec();
    for outlier in outliers {
        let view = &mut kept[outlier.view];
        let pixels = if outlier.side == CAMERAS[0] { &mut view.left_px } else { &mut view.right_px };
        pixels[outlier.corner] = [f64::NAN; 2];
    }
    kept
}

/// Minimises, re-reading the noise from the residuals until the Huber threshold has settled.
fn minimise<L: Lens<K>, const K: usize>(
    bundle: &Bundle<'_, L, K>,
    start: Estimate<K>,
    loss: Loss,
) -> (Minimum<K>, Huber) {
    const MAX_ROUNDS: usize = 12;
    let Loss::Huber { sigmas, .. } = loss else {
        return (bundle.minimise(start, Huber::SQUARED, TOLERANCE), Huber::SQUARED);
    };
    let threshold = |estimate: &Estimate<K>| Huber { threshold_px: sigmas * noise_px(bundle, estimate) };
    let mut huber = threshold(&start);
    let mut minimum = Minimum { estimate: start, converged: false };
    for _ in 0..MAX_ROUNDS {
        minimum = bundle.minimise(minimum.estimate, huber, TOLERANCE);
        let next = threshold(&minimum.estimate);
        if (next.threshold_px - huber.threshold_px).abs() <= 1e-3 * huber.threshold_px {
            break;
        }
        huber = next;
    }
    (minimum, huber)
}

/// Standard deviation of one coordinate of a corner; infinite where a corner has no image.
fn noise_px<L: Lens<K>, const K: usize>(bundle: &Bundle<'_, L, K>, estimate: &Estimate<K>) -> f64 {
    let mut lengths = Vec::new();
    match bundle.visit_residuals(estimate, |_, _, _, residual| lengths.push(residual.norm())) {
        Some(()) => spread_px(lengths.into_iter()),
        None => f64::INFINITY,
    }
}

/// Standard deviation of one coordinate, from the median length of residuals.
fn spread_px(lengths: impl Iterator<Item = f64>) -> f64 {
    /// Median of the Rayleigh distribution, which the length of a Gaussian 2-vector has.
    const RAYLEIGH_MEDIAN: f64 = 1.177_410_022_515_474_7;
    // Corners are never known better; it keeps the threshold of noise-free corners off rounding errors.
    const FLOOR_PX: f64 = 1e-3;
    let mut lengths: Vec<f64> = lengths.collect();
    if lengths.is_empty() {
        return FLOOR_PX;
    }
    let middle = lengths.len() / 2;
    let (_, median, _) = lengths.select_nth_unstable_by(middle, f64::total_cmp);
    (*median / RAYLEIGH_MEDIAN).max(FLOOR_PX)
}

/// Sums over the residuals at the minimum.
struct Residuals {
    /// Per view and camera: (sum of squares px², corners).
    views: Vec<[(f64, usize); 2]>,
    /// Sum of `|ψ|²`, px².
    influence: f64,
    /// Sum over corners of the mean slope of ψ.
    slope: f64,
}

impl Residuals {
    fn of<L: Lens<K>, const K: usize>(
        bundle: &Bundle<'_, L, K>,
        estimate: &Estimate<K>,
        huber: Huber,
    ) -> Option<Self> {
        let mut sums =
            Self { views: vec![[(0.0, 0); 2]; estimate.left_from_board.len()], influence: 0.0, slope: 0.0 };
        bundle.visit_residuals(estimate, |view, camera, _, residual| {
            let squared = residual.norm_squared();
            let sum = &mut sums.views[view][camera];
            *sum = (sum.0 + squared, sum.1 + 1);
            let clipped = huber.threshold_px / squared.sqrt();
            if clipped < 1.0 {
                // ψ = c r/|r|: its length is c, its divergence in the plane c/|r|, half of that per coordinate.
                sums.influence += huber.threshold_px * huber.threshold_px;
                sums.slope += 0.5 * clipped;
            } else {
                sums.influence += squared;
                sums.slope += 1.0;
            }
        })?;
        Some(sums)
    }

    fn corners(&self) -> usize {
        self.views.iter().flatten().map(|(_, corners)| corners).sum()
    }

    fn rms_px(&self) -> f64 {
        let sum: f64 = self.views.iter().flatten().map(|(sum, _)| sum).sum();
        (sum / self.corners() as f64).sqrt()
    }

    fn view_rms_px(&self) -> Vec<[f64; 2]> {
        self.views.iter().map(|cameras| cameras.map(|(sum, corners)| (sum / corners as f64).sqrt())).collect()
    }

    /// Variance of one coordinate that scales the inverse normal equations of an M-estimate
    /// (Huber, "Robust Statistics", 1981, ch. 7); the usual residual variance where no corner was clipped.
    fn variance(&self, parameters: usize) -> f64 {
        let corners = self.corners() as f64;
        let freedom = (2.0 * corners - parameters as f64).max(1.0);
        let mean_slope = self.slope / corners;
        self.influence / freedom / (mean_slope * mean_slope)
    }
}

fn undetermined_reason(camera_from_board: &[Pose], intrinsics: usize) -> String {
    let tilt = |pose: &Pose| pose.rotation[(2, 2)].abs().min(1.0).acos().to_degrees();
    let largest = camera_from_board.iter().map(tilt).fold(0.0, f64::max);
    if largest < 5.0 {
        format!(
            "all boards are parallel to the image plane (largest tilt {largest:.1} degrees), which leaves focal \
             length and distance inseparable; tilt the board by 30 degrees or more, in different directions"
        )
    } else if intrinsics > MODEST_LENS {
        "the views do not determine all coefficients of this lens model; take a simpler one, or more views that fill \
         the image to its corners"
            .to_owned()
    } else {
        "the views do not determine the focal length; tilt the board by 30 degrees or more, in different directions, \
         and fill the image with it"
            .to_owned()
    }
}

/// Fails, naming the tilt, if the boards of a start are all parallel to the image plane.
pub(super) fn require_tilt(camera_from_board: &[Pose]) -> Result<()> {
    const SINE_OF_1_DEGREE: f64 = 0.017;
    let tilted = |pose: &Pose| pose.rotation.column(2).xy().norm() > SINE_OF_1_DEGREE;
    if camera_from_board.iter().any(tilted) {
        return Ok(());
    }
    Err(Error::degenerate("calibration", undetermined_reason(camera_from_board, 0)))
}

/// Makes the public result, unless it is one that no pair of cameras with the left one on the left can have.
pub(super) fn finish<const K: usize>(
    fit: RigFit<K>,
    left: CameraModel,
    right: CameraModel,
    covariance: DMatrix<f64>,
) -> Result<StereoCalibration> {
    let views = fit
        .estimate
        .left_from_board
        .iter()
        .zip(&fit.view_rms_px)
        .map(|(pose, [left_rms_px, right_rms_px])| ViewResidual {
            left_rms_px: *left_rms_px,
            right_rms_px: *right_rms_px,
            left_from_board: *pose,
        })
        .collect();
    let calibration = StereoCalibration {
        left,
        right,
        right_from_left: fit.estimate.right_from_left,
        rms_px: fit.rms_px,
        epipolar_error_px: f64::NAN,
        covariance: Some(covariance),
        views,
        outliers: fit.outliers,
        board_warp: fit
            .warp_sigma_m
            .map(|sigma_m| BoardWarp { height_m: fit.estimate.board_warp_m.into(), sigma_m }),
    };
    calibration.validate()?;
    require_consistent_views(&fit.view_rms_px)?;
    require_plausible(&calibration)?;
    Ok(calibration)
}

/// A view whose grid was found from the other end, or not at all, is far from all others.
fn require_consistent_views(view_rms_px: &[[f64; 2]]) -> Result<()> {
    let mut worst: Vec<f64> = view_rms_px.iter().map(|[left, right]| left.max(*right)).collect();
    let (view, rms_px) =
        worst.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
    let middle = worst.len() / 2;
    let median_px = *worst.select_nth_unstable_by(middle, f64::total_cmp).1;
    if rms_px > 5.0 && rms_px > 10.0 * median_px {
        return Err(Error::degenerate(
            "calibration",
            format!(
                "view {view} (counting from 0) does not fit the others: rms {rms_px:.1} px against a median of \
                 {median_px:.2} px; its corners are mis-found or listed from the other end of the board in one camera"
            ),
        ));
    }
    Ok(())
}

fn require_plausible(calibration: &StereoCalibration) -> Result<()> {
    let unrealistic = |reason: String| Err(Error::degenerate("calibration", reason));
    for (side, camera) in [("left", &calibration.left), ("right", &calibration.right)] {
        let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.center_px);
        let (width, height) = (camera.width as f64, camera.height as f64);
        let ratio = fx / width.max(height);
        if !(0.1..=100.0).contains(&ratio) {
            return unrealistic(format!(
                "the {side} focal length came out as {fx:.1} px for an image of {width}x{height} px, which no \
                 ordinary lens has"
            ));
        }
        if !(0.5..=2.0).contains(&(fy / fx)) {
            return unrealistic(format!(
                "the {side} focal lengths came out as fx = {fx:.1} px and fy = {fy:.1} px; is the board's number of \
                 columns and rows right, and its spacing equal in both directions?"
            ));
        }
        if !((-0.25 * width..1.25 * width).contains(&cx) && (-0.25 * height..1.25 * height).contains(&cy)) {
            return unrealistic(format!(
                "the {side} principal point came out at ({cx:.1}, {cy:.1}) px, outside the {width}x{height} px image; \
                 tilt the board more and show it in all parts of the image"
            ));
        }
    }
    let diagonal_px = (calibration.left.width as f64).hypot(calibration.left.height as f64);
    if calibration.rms_px > 0.01 * diagonal_px {
        return unrealistic(format!(
            "the corners miss their predictions by {:.1} px rms; are both lists in the same order, and the number of \
             columns and rows right?",
            calibration.rms_px
        ));
    }
    let turn = calibration.right_from_left.angle_rad();
    if turn > 60_f64.to_radians() {
        return unrealistic(format!(
            "the cameras came out turned by {:.0} degrees against each other; the right corners are probably listed \
             from the other end of the board",
            turn.to_degrees()
        ));
    }
    let baseline_m = calibration.baseline_m();
    if baseline_m > 20.0 {
        return unrealistic(format!(
            "the cameras came out {baseline_m:.1} m apart; board_m is in metres, were millimetres given?"
        ));
    }
    AlignedFrame::of(&calibration.right_from_left).map(|_| ())
}
