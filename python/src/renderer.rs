//! Pictures of a prior.

use numpy::{PyArray1, PyArrayMethods};
use nvsprior::Picture;
use nvsprior::render::{Plan, Renderer};
use pyo3::prelude::*;

use crate::arrays::{check_out, write_picture};
use crate::engine::PyEngine;
use crate::geometry::{PyCamera, PyPose};
use crate::handle::{Handle, detached};
use crate::prior::PyPrior;

/// Draws a prior as one camera sees it.
#[pyclass(frozen, module = "nvsprior", name = "Renderer")]
pub struct PyRenderer {
    handle: Handle<Drawn>,
    camera: PyCamera,
}

struct Drawn {
    renderer: Renderer,
    picture: Picture,
}

/// Floats of a raw pixel.
const CHANNELS: usize = 5;

#[pymethods]
impl PyRenderer {
    #[new]
    fn new(
        py: Python,
        engine: &PyEngine,
        prior: &PyPrior,
        camera: &PyCamera,
    ) -> PyResult<PyRenderer> {
        let renderer = detached(py, || {
            let scene = engine.scene(&prior.0)?;
            Ok(engine.engine.renderer(&scene, &camera.0, Plan::picture())?)
        })?;
        let picture = Picture::new(camera.0.width, camera.0.height);
        Ok(PyRenderer { handle: Handle::new(Drawn { renderer, picture }), camera: *camera })
    }

    /// The picture at a pose: uint8, shape (height, width, 3), RGB. `out`: an array of that shape to write to.
    #[pyo3(signature = (pose, *, out = None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        pose: &PyPose,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let camera = self.camera.0;
        out.map(|out| check_out("out", out, (camera.width, camera.height))).transpose()?;
        let mut call = self.handle.enter()?;
        call.detached(py, |drawn| Ok(drawn.renderer.picture(&pose.0, &mut drawn.picture)?))?;
        write_picture(py, &call.picture, out)
    }

    /// What the picture is made of: float32, shape (height, width, 5): linear R, G, B as blended, before clamping;
    /// depth (the sum of weight times depth, in the prior's unit); transmittance.
    fn render_raw<'py>(&self, py: Python<'py>, pose: &PyPose) -> PyResult<Bound<'py, PyAny>> {
        let camera = self.camera.0;
        let values = self
            .handle
            .enter()?
            .detached(py, |drawn| Ok(drawn.renderer.draw(&pose.0)?.to_vec()))?;
        let size = [camera.height as usize, camera.width as usize, CHANNELS];
        Ok(PyArray1::from_vec(py, values).reshape(size)?.into_any())
    }

    /// The camera.
    #[getter]
    fn camera(&self) -> PyCamera {
        self.camera
    }
}
