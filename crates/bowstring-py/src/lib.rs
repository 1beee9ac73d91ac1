//! Python face of `bowstring-core`: arrays in, arrays out, errors as exceptions.

use pyo3::prelude::*;

mod rod;

#[pymodule]
mod _core {
    use super::*;

    #[pymodule_export]
    use super::rod::{Robot, Solution};

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        m.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
