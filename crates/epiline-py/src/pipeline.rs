//! Python face of `epiline::pipeline`.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use epiline::camera::StereoCalibration;
use epiline::ground::{GroundParams, NoGround};
use epiline::image::{Image, StereoPair};
use epiline::matching::MatcherParams;
use epiline::obstacles::ObstacleParams;
use epiline::pipeline::{FrameResult, Pipeline, PipelineParams};
use epiline::regions::{Region, paper_regions};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::camera::PyStereoCalibration;
use crate::convert::{OrRaise, grey_image, whole};
use crate::drift::PyDrift;
use crate::ground::{PyGroundPlane, PyMounting};
use crate::matching::{PyDisparityMap, PyStereoMatcher, parameters_dict};
use crate::obstacles::{PyObstacle, method_named};
use crate::range::PyRangeImage;
use crate::rectification::{PyAlignmentError, PyRectifiedGeometry, PyRectifiedPair};
use crate::regions::{PyRegion, PyRegionProfile, unwrap};
use crate::scan::{PyRobotFromCamera, PyScan, PyScanner};
use crate::tracking::{PyTrack, PyTracker};

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(py_default_disparities, module)?)?;
    module.add_class::<PyFrameResult>()?;
    module.add_class::<PyPipeline>()
}

/// Disparities to search in images of this width, px: a sixth of it in steps of 16, and no more than it has columns.
#[pyfunction]
#[pyo3(name = "default_disparities")]
fn py_default_disparities(width: usize) -> usize {
    PipelineParams::default_disparities(width)
}

/// Everything known about one pair. Its properties make new objects at each access; keep what you use twice.
#[pyclass(name = "FrameResult", module = "epiline", frozen)]
pub struct PyFrameResult(Arc<FrameResult>);

#[pymethods]
impl PyFrameResult {
    /// The aligned images, their masks and geometry.
    #[getter]
    fn pair(&self, py: Python<'_>) -> PyRectifiedPair {
        let FrameResult { left, right, valid, range, .. } = &*self.0;
        PyRectifiedPair::new(py, [left, right], valid.each_ref().map(Image::view), range.geometry)
    }

    /// Disparities of the left image.
    #[getter]
    fn disparity(&self) -> PyDisparityMap {
        PyDisparityMap { inner: self.0.disparity.clone() }
    }

    /// Metres of the left image.
    #[getter]
    fn range(&self) -> PyRangeImage {
        PyRangeImage::of_frame(self.0.clone())
    }

    /// One profile per region.
    #[getter]
    fn profiles(&self) -> Vec<PyRegionProfile> {
        self.0.profiles.iter().cloned().map(PyRegionProfile).collect()
    }

    /// The ground; None if there is none, and `ground_reason` says why.
    #[getter]
    fn ground(&self) -> Option<PyGroundPlane> {
        self.0.ground.ok().map(PyGroundPlane)
    }

    /// Why there is no ground; None if there is.
    #[getter]
    fn ground_reason(&self) -> Option<&'static str> {
        self.0.ground.err().map(NoGround::reason)
    }

    /// What stands in any of the regions, nearest first.
    #[getter]
    fn obstacles(&self) -> Vec<PyObstacle> {
        self.0.obstacles.iter().cloned().map(PyObstacle).collect()
    }

    /// Obstacles followed over frames, oldest first, those not confirmed among them; empty without a
    /// tracker.
    #[getter]
    fn tracks(&self) -> Vec<PyTrack> {
        self.0.tracks.iter().copied().map(PyTrack).collect()
    }

    /// The floor in every direction; None without a scanner.
    #[getter]
    fn scan(&self) -> Option<PyScan> {
        (!self.0.scan.is_empty()).then(|| PyScan(self.0.scan.clone()))
    }

    /// Vertical residual of the aligned pair; None if it was not asked for.
    #[getter]
    fn alignment(&self) -> Option<PyAlignmentError> {
        self.0.alignment.clone().map(PyAlignmentError)
    }

    /// How the rig has moved since calibration, from this pair and those before it; None if alignment was not asked for.
    #[getter]
    fn drift(&self) -> Option<PyDrift> {
        self.0.drift.map(PyDrift)
    }

    /// Milliseconds of each stage, and of all as "total".
    #[getter]
    fn stage_ms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let times = &self.0.times;
        let dict = PyDict::new(py);
        let stages: [(&str, Duration); 11] = [
            ("equalize", times.equalize),
            ("rectify", times.rectify),
            ("match", times.matching),
            ("range", times.range),
            ("regions", times.regions),
            ("ground", times.ground),
            ("obstacles", times.obstacles),
            ("tracks", times.tracks),
            ("scan", times.scan),
            ("alignment", times.alignment),
            ("total", times.total),
        ];
        for (name, time) in stages {
            dict.set_item(name, 1e3 * time.as_secs_f64())?;
        }
        Ok(dict)
    }

    fn __repr__(&self) -> String {
        let FrameResult { profiles, obstacles, left, .. } = &*self.0;
        let (width, height) = (left.width(), left.height());
        format!(
            "FrameResult({width}x{height} px, {} profiles, {} obstacles)",
            profiles.len(),
            obstacles.len()
        )
    }
}

