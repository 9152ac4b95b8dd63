//! Python face of `epiline::rectification`.

use epiline::image::{Image, ImageRef};
use epiline::rectification::{
    AlignmentError, AlignmentMeter, AlignmentOptions, PointMatch, Projection, RectifiedGeometry, Rectifier,
    RectifierOptions, Scale,
};
use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::camera::{PyStereoCalibration, matrix_array, rows_array};
use crate::convert::{OrRaise, given_array, grey_image, image_array, mask_image, rows_of, whole};

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyRectifiedGeometry>()?;
    module.add_class::<PyRectifiedPair>()?;
    module.add_class::<PyRectifier>()?;
    module.add_class::<PyAlignmentError>()?;
    module.add_function(wrap_pyfunction!(py_alignment_error, module)?)
}

/// Geometry of an aligned pair: both views share focal length, principal row and orientation.
///
/// With disparity d = x_left - x_right, depth along the optical axis is
/// Z = focal_px * baseline_m / (d + doffs_px).
///
/// Parameters
/// ----------
/// width, height : int
///     Size of both images, pixels.
/// focal_px : float
///     Focal length, pixels.
/// cx_px, cy_px : float
///     Principal point of the left image, pixels; (0, 0) is the centre of the top-left pixel.
/// baseline_m : float
///     Distance between the cameras, metres.
/// doffs_px : float
///     Principal column of the right image less that of the left, pixels.
///
/// Raises
/// ------
/// ValueError
///     A length that is not positive and finite.
#[pyclass(name = "RectifiedGeometry", module = "epiline", frozen, from_py_object)]
#[derive(Clone)]
pub struct PyRectifiedGeometry(pub RectifiedGeometry);

#[pymethods]
impl PyRectifiedGeometry {
    #[new]
    #[pyo3(signature = (*, width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px = 0.0))]
    fn new(
        width: i64,
        height: i64,
        focal_px: f64,
        cx_px: f64,
        cy_px: f64,
        baseline_m: f64,
        doffs_px: f64,
    ) -> PyResult<Self> {
        let (width, height) = (whole("width", width)?, whole("height", height)?);
        RectifiedGeometry::new(width, height, focal_px, cx_px, cy_px, doffs_px, baseline_m)
            .map(Self)
            .or_raise()
    }

    /// Width of both images, pixels.
    #[getter]
    fn width(&self) -> usize {
        self.0.width
    }

    /// Height of both images, pixels.
    #[getter]
    fn height(&self) -> usize {
        self.0.height
    }

    /// Focal length, pixels.
    #[getter]
    fn focal_px(&self) -> f64 {
        self.0.focal_px
    }

    /// Principal column of the left image, pixels.
    #[getter]
    fn cx_px(&self) -> f64 {
        self.0.cx_px
    }

    /// Principal row of both images, pixels.
    #[getter]
    fn cy_px(&self) -> f64 {
        self.0.cy_px
    }

    /// Principal column of the right image less that of the left, pixels.
    #[getter]
    fn doffs_px(&self) -> f64 {
        self.0.doffs_px
    }

    /// Distance between the cameras, metres.
    #[getter]
    fn baseline_m(&self) -> f64 {
        self.0.baseline_m
    }

