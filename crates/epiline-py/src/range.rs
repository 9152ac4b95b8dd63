//! Python face of `epiline::range`.

use std::cell::Cell;
use std::ffi::CString;
use std::sync::Arc;

use epiline::pipeline::FrameResult;
use epiline::range::{
    RangeCurve, RangeImage, fit_range_curve, fit_range_curve_robustly, to_range, to_range_by_confidence,
    useful_depth_m,
};
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::{PyUserWarning, PyValueError};
use pyo3::prelude::*;

use crate::convert::{OrRaise, image_array, vector_of};
use crate::matching::PyDisparityMap;
use crate::rectification::PyRectifiedGeometry;

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyRangeImage>()?;
    module.add_class::<PyRangeCurve>()?;
    module.add_function(wrap_pyfunction!(py_to_range, module)?)?;
    module.add_function(wrap_pyfunction!(py_useful_depth_m, module)?)?;
    module.add_function(wrap_pyfunction!(py_fit_range_curve, module)?)
}

/// Metres of every pixel of the left aligned image.
///
/// Arrays are NaN where the disparity map has no value, and where the two rays do not meet in front of the cameras.
#[pyclass(name = "RangeImage", module = "epiline", frozen)]
pub struct PyRangeImage(Holder);

/// Who owns the image: this object, or the frame it is part of.
enum Holder {
    Own(Box<RangeImage>),
    Frame(Arc<FrameResult>),
}

impl PyRangeImage {
    /// The range image of a frame, not copied.
    pub fn of_frame(frame: Arc<FrameResult>) -> Self {
        Self(Holder::Frame(frame))
    }

    fn image(&self) -> &RangeImage {
        match &self.0 {
            Holder::Own(image) => image,
            Holder::Frame(frame) => &frame.range,
        }
    }
}

#[pymethods]
impl PyRangeImage {
    /// (H, W) float32: Z along the optical axis, metres. A new array at each access, as the next three.
    #[getter]
    fn depth_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        image_array(py, &self.image().depth_m)
    }

    /// (H, W) float32: Euclidean distance from the left camera, metres.
    #[getter]
    fn range_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        image_array(py, &self.image().range_m)
    }

    /// (H, W) float32: standard deviation of `range_m`, metres, matching and calibration together.
    #[getter]
    fn sigma_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        image_array(py, &self.image().sigma_m)
    }

    /// (H, W) uint8: the bits of the disparity map.
    #[getter]
    fn validity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u8>> {
        image_array(py, &self.image().validity)
    }

    /// Every pixel that has a depth as a point.
    ///
    /// Parameters
    /// ----------
    /// color : (H, W) or (H, W, 3) uint8, optional
    ///     The left aligned image; three channels are blue, green, red.
    ///
    /// Returns
    /// -------
    /// (N, 3) or (N, 6) float32
    ///     X, Y, Z in metres in the left aligned frame (x right, y down, z forward), row after row of the image; with
    ///     a colour also red, green, blue, 0 to 255.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The colour image has another size, shape or type.
    #[pyo3(signature = (color = None))]
    fn points<'py>(
        &self,
        py: Python<'py>,
        color: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let image = self.image();
        let (numbers, columns) = match color {
            None => (image.points().flat_map(|(_, _, point)| point).collect::<Vec<_>>(), 3),
            Some(color) => {
                let red_green_blue = color_lookup(color, image)?;
                let row = |(x, y, [px, py, pz]): (usize, usize, [f32; 3])| {
                    let [r, g, b] = red_green_blue(x, y);
                    [px, py, pz, r, g, b]
                };
                (image.points().flat_map(row).collect(), 6)
            }
        };
        let rows = numbers.len() / columns;
        Ok(PyArray1::from_vec(py, numbers).reshape([rows, columns]).expect("rows x columns numbers"))
    }

    fn __repr__(&self) -> String {
        let image = self.image();
        format!("RangeImage({}x{} px)", image.width(), image.height())
    }
}

/// Red, green and blue of a pixel of a grey or BGR image of the range image's size.
fn color_lookup(
    color: &Bound<'_, PyAny>,
    image: &RangeImage,
) -> PyResult<impl Fn(usize, usize) -> [f32; 3] + use<>> {
    // Grey images are spread over three equal channels, so that there is one kind from here on.
    let numpy = color.py().import("numpy")?;
    let array = numpy.call_method1("atleast_3d", (color,))?;
    let array = array.extract::<PyReadonlyArray3<'_, u8>>().map_err(|_| {
        PyValueError::new_err("color: expected a uint8 array (H, W) or (H, W, 3)".to_string())
    })?;
    let &[height, width, channels] = array.shape() else { unreachable!("three dimensions") };
    if (width, height) != (image.width(), image.height()) || !matches!(channels, 1 | 3) {
        let message = format!(
            "color: expected a uint8 array ({h}, {w}) or ({h}, {w}, 3), got shape ({height}, {width}, {channels})",
            h = image.height(),
            w = image.width()
        );
        return Err(PyValueError::new_err(message));
    }
    let values: Vec<u8> = array.as_array().iter().copied().collect();
    Ok(move |x, y| {
        let at = (y * width + x) * channels;
        if channels == 1 {
            [f32::from(values[at]); 3]
        } else {
            [2, 1, 0].map(|channel| f32::from(values[at + channel]))
        }
    })
}