/// What a pipeline is made for: cameras as they are, or pairs already aligned.
#[derive(FromPyObject)]
enum Rig<'py> {
    #[pyo3(annotation = "StereoCalibration")]
    Cameras(Bound<'py, PyStereoCalibration>),
    #[pyo3(annotation = "RectifiedGeometry")]
    Aligned(PyRectifiedGeometry),
}

/// The pipeline and its results' memory.
struct State {
    pipeline: Pipeline,
    /// Results handed out; one that Python has let go of is filled again.
    results: Vec<Arc<FrameResult>>,
}

/// Results that take turns: the one being filled, the one the caller still holds, and one on its way.
const KEPT_RESULTS: usize = 3;

impl PyPipeline {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic in an earlier call leaves buffers that the next one sets up again.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn realign(&mut self) -> epiline::Result<StereoCalibration> {
        let corrected = self.pipeline.realign()?;
        // Results made for the geometry of before cannot be filled with the new one.
        self.results.clear();
        Ok(corrected)
    }

    fn process(&mut self, pair: StereoPair<'_>) -> epiline::Result<Arc<FrameResult>> {
        let free = self.results.iter_mut().position(|result| Arc::get_mut(result).is_some());
        let mut result = match free {
            Some(index) => self.results.swap_remove(index),
            None => Arc::new(self.pipeline.empty_result()),
        };
        let filled = Arc::get_mut(&mut result).expect("held by no one else");
        let outcome = self.pipeline.process_into(pair, filled);
        if self.results.len() < KEPT_RESULTS {
            self.results.push(result.clone());
        }
        outcome.map(|()| result)
    }
}

/// The whole path for one pair after the other: equalise, rectify, match, range, regions, obstacles.
///
/// Parameters
/// ----------
/// rig : StereoCalibration or RectifiedGeometry
///     A calibration for pairs as the cameras take them, a geometry for pairs that come aligned.
/// matcher : StereoMatcher, optional
///     Whose parameters to use; by default x-Sobel SAD in windows of 9 px with all tests, searching a sixth of the width.
/// regions : sequence of Region, optional
///     Default: paper_regions of the image's size.
/// equalize : bool
///     Equalise both histograms first (equation 3 of the 2011 paper).
/// only_regions : bool
///     Match only in the regions: what lies outside of them is unknown. Where a matcher's answers depend on the whole image
///     (`coarse_weight`, `fill`, `smooth`, method "sgm"; so with every preset) all of it is matched first, and no time is
///     saved.
/// alignment : bool
///     Measure the vertical residual of each pair.
/// disparity_sigma_px : float
///     Standard deviation of a disparity, px.
/// max_range_m : float, optional
///     No obstacle farther than this.
/// min_support : int
///     Pixels that a column must have within 1 px of disparity to see an obstacle there where no ground is known.
/// min_height_m : float
///     Where no ground is known, nothing lower is an obstacle, unless it reaches the lower edge of the image.
/// ground : bool
///     Find the ground and tell obstacles by their height over it.
/// mounting : Mounting, optional
///     How the camera is mounted, if that is known.
/// step_m : float
///     What rises less over the ground can be driven over, metres.
/// headroom_m : float
///     What hangs higher over the ground can be passed under, metres.
/// method : {"u-disparity", "paper"}
///     How obstacles are found; see find_obstacles.
/// tracker : Tracker, optional
///     Whose parameters to follow obstacles with; by default they are not followed.
/// scanner : Scanner, optional
///     Whose parameters to scan the floor with; by default it is not scanned. `disparity_sigma_px` is the pipeline's.
/// robot_from_camera : RobotFromCamera, optional
///     Where the camera is on the robot, for the scan; by default the robot is the camera.
///
/// Raises
/// ------
/// ValueError
///     A parameter out of range, or a region outside the image.
/// epiline.Error
///     A rig that cannot be rectified.
#[pyclass(name = "Pipeline", module = "epiline", frozen)]
pub struct PyPipeline {
    regions: Vec<Region>,
    matcher: MatcherParams,
    state: Mutex<State>,
}

