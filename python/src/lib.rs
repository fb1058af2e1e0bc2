//! The native part of the Python package `nvsprior`. It holds no algorithm: what a method does is a method of the Rust
//! library. Docstrings are the reference; `nvsprior/_nvsprior.pyi` has the types.

// Not published: the docstrings tell.
#![allow(missing_docs)]
#![deny(unsafe_code)]

mod arguments;
mod arrays;
mod channel;
mod decoder;
mod encoder;
mod engine;
mod errors;
mod geometry;
mod handle;
mod keys;
mod map;
mod options;
mod prior;
mod prior_arrays;
mod record;
mod renderer;
mod signals;
mod topside;
mod vehicle;

use pyo3::prelude::*;

#[pymodule]
mod _nvsprior {
    #[pymodule_export]
    use super::channel::PyChannel;
    #[pymodule_export]
    use super::decoder::{PyDecoded, PyDecoder};
    #[pymodule_export]
    use super::encoder::{PyEncoded, PyEncoder};
    #[pymodule_export]
    use super::engine::{PyEngine, devices};
    #[pymodule_export]
    use super::geometry::{PyCamera, PyHint, PyPose};
    #[pymodule_export]
    use super::keys::PyKeys;
    #[pymodule_export]
    use super::map::map;
    #[pymodule_export]
    use super::prior::PyPrior;
    #[pymodule_export]
    use super::renderer::PyRenderer;
    #[pymodule_export]
    use super::topside::{PyReceived, PyTopside, PyTopsideLink, join, split};
    #[pymodule_export]
    use super::vehicle::{PyDivision, PyVehicleLink};
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        errors::load(module.py())
    }
}
