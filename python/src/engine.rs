//! The engine: a device with its pipelines.

use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use nvsprior::render::Scene;
use nvsprior::vulkan::DeviceOptions;
use nvsprior::{Engine, Prior};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::Failure;
use crate::handle::detached;

/// A Vulkan device with its pipelines. Make it once, and share it between threads, encoders and decoders.
///
/// `device`: its number, or a part of its name or of its driver's name; None: the best one. `validation`: run under
/// the Khronos validation layer. `memory_limit`: most bytes of device memory; 0: all. `watchdog`: seconds that one
/// submission may take; None: no bound. `pipeline_cache`: what `pipeline_cache()` gave before.
#[pyclass(frozen, module = "nvsprior", name = "Engine")]
pub struct PyEngine {
    pub engine: Engine,
    /// Priors that are uploaded, as long as somebody draws them.
    uploaded: Mutex<Vec<(Weak<Prior>, Weak<Scene>)>>,
}

impl PyEngine {
    /// A prior on the device: the one that is there already, or a new one.
    pub fn scene(&self, prior: &Arc<Prior>) -> Result<Arc<Scene>, Failure> {
        // Only whole pairs are put in, so what a thread that panicked left is valid.
        let mut uploaded = self.uploaded.lock().unwrap_or_else(PoisonError::into_inner);
        uploaded.retain(|(prior, scene)| prior.strong_count() > 0 && scene.strong_count() > 0);
        let same = |(of, _): &&(Weak<Prior>, Weak<Scene>)| of.as_ptr() == Arc::as_ptr(prior);
        if let Some(scene) = uploaded.iter().find(same).and_then(|(_, scene)| scene.upgrade()) {
            return Ok(scene);
        }
        let scene = self.engine.upload(prior)?;
        uploaded.push((Arc::downgrade(prior), Arc::downgrade(&scene)));
        Ok(scene)
    }
}

#[pymethods]
impl PyEngine {
    #[new]
    #[pyo3(signature = (device = None, *, validation = false, memory_limit = 0, watchdog = None,
        pipeline_cache = None))]
    fn new(
        py: Python,
        device: Option<String>,
        validation: bool,
        memory_limit: u64,
        watchdog: Option<f64>,
        pipeline_cache: Option<&[u8]>,
    ) -> PyResult<PyEngine> {
        let watchdog = watchdog.map(|seconds| match Duration::try_from_secs_f64(seconds) {
            Ok(time) if !time.is_zero() => Ok(time),
            _ => Err(Failure::argument(format!("watchdog: {seconds} s, must be positive"))),
        });
        let options = DeviceOptions {
            device,
            validation,
            memory_limit,
            watchdog: watchdog.transpose()?,
            pipeline_cache: pipeline_cache.unwrap_or_default().to_vec(),
            given: None,
        };
        let engine = detached(py, || Ok(Engine::new(&options).map_err(nvsprior::Error::from)?))?;
        Ok(PyEngine { engine, uploaded: Mutex::default() })
    }

    /// The device's name.
    #[getter]
    fn device(&self) -> &str {
        &self.engine.device().name
    }

    /// The driver's name and version.
    #[getter]
    fn driver(&self) -> &str {
        &self.engine.device().driver
    }

    /// Whether the device draws what every portable device draws, byte for byte.
    #[getter]
    fn portable(&self) -> bool {
        self.engine.device().portable
    }

    /// Bytes of device memory in use.
    #[getter]
    fn memory(&self) -> u64 {
        self.engine.memory().used
    }

    /// Messages of the validation layer so far.
    #[getter]
    fn validation_messages(&self) -> Vec<String> {
        self.engine.validation_messages()
    }

    /// What the driver has compiled. Give it to a later engine, which then starts faster.
    fn pipeline_cache<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = detached(py, || Ok(self.engine.vulkan().pipeline_cache()?))?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn __repr__(&self) -> String {
        format!("<nvsprior.Engine on {}>", self.engine.device())
    }
}

/// The Vulkan devices of the installed drivers by name, in the order of their numbers.
#[pyfunction]
pub fn devices(py: Python) -> PyResult<Vec<String>> {
    let devices = detached(py, || Ok(nvsprior::vulkan::devices()?))?;
    Ok(devices.iter().map(|device| device.info.name.clone()).collect())
}
