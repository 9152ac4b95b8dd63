//! Python face of `epiline::tracking`.

use std::sync::{Mutex, MutexGuard, PoisonError};

use epiline::obstacles::PixelBox;
use epiline::tracking::{
    Assignment, Continuity, Detection, EgoMotion, Track, TrackParams, Tracker, UNASSIGNED,
};
use numpy::{PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{OrRaise, whole};
use crate::obstacles::PyObstacle;

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyDetection>()?;
    module.add_class::<PyTrack>()?;
    module.add_class::<PyTracker>()?;
    module.add_function(wrap_pyfunction!(assignment, module)?)
}

/// Something seen in one frame, for a Tracker: for those who find obstacles by other means.
///
/// Parameters
/// ----------
/// range_m : float
///     Euclidean range.
/// bearing_rad : float
///     Positive to the right of the optical axis.
/// sigma_m : float
///     Standard deviation of `range_m`.
/// depth_m : float, optional
///     Z along the optical axis; by default that of something at the camera's height.
/// width_m, height_m : float
///     Its size.
/// support : int
///     Pixels it was seen by; of two that are one thing, the better seen one counts.
/// box : tuple of int
///     x, y, width, height where it was seen, pixels: boxes tell parts of one thing from two things.
#[pyclass(name = "Detection", module = "epiline", frozen, eq)]
#[derive(PartialEq)]
pub struct PyDetection(Detection);

#[pymethods]
impl PyDetection {
    #[new]
    #[pyo3(signature = (
        range_m, bearing_rad, sigma_m, *, depth_m = None, width_m = 0.0, height_m = 0.0, support = 1, r#box = (0, 0, 0, 0)
    ))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        range_m: f64,
        bearing_rad: f64,
        sigma_m: f64,
        depth_m: Option<f64>,
        width_m: f64,
        height_m: f64,
        support: i64,
        r#box: (i64, i64, i64, i64),
    ) -> PyResult<Self> {
        let (x, y, width, height) = r#box;
        let bounds = PixelBox {
            x: whole("box x", x)?,
            y: whole("box y", y)?,
            width: whole("box width", width)?,
            height: whole("box height", height)?,
        };
        let level = Detection::level(range_m, bearing_rad, sigma_m);
        let depth_m = depth_m.unwrap_or(level.depth_m);
        let support = whole("support", support)?;
        let detection = Detection { depth_m, width_m, height_m, support, bounds, ..level };
        detection.validate().map(|()| Self(detection)).or_raise()
    }

    /// Euclidean range, metres.
    #[getter]
    fn range_m(&self) -> f64 {
        self.0.range_m
    }

    /// Positive to the right of the optical axis, radians.
    #[getter]
    fn bearing_rad(&self) -> f64 {
        self.0.bearing_rad
    }

    /// Standard deviation of `range_m`, metres.
    #[getter]
    fn sigma_m(&self) -> f64 {
        self.0.sigma_m
    }

    fn __repr__(&self) -> String {
        let Detection { range_m, bearing_rad, sigma_m, .. } = self.0;
        format!("Detection(range_m={range_m:.3}, bearing_rad={bearing_rad:.3}, sigma_m={sigma_m:.3})")
    }
}

/// An obstacle followed over frames.
#[pyclass(name = "Track", module = "epiline", frozen, eq)]
#[derive(PartialEq)]
pub struct PyTrack(pub Track);

#[pymethods]
impl PyTrack {
    /// Its own as long as it lives, and never another's.
    #[getter]
    fn id(&self) -> u64 {
        self.0.id
    }

    /// x to the right of the left camera and z along its optical axis, metres.
    #[getter]
    fn position_m(&self) -> (f64, f64) {
        self.0.position_m.into()
    }

    /// x and z, m/s: relative to the camera, or over the ground where its motion is given.
    #[getter]
    fn velocity_mps(&self) -> (f64, f64) {
        self.0.velocity_mps.into()
    }

