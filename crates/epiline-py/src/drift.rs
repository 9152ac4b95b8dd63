//! Python face of a rig's drift.

use epiline::rectification::{Drift, DriftAxis, DriftMeter, PointMatch, realign};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::camera::PyStereoCalibration;
use crate::convert::OrRaise;
use crate::rectification::{PyAlignmentError, PyRectifiedGeometry};

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyDrift>()?;
    module.add_function(wrap_pyfunction!(measure_drift, module)?)?;
    module.add_function(wrap_pyfunction!(py_realign, module)?)
}

/// How the right camera has moved against the left since calibration, as far as rows tell.
///
/// Pitch, yaw and roll turn it about the aligned x, y and z axes (right-handed; x right, y down, z forward); zoom is the
/// relative change of its focal length. Rows show a yaw weakly: trust its sigma.
#[pyclass(name = "Drift", module = "epiline", frozen, from_py_object)]
#[derive(Clone, Copy)]
pub struct PyDrift(pub Drift);

#[pymethods]
impl PyDrift {
    /// dict: "pitch", "yaw", "roll" in radians and "zoom", relative.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        named(py, &self.0.values)
    }

    /// dict: standard deviations of the values; infinite before anything was seen.
    #[getter]
    fn sigma<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        named(py, &self.0.sigma)
    }

    /// "pitch", "yaw", "roll" or "zoom": what moved most, beyond doubt; None if the rig holds as far as can be seen.
    #[getter]
    fn axis(&self) -> Option<&'static str> {
        self.0.axis().map(DriftAxis::name)
    }

    /// Number of pairs that spoke.
    #[getter]
    fn frames(&self) -> usize {
        self.0.frames
    }

    /// Number of matches that spoke.
    #[getter]
    fn matches(&self) -> usize {
        self.0.matches
    }

    fn __repr__(&self) -> String {
        let Drift { values, sigma, frames, .. } = self.0;
        let of = |axis: DriftAxis| {
            let i = axis as usize;
            format!("{}={:.2e} ± {:.1e}", axis.name(), values[i], sigma[i])
        };
        format!("Drift({}, frames={frames})", DriftAxis::ALL.map(of).join(", "))
    }
}

fn named<'py>(py: Python<'py>, values: &[f64; 4]) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for axis in DriftAxis::ALL {
        dict.set_item(axis.name(), values[axis as usize])?;
    }
    Ok(dict)
}

/// Drift of a rig from pairs that its calibration aligned.
///
/// Parameters
/// ----------
/// geometry : RectifiedGeometry
///     Of the aligned pairs.
/// residuals : sequence of AlignmentError
///     What alignment_error measured on each pair.
/// calibration : StereoCalibration, optional
///     The one that aligned them: what its covariance leaves uncertain is not taken for drift.
/// reference : Drift, optional
///     Measured when the rig was known to hold; drift counts from there.
///
/// Returns
/// -------
/// Drift
#[pyfunction]
#[pyo3(signature = (geometry, residuals, *, calibration = None, reference = None))]
fn measure_drift(
    geometry: PyRectifiedGeometry,
    residuals: Vec<PyRef<'_, PyAlignmentError>>,
    calibration: Option<&Bound<'_, PyStereoCalibration>>,
    reference: Option<PyDrift>,
) -> PyResult<PyDrift> {
    let mut meter = match calibration {
        Some(calibration) => DriftMeter::for_calibration(&geometry.0, &calibration.get().0).or_raise()?,
        None => DriftMeter::new(&geometry.0),
    };
    if let Some(reference) = reference {
        meter.set_reference(reference.0);
    }
    for residual in &residuals {
        let matches: &[PointMatch] = &residual.0.matches;
        meter.add(matches);
    }
    Ok(PyDrift(meter.drift()))
}

/// The calibration with the right camera turned as the drift says, the correction's uncertainty in its covariance.
///
/// Values that are not beyond doubt stay as calibrated; their uncertainty is added all the same.
///
/// Parameters
/// ----------
/// calibration : StereoCalibration
/// drift : Drift
///     Measured on pairs that this calibration aligned.
///
/// Returns
/// -------
/// StereoCalibration
///
/// Raises
/// ------
/// epiline.Error
///     No pair was seen yet, or the corrected rig cannot be aligned.
#[pyfunction]
#[pyo3(name = "realign")]
fn py_realign(calibration: &Bound<'_, PyStereoCalibration>, drift: PyDrift) -> PyResult<PyStereoCalibration> {
    realign(&calibration.get().0, &drift.0).map(PyStereoCalibration).or_raise()
}
