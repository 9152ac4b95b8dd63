//! Python face of `epiline::scan`.

use std::sync::{Mutex, PoisonError};

use epiline::scan::{LaserScan, RobotFromCamera, Scan, ScanParams, Scanner};
use nalgebra::{Matrix3, Vector3};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{OrRaise, rows_of, whole};
use crate::ground::PyGroundPlane;
use crate::matching::PyDisparityMap;
use crate::rectification::PyRectifiedGeometry;

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyRobotFromCamera>()?;
    module.add_class::<PyScan>()?;
    module.add_class::<PyScanner>()?;
    module.add_function(wrap_pyfunction!(py_scan, module)?)
}

/// Pose of the left aligned camera on the robot, whose frame is REP 103's: x forward, y left, z up, the floor at z = 0.
///
/// Parameters
/// ----------
/// height_m : float
///     Of the camera over the floor.
/// x_m, y_m : float
///     Where the camera is, forward and to the left.
/// roll_rad, pitch_rad, yaw_rad : float
///     How far it leans to the right, points down, and points to the left.
///
/// Raises
/// ------
/// ValueError
///     A value that is not finite, or a camera below the floor.
#[pyclass(name = "RobotFromCamera", module = "epiline", frozen, eq, from_py_object)]
#[derive(Clone, PartialEq)]
pub struct PyRobotFromCamera(pub RobotFromCamera);

#[pymethods]
impl PyRobotFromCamera {
    #[new]
    #[pyo3(signature = (height_m, *, x_m = 0.0, y_m = 0.0, roll_rad = 0.0, pitch_rad = 0.0, yaw_rad = 0.0))]
    fn new(height_m: f64, x_m: f64, y_m: f64, roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> PyResult<Self> {
        RobotFromCamera::from_angles([x_m, y_m, height_m], roll_rad, pitch_rad, yaw_rad).map(Self).or_raise()
    }

    /// From the pose itself.
    ///
    /// Parameters
    /// ----------
    /// robot_from_camera : (4, 4) or (3, 4) float64
    ///     Maps points of the left aligned camera's optical frame to the robot's, metres.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     No pose, or a camera below the floor.
    #[staticmethod]
    fn from_matrix(robot_from_camera: &Bound<'_, PyAny>) -> PyResult<Self> {
        let rows = rows_of::<4>("robot_from_camera", robot_from_camera)?;
        let (&[a, b, c], rest) = rows.split_first_chunk::<3>().ok_or_else(|| wrong_pose(rows.len()))?;
        if !(rest.is_empty() || rest == [[0.0, 0.0, 0.0, 1.0]]) {
            return Err(wrong_pose(rows.len()));
        }
        let rotation = Matrix3::new(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]);
        RobotFromCamera::new(rotation, Vector3::new(a[3], b[3], c[3])).map(Self).or_raise()
    }

    /// (4, 4) float64: maps points of the left aligned camera's optical frame to the robot's, metres.
    #[getter]
    fn robot_from_camera<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let pose = self.0.rotation().insert_column(3, 0.0).insert_row(3, 0.0);
        let pose = {
            let mut pose = pose;
            pose.fixed_view_mut::<3, 1>(0, 3).copy_from(self.0.translation_m());
            pose[(3, 3)] = 1.0;
            pose
        };
        let rows: Vec<f64> = pose.transpose().iter().copied().collect();
        PyArray1::from_vec(py, rows).reshape([4, 4]).expect("sixteen values")
    }

    fn __repr__(&self) -> String {
        let at = self.0.translation_m();
        format!("RobotFromCamera(height_m={}, x_m={}, y_m={}, ...)", at.z, at.x, at.y)
    }
}

fn wrong_pose(rows: usize) -> PyErr {
    pyo3::exceptions::PyValueError::new_err(format!(
        "robot_from_camera: expected three rows, or four of which the last is 0 0 0 1; got {rows} rows"
    ))
}

/// What stands nearest, how far it is free, and what is not known, for every direction over the floor.
///
/// Arrays have an entry per direction, counter-clockwise. Distances are metres over the floor from the foot of the left
/// camera, `origin_m`, where the lines of sight begin; NaN where there is none.
#[pyclass(name = "Scan", module = "epiline", frozen, eq)]
#[derive(PartialEq)]
pub struct PyScan(pub Scan);

