//! From corners to a calibrated pair; Tsai's method for one camera.

use epiline::Error;
use epiline::calibration::tsai::{self, Sensor, TsaiCalibration, TsaiCamera, TsaiSigma};
use epiline::calibration::{self, BoardView, BundleOptions, Constraints, LensModel, Loss};
use epiline::camera::Pose;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::camera::{PyStereoCalibration, matrix_array};
use crate::convert::{OrRaise, rows_of, whole};

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(calibrate_points, module)?)?;
    module.add_function(wrap_pyfunction!(tsai_calibrate, module)?)?;
    module.add_function(wrap_pyfunction!(brown_from_tsai, module)?)
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

/// A lens by name, or the one that the views ask for.
#[derive(Clone, Copy)]
enum Model {
    Named(LensModel),
    Auto,
}

fn model_of(word: &str) -> PyResult<Model> {
    let named = LensModel::ALL.map(|(name, lens)| (name, Model::Named(lens)));
    let choices: Vec<_> = named.into_iter().chain([("auto", Model::Auto)]).collect();
    choice("model", word, &choices)
}

/// Parts of the held-out error: a number of them, or whether to have any.
#[derive(FromPyObject)]
enum HeldOut {
    Wanted(bool),
    Folds(i64),
}

impl HeldOut {
    fn folds(&self) -> PyResult<usize> {
        match *self {
            Self::Wanted(true) => Ok(BundleOptions::default().held_out_folds),
            Self::Wanted(false) => Ok(0),
            Self::Folds(folds @ (0 | 2..=100)) => Ok(folds as usize),
            Self::Folds(folds) => {
                Err(PyValueError::new_err(format!("held_out = {folds}: expected 0 or 2 to 100 parts")))
            }
        }
    }
}

