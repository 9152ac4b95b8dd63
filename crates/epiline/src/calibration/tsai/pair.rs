//! A pair of cameras by Tsai's method, from views of a flat board.

use nalgebra::{DMatrix, SMatrix, SVector, Vector2};

use super::lens::{TsaiLens, brown_from_tsai};
use super::{Intrinsics, METHOD, Sensor, TsaiCamera, two_stage};
use crate::calibration::homography::{Pinhole, image_center, pose};
use crate::calibration::lens::unpack;
use crate::calibration::solver::{Estimate, Freedom};
use crate::calibration::{BoardView, BundleOptions, CAMERAS, held_out, input, rig, start};
use crate::camera::{CameraModel, Lens, Pose, StereoCalibration};
use crate::error::{Error, Result};

/// Views from which the principal point and sx are solved for too; a single plane does not determine them.
const MIN_VIEWS_FOR_CENTER: usize = 3;

const K: usize = 5;
/// Parameters of a camera behind a Brown lens.
const BROWN: usize = 9;

/// Calibrates a pair of cameras from views of a flat board by Tsai's method.
///
/// Each view of each camera goes through the two stages, with the principal point in the image centre and square
/// pixels; views parallel to the image have no say. The medians of f and kappa1 start a joint minimisation of the
/// reprojection error in Tsai's model over f, kappa1, the principal point and sx of both cameras (with fewer than
/// three views f and kappa1 only), the board poses and the pose between the cameras. The result carries the
/// Brown–Conrady coefficients that do what kappa1 does over the image, and the covariance carried over to them.
/// The distortion model of the options does not apply: it is Tsai's.
///
/// # Errors
///
/// As [`calibrate`](crate::calibration::calibrate); also if no view of a camera passes the two stages.
pub fn calibrate_rig(
    views: &[BoardView],
    image_size: (usize, usize),
    options: &BundleOptions,
) -> Result<StereoCalibration> {
    input::check(views, image_size, 1)?;
    input::check_loss(options.loss)?;
    held_out::fit_and_test(views, options.held_out_folds, |part| fit(part, image_size, options))
}

fn fit(
    views: &[BoardView],
    image_size: (usize, usize),
    options: &BundleOptions,
) -> Result<StereoCalibration> {
    let (left, right) = (Start::of(0, views, image_size)?, Start::of(1, views, image_size)?);
    let right_from_left = start::right_from_left(&left.camera_from_board, &right.camera_from_board)?;
    let poses = [&left.camera_from_board, &right.camera_from_board];
    let estimate = Estimate {
        left_from_board: start::left_from_board(poses[0], poses[1], &right_from_left),
        right_from_left,
        intrinsics: [left.intrinsics, right.intrinsics],
        board_warp_m: Vector2::zeros(),
    };
    let center = views.len() >= MIN_VIEWS_FOR_CENTER;
    let camera = [true, true, center, center, center];
    let free: Vec<bool> = camera.into_iter().chain(camera).chain([true; 6]).chain([false; 2]).collect();
    let fit = rig::fit(&SENSOR, views, estimate, &Freedom::new(&free, &[]), options.loss)?;
    let [left, right] = fit.estimate.intrinsics.map(|intrinsics| Brown::of(&intrinsics, image_size));
    let (left, right) = (left?, right?);
    let covariance = left.covariance_with(&right, &fit.covariance);
    rig::finish(fit, left.camera, right.camera, covariance)
}

/// Lengths on the sensor are counted in pixels: only f and kappa1 depend on the pitch.
const SENSOR: TsaiLens = TsaiLens { dpx_mm: 1.0, dpy_mm: 1.0 };

/// Where the joint minimisation starts.
struct Start {
    intrinsics: Intrinsics,
    camera_from_board: Vec<Option<Pose>>,
}

