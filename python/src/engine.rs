//! The engine: a device with its pipelines.

use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use nvsprior::render::Scene;
use nvsprior::vulkan::DeviceOptions;
use nvsprior::{Engine, Prior};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::{Bytes, whole, wrong_type};
use crate::errors::Failure;
use crate::handle::{Owned, detached};

/// A device's number, or a part of a name.
pub struct DeviceArgument(String);

impl FromPyObject<'_, '_> for DeviceArgument {
    type Error = PyErr;

    fn extract(given: Borrowed<PyAny>) -> PyResult<DeviceArgument> {
        let number = || given.extract::<i128>().map(|number| number.to_string());
        let found = given.extract::<String>().or_else(|_| number());
        found
            .map(DeviceArgument)
            .map_err(|_| wrong_type(&given, "device: a number, a part of a name or None"))
    }
}

/// A Vulkan device with its pipelines. Make it once, and share it between threads, encoders and decoders.
///
/// `device`: its number, or a part of its name or of its driver's name; None: the best one. `validation`: run under
/// the Khronos validation layer. `memory_limit`: most bytes of device memory; 0: all. `watchdog`: seconds that one
/// submission may take; None: no bound. `pipeline_cache`: what `pipeline_cache()` gave before. Types: device: str | int
/// | None, validation: bool, memory_limit: int, watchdog: float | None, pipeline_cache: bytes-like | None.
#[pyclass(frozen, module = "nvsprior", name = "Engine")]
pub struct PyEngine {
    engine: Owned<Engine>,
    /// Priors that are uploaded, as long as somebody draws them.
    uploaded: Mutex<Vec<(Weak<Prior>, Weak<Scene>)>>,
}

impl PyEngine {
    pub fn get(&self) -> Result<&Engine, Failure> {
        self.engine.get()
    }

    /// A prior on the device: the one that is there already, or a new one.
    pub fn scene(&self, prior: &Arc<Prior>) -> Result<Arc<Scene>, Failure> {
        let engine = self.get()?;
        // Only whole pairs are put in, so what a thread that panicked left is valid.
        let mut uploaded = self.uploaded.lock().unwrap_or_else(PoisonError::into_inner);
        uploaded.retain(|(prior, scene)| prior.strong_count() > 0 && scene.strong_count() > 0);
        let same = |(of, _): &&(Weak<Prior>, Weak<Scene>)| of.as_ptr() == Arc::as_ptr(prior);
        if let Some(scene) = uploaded.iter().find(same).and_then(|(_, scene)| scene.upgrade()) {
            return Ok(scene);
        }
        let scene = engine.upload(prior)?;
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
        device: Option<DeviceArgument>,
        validation: bool,
        memory_limit: i128,
        watchdog: Option<f64>,
        pipeline_cache: Option<Bytes>,
    ) -> PyResult<PyEngine> {
        whole!(memory_limit);
        let watchdog = watchdog.map(|seconds| match Duration::try_from_secs_f64(seconds) {
            Ok(time) if !time.is_zero() => Ok(time),
            _ => Err(Failure::argument(format!("watchdog: {seconds} s, must be positive"))),
        });
        let options = DeviceOptions {
            device: device.map(|device| device.0),
            validation,
            memory_limit,
            watchdog: watchdog.transpose()?,
            pipeline_cache: pipeline_cache.map(|cache| cache.to_vec()).unwrap_or_default(),
            given: None,
        };
        let engine = detached(py, || Ok(Engine::new(&options).map_err(nvsprior::Error::from)?))?;
        Ok(PyEngine { engine: Owned::new(engine), uploaded: Mutex::default() })
    }

    /// The device's name. Type: str.
    #[getter]
    fn device(&self) -> PyResult<&str> {
        Ok(&self.get()?.device().name)
    }

    /// The driver's name and version. Type: str.
    #[getter]
    fn driver(&self) -> PyResult<&str> {
        Ok(&self.get()?.device().driver)
    }

    /// Whether the device draws what every portable device draws, byte for byte. Type: bool.
    #[getter]
    fn portable(&self) -> PyResult<bool> {
        Ok(self.get()?.device().portable)
    }

    /// Bytes of device memory in use. Type: int.
    #[getter]
    fn memory(&self) -> PyResult<u64> {
        Ok(self.get()?.memory().used)
    }

    /// Messages of the validation layer so far. Type: list[str].
    #[getter]
    fn validation_messages(&self) -> PyResult<Vec<String>> {
        Ok(self.get()?.validation_messages())
    }

    /// What the driver has compiled. Give it to a later engine, which then starts faster. Returns bytes.
    fn pipeline_cache<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = detached(py, || Ok(self.get()?.vulkan().pipeline_cache()?))?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn __repr__(&self) -> String {
        match self.get() {
            Ok(engine) => format!("<nvsprior.Engine on {}>", engine.device()),
            Err(_) => "<nvsprior.Engine of another process>".into(),
        }
    }
}

/// The Vulkan devices of the installed drivers by name, in the order of their numbers. Returns list[str].
#[pyfunction]
pub fn devices(py: Python) -> PyResult<Vec<String>> {
    let devices = detached(py, || Ok(nvsprior::vulkan::devices()?))?;
    Ok(devices.iter().map(|device| device.info.name.clone()).collect())
}
