//! Cameras, the calibrated pair, rig files.

use std::path::PathBuf;

use epiline::camera::formats::{Format, ReadOptions};
use epiline::camera::{CameraModel, Lens, Outlier, Pose, StereoCalibration, ViewResidual};
use nalgebra::{Matrix3, Vector2, Vector3};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{OrRaise, rows_of, vector_of, whole};

/// Adds this file's classes and functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyCameraModel>()?;
    module.add_class::<PyViewResidual>()?;
    module.add_class::<PyOutlier>()?;
    module.add_class::<PyStereoCalibration>()
}

/// A `(rows, N)` array of rows.
pub fn rows_array<'py, const N: usize>(
    py: Python<'py>,
    rows: impl IntoIterator<Item = [f64; N]>,
) -> Bound<'py, PyArray2<f64>> {
    let flat: Vec<f64> = rows.into_iter().flatten().collect();
    let count = flat.len() / N;
    PyArray1::from_vec(py, flat).reshape([count, N]).expect("rows of N numbers")
}

/// A `(3, 3)` array.
pub fn matrix_array<'py>(py: Python<'py>, matrix: &Matrix3<f64>) -> Bound<'py, PyArray2<f64>> {
    rows_array(py, matrix.row_iter().map(|row| [row[0], row[1], row[2]]))
}

/// A `(3,)` array.
pub fn vector_array<'py>(py: Python<'py>, vector: &Vector3<f64>) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, vector.as_slice())
}

fn matrix_of(name: &str, object: &Bound<'_, PyAny>) -> PyResult<Matrix3<f64>> {
    let rows = rows_of::<3>(name, object)?;
    if rows.len() != 3 {
        let given = rows.len();
        return Err(PyValueError::new_err(format!("{name}: expected shape (3, 3), got ({given}, 3)")));
    }
    Ok(Matrix3::from_fn(|r, c| rows[r][c]))
}

/// One file of a rig, or two.
#[derive(FromPyObject)]
enum Paths {
    One(PathBuf),
    Two(PathBuf, PathBuf),
}

impl Paths {
    fn into_vec(self) -> Vec<PathBuf> {
        match self {
            Self::One(path) => vec![path],
            Self::Two(left, right) => vec![left, right],
        }
    }
}

/// The lens of a model's name, or of OpenCV's number of coefficients.
fn lens_of(name: Option<&str>, coefficients: &[f64]) -> PyResult<Lens> {
    let Some(name) = name else {
        return Lens::from_opencv(coefficients).or_raise();
    };
    let model = Lens::of_name(name).ok_or_else(|| {
        let known = Lens::NAMES.join(", ");
        PyValueError::new_err(format!("lens = '{name}': expected one of {known}"))
    })?;
    // OpenCV's and ROS's lists of a Brown lens may end before k3.
    let padded = [coefficients, &[0.0]].concat();
    let short = matches!(model, Lens::Brown(_)) && coefficients.len() == 4;
    model.with_coefficients(if short { &padded } else { coefficients }).ok_or_else(|| {
        let (names, count) = (model.coefficient_names(), coefficients.len());
        PyValueError::new_err(format!(
            "distortion: a lens '{name}' has {} coefficients ({}), got {count}",
            names.len(),
            names.join(", ")
        ))
    })
}

/// One camera: a lens, focal lengths and principal point in pixels, and an image size.
///
/// Parameters
/// ----------
/// camera_matrix : (3, 3) array_like
///     ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, pixels; skew must be zero.
/// distortion : (N,) array_like
///     The lens's coefficients.
/// width, height : int
///     Image size, pixels.
/// lens : {"brown-conrady", "rational", "thin-prism", "kannala-brandt", "tsai"}, optional
///     What the coefficients mean: k1, k2, p1, p2[, k3] of Brown and Conrady; with k4, k5, k6 after them of the
///     rational model; with s1, s2, s3, s4 after those of thin prisms; k1, k2, k3, k4 of Kannala and Brandt's fisheye;
///     kappa1 of Tsai's model, in units of the focal length. By default the number of coefficients decides as in
///     OpenCV's functions: 4 or 5, 8, 12.
///
/// Raises
/// ------
/// ValueError
///     A number is not finite, a focal length not positive, or an array has another shape.
#[pyclass(frozen, eq, module = "epiline", name = "CameraModel", from_py_object)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyCameraModel(pub CameraModel);

