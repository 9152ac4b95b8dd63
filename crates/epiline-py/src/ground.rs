//! Python face of `epiline::ground`.

use std::sync::{Mutex, MutexGuard, PoisonError};

use epiline::ground::{GroundEstimator, GroundParams, GroundPlane, Mounting, NoGround};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::convert::OrRaise;
use crate::matching::PyDisparityMap;
use crate::rectification::PyRectifiedGeometry;
use crate::regions::PyCameraOverGround;

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyGroundPlane>()?;
    module.add_class::<PyMounting>()?;
    module.add_class::<PyGroundEstimator>()
}

/// How the camera is mounted, as far as the user knows.
///
/// Only planes within five standard deviations of it are taken for the ground, and the first frame's is drawn toward it.
///
/// Parameters
/// ----------
/// camera_height_m : float
///     Height of the left camera's centre above the ground, metres.
/// pitch_rad, roll_rad : float
///     How far the optical axis points below the horizon, and how far the image's right side hangs lower than its left.
/// camera_height_sigma_m, pitch_sigma_rad, roll_sigma_rad : float
///     Standard deviations of the three.
///
/// Raises
/// ------
/// ValueError
///     When it is used, for a height or deviation that is not positive, or an angle not within a right one.
#[pyclass(name = "Mounting", module = "epiline", frozen, eq, from_py_object)]
#[derive(Clone, PartialEq)]
pub struct PyMounting(pub Mounting);

#[pymethods]
impl PyMounting {
    #[new]
    #[pyo3(signature = (
        camera_height_m, *, pitch_rad = 0.0, roll_rad = 0.0, camera_height_sigma_m = 0.05, pitch_sigma_rad = 0.03,
        roll_sigma_rad = 0.02
    ))]
    fn new(
        camera_height_m: f64,
        pitch_rad: f64,
        roll_rad: f64,
        camera_height_sigma_m: f64,
        pitch_sigma_rad: f64,
        roll_sigma_rad: f64,
    ) -> Self {
        Self(Mounting {
            camera_height_m,
            pitch_rad,
            roll_rad,
            camera_height_sigma_m,
            pitch_sigma_rad,
            roll_sigma_rad,
        })
    }

    fn __repr__(&self) -> String {
        let Mounting { camera_height_m, pitch_rad, roll_rad, .. } = self.0;
        format!("Mounting(camera_height_m={camera_height_m}, pitch_rad={pitch_rad}, roll_rad={roll_rad})")
    }
}

/// The ground in front of the camera: a plane, and how the ground rises over it ahead.
#[pyclass(name = "GroundPlane", module = "epiline", frozen, eq)]
#[derive(PartialEq)]
pub struct PyGroundPlane(pub GroundPlane);

#[pymethods]
impl PyGroundPlane {
    /// Distance of the left camera's centre from the plane, metres.
    #[getter]
    fn camera_height_m(&self) -> f64 {
        self.0.camera_height_m
    }

    /// How far the optical axis points below the plane's horizon, radians.
    #[getter]
    fn pitch_rad(&self) -> f64 {
        self.0.pitch_rad
    }

    /// How far the image's right side hangs lower than its left, radians.
    #[getter]
    fn roll_rad(&self) -> f64 {
        self.0.roll_rad
    }

    /// Standard deviation of `camera_height_m`, metres.
    #[getter]
    fn camera_height_sigma_m(&self) -> f64 {
        self.0.camera_height_sigma_m
    }

    /// Standard deviation of `pitch_rad`, radians.
    #[getter]
    fn pitch_sigma_rad(&self) -> f64 {
        self.0.pitch_sigma_rad
    }

    /// Standard deviation of `roll_rad`, radians.
    #[getter]
    fn roll_sigma_rad(&self) -> f64 {
        self.0.roll_sigma_rad
    }

    /// Share of the pixels looked at in the frame that lie on the plane, 0 to 1.
    #[getter]
    fn support_share(&self) -> f64 {
        self.0.support_share
    }

