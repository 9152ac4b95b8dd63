//! Python face of `epiline::preprocess`.

use epiline::image::Image;
use epiline::preprocess::{self, GaussianLowPass, equalize_histogram};
use numpy::{PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{OrRaise, Pixels, given_array, grey_image, image_array, typed_image, whole};

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(grey, module)?)?;
    module.add_function(wrap_pyfunction!(equalize, module)?)?;
    module.add_function(wrap_pyfunction!(xsobel, module)?)?;
    module.add_class::<PyGaussianLowPass>()?;
    module.add_function(wrap_pyfunction!(gaussian_low_pass, module)?)
}

/// Grey level of every pixel: Y = 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601), rounded to nearest.
///
/// Parameters
/// ----------
/// image : (H, W, 3) or (H, W) uint8
///     Blue, green, red; a grey image is copied.
///
/// Returns
/// -------
/// (H, W) uint8
///     Equal bit for bit to OpenCV's ``COLOR_BGR2GRAY``.
///
/// Raises
/// ------
/// ValueError
///     Another shape or type.
#[pyfunction]
fn grey<'py>(py: Python<'py>, image: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<u8>>> {
    match grey_image("image", image)? {
        Pixels::Borrowed(array) => Ok(PyArray2::from_array(py, &array.as_array())),
        Pixels::Owned(image) => Ok(given_array(py, image)),
    }
}

/// Histogram equalisation, eq. 3 of the 2011 paper: q = T(w) = 255 * (share of pixels not brighter than w).
///
/// Parameters
/// ----------
/// image : (H, W) or (H, W, 3) uint8
///     Three channels are blue, green, red and become grey first.
///
/// Returns
/// -------
/// (H, W) uint8
///     Rounded to nearest, halves upward.
///
/// Raises
/// ------
/// ValueError
///     Another shape or type.
///
/// Notes
/// -----
/// ``cv2.equalizeHist`` leaves the pixels of the darkest occupied level out of the sum, so that this level becomes 0;
/// here it becomes its own share of 255.
#[pyfunction]
fn equalize<'py>(py: Python<'py>, image: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let image = grey_image("image", image)?;
    let view = image.view();
    let mut equalized = Image::default();
    py.detach(|| equalize_histogram(view, &mut equalized));
    Ok(given_array(py, equalized))
}

/// Horizontal Sobel derivative, clipped to plus or minus `cap` and raised by `cap`: what is left of an image without
/// its exposure.
///
/// Parameters
/// ----------
/// image : (H, W) or (H, W, 3) uint8
///     Three channels are blue, green, red and become grey first.
/// cap : int
///     1 to 63 grey levels.
///
/// Returns
/// -------
/// (H, W) uint8
///     0 to 2 * cap; cap where the image is flat.
///
/// Raises
/// ------
/// ValueError
///     Another shape or type, or a cap outside its range.
#[pyfunction]
#[pyo3(signature = (image, *, cap = 31))]
fn xsobel<'py>(py: Python<'py>, image: &Bound<'py, PyAny>, cap: i64) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let image = grey_image("image", image)?;
    let view = image.view();
    let cap = whole("cap", cap)?;
    let mut filtered = Image::default();
    py.detach(|| preprocess::xsobel(view, cap, &mut filtered)).or_raise()?;
    Ok(image_array(py, &filtered))
}

/// Gaussian low-pass in the frequency domain, eq. 7 of the 2011 paper: H(u, v) = exp(-D(u, v)**2 / (2 sigma**2)).
///
/// Parameters
/// ----------
/// image : (H, W) float32
///     Every pixel finite.
/// sigma : float
///     In the unit of D: frequency samples from the centre of the shifted spectrum, that is, whole periods across
///     the image's width or height. Smaller blurs more.
/// method : "auto" or "frequency"
///     "frequency" transforms, multiplies and transforms back, as the equation is written. "auto" sums over neighbours
///     where that is faster, to within 1e-4 of the image's largest magnitude.
///
/// Returns
/// -------
/// (H, W) float32
///     The image continues periodically, as the discrete transform implies: its right edge blurs into its left.
///
/// Raises
/// ------
/// ValueError
///     Another shape or type, a pixel that is not finite, a sigma that is not positive, an unknown method.
#[pyfunction]
#[pyo3(signature = (image, *, sigma, method = "auto"))]
fn gaussian_low_pass<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    sigma: f64,
    method: &str,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let image = typed_image::<f32>("image", image, "float32")?;
    let view = image.view();
    let mut filtered = Image::default();
    let mut filter = plan(view.width(), view.height(), sigma, method)?;
    py.detach(|| filter.apply(view, &mut filtered)).or_raise()?;
    Ok(given_array(py, filtered))
}

fn plan(width: usize, height: usize, sigma: f64, method: &str) -> PyResult<GaussianLowPass> {
    match method {
        "auto" => GaussianLowPass::new(width, height, sigma),
        "frequency" => GaussianLowPass::in_frequency_domain(width, height, sigma),
        other => {
            let message = format!("method = '{other}': must be 'auto' or 'frequency'");
            return Err(PyValueError::new_err(message));
        }
    }
    .or_raise()
}

/// The filter of gaussian_low_pass for many images of one size: weights and buffers are kept.
///
/// Parameters
/// ----------
/// width, height : int
///     Of the images, px.
/// sigma, method
///     As gaussian_low_pass takes them.
///
/// Raises
/// ------
/// ValueError
///     A size that is none, a sigma that is not positive, an unknown method.
#[pyclass(name = "GaussianLowPass", module = "epiline")]
pub struct PyGaussianLowPass {
    filter: GaussianLowPass,
}

#[pymethods]
impl PyGaussianLowPass {
    #[new]
    #[pyo3(signature = (width, height, *, sigma, method = "auto"))]
    fn new(width: i64, height: i64, sigma: f64, method: &str) -> PyResult<Self> {
        let filter = plan(whole("width", width)?, whole("height", height)?, sigma, method)?;
        Ok(Self { filter })
    }

    /// Filters an image.
    ///
    /// Parameters
    /// ----------
    /// image : (H, W) float32
    ///     Every pixel finite.
    /// out : (H, W) float32, optional
    ///     Takes the answer; contiguous. A new array by default.
    ///
    /// Returns
    /// -------
    /// (H, W) float32
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Another size or type, or a pixel that is not finite.
    #[pyo3(signature = (image, *, out = None))]
    fn __call__<'py>(
        &mut self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        out: Option<Bound<'py, PyArray2<f32>>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let image = typed_image::<f32>("image", image, "float32")?;
        let view = image.view();
        let filter = &mut self.filter;
        let Some(out) = out else {
            let mut filtered = Image::default();
            py.detach(|| filter.apply(view, &mut filtered)).or_raise()?;
            return Ok(given_array(py, filtered));
        };
        let size = [view.height(), view.width()];
        // Fails too where `out` is the image itself, which is borrowed.
        let mut taken = out
            .try_readwrite()
            .map_err(|error| PyValueError::new_err(format!("out: cannot be written: {error}")))?;
        match taken.as_slice_mut() {
            Ok(pixels) if out.shape() == size => py.detach(|| filter.apply_to(view, pixels)).or_raise()?,
            _ => {
                let message =
                    format!("out: expected a contiguous array of shape {size:?}, got {:?}", out.shape());
                return Err(PyValueError::new_err(message));
            }
        }
        drop(taken);
        Ok(out)
    }

    /// Whether it sums over neighbours; else it transforms.
    #[getter]
    fn is_spatial(&self) -> bool {
        self.filter.is_spatial()
    }
}