/// Depth, range and sigma of a disparity map.
///
/// Z = focal_px * baseline_m / (d + doffs_px), equation 2 of the 2011 paper; range_m is Z times the length of the
/// pixel's ray; sigma_m is made from Z**2 times the disparity's standard deviation / (focal_px * baseline_m) and the
/// calibration's own uncertainty.
///
/// Parameters
/// ----------
/// disparity : DisparityMap
///     Disparities of the left image.
/// geometry : RectifiedGeometry
///     Of the aligned pair, of the map's size.
/// disparity_sigma_px : float, optional
///     Standard deviation of every disparity, px. By default each pixel has its own, by the map's confidence: 0.15 px
///     where that is full to 2 px where there is next to none, as measured on scenes with ground truth.
///
/// Returns
/// -------
/// RangeImage
///
/// Raises
/// ------
/// ValueError
///     Map and geometry differ in size, or a standard deviation that is negative or not finite.
#[pyfunction]
#[pyo3(name = "to_range", signature = (disparity, geometry, *, disparity_sigma_px = None))]
fn py_to_range(
    py: Python<'_>,
    disparity: PyRef<'_, PyDisparityMap>,
    geometry: PyRectifiedGeometry,
    disparity_sigma_px: Option<f64>,
) -> PyResult<PyRangeImage> {
    let (map, geometry) = (&disparity.inner, geometry.0);
    let image = py.detach(|| {
        let mut image = Box::new(RangeImage::new(&geometry));
        match disparity_sigma_px {
            Some(sigma_px) => to_range(map, &geometry, sigma_px, &mut image),
            None => to_range_by_confidence(map, &geometry, &mut image),
        }
        .map(|()| image)
    });
    Ok(PyRangeImage(Holder::Own(image.or_raise()?)))
}

/// The depth up to which the standard deviation of a depth stays below a share of it, metres.
///
/// Parameters
/// ----------
/// geometry : RectifiedGeometry
///     Of the aligned pair; what its calibration is uncertain of counts.
/// share : float
///     For example 0.1 for 10 %.
/// disparity_sigma_px : float
///     Standard deviation of a disparity, px.
///
/// Returns
/// -------
/// float
///     Infinite where the share is never exceeded, 0 where it always is.
///
/// Raises
/// ------
/// ValueError
///     A share that is not positive, a standard deviation that is negative or not finite, or a cylindrical pair.
#[pyfunction]
#[pyo3(name = "useful_depth_m", signature = (geometry, share, *, disparity_sigma_px = 0.25))]
fn py_useful_depth_m(geometry: PyRectifiedGeometry, share: f64, disparity_sigma_px: f64) -> PyResult<f64> {
    useful_depth_m(&geometry.0, disparity_sigma_px, share).or_raise()
}

/// distance = a e^(b x) + c e^(d x), x a disparity in pixels, distance in metres: equation 6 of the 2011 paper.
///
/// Made by fit_range_curve; it means nothing outside span_px.
#[pyclass(name = "RangeCurve", module = "epiline", frozen)]
pub struct PyRangeCurve(RangeCurve);

/// A float64 array of any shape.
type Floats<'py> = Bound<'py, PyArrayDyn<f64>>;

/// `f` of every element of anything NumPy reads as float64, in the same shape.
fn elementwise<'py>(values: &Bound<'py, PyAny>, f: impl Fn(f64) -> PyResult<f64>) -> PyResult<Floats<'py>> {
    let py = values.py();
    let numpy = py.import("numpy")?;
    let array = numpy.call_method1("asarray", (values, "float64"))?;
    let array = array.cast_into::<PyArrayDyn<f64>>()?;
    let mapped = array.readonly().as_array().iter().map(|&v| f(v)).collect::<PyResult<Vec<f64>>>()?;
    PyArray1::from_vec(py, mapped).reshape(array.shape())
}

impl PyRangeCurve {
    /// Warns of the first disparity that the fit has not seen the like of.
    fn warn_outside(&self, disparity_px: &Bound<'_, PyAny>) -> PyResult<()> {
        let outside = Cell::new(None);
        elementwise(disparity_px, |x| {
            if !self.0.covers(x) && outside.get().is_none() {
                outside.set(Some(x));
            }
            Ok(x)
        })?;
        let Some(x) = outside.get() else { return Ok(()) };
        let (low, high) = self.0.span_px;
        let message =
            format!("disparity_px = {x} px: the curve was fitted to {low} to {high} px and is a guess there");
        let message = CString::new(message).expect("numbers and words hold no zero byte");
        PyErr::warn(disparity_px.py(), &disparity_px.py().get_type::<PyUserWarning>(), &message, 1)
    }
}