    /// (4, 4) float64: covariance of x, z, and their velocities; metres and m/s.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        PyArray2::from_vec2(py, &self.0.covariance.map(Vec::from)).expect("four rows of four")
    }

    /// Euclidean range, metres.
    #[getter]
    fn range_m(&self) -> f64 {
        self.0.range_m
    }

    /// Standard deviation of `range_m`, metres.
    #[getter]
    fn sigma_m(&self) -> f64 {
        self.0.sigma_m
    }

    /// Positive to the right of the optical axis, radians.
    #[getter]
    fn bearing_rad(&self) -> f64 {
        self.0.bearing_rad
    }

    /// Seconds since it was first seen.
    #[getter]
    fn age_s(&self) -> f64 {
        self.0.age_s
    }

    /// Frames with an obstacle.
    #[getter]
    fn hits(&self) -> u32 {
        self.0.hits
    }

    /// Frames since the last obstacle; 0 if this frame has it.
    #[getter]
    fn misses(&self) -> u32 {
        self.0.misses
    }

    /// Whether it was seen often enough to be believed; stays so.
    #[getter]
    fn confirmed(&self) -> bool {
        self.0.confirmed
    }

    /// Which of this frame's obstacles it is, as an index; None if none.
    #[getter]
    fn obstacle(&self) -> Option<usize> {
        self.0.obstacle
    }

    /// x, y, width, height: where it was last seen, pixels of the left aligned image.
    #[getter]
    fn r#box(&self) -> (usize, usize, usize, usize) {
        let PixelBox { x, y, width, height } = self.0.bounds;
        (x, y, width, height)
    }

    /// Width, metres, smoothed.
    #[getter]
    fn width_m(&self) -> f64 {
        self.0.width_m
    }

    /// Height, metres, smoothed.
    #[getter]
    fn height_m(&self) -> f64 {
        self.0.height_m
    }

    /// Squared Mahalanobis distance of its last obstacle from where it was expected, 2 on average if the sigmas are
    /// honest; NaN for its first.
    #[getter]
    fn surprise(&self) -> f64 {
        self.0.surprise
    }

    fn __repr__(&self) -> String {
        let Track { id, range_m, sigma_m, velocity_mps: [right, forward], confirmed, .. } = self.0;
        let confirmed = if confirmed { "True" } else { "False" };
        format!(
            "Track(id={id}, range_m={range_m:.3}, sigma_m={sigma_m:.3}, velocity_mps=({right:.2}, {forward:.2}), confirmed={confirmed})"
        )
    }
}

/// What a tracker is fed with.
#[derive(FromPyObject)]
enum Seen<'py> {
    #[pyo3(annotation = "Obstacle")]
    Obstacle(Bound<'py, PyObstacle>),
    #[pyo3(annotation = "Detection")]
    Detection(Bound<'py, PyDetection>),
}

impl Seen<'_> {
    fn detection(&self) -> Detection {
        match self {
            Self::Obstacle(obstacle) => Detection::from(&obstacle.get().0),
            Self::Detection(detection) => detection.get().0,
        }
    }
}

/// Follows obstacles over frames: stable ids and velocities, with a gate that follows sigma.
///
/// Parameters
/// ----------
/// velocity_walk_mps : float
///     Standard deviation of the change of each component of velocity within one second, m/s.
/// initial_velocity_mps : float
///     Standard deviation of each component of the velocity of what is seen first, m/s: at least the camera's speed.
/// bearing_sigma_rad : float
///     Standard deviation of a bearing.
/// extent_share : float
///     How far the middle of what is seen of an obstacle wanders, one standard deviation as a share of its width.
/// gate_probability : float
///     Probability that a track's own obstacle lies in its gate.
/// confirm_hits, confirm_window : int
///     A track is confirmed by obstacles in so many of its last so many frames.
/// max_misses : int
///     A confirmed track ends after more frames in a row without an obstacle.
/// max_gap_s : float
///     All tracks end where no frame came for longer.
/// scene_stands_still : bool
///     Take most of what is seen to stand still, and the camera to drive straight ahead: where its motion is not given
///     it is estimated from the obstacles, and velocities are over the ground. For a camera that drives past many
///     things.
///
/// Raises
/// ------
/// ValueError
///     A parameter out of range.
#[pyclass(name = "Tracker", module = "epiline", frozen)]
pub struct PyTracker(Mutex<State>);

struct State {
    tracker: Tracker,
    tracks: Vec<Track>,
    continuity: Option<Continuity>,
}