#[pymethods]
impl PyPipeline {
    #[new]
    #[pyo3(signature = (
        rig, *, matcher = None, regions = None, equalize = false, alignment = true, disparity_sigma_px = 0.25,
        max_range_m = None, min_support = 8, min_height_m = 0.3, ground = true, mounting = None, step_m = 0.05,
        headroom_m = 2.0, method = "u-disparity", only_regions = false, tracker = None, scanner = None,
        robot_from_camera = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        rig: Rig<'_>,
        matcher: Option<&Bound<'_, PyStereoMatcher>>,
        regions: Option<Vec<PyRegion>>,
        equalize: bool,
        alignment: bool,
        disparity_sigma_px: f64,
        max_range_m: Option<f64>,
        min_support: i64,
        min_height_m: f64,
        ground: bool,
        mounting: Option<PyMounting>,
        step_m: f64,
        headroom_m: f64,
        method: &str,
        only_regions: bool,
        tracker: Option<Bound<'_, PyTracker>>,
        scanner: Option<Bound<'_, PyScanner>>,
        robot_from_camera: Option<PyRobotFromCamera>,
    ) -> PyResult<Self> {
        let (width, height) = match &rig {
            Rig::Cameras(calibration) => {
                let left = &calibration.get().0.left;
                (left.width, left.height)
            }
            Rig::Aligned(geometry) => (geometry.0.width, geometry.0.height),
        };
        let mut params = PipelineParams::for_width(width);
        if let Some(matcher) = matcher {
            params.matcher = matcher.get().params();
        }
        let min_support = whole("min_support", min_support)?;
        params.obstacles = ObstacleParams {
            method: method_named(method)?,
            min_support,
            max_range_m,
            min_height_m,
            step_m,
            headroom_m,
            ..params.obstacles
        };
        let mounting = mounting.map(|mounting| mounting.0);
        params.tracks = tracker.map(|tracker| tracker.get().params());
        params.scan = scanner.map(|scanner| scanner.get().params());
        params.robot_from_camera = robot_from_camera.map(|mounting| mounting.0);
        params.ground = ground.then(|| GroundParams { mounting, ..GroundParams::default() });
        params = PipelineParams { equalize, only_regions, alignment, disparity_sigma_px, ..params };
        let regions = match regions {
            Some(regions) => unwrap(regions),
            None => paper_regions(width, height).or_raise()?,
        };
        let pipeline = match rig {
            Rig::Cameras(calibration) => {
                let calibration = &calibration.get().0;
                py.detach(|| Pipeline::for_cameras(calibration, regions, params))
            }
            Rig::Aligned(geometry) => Pipeline::for_aligned(geometry.0, regions, params),
        };
        let pipeline = pipeline.or_raise()?;
        let regions = pipeline.regions().to_vec();
        let matcher = params.matcher;
        Ok(Self { regions, matcher, state: Mutex::new(State { pipeline, results: Vec::new() }) })
    }

    /// Geometry of the aligned images.
    #[getter]
    fn geometry(&self) -> PyRectifiedGeometry {
        PyRectifiedGeometry(*self.lock().pipeline.geometry())
    }

    /// The regions read.
    #[getter]
    fn regions(&self) -> Vec<PyRegion> {
        self.regions.iter().cloned().map(PyRegion).collect()
    }

    /// dict: the matcher's parameters, by the names StereoMatcher is given them with.
    #[getter]
    fn matcher_parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        parameters_dict(py, &self.matcher)
    }

    /// Processes a pair.
    ///
    /// Parameters
    /// ----------
    /// left, right : (H, W) or (H, W, 3) uint8
    ///     Of the calibrated (or aligned) size; three channels are blue, green, red.
    /// stamp_nanos : int
    ///     When it was taken, on one clock: what tracks take for time. Pairs of one stamp are one frame to them.
    ///
    /// Returns
    /// -------
    /// FrameResult
    ///     Stays as it is, however many pairs are processed after it.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Another size, shape or type.
    #[pyo3(signature = (left, right, *, stamp_nanos = 0))]
    fn process(
        &self,
        py: Python<'_>,
        left: &Bound<'_, PyAny>,
        right: &Bound<'_, PyAny>,
        stamp_nanos: i64,
    ) -> PyResult<PyFrameResult> {
        let (left, right) = (grey_image("left", left)?, grey_image("right", right)?);
        let pair = StereoPair {
            left_stamp_nanos: stamp_nanos,
            right_stamp_nanos: stamp_nanos,
            ..StereoPair::new(left.view(), right.view()).or_raise()?
        };
        let result = py.detach(|| self.lock().process(pair));
        result.map(PyFrameResult).or_raise()
    }

    /// Takes the rig to hold as it is now: from the next pair on, drift counts from what was seen so far. The
    /// calibration's own uncertainty cancels then, and even a small yaw shows.
    ///
    /// Raises
    /// ------
    /// epiline.Error
    ///     No pair with enough matches was seen yet.
    fn set_drift_reference(&self) -> PyResult<()> {
        self.lock().pipeline.set_drift_reference().or_raise()
    }

    /// Corrects the rig by the drift seen so far (FrameResult.drift). The next pair is aligned by the corrected
    /// calibration, and the drift counts anew from there.
    ///
    /// Returns
    /// -------
    /// StereoCalibration
    ///     The corrected one, the correction's uncertainty in its covariance.
    ///
    /// Raises
    /// ------
    /// epiline.Error
    ///     The pairs come aligned, or no pair with enough matches was seen yet.
    fn realign(&self, py: Python<'_>) -> PyResult<PyStereoCalibration> {
        py.detach(|| self.lock().realign()).map(PyStereoCalibration).or_raise()
    }
}