#[pymethods]
impl PyRangeCurve {
    /// Amplitude of the first exponential, metres.
    #[getter]
    fn a(&self) -> f64 {
        self.0.a
    }

    /// Rate of the first exponential, 1/px; smaller than d.
    #[getter]
    fn b(&self) -> f64 {
        self.0.b
    }

    /// Amplitude of the second exponential, metres.
    #[getter]
    fn c(&self) -> f64 {
        self.0.c
    }

    /// Rate of the second exponential, 1/px.
    #[getter]
    fn d(&self) -> f64 {
        self.0.d
    }

    /// (4,) float64: standard errors of a, b, c, d; very large where the data leave a constant open.
    #[getter]
    fn standard_errors<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.standard_errors())
    }

    /// (4, 4) float64: covariance of a, b, c, d in the linear approximation at the fit.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        // Symmetric, so that nalgebra's order of storage does not matter.
        PyArray1::from_slice(py, self.0.covariance().as_slice()).reshape([4, 4]).expect("4 x 4 numbers")
    }

    /// Root of the mean squared residual, metres.
    #[getter]
    fn rmse_m(&self) -> f64 {
        self.0.rmse_m
    }

    /// Share of the distances' variance that the curve explains.
    #[getter]
    fn r_squared(&self) -> f64 {
        self.0.r_squared
    }

    /// Smallest and largest disparity it was fitted to, px.
    #[getter]
    fn span_px(&self) -> (f64, f64) {
        self.0.span_px
    }

    /// How many pairs it was fitted to.
    #[getter]
    fn samples(&self) -> usize {
        self.0.samples
    }

    /// (K,) int64: which of the pairs given were left out as outliers, by their place in the list.
    #[getter]
    fn outliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.0.outliers.iter().map(|&place| place as i64))
    }

    /// Distance, metres, at disparities in pixels; in the shape of its argument.
    ///
    /// Warns
    /// -----
    /// UserWarning
    ///     A disparity outside span_px, where the curve is a guess.
    fn predict<'py>(&self, disparity_px: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
        self.warn_outside(disparity_px)?;
        elementwise(disparity_px, |x| Ok(self.0.predict(x)))
    }

    /// Bounds, metres, between which one new measurement at each disparity falls with probability `confidence`.
    ///
    /// Parameters
    /// ----------
    /// disparity_px : array_like
    ///     Disparities, px.
    /// confidence : float
    ///     Between 0 and 1.
    ///
    /// Returns
    /// -------
    /// tuple of two float64 arrays
    ///     Lower and upper bounds, in the shape of the argument (delta method, Student's t).
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     A confidence outside (0, 1).
    ///
    /// Warns
    /// -----
    /// UserWarning
    ///     A disparity outside span_px, where neither the curve nor its interval can be relied on.
    #[pyo3(signature = (disparity_px, *, confidence = 0.95))]
    fn predict_interval<'py>(
        &self,
        disparity_px: &Bound<'py, PyAny>,
        confidence: f64,
    ) -> PyResult<(Floats<'py>, Floats<'py>)> {
        self.warn_outside(disparity_px)?;
        let interval = |x| self.0.predict_interval(x, confidence).or_raise();
        Ok((
            elementwise(disparity_px, |x| interval(x).map(|(low, _)| low))?,
            elementwise(disparity_px, |x| interval(x).map(|(_, high)| high))?,
        ))
    }

    fn __repr__(&self) -> String {
        let RangeCurve { a, b, c, d, rmse_m, .. } = &self.0;
        format!("RangeCurve(a={a}, b={b}, c={c}, d={d}, rmse_m={rmse_m:.4})")
    }
}

/// Fits distance = a e^(b x) + c e^(d x), equation 6 of the 2011 paper, by least squares in distance.
///
/// Starts from everywhere and answers with the lowest sum of squares found. Where the data follow a single
/// exponential the predictions are good but the constants are not determined: standard_errors says so.
///
/// Parameters
/// ----------
/// disparity_px, distance_m : (N,) array_like
///     Measured pairs, in any order; at least 5, with at least 4 different disparities.
/// robust : bool
///     Leave out pairs that do not fit with most of the others; the curve's `outliers` are their places in the list.
///
/// Returns
/// -------
/// RangeCurve
///
/// Raises
/// ------
/// ValueError
///     Lists of different length, fewer than 5 pairs, or a number that is not finite.
/// epiline.Error
///     Fewer than 4 different disparities.
#[pyfunction]
#[pyo3(name = "fit_range_curve", signature = (disparity_px, distance_m, *, robust = false))]
fn py_fit_range_curve(
    py: Python<'_>,
    disparity_px: &Bound<'_, PyAny>,
    distance_m: &Bound<'_, PyAny>,
    robust: bool,
) -> PyResult<PyRangeCurve> {
    let disparity_px = vector_of("disparity_px", disparity_px)?;
    let distance_m = vector_of("distance_m", distance_m)?;
    let fit = if robust { fit_range_curve_robustly } else { fit_range_curve };
    py.detach(|| fit(&disparity_px, &distance_m)).map(PyRangeCurve).or_raise()
}