    /// (N, 2) float64: depths, and how high the ground is over the plane there, metres; straight between them.
    #[getter]
    fn profile_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let knots: Vec<Vec<f64>> =
            self.0.profile.knots().map(|(depth_m, up_m)| vec![depth_m, up_m]).collect();
        Ok(PyArray2::from_vec2(py, &knots)?)
    }

    /// How the camera stands over the plane: what regions in metres are placed by.
    #[getter]
    fn camera(&self) -> PyCameraOverGround {
        PyCameraOverGround(self.0.camera())
    }

    /// (3,) float64: the unit vector from the camera straight down onto the plane, in the left aligned frame.
    #[getter]
    fn down<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.down().as_slice())
    }

    /// Disparity of the ground at a pixel of the left image, px; None above its horizon.
    fn disparity_px(&self, x: f64, y: f64) -> Option<f64> {
        self.0.disparity_px(x, y)
    }

    /// How high the point seen at a pixel with a disparity is above the ground, metres.
    fn height_m(&self, x: f64, y: f64, disparity_px: f64) -> f64 {
        self.0.height_m(x, y, disparity_px)
    }

    fn __repr__(&self) -> String {
        let GroundPlane { camera_height_m, pitch_rad, roll_rad, .. } = self.0;
        format!(
            "GroundPlane(camera_height_m={camera_height_m:.3}, pitch_rad={pitch_rad:.4}, roll_rad={roll_rad:.4})",
        )
    }
}

/// Finds the ground in each frame and follows it.
///
/// Parameters
/// ----------
/// camera_height_m : (float, float)
///     Lowest and highest plausible camera, metres.
/// pitch_rad : (float, float)
///     Least and most plausible pitch, radians: how far the camera looks down.
/// max_roll_rad : float
///     Most plausible roll to either side, radians.
/// mounting : Mounting, optional
///     How the camera is mounted, if that is known.
/// disparity_sigma_px : float
///     Standard deviation of a disparity, px.
///
/// Raises
/// ------
/// ValueError
///     A parameter out of range.
#[pyclass(name = "GroundEstimator", module = "epiline", frozen)]
pub struct PyGroundEstimator(Mutex<State>);

struct State {
    estimator: GroundEstimator,
    reason: Option<NoGround>,
}

impl PyGroundEstimator {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic in an earlier call leaves buffers that the next one sets up again.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl PyGroundEstimator {
    #[new]
    #[pyo3(signature = (
        *, camera_height_m = (0.05, 4.0), pitch_rad = (-0.35, 1.0), max_roll_rad = 0.35, mounting = None,
        disparity_sigma_px = 0.25
    ))]
    fn new(
        camera_height_m: (f64, f64),
        pitch_rad: (f64, f64),
        max_roll_rad: f64,
        mounting: Option<PyMounting>,
        disparity_sigma_px: f64,
    ) -> PyResult<Self> {
        let mounting = mounting.map(|mounting| mounting.0);
        let params = GroundParams { camera_height_m, pitch_rad, max_roll_rad, mounting, disparity_sigma_px };
        let estimator = GroundEstimator::new(params).or_raise()?;
        Ok(Self(Mutex::new(State { estimator, reason: None })))
    }

    /// The ground in the next frame, or None; `reason` then says why.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     A geometry of another size, or a cylindrical one.
    fn __call__(
        &self,
        py: Python<'_>,
        disparity: PyRef<'_, PyDisparityMap>,
        geometry: PyRectifiedGeometry,
    ) -> PyResult<Option<PyGroundPlane>> {
        let map = &disparity.inner;
        let found = py.detach(|| {
            let mut state = self.lock();
            let found = state.estimator.estimate(map, &geometry.0)?;
            state.reason = found.err();
            Ok(found)
        });
        Ok(found.or_raise()?.ok().map(PyGroundPlane))
    }

    /// Why there was no ground in the last frame; None if there was.
    #[getter]
    fn reason(&self) -> Option<&'static str> {
        self.lock().reason.map(NoGround::reason)
    }

    /// Forgets all frames.
    fn reset(&self) {
        self.lock().estimator.reset();
    }
}