#[pymethods]
impl PyCameraModel {
    #[new]
    #[pyo3(signature = (camera_matrix, distortion, *, width, height, lens = None))]
    fn new(
        camera_matrix: &Bound<'_, PyAny>,
        distortion: &Bound<'_, PyAny>,
        width: i64,
        height: i64,
        lens: Option<&str>,
    ) -> PyResult<Self> {
        let (width, height) = (whole("width", width)?, whole("height", height)?);
        let k = matrix_of("camera_matrix", camera_matrix)?;
        let pinhole = Matrix3::new(k.m11, 0.0, k.m13, 0.0, k.m22, k.m23, 0.0, 0.0, 1.0);
        // NaN is not equal to itself: it is named below.
        if k.iter().all(|v| v.is_finite()) && k != pinhole {
            let expected = "camera_matrix: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]";
            return Err(PyValueError::new_err(format!("{expected}, got {:?}", k.transpose().as_slice())));
        }
        let lens = lens_of(lens, &vector_of("distortion", distortion)?)?;
        let model = CameraModel { focal_px: [k.m11, k.m22], center_px: [k.m13, k.m23], lens, width, height };
        model.validate().or_raise()?;
        Ok(Self(model))
    }

    /// (3, 3) float64: focal lengths and principal point, pixels.
    #[getter]
    fn camera_matrix<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let ([fx, fy], [cx, cy]) = (self.0.focal_px, self.0.center_px);
        rows_array(py, [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    }

    /// (N,) float64: the lens's coefficients; five of a Brown–Conrady lens.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.0.lens.coefficients())
    }

    /// Name of the lens model.
    #[getter]
    fn lens(&self) -> &'static str {
        self.0.lens.name()
    }

    /// Image width, pixels.
    #[getter]
    fn width(&self) -> usize {
        self.0.width
    }

    /// Image height, pixels.
    #[getter]
    fn height(&self) -> usize {
        self.0.height
    }

    /// Where points of the camera's frame appear.
    ///
    /// Parameters
    /// ----------
    /// points_m : (N, 3) array_like
    ///     Metres; z forward, x right, y down.
    ///
    /// Returns
    /// -------
    /// (N, 2) float64
    ///     Pixels; NaN outside the lens's field of view.
    fn project<'py>(
        &self,
        py: Python<'py>,
        points_m: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = rows_of::<3>("points_m", points_m)?;
        let nowhere = Vector2::repeat(f64::NAN);
        let view = self.0.view();
        let see = |p: [f64; 3]| view.project(&Vector3::from(p)).unwrap_or(nowhere).into();
        Ok(rows_array::<2>(py, points.into_iter().map(see)))
    }

    /// The directions that pixels see.
    ///
    /// Parameters
    /// ----------
    /// pixels : (N, 2) array_like
    ///     Positions in the photograph.
    ///
    /// Returns
    /// -------
    /// (N, 3) float64
    ///     Of length one in the camera's frame; NaN outside the lens's field of view.
    fn directions<'py>(
        &self,
        py: Python<'py>,
        pixels: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pixels = rows_of::<2>("pixels", pixels)?;
        let view = self.0.view();
        let nowhere = Vector3::repeat(f64::NAN);
        let look = |p: [f64; 2]| view.direction(Vector2::from(p)).unwrap_or(nowhere).into();
        Ok(rows_array::<3>(py, pixels.into_iter().map(look)))
    }

    /// Where a lens without distortion and the same camera matrix would have seen pixels.
    ///
    /// Parameters
    /// ----------
    /// pixels : (N, 2) array_like
    ///     Positions in the photograph.
    ///
    /// Returns
    /// -------
    /// (N, 2) float64
    ///     Pixels; NaN where the distortion has no inverse, or a fisheye looks sideways.
    fn undistort<'py>(
        &self,
        py: Python<'py>,
        pixels: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pixels = rows_of::<2>("pixels", pixels)?;
        let view = self.0.view();
        let ideal = CameraModel { lens: Lens::default(), ..self.0 }.view();
        let straighten = |pixel: [f64; 2]| -> [f64; 2] {
            let ray = view.direction(Vector2::from(pixel));
            ray.and_then(|ray| ideal.project(&ray)).map_or([f64::NAN; 2], Into::into)
        };
        Ok(rows_array(py, pixels.into_iter().map(straighten)))
    }

    fn __repr__(&self) -> String {
        let CameraModel { focal_px: [fx, fy], center_px: [cx, cy], width, height, .. } = self.0;
        let lens = self.lens();
        format!(
            "CameraModel({width}x{height}, fx={fx:.2}, fy={fy:.2}, cx={cx:.2}, cy={cy:.2}, lens='{lens}')"
        )
    }
}