    /// What the images are drawn on: "pinhole" or "cylindrical".
    #[getter]
    fn projection(&self) -> &'static str {
        match self.0.projection {
            Projection::Pinhole => "pinhole",
            Projection::Cylindrical => "cylindrical",
        }
    }

    /// (4, 4) float64: (X, Y, Z, 1) ~ Q (x, y, d, 1), metres in the left aligned frame. A cylinder has none.
    #[getter(Q)]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.0.require_pinhole("Q").or_raise()?;
        // nalgebra stores columns first.
        let q = PyArray1::from_slice(py, self.0.q_matrix().transpose().as_slice());
        Ok(q.reshape([4, 4]).expect("4 x 4 numbers"))
    }

    /// The points seen at positions of the left image with disparities, whatever the projection.
    ///
    /// Parameters
    /// ----------
    /// pixels : (N, 3) array_like
    ///     x, y and disparity, pixels.
    ///
    /// Returns
    /// -------
    /// (N, 3) float64
    ///     Metres in the left aligned frame; NaN where the rays do not meet in front of both cameras.
    fn points<'py>(
        &self,
        py: Python<'py>,
        pixels: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pixels = rows_of::<3>("pixels", pixels)?;
        let nowhere = Vector3::repeat(f64::NAN);
        let point = |[x, y, d]: [f64; 3]| self.0.point_m(x, y, d).unwrap_or(nowhere).into();
        Ok(rows_array::<3>(py, pixels.into_iter().map(point)))
    }

    /// (3, 3) float64: rotates left-camera directions into the aligned frame.
    #[getter]
    fn aligned_from_left<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix_array(py, &self.0.aligned_from_left)
    }

    /// Depth along the optical axis, metres, of a disparity in pixels.
    fn depth_m(&self, disparity_px: f64) -> f64 {
        self.0.depth_m(disparity_px)
    }

    /// Disparity, pixels, of a depth along the optical axis in metres.
    fn disparity_px(&self, depth_m: f64) -> f64 {
        self.0.disparity_px(depth_m)
    }

    fn __repr__(&self) -> String {
        let RectifiedGeometry { width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px, .. } = self.0;
        format!(
            "RectifiedGeometry(width={width}, height={height}, focal_px={focal_px}, cx_px={cx_px}, \
             cy_px={cy_px}, baseline_m={baseline_m}, doffs_px={doffs_px})"
        )
    }
}

/// Two aligned images: a point of the scene lies on one row in both.
#[pyclass(name = "RectifiedPair", module = "epiline", frozen)]
pub struct PyRectifiedPair {
    left: Py<PyArray2<u8>>,
    right: Py<PyArray2<u8>>,
    left_valid: Py<PyArray2<bool>>,
    right_valid: Py<PyArray2<bool>>,
    geometry: RectifiedGeometry,
}

impl PyRectifiedPair {
    /// A pair from the core's images and masks (0 is invalid).
    pub fn new(
        py: Python<'_>,
        images: [&Image<u8>; 2],
        valid: [ImageRef<'_, u8>; 2],
        geometry: RectifiedGeometry,
    ) -> Self {
        let [left, right] = images.map(|image| image_array(py, image).unbind());
        let [left_valid, right_valid] = valid.map(|mask| mask_array(py, mask).unbind());
        Self { left, right, left_valid, right_valid, geometry }
    }
}

#[pymethods]
impl PyRectifiedPair {
    /// (H, W) uint8: the aligned left image; 0 where it has no source.
    #[getter]
    fn left<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u8>> {
        self.left.bind(py).clone()
    }

    /// (H, W) uint8: the aligned right image; 0 where it has no source.
    #[getter]
    fn right<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u8>> {
        self.right.bind(py).clone()
    }

    /// (H, W) bool: true where the aligned left image has a source; read-only where a Rectifier made the pair.
    #[getter]
    fn left_valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<bool>> {
        self.left_valid.bind(py).clone()
    }

    /// (H, W) bool: true where the aligned right image has a source; read-only as the left one.
    #[getter]
    fn right_valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<bool>> {
        self.right_valid.bind(py).clone()
    }

