//! Pictures of a prior.

use numpy::{PyArray1, PyArray2, PyArray4, PyArrayMethods};
use nvsprior::render::{Jacobian, Plan, Renderer};
use nvsprior::tracking::Objective;
use nvsprior::{Engine, Picture, Pose};
use pyo3::prelude::*;

use crate::arrays::{array_of_rows, check_out, read_picture, write_picture, wrong_shape};
use crate::engine::PyEngine;
use crate::errors::Failure;
use crate::geometry::{Poses, PyCamera, PyPose};
use crate::handle::{Handle, detached};
use crate::prior::PyPrior;

/// Draws a prior as one camera sees it. Types: engine: Engine, prior: Prior, camera: Camera.
#[pyclass(frozen, module = "nvsprior", name = "Renderer")]
pub struct PyRenderer {
    handle: Handle<Drawn>,
    camera: PyCamera,
}

struct Drawn {
    engine: Engine,
    renderer: Renderer,
    picture: Picture,
    /// Made when it is first asked for.
    objective: Option<Objective>,
}

impl Drawn {
    /// Draws it from a pose in the world, as floats.
    fn draw(&mut self, pose: &Pose) -> Result<&[f32], nvsprior::Error> {
        Ok(self.renderer.draw(&pose.relative_to(self.renderer.scene().origin()))?)
    }

    /// As [`draw`](Self::draw), into `picture`.
    fn picture(&mut self, pose: &Pose) -> Result<(), nvsprior::Error> {
        let pose = pose.relative_to(self.renderer.scene().origin());
        Ok(self.renderer.picture(&pose, &mut self.picture)?)
    }
}

/// Floats of a raw pixel.
const CHANNELS: usize = 5;

type Derivatives<'py> = (f64, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl PyRenderer {
    #[new]
    fn new(
        py: Python,
        engine: &PyEngine,
        prior: &PyPrior,
        camera: &PyCamera,
    ) -> PyResult<PyRenderer> {
        let drawn = detached(py, || {
            let (scene, engine) = (engine.scene(&prior.0)?, engine.get()?.clone());
            let renderer = engine.renderer(&scene, &camera.0, Plan::picture())?;
            let picture = Picture::new(camera.0.width, camera.0.height);
            Ok(Drawn { engine, renderer, picture, objective: None })
        })?;
        Ok(PyRenderer { handle: Handle::new(drawn), camera: *camera })
    }

    /// The picture at a pose: uint8, shape (height, width, 3), RGB. Of many poses, a list or an array of shape (N, 4,
    /// 4): shape (N, height, width, 3). `out`: an array of that shape to write to. Types: pose: Pose | array |
    /// list[Pose | array], out: uint8 array | None. Returns uint8 array.
    #[pyo3(signature = (pose, *, out = None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        pose: Poses,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let poses = match pose {
            Poses::One(pose) => return self.picture(py, pose, out),
            Poses::Many(poses) => poses,
        };
        let (width, height) = (self.camera.0.width as usize, self.camera.0.height as usize);
        let shape = [poses.len(), height, width, 3];
        let pictures = match out {
            Some(out) => out.clone(),
            None => PyArray4::<u8>::zeros(py, shape, false).into_any(),
        };
        if pictures.len()? != poses.len() {
            return Err(wrong_shape("out", &[pictures.len()?], &format!("{shape:?}")).into());
        }
        for (at, pose) in poses.into_iter().enumerate() {
            self.picture(py, pose, Some(&pictures.get_item(at)?))?;
            py.check_signals()?;
        }
        Ok(pictures)
    }

    /// What the picture is made of: float32, shape (height, width, 5): linear R, G, B as blended, before clamping;
    /// depth (the sum of weight times depth, in the prior's unit); transmittance. Types: pose: Pose | array. Returns
    /// float32 array.
    fn render_raw<'py>(&self, py: Python<'py>, pose: PyPose) -> PyResult<Bound<'py, PyAny>> {
        let camera = self.camera.0;
        let values =
            self.handle.enter()?.detached(py, |drawn| Ok(drawn.draw(&pose.0)?.to_vec()))?;
        let size = [camera.height as usize, camera.width as usize, CHANNELS];
        Ok(PyArray1::from_vec(py, values).reshape(size)?.into_any())
    }

    /// The mean squared error of the render at a pose against a frame, values in [0, 1], and its derivatives by a step
    /// of `Pose.stepped`: the gradient, shape (6,), and Gauss-Newton's approximation of the second derivatives, shape
    /// (6, 6). `-numpy.linalg.solve(second, gradient)` is Gauss-Newton's step. Types: frame: uint8 array, pose: Pose |
    /// array. Returns tuple[float, float64 array, float64 array].
    fn derivatives<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<PyAny>,
        pose: PyPose,
    ) -> PyResult<Derivatives<'py>> {
        let mut call = self.handle.enter()?;
        read_picture("frame", frame, &mut call.picture)?;
        let (found, camera) = ((call.picture.width, call.picture.height), self.camera.0);
        let expected = (camera.width, camera.height);
        if found != expected {
            call.picture.resize(expected.0, expected.1);
            return Err(Failure::from(nvsprior::Error::FrameSize { expected, found }).into());
        }
        let equations = call.detached(py, |drawn| {
            let objective = match &mut drawn.objective {
                Some(objective) => objective,
                none => {
                    let plan = Plan { jacobians: vec![Jacobian::Exact], ..Plan::picture() };
                    let scene = drawn.renderer.scene();
                    none.insert(Objective::new(drawn.engine.renderer(scene, &camera, plan)?))
                }
            };
            objective.set_frame(&drawn.picture);
            let here = pose.0.relative_to(drawn.renderer.scene().origin());
            Ok(objective.evaluate(0, Jacobian::Exact, &here)?)
        })?;
        let second = equations.jtj.map(|row| row.map(|v| 2.0 * v / equations.residuals as f64));
        let gradient = PyArray1::from_slice(py, &equations.gradient());
        Ok((equations.mse(), gradient, array_of_rows(py, &second)?))
    }

    /// The camera. Type: Camera.
    #[getter]
    fn camera(&self) -> PyCamera {
        self.camera
    }
}

impl PyRenderer {
    fn picture<'py>(
        &self,
        py: Python<'py>,
        pose: PyPose,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let camera = self.camera.0;
        out.map(|out| check_out("out", out, (camera.width, camera.height))).transpose()?;
        let mut call = self.handle.enter()?;
        call.detached(py, |drawn| Ok(drawn.picture(&pose.0)?))?;
        write_picture(py, &call.picture, out)
    }
}