/// How well one pair of photographs agrees with the calibration.
#[pyclass(frozen, eq, module = "epiline", name = "ViewResidual")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyViewResidual(ViewResidual);

#[pymethods]
impl PyViewResidual {
    /// Root mean square distance of the left corners from their prediction, pixels; NaN if it saw none.
    #[getter]
    fn left_rms_px(&self) -> f64 {
        self.0.left_rms_px
    }

    /// Root mean square distance of the right corners from their prediction, pixels.
    #[getter]
    fn right_rms_px(&self) -> f64 {
        self.0.right_rms_px
    }

    /// (3, 3) float64: turns board directions into the left camera's frame.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix_array(py, &self.0.left_from_board.rotation)
    }

    /// (3,) float64: the board's origin in the left camera's frame, metres.
    #[getter]
    fn translation_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector_array(py, &self.0.left_from_board.translation_m)
    }

    fn __repr__(&self) -> String {
        let ViewResidual { left_rms_px, right_rms_px, .. } = self.0;
        format!("ViewResidual(left_rms_px={left_rms_px:.3}, right_rms_px={right_rms_px:.3})")
    }
}

/// A corner that a calibration left out because it was mis-found.
#[pyclass(frozen, eq, module = "epiline", name = "Outlier")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyOutlier(Outlier);

#[pymethods]
impl PyOutlier {
    /// Which view, counting from 0.
    #[getter]
    fn view(&self) -> usize {
        self.0.view
    }

    /// Whose photograph.
    #[getter]
    fn side(&self) -> &'static str {
        self.0.side
    }

    /// Which of the view's corners, counting from 0.
    #[getter]
    fn corner(&self) -> usize {
        self.0.corner
    }

    /// Its distance from its prediction, pixels.
    #[getter]
    fn residual_px(&self) -> f64 {
        self.0.residual_px
    }

    /// Why it was left out.
    #[getter]
    fn reason(&self) -> String {
        self.0.reason()
    }

    fn __repr__(&self) -> String {
        let Outlier { view, side, corner, residual_px, .. } = self.0;
        format!("Outlier(view={view}, side='{side}', corner={corner}, residual_px={residual_px:.2})")
    }
}

/// Two cameras, the pose between them, and how far to trust both.
///
/// Parameters
/// ----------
/// left, right : CameraModel
/// rotation : (3, 3) array_like
/// translation_m : (3,) array_like
///     Map points of the left camera's frame to the right camera's: ``p_right = rotation @ p_left + translation_m``.
///
/// Raises
/// ------
/// ValueError
///     The rotation is none, a number is not finite, or the cameras are in one place.
#[pyclass(frozen, eq, module = "epiline", name = "StereoCalibration")]
#[derive(Clone, PartialEq)]
pub struct PyStereoCalibration(pub StereoCalibration);

#[pymethods]
impl PyStereoCalibration {
    #[new]
    fn new(
        left: &PyCameraModel,
        right: &PyCameraModel,
        rotation: &Bound<'_, PyAny>,
        translation_m: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let translation = vector_of("translation_m", translation_m)?;
        let [x, y, z] = translation[..] else {
            let count = translation.len();
            return Err(PyValueError::new_err(format!("translation_m: expected 3 numbers, got {count}")));
        };
        let pose = Pose { rotation: matrix_of("rotation", rotation)?, translation_m: Vector3::new(x, y, z) };
        StereoCalibration::new(left.0, right.0, pose).map(Self).or_raise()
    }

