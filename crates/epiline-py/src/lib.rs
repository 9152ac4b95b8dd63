//! Python bindings: arrays in, arrays out, the GIL released while the core works, errors mapped; no arithmetic.

use pyo3::prelude::*;

mod convert;
mod matching;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<convert::exception::Error>())?;
    matching::register(module)?;
    Ok(())
}
