//! From corners to a calibrated pair; Tsai's method for one camera.

use epiline::Error;
use epiline::calibration::tsai::{self, Sensor, TsaiCalibration, TsaiCamera, TsaiSigma};
use epiline::calibration::{self, BoardView, BundleOptions, LensModel, Loss};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::camera::{PyStereoCalibration, matrix_array};
use crate::convert::{OrRaise, rows_of, whole};

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(calibrate_points, module)?)?;
    module.add_function(wrap_pyfunction!(tsai_calibrate, module)?)
}

/// The value that a word stands for, or a ValueError with the choices.
fn choice<T: Copy>(name: &'static str, word: &str, choices: &[(&str, T)]) -> PyResult<T> {
    choices.iter().find(|(key, _)| *key == word).map(|(_, value)| *value).ok_or_else(|| {
        let words: Vec<_> = choices.iter().map(|(key, _)| format!("\"{key}\"")).collect();
        PyValueError::new_err(format!("{name} = \"{word}\": expected {}", words.join(" or ")))
    })
}

#[derive(Clone, Copy)]
enum Method {
    Bundle,
    Tsai,
}

/// Calibrates a pair of cameras from corners of a flat board.
///
/// Parameters
/// ----------
/// left_px, right_px : sequence of (N, 2) array_like
///     Per view, where each camera saw the corners, pixels.
/// board_m : sequence of (N, 3) array_like
///     Per view, where they are on the board, metres; z = 0.
/// image_size : (int, int)
///     Width and height of both cameras' images, pixels.
/// method : {"bundle", "tsai"}
///     Bundle adjustment, or Tsai's two-stage method started view by view (one radial coefficient).
/// model : {"brown4", "brown5"}
///     Distortion of the bundle adjustment: k1 k2 p1 p2, or with k3.
/// loss : {"huber", "squared"}
///     Huber's loss forgives a mis-found corner; the squared loss is what other systems minimise.
/// held_out : bool
///     Also fit parts of the views and measure the rest: fills ``epipolar_error_px``.
///
/// Returns
/// -------
/// StereoCalibration
///
/// Raises
/// ------
/// ValueError
///     Lists that do not belong together, a corner that is not finite or outside the image, too few of them.
/// epiline.Error
///     The views do not determine the cameras, or the cameras are swapped, with the reason.
#[pyfunction]
#[pyo3(signature = (left_px, right_px, board_m, image_size, *, method="bundle", model="brown4", loss="huber", held_out=true))]
#[expect(clippy::too_many_arguments, reason = "the keyword arguments of the Python function")]
fn calibrate_points(
    py: Python<'_>,
    left_px: Vec<Bound<'_, PyAny>>,
    right_px: Vec<Bound<'_, PyAny>>,
    board_m: Vec<Bound<'_, PyAny>>,
    image_size: (i64, i64),
    method: &str,
    model: &str,
    loss: &str,
    held_out: bool,
) -> PyResult<PyStereoCalibration> {
    let image_size = (whole("image_size", image_size.0)?, whole("image_size", image_size.1)?);
    let method = choice("method", method, &[("bundle", Method::Bundle), ("tsai", Method::Tsai)])?;
    let lens = choice("model", model, &[("brown4", LensModel::Brown4), ("brown5", LensModel::Brown5)])?;
    let loss = choice("loss", loss, &[("huber", Loss::default()), ("squared", Loss::Squared)])?;
    let folds = if held_out { BundleOptions::default().held_out_folds } else { 0 };
    let options = BundleOptions { lens, loss, held_out_folds: folds };
    for (name, list) in [("left_px", &left_px), ("right_px", &right_px)] {
        if list.len() != board_m.len() {
            let expected = format!("board_m has {} views; the lists must have one length", board_m.len());
            return Err(Error::invalid(name, format!("{} views", list.len()), expected)).or_raise();
        }
    }
    let mut views = Vec::with_capacity(board_m.len());
    for (v, board) in board_m.iter().enumerate() {
        views.push(BoardView {
            left_px: rows_of(&format!("left_px[{v}]"), &left_px[v])?,
            right_px: rows_of(&format!("right_px[{v}]"), &right_px[v])?,
            board_m: rows_of(&format!("board_m[{v}]"), board)?,
        });
    }
    let fit = || match method {
        Method::Bundle => calibration::calibrate(&views, image_size, &options),
        Method::Tsai => tsai::calibrate_rig(&views, image_size, &options),
    };
    py.detach(fit).map(PyStereoCalibration).or_raise()
}