#[pymethods]
impl PyScan {
    /// (N,) float32: direction about the robot's z axis, from its x axis, radians, ascending.
    #[getter]
    fn angle_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.angle_rad)
    }

    /// (N,) uint8: 0 unknown, 1 nothing as far as was looked, 2 an obstacle.
    #[getter]
    fn seen<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        PyArray1::from_slice(py, &self.0.seen)
    }

    /// (N,) float32: distance of the nearest obstacle.
    #[getter]
    fn nearest_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.nearest_m)
    }

    /// (N,) float32: standard deviation of `nearest_m`.
    #[getter]
    fn sigma_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.sigma_m)
    }

    /// (N,) float32: where the free stretch begins; what is nearer is out of view, or of the disparities searched.
    #[getter]
    fn free_from_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.free_from_m)
    }

    /// (N,) float32: where the free stretch ends; never beyond `nearest_m`.
    #[getter]
    fn free_to_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.free_to_m)
    }

    /// The camera's foot in the robot's frame, x and y, metres.
    #[getter]
    fn origin_m(&self) -> (f64, f64) {
        self.0.origin_m.into()
    }

    /// How far was looked, metres.
    #[getter]
    fn max_range_m(&self) -> f64 {
        self.0.max_range_m
    }

    /// What is nearer straight ahead cannot be measured: its disparity was not searched; metres.
    #[getter]
    fn blind_m(&self) -> f64 {
        self.0.blind_m
    }

    /// (M, 2) float32: where the obstacles are, in the robot's frame, metres.
    fn obstacle_points_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        let points: Vec<f32> = self.0.obstacle_points_m().flatten().collect();
        let rows = points.len() / 2;
        PyArray1::from_vec(py, points).reshape([rows, 2]).expect("pairs")
    }

    /// Obstacles as a sensor_msgs/LaserScan has them, its fields by name, with REP 117's values: +Inf where all is
    /// free, NaN unknown, -Inf nearer than `range_min`. Its frame is the robot's, moved to `origin_m`.
    ///
    /// For a costmap to mark with, not to clear with: there may be unknown space before an obstacle.
    #[pyo3(signature = (*, range_min_m = 0.0))]
    fn to_laser_scan<'py>(&self, py: Python<'py>, range_min_m: f64) -> PyResult<Bound<'py, PyDict>> {
        laser_dict(py, self.0.to_laser_scan(range_min_m))
    }

    /// Free space as a sensor_msgs/LaserScan has it: each range is how far it is free, +Inf as far as was looked, NaN
    /// where nothing is known to be free. `range_min` is where the free stretches begin at the latest.
    ///
    /// For a costmap to clear with, not to mark with: the end of what is free need not be an obstacle.
    fn to_clearing_scan<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        laser_dict(py, self.0.to_clearing_scan())
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        let obstacles = self.0.obstacle_points_m().count();
        format!("Scan({} directions, {obstacles} with an obstacle)", self.0.len())
    }
}

fn laser_dict(py: Python<'_>, scan: LaserScan) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("angle_min", scan.angle_min_rad)?;
    dict.set_item("angle_max", scan.angle_max_rad)?;
    dict.set_item("angle_increment", scan.angle_increment_rad)?;
    dict.set_item("time_increment", 0.0)?;
    dict.set_item("scan_time", 0.0)?;
    dict.set_item("range_min", scan.range_min_m)?;
    dict.set_item("range_max", scan.range_max_m)?;
    dict.set_item("ranges", PyArray1::from_vec(py, scan.ranges_m))?;
    Ok(dict)
}

/// Scans disparity maps: per direction over the floor the nearest obstacle, how far it is free, or unknown. Keeps its
/// buffers from frame to frame.
///
/// Parameters
/// ----------
/// min_support : int
///     Pixels that a direction must have within 1 px of disparity to see an obstacle.
/// step_m : float
///     What rises less over the floor can be driven over.
/// headroom_m : float
///     What hangs higher over the floor can be passed under; may be infinite.
/// max_range_m : float
///     How far to look.
/// gap_guard_px : float
///     Rows by which the matcher's window may shrink a gap in the floor.
/// disparity_sigma_px : float
///     Standard deviation of a disparity, px.
///
/// Raises
/// ------
/// ValueError
///     A parameter out of range.
#[pyclass(name = "Scanner", module = "epiline", frozen)]
pub struct PyScanner {
    params: ScanParams,
    scanner: Mutex<Scanner>,
}

impl PyScanner {
    /// The parameters in use.
    pub fn params(&self) -> ScanParams {
        self.params
    }
}