/// Calibrates a pair of cameras from corners of a flat board.
///
/// Parameters
/// ----------
/// left_px, right_px : sequence of (N, 2) array_like
///     Per view, where each camera saw the corners, pixels; NaN for a corner that it did not see. A view of one camera
///     alone has nothing but NaN for the other.
/// board_m : sequence of (N, 3) array_like
///     Per view, where they are on the board, metres; z = 0.
/// image_size : (int, int)
///     Width and height of both cameras' images, pixels.
/// method : {"bundle", "tsai"}
///     Bundle adjustment, or Tsai's two-stage method started view by view (one radial coefficient).
/// model : {"brown4", "brown5", "rational", "thin-prism", "fisheye", "auto"}
///     Lens of the bundle adjustment: k1 k2 p1 p2; with k3; with k4 k5 k6; with s1 s2 s3 s4; Kannala and Brandt's k1 k2
///     k3 k4. "auto" takes the simplest whose held-out error is within 5 % of the smallest.
/// loss : {"huber", "squared"}
///     Huber's loss forgives corners a little off and leaves out, in ``outliers``, those beyond 4.5 sigma; the squared
///     loss is what other systems minimise.
/// held_out : bool or int
///     Into how many parts the views are divided, each measured by a fit of the others: fills ``epipolar_error_px``.
///     True stands for 2, False for none.
/// fix : sequence of str
///     Parameters to hold, by their names in ``sigma``; without ``left_`` or ``right_`` of both cameras; "lens" for all
///     coefficients. They keep the value of `initial`, or else the image centre and no distortion.
/// share : sequence of str
///     Parameters that are the same in both cameras, such as "fx" or "lens".
/// square_pixels : bool
///     One focal length for x and y in each camera.
/// warp : bool
///     Also solve for the board's bend, two parabolas along its sides: fills ``board_warp_m``.
/// initial : StereoCalibration, optional
///     Where to start, and what fixed parameters are.
///
/// Returns
/// -------
/// StereoCalibration
///
/// Raises
/// ------
/// ValueError
///     Lists that do not belong together, a corner that is infinite or outside the image, too few of them, a parameter
///     that the model does not have.
/// epiline.Error
///     The views do not determine the cameras, or the cameras are swapped, with the reason.
#[pyfunction]
#[pyo3(signature = (
    left_px, right_px, board_m, image_size, *, method="bundle", model="brown4", loss="huber",
    held_out=HeldOut::Wanted(true), fix=Vec::new(), share=Vec::new(), square_pixels=false, warp=false, initial=None
))]
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
    held_out: HeldOut,
    fix: Vec<String>,
    share: Vec<String>,
    square_pixels: bool,
    warp: bool,
    initial: Option<Bound<'_, PyStereoCalibration>>,
) -> PyResult<PyStereoCalibration> {
    let image_size = (whole("image_size", image_size.0)?, whole("image_size", image_size.1)?);
    let method = choice("method", method, &[("bundle", Method::Bundle), ("tsai", Method::Tsai)])?;
    let model = model_of(model)?;
    let options = BundleOptions {
        lens: if let Model::Named(lens) = model { lens } else { LensModel::default() },
        loss: choice("loss", loss, &[("huber", Loss::default()), ("squared", Loss::Squared)])?,
        constraints: Constraints {
            fixed: fix,
            shared: share,
            square_pixels,
            initial: initial.map(|rig| rig.get().0.clone()),
        },
        solve_warp: warp,
        held_out_folds: held_out.folds()?,
    };
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
    let fit = || match (method, model) {
        (Method::Tsai, _) => tsai::calibrate_rig(&views, image_size, &options),
        (Method::Bundle, Model::Named(_)) => calibration::calibrate(&views, image_size, &options),
        (Method::Bundle, Model::Auto) => calibration::calibrate_choosing_lens(&views, image_size, &options),
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
/// start : (8,) array_like, optional
///     f, kappa1, Tx, Ty, Tz, Rx, Ry, Rz to start a full optimisation from, without the two stages.
///
/// Returns
/// -------
/// dict
///     f, kappa1, Cx, Cy, sx, Tx, Ty, Tz, Rx, Ry, Rz, R, sse_px2, condition, coplanar, skew_rad, sigma; mm, pixels, radians.
///
/// Raises
/// ------
/// ValueError
///     Numbers that are not finite, lists of different length, too few points.
/// epiline.Error
///     The points do not determine the camera, with the reason.
#[pyfunction]
#[pyo3(signature = (world_mm, pixels, *, cx, cy, sx, dpx_mm, dpy_mm, full, start=None))]
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
    start: Option<[f64; 8]>,
) -> PyResult<Bound<'py, PyDict>> {
    let world_mm = rows_of::<3>("world_mm", world_mm)?;
    let pixels = rows_of::<2>("pixels", pixels)?;
    let sensor = Sensor { dpx_mm, dpy_mm, cx, cy, sx };
    let found = py.detach(|| match start {
        None => tsai::calibrate(&world_mm, &pixels, &sensor, full),
        Some([f_mm, kappa1, tx, ty, tz, rx, ry, rz]) => {
            let camera = TsaiCamera { f_mm, kappa1, sensor, camera_from_world: Pose::identity() };
            tsai::refine(&world_mm, &pixels, &camera.with_pose([tx, ty, tz], [rx, ry, rz]))
        }
    });
    let TsaiCalibration { camera, sse_px2, condition, coplanar, skew_rad, sigma } = found.or_raise()?;
    let TsaiCamera { f_mm, kappa1, sensor: Sensor { cx, cy, sx, .. }, camera_from_world } = camera;
    let result = PyDict::new(py);
    set_parameters(&result, [f_mm, kappa1, cx, cy, sx], camera.translation_mm(), camera.angles())?;
    result.set_item("R", matrix_array(py, &camera_from_world.rotation))?;
    result.set_item("sse_px2", sse_px2)?;
    result.set_item("condition", condition)?;
    result.set_item("coplanar", coplanar)?;
    result.set_item("skew_rad", skew_rad)?;
    let sigmas = PyDict::new(py);
    if let Some(TsaiSigma { f_mm, kappa1, cx, cy, sx, translation_mm, angles }) = sigma {
        set_parameters(&sigmas, [f_mm, kappa1, cx, cy, sx], translation_mm, angles)?;
    }
    result.set_item("sigma", sigmas)?;
    Ok(result)
}

/// Brown's k1, k2, k3 that do what Tsai's kappa1 does out to a radius, both in units of the focal length.
///
/// Parameters
/// ----------
/// kappa1 : float
///     ``kappa1[1/mm²]·f[mm]²``.
/// largest_radius : float
///     Distorted radius out to which the two agree in the sense of least squares.
///
/// Returns
/// -------
/// (float, float, float)
///
/// Raises
/// ------
/// epiline.Error
///     The radius is beyond where Tsai's lens folds over.
#[pyfunction]
fn brown_from_tsai(kappa1: f64, largest_radius: f64) -> PyResult<(f64, f64, f64)> {
    let lens = tsai::brown_from_tsai(kappa1, largest_radius).ok_or_else(|| {
        let reason = format!("the lens folds over within the radius {largest_radius}: kappa1 = {kappa1}");
        Error::degenerate("Tsai calibration", reason)
    });
    lens.map(|lens| (lens.k1, lens.k2, lens.k3)).or_raise()
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