    /// Geometry of both images.
    #[getter]
    fn geometry(&self) -> PyRectifiedGeometry {
        PyRectifiedGeometry(self.geometry)
    }
}

/// Aligns the images of a calibrated rig; its maps are computed once.
///
/// Both cameras turn by half of the rotation between them and then together until the baseline is horizontal. Both
/// aligned images share focal length (by default that of the cameras) and principal point, placed so that
/// the middle of the output shows the middle of what both cameras see at infinity. Pixels are bilinear combinations
/// of four (eq. 4 of the 2011 paper), at source positions rounded to 1/256 px; a pixel with no source is 0 and
/// marked in the masks.
///
/// Parameters
/// ----------
/// calibration : StereoCalibration
///     The rig.
/// size : (width, height), optional
///     Of both aligned images, pixels; by default that of the left camera, exchanged if the rig is rolled by more than
///     45 degrees.
/// alpha : float, optional
///     How much of the scene is shown: 0 only pixels that have a source in both images, 1 all pixels of both
///     photographs.
/// fov_deg : float, optional
///     The same as the view's width in degrees.
/// focal_px : float, optional
///     The same as a focal length, pixels; on a cylinder pixels per radian. Of these three at most one; by default the
///     middle of the picture keeps its scale.
/// projection : {"pinhole", "cylindrical"}
///     What the images are drawn on: a plane, or for wide lenses a cylinder around the baseline whose columns are
///     angles. ``geometry.points`` gives the points of either; ``to_range`` takes the plane.
///
/// Raises
/// ------
/// ValueError
///     A rig that cannot exist, or an option out of its range.
/// epiline.Error
///     Swapped cameras, a baseline along the viewing direction, or cameras that see nothing in common.
#[pyclass(name = "Rectifier", module = "epiline", frozen)]
pub struct PyRectifier {
    rectifier: Rectifier,
    /// Read-only, and the same for every pair.
    valid: [Py<PyArray2<bool>>; 2],
}

#[pymethods]
impl PyRectifier {
    #[new]
    #[pyo3(signature = (calibration, *, size = None, alpha = None, fov_deg = None, focal_px = None, projection = "pinhole"))]
    fn new(
        py: Python<'_>,
        calibration: &Bound<'_, PyStereoCalibration>,
        size: Option<(i64, i64)>,
        alpha: Option<f64>,
        fov_deg: Option<f64>,
        focal_px: Option<f64>,
        projection: &str,
    ) -> PyResult<Self> {
        let size = size.map(|(w, h)| PyResult::Ok((whole("width", w)?, whole("height", h)?))).transpose()?;
        let scale = match (alpha, fov_deg, focal_px) {
            (None, None, None) => Scale::Natural,
            (Some(alpha), None, None) => Scale::Alpha(alpha),
            (None, Some(fov_deg), None) => Scale::FieldOfView(fov_deg.to_radians()),
            (None, None, Some(focal_px)) => Scale::Focal(focal_px),
            _ => return Err(PyValueError::new_err("alpha, fov_deg, focal_px: give at most one of them")),
        };
        let projection = match projection {
            "pinhole" => Projection::Pinhole,
            "cylindrical" => Projection::Cylindrical,
            other => {
                let expected = "expected pinhole or cylindrical";
                return Err(PyValueError::new_err(format!("projection = '{other}': {expected}")));
            }
        };
        let options = RectifierOptions { size, scale, projection };
        let calibration = &calibration.get().0;
        let rectifier = py.detach(|| Rectifier::with_options(calibration, options)).or_raise()?;
        let valid = [rectifier.left_valid(), rectifier.right_valid()].map(|mask| {
            let array = mask_array(py, mask);
            array.readwrite().make_nonwriteable();
            array.unbind()
        });
        Ok(Self { rectifier, valid })
    }

    /// Geometry of the aligned images.
    #[getter]
    fn geometry(&self) -> PyRectifiedGeometry {
        PyRectifiedGeometry(*self.rectifier.geometry())
    }

    /// Aligns a pair.
    ///
    /// Parameters
    /// ----------
    /// left, right : (H, W) or (H, W, 3) uint8
    ///     Images of the size the cameras were calibrated with; three channels are blue, green, red.
    ///
    /// Returns
    /// -------
    /// RectifiedPair
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Another size, shape or type.
    fn __call__(
        &self,
        py: Python<'_>,
        left: &Bound<'_, PyAny>,
        right: &Bound<'_, PyAny>,
    ) -> PyResult<PyRectifiedPair> {
        let (left, right) = (grey_image("left", left)?, grey_image("right", right)?);
        let (left, right) = (left.view(), right.view());
        let mut aligned = [Image::default(), Image::default()];
        py.detach(|| {
            self.rectifier.rectify_left(left, &mut aligned[0])?;
            self.rectifier.rectify_right(right, &mut aligned[1])
        })
        .or_raise()?;
        let [left, right] = aligned.map(|image| given_array(py, image).unbind());
        let [left_valid, right_valid] = self.valid.each_ref().map(|mask| mask.clone_ref(py));
        let geometry = *self.rectifier.geometry();
        Ok(PyRectifiedPair { left, right, left_valid, right_valid, geometry })
    }
}

fn mask_array<'py>(py: Python<'py>, mask: ImageRef<'_, u8>) -> Bound<'py, PyArray2<bool>> {
    PyArray1::from_iter(py, mask.rows().flatten().map(|&valid| valid != 0))
        .reshape([mask.height(), mask.width()])
        .expect("a mask has height x width elements")
}

/// Vertical residual of an aligned pair, dy = y_right - y_left over its matches.
#[pyclass(name = "AlignmentError", module = "epiline", frozen)]
pub struct PyAlignmentError(pub AlignmentError);

#[pymethods]
impl PyAlignmentError {
    /// Median of abs(dy), pixels; NaN with too few matches.
    #[getter]
    fn median_px(&self) -> f64 {
        self.0.median_px
    }

