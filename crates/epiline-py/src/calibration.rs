//! From corners to a calibrated pair; Tsai's method for one camera.

use epiline::Error;
use epiline::calibration::{self, BoardView, BundleOptions, LensModel, Loss};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::camera::PyStereoCalibration;
use crate::convert::{OrRaise, rows_of};

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(calibrate_points, module)?)
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
    image_size: (usize, usize),
    method: &str,
    model: &str,
    loss: &str,
    held_out: bool,
) -> PyResult<PyStereoCalibration> {
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
        Method::Tsai => unimplemented!(),
    };
    py.detach(fit).map(PyStereoCalibration).or_raise()
}