impl PyTracker {
    /// The parameters in use.
    pub fn params(&self) -> TrackParams {
        *self.lock().tracker.params()
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl PyTracker {
    #[new]
    #[pyo3(signature = (
        *, velocity_walk_mps = 2.0, initial_velocity_mps = 5.0, bearing_sigma_rad = 0.005, extent_share = 0.1,
        gate_probability = 0.99, confirm_hits = 3, confirm_window = 5, max_misses = 5, max_gap_s = 1.0,
        scene_stands_still = false
    ))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        velocity_walk_mps: f64,
        initial_velocity_mps: f64,
        bearing_sigma_rad: f64,
        extent_share: f64,
        gate_probability: f64,
        confirm_hits: i64,
        confirm_window: i64,
        max_misses: i64,
        max_gap_s: f64,
        scene_stands_still: bool,
    ) -> PyResult<Self> {
        let tracker = Tracker::new(TrackParams {
            velocity_walk_mps,
            initial_velocity_mps,
            bearing_sigma_rad,
            extent_share,
            gate_probability,
            confirm_hits: whole("confirm_hits", confirm_hits)?,
            confirm_window: whole("confirm_window", confirm_window)?,
            max_misses: whole("max_misses", max_misses)?,
            max_gap_s,
            scene_stands_still,
        });
        Ok(Self(Mutex::new(State { tracker: tracker.or_raise()?, tracks: Vec::new(), continuity: None })))
    }

    /// Takes in what was seen in a frame.
    ///
    /// Parameters
    /// ----------
    /// obstacles : sequence of Obstacle or Detection
    ///     Of one frame.
    /// stamp_nanos : int
    ///     When the frame was taken, on one clock. The same stamp again changes nothing; an earlier one, or one later
    ///     than `max_gap_s` allows, begins anew: see `continuity`.
    /// ego_motion : tuple of float, optional
    ///     How the camera moved since the frame before, in its axes then: metres to the right, metres forward, radians
    ///     turned to the right. Give it always, for velocities over the ground, or never.
    ///
    /// Returns
    /// -------
    /// list of Track
    ///     All that live, oldest first, unconfirmed ones among them.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     A motion that is not finite; the tracks are as before then.
    #[pyo3(signature = (obstacles, stamp_nanos, *, ego_motion = None))]
    fn update(
        &self,
        obstacles: Vec<Seen<'_>>,
        stamp_nanos: i64,
        ego_motion: Option<(f64, f64, f64)>,
    ) -> PyResult<Vec<PyTrack>> {
        let ego = ego_motion.map(|(right_m, forward_m, yaw_rad)| EgoMotion { right_m, forward_m, yaw_rad });
        let State { tracker, tracks, continuity } = &mut *self.lock();
        let detections = obstacles.iter().map(Seen::detection);
        *continuity = Some(tracker.update(detections, stamp_nanos, ego.as_ref(), tracks).or_raise()?);
        Ok(tracks.iter().copied().map(PyTrack).collect())
    }

    /// What the last frame was to those before: "started", "advanced", "repeated", "backward" or "gap"; None before the
    /// first.
    #[getter]
    fn continuity(&self) -> Option<&'static str> {
        self.lock().continuity.map(Continuity::name)
    }

    /// Forgets all tracks; their ids are not given again.
    fn reset(&self) {
        self.lock().tracker.reset();
    }
}

/// For each row of a matrix of costs its column, such that the sum is smallest.
///
/// Parameters
/// ----------
/// costs : (rows, columns) float64
///     Infinite where a pair is forbidden.
/// miss_cost : float
///     Of a row without a column.
///
/// Returns
/// -------
/// list of int or None
///     A column per row, None for a row without one.
///
/// Raises
/// ------
/// ValueError
///     A cost that is NaN or minus infinity, or a `miss_cost` that is not finite.
#[pyfunction]
fn assignment(costs: PyReadonlyArray2<'_, f64>, miss_cost: f64) -> PyResult<Vec<Option<usize>>> {
    let costs_view = costs.as_array();
    if !miss_cost.is_finite() {
        return Err(PyValueError::new_err(format!("miss_cost = {miss_cost}: must be finite")));
    }
    if let Some(bad) = costs_view.iter().find(|cost| cost.is_nan() || **cost == f64::NEG_INFINITY) {
        return Err(PyValueError::new_err(format!(
            "costs: {bad} among them; must be finite, or plus infinity"
        )));
    }
    let (rows, columns) = (costs.shape()[0], costs.shape()[1]);
    let mut solver = Assignment::default();
    let solution = solver.solve(rows, columns, miss_cost, |row, column| costs_view[[row, column]]);
    Ok(solution.iter().map(|&column| (column != UNASSIGNED).then_some(column)).collect())
}