    /// Median of dy, pixels, positive where the right image is too low; NaN with too few matches.
    #[getter]
    fn signed_median_px(&self) -> f64 {
        self.0.signed_median_px
    }

    /// Robust standard deviation of dy, pixels; NaN with too few matches.
    #[getter]
    fn spread_px(&self) -> f64 {
        self.0.spread_px
    }

    /// Number of matches.
    #[getter]
    fn matches(&self) -> usize {
        self.0.matches.len()
    }

    /// (N, 2) float64: x, y of each match in the left image, pixels.
    #[getter]
    fn left_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.points(py, |found| found.left_px)
    }

    /// (N, 2) float64: x, y of each match in the right image, pixels.
    #[getter]
    fn right_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.points(py, |found| found.right_px)
    }

    fn __repr__(&self) -> String {
        let AlignmentError { median_px, spread_px, matches, .. } = &self.0;
        format!(
            "AlignmentError(median_px={median_px:.3}, spread_px={spread_px:.3}, matches={})",
            matches.len()
        )
    }
}

impl PyAlignmentError {
    fn points<'py>(
        &self,
        py: Python<'py>,
        point: impl FnMut(&PointMatch) -> [f64; 2],
    ) -> Bound<'py, PyArray2<f64>> {
        PyArray1::from_iter(py, self.0.matches.iter().flat_map(point))
            .reshape([self.0.matches.len(), 2])
            .expect("two numbers per match")
    }
}

/// Vertical residual of an already rectified pair, from the pair's own content.
///
/// Parameters
/// ----------
/// left, right : (H, W) or (H, W, 3) uint8
///     The aligned images.
/// num_disparities : int
///     Disparities looked at, 1 to 4096 px.
/// max_offset_px : int
///     Rows up and down looked at, 1 to 64; a larger vertical error is not seen.
/// left_valid, right_valid : (H, W) bool, optional
///     Where the images have a source; nothing near a pixel without one takes part.
///
/// Returns
/// -------
/// AlignmentError
///     Its numbers are NaN if too few points match; its count says so.
///
/// Raises
/// ------
/// ValueError
///     The images differ in size or type, or an option is outside its range.
#[pyfunction]
#[pyo3(
    name = "alignment_error",
    signature = (left, right, *, num_disparities = 192, max_offset_px = 8, left_valid = None, right_valid = None)
)]
fn py_alignment_error(
    py: Python<'_>,
    left: &Bound<'_, PyAny>,
    right: &Bound<'_, PyAny>,
    num_disparities: i64,
    max_offset_px: i64,
    left_valid: Option<&Bound<'_, PyAny>>,
    right_valid: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyAlignmentError> {
    let (left, right) = (grey_image("left", left)?, grey_image("right", right)?);
    let (left, right) = (left.view(), right.view());
    let left_valid = left_valid.map(|mask| mask_image("left_valid", mask)).transpose()?;
    let right_valid = right_valid.map(|mask| mask_image("right_valid", mask)).transpose()?;
    let options = AlignmentOptions {
        num_disparities: whole("num_disparities", num_disparities)?,
        max_offset_px: whole("max_offset_px", max_offset_px)?,
    };
    let measured = py.detach(|| {
        let (left_valid, right_valid) = (left_valid.as_ref(), right_valid.as_ref());
        let mut meter = AlignmentMeter::new(options)?;
        meter.measure(left, right, left_valid.map(Image::view), right_valid.map(Image::view)).cloned()
    });
    measured.map(PyAlignmentError).or_raise()
}