/// Tsai's calibration of one camera; ``epiline.tsai.calibrate`` is the public face of it.
///
/// Parameters
/// ----------
/// world_mm : (N, 3) array_like
///     World points, millimetres; right-handed.
/// pixels : (N, 2) array_like
///     Where the camera saw them.
/// cx, cy, sx, dpx_mm, dpy_mm : float
///     Principal point (pixels), horizontal scale, effective pixel pitch.
/// full : bool
///     Refine everything to the minimum of the squared pixel distances.
///
/// Returns
/// -------
/// dict
///     f, kappa1, Cx, Cy, sx, Tx, Ty, Tz, Rx, Ry, Rz, R, sse_px2, condition, coplanar, sigma; mm, pixels, radians.
///
/// Raises
/// ------
/// ValueError
///     Numbers that are not finite, lists of different length, too few points.
/// epiline.Error
///     The points do not determine the camera, with the reason.
#[pyfunction]
#[pyo3(signature = (world_mm, pixels, *, cx, cy, sx, dpx_mm, dpy_mm, full))]
#[expect(clippy::too_many_arguments, reason = "the keyword arguments of the Python function")]
fn tsai_calibrate<'py>(
    py: Python<'py>,
    world_mm: &Bound<'py, PyAny>,
    pixels: &Bound<'py, PyAny>,
    cx: f64,
    cy: f64,
    sx: f64,
    dpx_mm: f64,
    dpy_mm: f64,
    full: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let world_mm = rows_of::<3>("world_mm", world_mm)?;
    let pixels = rows_of::<2>("pixels", pixels)?;
    let sensor = Sensor { dpx_mm, dpy_mm, cx, cy, sx };
    let found = py.detach(|| tsai::calibrate(&world_mm, &pixels, &sensor, full)).or_raise()?;
    let TsaiCalibration { camera, sse_px2, condition, coplanar, sigma } = found;
    let TsaiCamera { f_mm, kappa1, sensor: Sensor { cx, cy, sx, .. }, camera_from_world } = camera;
    let result = PyDict::new(py);
    set_parameters(&result, [f_mm, kappa1, cx, cy, sx], camera.translation_mm(), camera.angles())?;
    result.set_item("R", matrix_array(py, &camera_from_world.rotation))?;
    result.set_item("sse_px2", sse_px2)?;
    result.set_item("condition", condition)?;
    result.set_item("coplanar", coplanar)?;
    let sigmas = PyDict::new(py);
    if let Some(TsaiSigma { f_mm, kappa1, cx, cy, sx, translation_mm, angles }) = sigma {
        set_parameters(&sigmas, [f_mm, kappa1, cx, cy, sx], translation_mm, angles)?;
    }
    result.set_item("sigma", sigmas)?;
    Ok(result)
}

/// Enters the eleven parameters under Tsai's names.
fn set_parameters(
    dict: &Bound<'_, PyDict>,
    intrinsics: [f64; 5],
    translation_mm: [f64; 3],
    angles: [f64; 3],
) -> PyResult<()> {
    let names = ["f", "kappa1", "Cx", "Cy", "sx", "Tx", "Ty", "Tz", "Rx", "Ry", "Rz"];
    let values = intrinsics.into_iter().chain(translation_mm).chain(angles);
    names.into_iter().zip(values).try_for_each(|(name, value)| dict.set_item(name, value))
}
