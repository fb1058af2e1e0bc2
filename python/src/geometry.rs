//! Cameras and poses.

use glam::{DMat3, DQuat, DVec3};
use numpy::{PyArray1, PyArray2};
use nvsprior::Pose;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{array_of_rows, numbers, rows};
use crate::errors::Failure;

/// A pinhole camera without distortion; all in pixels. x points right, y down, z forward, and the centre of the first
/// pixel lies at (0.5, 0.5).
#[pyclass(frozen, eq, module = "nvsprior", name = "Camera")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyCamera(pub nvsprior::Camera);

#[pymethods]
impl PyCamera {
    #[new]
    fn new(width: u32, height: u32, fx: f32, fy: f32, cx: f32, cy: f32) -> PyResult<PyCamera> {
        let camera = nvsprior::Camera { width, height, fx, fy, cx, cy };
        camera.check().map_err(Failure::from)?;
        Ok(PyCamera(camera))
    }

    /// Picture width, pixels.
    #[getter]
    fn width(&self) -> u32 {
        self.0.width
    }

    /// Picture height, pixels.
    #[getter]
    fn height(&self) -> u32 {
        self.0.height
    }

    /// Focal length along x, pixels.
    #[getter]
    fn fx(&self) -> f32 {
        self.0.fx
    }

    /// Focal length along y, pixels.
    #[getter]
    fn fy(&self) -> f32 {
        self.0.fy
    }

    /// Principal point, x, pixels.
    #[getter]
    fn cx(&self) -> f32 {
        self.0.cx
    }

    /// Principal point, y, pixels.
    #[getter]
    fn cy(&self) -> f32 {
        self.0.cy
    }

    /// The same view at another picture size: the intrinsics scale with the sides.
    fn resized(&self, width: u32, height: u32) -> PyResult<PyCamera> {
        let camera = self.0.resized(width, height);
        camera.check().map_err(Failure::from)?;
        Ok(PyCamera(camera))
    }

    fn __repr__(&self) -> String {
        let nvsprior::Camera { width, height, fx, fy, cx, cy } = self.0;
        format!("Camera({width}, {height}, {fx}, {fy}, {cx}, {cy})")
    }
}

/// How far a matrix's rows may be from unit length and from right angles.
const RIGID: f64 = 1e-4;

/// Where a camera stands: the motion from world to camera, X_camera = R X_world + t. `rotation`: the quaternion
/// (w, x, y, z) of R, of any length but zero. `translation`: t, in the prior's unit.
#[pyclass(frozen, eq, module = "nvsprior", name = "Pose")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyPose(pub Pose);

#[pymethods]
impl PyPose {
    #[new]
    #[pyo3(signature = (rotation = None, translation = None))]
    fn new(
        rotation: Option<&Bound<PyAny>>,
        translation: Option<&Bound<PyAny>>,
    ) -> PyResult<PyPose> {
        let q = rotation.map_or(Ok([1.0, 0.0, 0.0, 0.0]), |given| numbers("rotation", given))?;
        let t = translation.map_or(Ok([0.0; 3]), |given| numbers("translation", given))?;
        let pose = Pose::from_wxyz(q, t);
        let pose = pose.ok_or_else(|| Failure::argument("rotation: the quaternion is zero"))?;
        Ok(PyPose(pose))
    }

    /// The pose of a world-to-camera matrix [R | t], of shape (3, 4) or (4, 4).
    #[staticmethod]
    fn from_matrix(matrix: &Bound<PyAny>) -> PyResult<PyPose> {
        let rows = rows::<4>("matrix", matrix, 3..=4)?;
        let r = [0, 1, 2].map(|i| DVec3::new(rows[i][0], rows[i][1], rows[i][2]));
        let matrix = DMat3::from_cols(r[0], r[1], r[2]).transpose();
        let off = (matrix * matrix.transpose() - DMat3::IDENTITY).to_cols_array();
        let rigid = off.iter().all(|value| value.abs() <= RIGID) && matrix.determinant() > 0.0;
        if !rigid || rows.get(3).is_some_and(|row| *row != [0.0, 0.0, 0.0, 1.0]) {
            let text =
                "matrix: no rigid motion; its rows are not at right angles or not of length 1";
            return Err(Failure::argument(text).into());
        }
        let translation = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
        let rotation = DQuat::from_mat3(&matrix).normalize();
        Ok(PyPose(Pose { rotation, translation }))
    }

