//! Python face of alignment without calibration.

use epiline::image::Image;
use epiline::rectification::{PairAlignment, align_pair};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::camera::{PyCameraModel, matrix_array};
use crate::convert::{OrRaise, grey_image, image_array, mapped_array, rows_of};

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyPairAlignment>()?;
    module.add_function(wrap_pyfunction!(align_candidates, module)?)
}

/// A pair aligned by its own content, and whether that can be trusted.
#[pyclass(name = "PairAlignment", module = "epiline", frozen)]
pub struct PyPairAlignment(PairAlignment);

#[pymethods]
impl PyPairAlignment {
    /// (H, W) uint8: the aligned left image; 0 where it has no source.
    #[getter]
    fn left<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u8>> {
        image_array(py, &self.0.images[0])
    }

    /// (H, W) uint8: the aligned right image; 0 where it has no source.
    #[getter]
    fn right<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u8>> {
        image_array(py, &self.0.images[1])
    }

    /// (H, W) bool: true where the aligned left image has a source.
    #[getter]
    fn left_valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<bool>> {
        mask(py, &self.0.valid[0])
    }

    /// (H, W) bool: true where the aligned right image has a source.
    #[getter]
    fn right_valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<bool>> {
        mask(py, &self.0.valid[1])
    }

    /// Two (3, 3) float64: map pixels of the left and of the right photograph, once freed of lens distortion, to
    /// pixels of the aligned images.
    #[getter]
    fn homographies<'py>(&self, py: Python<'py>) -> [Bound<'py, PyArray2<f64>>; 2] {
        self.0.homographies.each_ref().map(|h| matrix_array(py, h))
    }

    /// Two (3, 3) float64: rotate directions of the left and of the right camera into the aligned frame.
    #[getter]
    fn rotations<'py>(&self, py: Python<'py>) -> [Bound<'py, PyArray2<f64>>; 2] {
        self.0.aligned_from_camera.each_ref().map(|r| matrix_array(py, r))
    }

    /// Left and right lens: those given, or the estimate; None if there is none.
    #[getter]
    fn lens(&self) -> Option<[PyCameraModel; 2]> {
        self.0.cameras.map(|cameras| cameras.map(PyCameraModel))
    }

    /// Median vertical disparity of matches that the fit did not see, pixels; NaN if there are none.
    #[getter]
    fn epipolar_error_px(&self) -> f64 {
        self.0.epipolar_error_px
    }

    /// Vertical error, one sigma, that nine tenths of the view stay below by the fit's own account, pixels.
    #[getter]
    fn sigma_px(&self) -> f64 {
        self.0.sigma_px
    }

    /// Number of matches that the fit rests on.
    #[getter]
    fn matches(&self) -> usize {
        self.0.matches.len()
    }

    /// (N, 2) float64: x, y of each match in the left photograph, pixels.
    #[getter]
    fn left_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        points(py, &self.0, 0)
    }

    /// (N, 2) float64: x, y of each match in the right photograph, pixels.
    #[getter]
    fn right_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        points(py, &self.0, 1)
    }

    /// Whether nothing speaks against the alignment.
    #[getter]
    fn trusted(&self) -> bool {
        self.0.is_trusted()
    }

    /// Why the alignment must not be trusted, in words; empty if it can be.
    #[getter]
    fn reason(&self) -> String {
        self.0.reasons.join("; ")
    }

    fn __repr__(&self) -> String {
        let PairAlignment { epipolar_error_px, sigma_px, matches, .. } = &self.0;
        let trusted = if self.0.is_trusted() { "True" } else { "False" };
        format!(
            "PairAlignment(trusted={trusted}, epipolar_error_px={epipolar_error_px:.3}, sigma_px={sigma_px:.3}, \
             matches={})",
            matches.len()
        )
    }
}

fn mask<'py>(py: Python<'py>, valid: &Image<u8>) -> Bound<'py, PyArray2<bool>> {
    mapped_array(py, valid, |v| v != 0)
}

fn points<'py>(py: Python<'py>, alignment: &PairAlignment, side: usize) -> Bound<'py, PyArray2<f64>> {
    PyArray1::from_iter(py, alignment.matches.iter().flat_map(|found| found[side]))
        .reshape([alignment.matches.len(), 2])
        .expect("two numbers per match")
}

/// Aligns a pair from candidate matches; `epiline.align` finds them.
///
/// Parameters
/// ----------
/// left, right : (H, W) or (H, W, 3) uint8
/// left_px, right_px : (N, 2) array_like
///     x, y of matched features in the photographs, pixels; many may be wrong.
/// lens : pair of CameraModel, optional
///
/// Returns
/// -------
/// PairAlignment
///
/// Raises
/// ------
/// ValueError
///     Images, lenses or lists of different sizes.
#[pyfunction]
#[pyo3(signature = (left, right, left_px, right_px, lens = None))]
fn align_candidates(
    py: Python<'_>,
    left: &Bound<'_, PyAny>,
    right: &Bound<'_, PyAny>,
    left_px: &Bound<'_, PyAny>,
    right_px: &Bound<'_, PyAny>,
    lens: Option<[PyCameraModel; 2]>,
) -> PyResult<PyPairAlignment> {
    let (left, right) = (grey_image("left", left)?, grey_image("right", right)?);
    let (left_px, right_px) = (rows_of::<2>("left_px", left_px)?, rows_of::<2>("right_px", right_px)?);
    if left_px.len() != right_px.len() {
        let message =
            format!("{} left and {} right features: each needs its partner", left_px.len(), right_px.len());
        return Err(pyo3::exceptions::PyValueError::new_err(message));
    }
    let candidates: Vec<_> = left_px.into_iter().zip(right_px).map(|(l, r)| [l, r]).collect();
    let lenses = lens.map(|lens| lens.map(|camera| camera.0));
    let (left, right) = (left.view(), right.view());
    py.detach(|| align_pair(left, right, &candidates, lenses)).map(PyPairAlignment).or_raise()
}