    /// The left camera: the reference.
    #[getter]
    fn left(&self) -> PyCameraModel {
        PyCameraModel(self.0.left)
    }

    /// The right camera.
    #[getter]
    fn right(&self) -> PyCameraModel {
        PyCameraModel(self.0.right)
    }

    /// (3, 3) float64: turns left-camera directions into the right camera's frame.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix_array(py, &self.0.right_from_left.rotation)
    }

    /// (3,) float64: the left camera's centre in the right camera's frame, metres.
    #[getter]
    fn translation_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector_array(py, &self.0.right_from_left.translation_m)
    }

    /// Distance between the centres of projection, metres.
    #[getter]
    fn baseline_m(&self) -> f64 {
        self.0.baseline_m()
    }

    /// (width, height) of the left camera, pixels.
    #[getter]
    fn image_size(&self) -> (usize, usize) {
        (self.0.left.width, self.0.left.height)
    }

    /// Root mean square reprojection error over all corners of both cameras, pixels; NaN if unknown.
    #[getter]
    fn rms_px(&self) -> f64 {
        self.0.rms_px
    }

    /// Mean vertical disparity after rectification of corners in views the fit did not see, pixels; NaN if unknown.
    #[getter]
    fn epipolar_error_px(&self) -> f64 {
        self.0.epipolar_error_px
    }

    /// (N, N) float64 in the order of ``sigma``'s keys, or None if unknown; zero for parameters held fixed.
    ///
    /// The parameters of both cameras (four and the lens's coefficients each: 9 with a Brown–Conrady lens), then six
    /// of the pose between them.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        let covariance = self.0.covariance.as_ref()?;
        // nalgebra stores columns first.
        let flat = PyArray1::from_slice(py, covariance.transpose().as_slice());
        Some(flat.reshape([covariance.nrows(), covariance.ncols()]).expect("N x N numbers"))
    }

    /// Standard deviation by parameter name: pixels, 1, radians or metres; empty if unknown.
    ///
    /// Rotation is a left increment on the rotation vector.
    #[getter]
    fn sigma<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let sigma = PyDict::new(py);
        for (name, value) in self.0.parameter_names().iter().zip(self.0.sigmas().into_iter().flatten()) {
            sigma.set_item(name, value)?;
        }
        Ok(sigma)
    }

    /// One entry per view used; empty if unknown.
    #[getter]
    fn views(&self) -> Vec<PyViewResidual> {
        self.0.views.iter().copied().map(PyViewResidual).collect()
    }

    /// Corners that were left out, each with its reason.
    #[getter]
    fn outliers(&self) -> Vec<PyOutlier> {
        self.0.outliers.iter().copied().map(PyOutlier).collect()
    }

    /// (2,) float64: how far the board's middle stands out behind the plane of its corners, along its x and y axis,
    /// metres; None if it was not solved for.
    #[getter]
    fn board_warp_m<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.0.board_warp.map(|warp| PyArray1::from_slice(py, &warp.height_m))
    }

    /// (2,) float64: standard deviations of ``board_warp_m``, metres.
    #[getter]
    fn board_warp_sigma_m<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.0.board_warp.map(|warp| PyArray1::from_slice(py, &warp.sigma_m))
    }

    /// Standard deviation of depth from the calibration's own uncertainty, at the image centre.
    ///
    /// Parameters
    /// ----------
    /// z_m : float
    ///     Depth, metres.
    ///
    /// Returns
    /// -------
    /// float
    ///     Metres; NaN if the covariance is unknown. Matching adds ``z_m**2 * sigma_d / (focal_px * baseline_m)``.
    fn range_sigma(&self, z_m: f64) -> f64 {
        self.0.range_sigma_m(z_m)
    }

    /// Writes the rig to one file, or to one for each camera; each appears complete or not at all.
    ///
    /// Parameters
    /// ----------
    /// path : path or (path, path)
    ///     The file; for formats with two, those of the left and of the right camera (OpenCV: intrinsics, extrinsics).
    /// format : {"epiline", "opencv", "ros", "kalibr", "mrcal", "middlebury", "kitti"}, optional
    ///     By default the names decide: one file is YAML of ours, with covariance, errors and views, which other
    ///     formats go without; one in ``.xml`` is OpenCV's, in ``.txt`` Middlebury's; two in ``.yaml`` are ROS's, in
    ///     ``.cameramodel`` mrcal's.
    ///
    /// Raises
    /// ------
    /// OSError
    ///     A file cannot be written.
    /// epiline.Error
    ///     The format cannot hold this rig; the message says what of it.
    /// ValueError
    ///     The format is unknown, cannot be written, or has another number of files.
    #[pyo3(signature = (path, *, format = None))]
    fn save(&self, py: Python<'_>, path: Paths, format: Option<&str>) -> PyResult<()> {
        let format = format.map(Format::of_name).transpose().or_raise()?;
        py.detach(|| self.0.save_files(&path.into_vec(), format)).or_raise()
    }

    /// Reads a rig of any known format.
    ///
    /// Parameters
    /// ----------
    /// path : path or (path, path)
    ///     The file; for formats with two, those of the left and of the right camera (OpenCV: intrinsics, extrinsics).
    /// format : str, optional
    ///     "epiline", "opencv", "ros", "kalibr", "mrcal", "boofcv", "middlebury", "kitti", "kitti-grey" (both of aligned
    ///     pictures) or "kitti-raw" (of pictures as taken). By default the content decides.
    /// image_size : (width, height), optional
    ///     Of the images, pixels, for files without it: OpenCV's, those of KITTI's benchmarks.
    /// unit_m : float
    ///     Metres in one unit of length, for files that do not say: OpenCV's and BoofCV's. 0.001 if the board was
    ///     measured in millimetres.
    /// cameras : (int, int), optional
    ///     Left and right camera of KITTI's files, which hold four: (2, 3) by default, (0, 1) with "kitti-grey".
    ///
    /// Raises
    /// ------
    /// OSError
    ///     A file cannot be read.
    /// epiline.Error
    ///     An entry is missing, of the wrong type, not finite, no lens here equals the file's, or the rig could not
    ///     exist.
    /// ValueError
    ///     The format is unknown or has another number of files.
    #[staticmethod]
    #[pyo3(signature = (path, *, format = None, image_size = None, unit_m = 1.0, cameras = None))]
    fn load(
        py: Python<'_>,
        path: Paths,
        format: Option<&str>,
        image_size: Option<(i64, i64)>,
        unit_m: f64,
        cameras: Option<(i64, i64)>,
    ) -> PyResult<Self> {
        let format = format.map(Format::of_name).transpose().or_raise()?;
        let image_size =
            image_size.map(|(w, h)| PyResult::Ok((whole("width", w)?, whole("height", h)?))).transpose()?;
        let cameras = cameras
            .map(|(left, right)| PyResult::Ok([whole("cameras", left)?, whole("cameras", right)?]))
            .transpose()?;
        let options = ReadOptions { format, image_size, unit_m, cameras };
        py.detach(|| StereoCalibration::load_files(&path.into_vec(), &options)).map(Self).or_raise()
    }

    /// Whether a file describes pictures that came aligned: Middlebury's and KITTI's do.
    ///
    /// Parameters
    /// ----------
    /// path : path
    ///
    /// Raises
    /// ------
    /// OSError
    ///     The file cannot be read.
    /// epiline.Error
    ///     It is no text, or no document.
    #[staticmethod]
    fn describes_aligned_pictures(py: Python<'_>, path: PathBuf) -> PyResult<bool> {
        let format = py.detach(|| Format::of_file(path)).or_raise()?;
        Ok(format.is_some_and(Format::is_aligned))
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.image_size();
        format!(
            "StereoCalibration({width}x{height}, baseline_m={:.5}, rms_px={:.3}, epipolar_error_px={:.3})",
            self.0.baseline_m(),
            self.0.rms_px,
            self.0.epipolar_error_px
        )
    }
}