    /// The unit quaternion of R: (w, x, y, z), float64, shape (4,).
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.wxyz())
    }

    /// t, float64, shape (3,), in the prior's unit.
    #[getter]
    fn translation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.translation.to_array())
    }

    /// The camera's place in the world, float64, shape (3,), in the prior's unit.
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.centre().to_array())
    }

    /// The matrix [R | t; 0 1], float64, shape (4, 4).
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (r, t) = (self.0.matrix(), self.0.translation);
        let row = |i: usize| [r.col(0)[i], r.col(1)[i], r.col(2)[i], t[i]];
        array_of_rows(py, &[row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
    }

    /// The inverse motion.
    fn inverse(&self) -> PyPose {
        PyPose(self.0.inverse())
    }

    /// The pose after a small motion of the camera: `step` = (rho, theta), six numbers, rho in the prior's unit and
    /// theta in radians, applied from the left.
    fn stepped(&self, step: &Bound<PyAny>) -> PyResult<PyPose> {
        Ok(PyPose(self.0.stepped(&numbers("step", step)?)))
    }

    /// The pose on the way to another: `part` 0 is this one, 1 the other.
    fn between(&self, other: &PyPose, part: f64) -> PyResult<PyPose> {
        if !part.is_finite() {
            return Err(PyValueError::new_err("part: must be finite"));
        }
        Ok(PyPose(self.0.between(&other.0, part)))
    }

    fn __repr__(&self) -> String {
        let (q, t) = (self.0.wxyz(), self.0.translation.to_array());
        format!("Pose({q:?}, {t:?})")
    }
}

/// A pose from sensors or an estimator, and how sure it is. `covariance`: shape (6, 6), of the step (rho, theta) from
/// `pose` to the truth, rho in the prior's unit and theta in radians. `deviation`: in its place, six standard
/// deviations. `age`: seconds from when the pose was taken to when the frame was.
#[pyclass(frozen, module = "nvsprior", name = "Hint")]
pub struct PyHint(pub nvsprior::Hint);

#[pymethods]
impl PyHint {
    #[new]
    #[pyo3(signature = (pose, covariance = None, deviation = None, age = 0.0))]
    fn new(
        pose: &PyPose,
        covariance: Option<&Bound<PyAny>>,
        deviation: Option<&Bound<PyAny>>,
        age: f64,
    ) -> PyResult<PyHint> {
        let hint = match (covariance, deviation) {
            (None, None) => nvsprior::Hint::of(pose.0),
            (Some(given), None) => {
                let rows = rows::<6>("covariance", given, 6..=6)?;
                let covariance = std::array::from_fn(|i| rows[i]);
                nvsprior::Hint::with_covariance(pose.0, &covariance).ok_or_else(|| {
                    let text = "covariance: not symmetric and positive semidefinite";
                    Failure::argument(text)
                })?
            }
            (None, Some(given)) => {
                let deviation = numbers("deviation", given)?;
                nvsprior::Hint::with_deviation(pose.0, &deviation)
                    .ok_or_else(|| Failure::argument("deviation: a number is negative"))?
            }
            (Some(_), Some(_)) => {
                return Err(Failure::argument("covariance and deviation: give one of them").into());
            }
        };
        if !(age.is_finite() && age >= 0.0) {
            return Err(Failure::argument(format!("age: {age} s, must be 0 or more")).into());
        }
        Ok(PyHint(nvsprior::Hint { age, ..hint }))
    }

    /// The pose.
    #[getter]
    fn pose(&self) -> PyPose {
        PyPose(self.0.pose)
    }

    /// Seconds.
    #[getter]
    fn age(&self) -> f64 {
        self.0.age
    }
}