#[pymethods]
impl PyScanner {
    #[new]
    #[pyo3(signature = (
        *, min_support = 8, step_m = 0.05, headroom_m = 2.0, max_range_m = 10.0, gap_guard_px = 4.0,
        disparity_sigma_px = 0.25
    ))]
    fn new(
        min_support: i64,
        step_m: f64,
        headroom_m: f64,
        max_range_m: f64,
        gap_guard_px: f64,
        disparity_sigma_px: f64,
    ) -> PyResult<Self> {
        let min_support = whole("min_support", min_support)?;
        let params =
            ScanParams { min_support, step_m, headroom_m, max_range_m, gap_guard_px, disparity_sigma_px };
        params.validate().or_raise()?;
        Ok(Self { params, scanner: Mutex::default() })
    }

    /// Scans a disparity map.
    ///
    /// Parameters
    /// ----------
    /// disparity : DisparityMap
    ///     Disparities of the left image.
    /// geometry : RectifiedGeometry
    ///     Of the aligned pair, of the map's size.
    /// ground : GroundPlane, optional
    ///     The floor; by default where `mounting` says.
    /// mounting : RobotFromCamera, optional
    ///     Where the camera is on the robot; by default the robot is the camera.
    ///
    /// Returns
    /// -------
    /// Scan
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     A geometry of another size, or a mounting lower than `step_m`.
    /// epiline.Error
    ///     A camera tilted so far that its columns do not rise from the floor.
    #[pyo3(signature = (disparity, geometry, *, ground = None, mounting = None))]
    fn __call__(
        &self,
        py: Python<'_>,
        disparity: PyRef<'_, PyDisparityMap>,
        geometry: PyRectifiedGeometry,
        ground: Option<Bound<'_, PyGroundPlane>>,
        mounting: Option<PyRobotFromCamera>,
    ) -> PyResult<PyScan> {
        let map = &disparity.inner;
        let (ground, mounting) = (ground.map(|ground| ground.get().0), mounting.map(|mounting| mounting.0));
        py.detach(|| {
            let mut scan = Scan::default();
            let mut scanner = self.scanner.lock().unwrap_or_else(PoisonError::into_inner);
            scanner.scan(map, &geometry.0, ground.as_ref(), mounting.as_ref(), &self.params, &mut scan)?;
            Ok(PyScan(scan))
        })
        .or_raise()
    }
}

/// Scans a disparity map: per direction over the floor the nearest obstacle, how far it is free, or unknown.
///
/// Free means that the floor was seen, without a gap in which something `step_m` high could stand. Unknown is
/// never free: a wall without texture, a hole in the map, what is out of view.
///
/// Parameters
/// ----------
/// disparity : DisparityMap
///     Disparities of the left image.
/// geometry : RectifiedGeometry
///     Of the aligned pair, of the map's size.
/// ground : GroundPlane, optional
///     The floor; by default where `mounting` says.
/// mounting : RobotFromCamera, optional
///     Where the camera is on the robot; by default the robot is the camera. Without it and without a ground heights
///     are not known, and a direction is free up to its obstacle as far as what hides in the rows without an answer
///     would have to be.
/// min_support : int
///     Pixels that a direction must have within 1 px of disparity to see an obstacle.
/// step_m : float
///     What rises less over the floor can be driven over.
/// headroom_m : float
///     What hangs higher over the floor can be passed under; may be infinite.
/// max_range_m : float
///     How far to look.
/// gap_guard_px : float
///     Rows by which the matcher's window may shrink a gap in the floor.
/// disparity_sigma_px : float
///     Standard deviation of a disparity, px.
///
/// Returns
/// -------
/// Scan
///
/// Raises
/// ------
/// ValueError
///     A geometry of another size, a parameter out of range.
/// epiline.Error
///     A camera tilted so far that its columns do not rise from the floor.
#[pyfunction]
#[pyo3(
    name = "scan",
    signature = (
        disparity, geometry, *, ground = None, mounting = None, min_support = 8, step_m = 0.05, headroom_m = 2.0,
        max_range_m = 10.0, gap_guard_px = 4.0, disparity_sigma_px = 0.25
    )
)]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
fn py_scan(
    py: Python<'_>,
    disparity: PyRef<'_, PyDisparityMap>,
    geometry: PyRectifiedGeometry,
    ground: Option<Bound<'_, PyGroundPlane>>,
    mounting: Option<PyRobotFromCamera>,
    min_support: i64,
    step_m: f64,
    headroom_m: f64,
    max_range_m: f64,
    gap_guard_px: f64,
    disparity_sigma_px: f64,
) -> PyResult<PyScan> {
    PyScanner::new(min_support, step_m, headroom_m, max_range_m, gap_guard_px, disparity_sigma_px)?
        .__call__(py, disparity, geometry, ground, mounting)
}