impl Start {
    fn of(side: usize, views: &[BoardView], image_size: (usize, usize)) -> Result<Self> {
        let name = CAMERAS[side];
        let [cx, cy] = image_center(image_size);
        let sensor = Sensor { dpx_mm: SENSOR.dpx_mm, dpy_mm: SENSOR.dpy_mm, cx, cy, sx: 1.0 };
        let seen = start::seen_by(side, views);
        let homographies = start::homographies(name, &seen)?;
        let (mut cameras, mut refusal) = (Vec::new(), None);
        for view in &seen {
            let world_mm: Vec<[f64; 3]> = view.board_m.iter().map(|p| p.map(|v| v * 1e3)).collect();
            match two_stage(&world_mm, &view.pixels, &sensor) {
                Ok(view) => cameras.push(view.camera),
                Err(error) => refusal = Some(error),
            }
        }
        let median = |of: fn(&TsaiCamera) -> f64| {
            let mut values: Vec<f64> = cameras.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied()
        };
        let Some((f, kappa1)) = median(|c| c.f_mm).zip(median(|c| c.kappa1)) else {
            let reason = refusal.map_or_else(String::new, |error| format!("; the last: {error}"));
            return Err(Error::degenerate(
                METHOD,
                format!("no view of the {name} camera can be used{reason}"),
            ));
        };
        let pinhole = Pinhole { focal_px: [f; 2], center_px: [cx, cy] };
        let mut camera_from_board = vec![None; views.len()];
        for (view, homography) in seen.iter().zip(&homographies) {
            let found = pose(homography, &pinhole).ok_or_else(|| {
                let reason = format!("view {} of the {name} camera has no pose", view.index);
                Error::degenerate(METHOD, reason)
            })?;
            camera_from_board[view.index] = Some(found);
        }
        Ok(Self { intrinsics: SVector::from([f, kappa1, cx, cy, 1.0]), camera_from_board })
    }
}

/// A camera in Brown's model, and how its parameters follow from Tsai's.
struct Brown {
    camera: CameraModel,
    by_tsai: SMatrix<f64, BROWN, K>,
}

impl Brown {
    fn of(intrinsics: &Intrinsics, image_size: (usize, usize)) -> Result<Self> {
        let beyond = || {
            let reason =
                "the lens model folds over inside the image: kappa1 is beyond what Tsai's model can describe";
            Error::degenerate(METHOD, reason)
        };
        let parameters = brown_parameters(intrinsics, image_size).ok_or_else(beyond)?;
        let mut by_tsai = SMatrix::<f64, BROWN, K>::zeros();
        for k in 0..K {
            let step = 1e-5 * intrinsics[k].abs().max(1e-9);
            let at = |sign: f64| {
                let mut moved = *intrinsics;
                moved[k] += sign * step;
                brown_parameters(&moved, image_size).ok_or_else(beyond)
            };
            by_tsai.set_column(k, &((at(1.0)? - at(-1.0)?) / (2.0 * step)));
        }
        let blank = CameraModel {
            focal_px: [1.0; 2],
            center_px: [0.0; 2],
            lens: Lens::default(),
            width: image_size.0,
            height: image_size.1,
        };
        Ok(Self { camera: unpack(&parameters, &blank), by_tsai })
    }

    /// Covariance in the order of [`StereoCalibration::parameter_names`] from that of `left, right` in Tsai's model.
    fn covariance_with(&self, right: &Self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let mut by_tsai = DMatrix::zeros(2 * BROWN + 6, 2 * K + 6);
        by_tsai.view_mut((0, 0), (BROWN, K)).copy_from(&self.by_tsai);
        by_tsai.view_mut((BROWN, K), (BROWN, K)).copy_from(&right.by_tsai);
        by_tsai.view_mut((2 * BROWN, 2 * K), (6, 6)).fill_with_identity();
        &by_tsai * covariance * by_tsai.transpose()
    }
}

/// fx, fy, cx, cy, k1, k2, p1, p2, k3; `None` if the image reaches beyond the barrel limit.
fn brown_parameters(intrinsics: &Intrinsics, (width, height): (usize, usize)) -> Option<SVector<f64, BROWN>> {
    let [f, kappa1, cx, cy, sx] = (*intrinsics).into();
    let far = |c: f64, side: usize| c.max(side as f64 - 1.0 - c);
    let corner = (far(cx, width) / sx).hypot(far(cy, height)) / f;
    let lens = brown_from_tsai(kappa1 * f * f, corner)?;
    Some(SVector::from([f * sx, f, cx, cy, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3]))
}
