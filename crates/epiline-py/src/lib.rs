//! Python bindings: arrays in, arrays out, the GIL released while the core works, errors mapped; no arithmetic.

use pyo3::prelude::*;

mod align;
mod calibration;
mod camera;
mod convert;
mod drift;
mod ground;
mod matching;
mod obstacles;
mod pipeline;
mod preprocess;
mod range;
mod rectification;
mod regions;
mod scan;
mod tracking;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<convert::exception::Error>())?;
    camera::register(module)?;
    calibration::register(module)?;
    preprocess::register(module)?;
    rectification::register(module)?;
    align::register(module)?;
    drift::register(module)?;
    matching::register(module)?;
    range::register(module)?;
    regions::register(module)?;
    ground::register(module)?;
    obstacles::register(module)?;
    tracking::register(module)?;
    scan::register(module)?;
    pipeline::register(module)?;
    Ok(())
}
