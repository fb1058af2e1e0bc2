//! Cameras and poses.

use std::hash::{Hash, Hasher};

use glam::{DMat3, DQuat, DVec3};
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use nvsprior::Pose;
use nvsprior::geometry::rotation_of;
use nvsprior::tracking::Covariance;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::arguments::{whole, wrong_type};
use crate::arrays::{any_numbers, any_rows, array_of_rows, numbers, numeric, rows};
use crate::errors::Failure;

/// A pinhole camera without distortion; all in pixels. x points right, y down, z forward, and the centre of the first
/// pixel lies at (0.5, 0.5). Types: width: int, height: int, fx: float, fy: float, cx: float, cy: float.
#[pyclass(frozen, eq, hash, module = "nvsprior", name = "Camera")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyCamera(pub nvsprior::Camera);

/// Hashes numbers so that equal ones have equal hashes: -0.0 is 0.0.
fn hash_numbers(values: impl IntoIterator<Item = f64>, state: &mut impl Hasher) {
    values.into_iter().for_each(|value| (value + 0.0).to_bits().hash(state));
}

impl Hash for PyCamera {
    fn hash<H: Hasher>(&self, state: &mut H) {
        let nvsprior::Camera { width, height, fx, fy, cx, cy } = self.0;
        (width, height).hash(state);
        hash_numbers([fx, fy, cx, cy].map(f64::from), state);
    }
}

#[pymethods]
impl PyCamera {
    #[new]
    fn new(width: i128, height: i128, fx: f32, fy: f32, cx: f32, cy: f32) -> PyResult<PyCamera> {
        whole!(width, height);
        let camera = nvsprior::Camera { width, height, fx, fy, cx, cy };
        camera.check().map_err(Failure::from)?;
        Ok(PyCamera(camera))
    }

    /// Picture width, pixels. Type: int.
    #[getter]
    fn width(&self) -> u32 {
        self.0.width
    }

    /// Picture height, pixels. Type: int.
    #[getter]
    fn height(&self) -> u32 {
        self.0.height
    }

    /// Focal length along x, pixels. Type: float.
    #[getter]
    fn fx(&self) -> f32 {
        self.0.fx
    }

    /// Focal length along y, pixels. Type: float.
    #[getter]
    fn fy(&self) -> f32 {
        self.0.fy
    }

    /// Principal point, x, pixels. Type: float.
    #[getter]
    fn cx(&self) -> f32 {
        self.0.cx
    }

    /// Principal point, y, pixels. Type: float.
    #[getter]
    fn cy(&self) -> f32 {
        self.0.cy
    }

    /// The same view at another picture size: the intrinsics scale with the sides. Types: width: int, height: int.
    /// Returns Camera.
    fn resized(&self, width: i128, height: i128) -> PyResult<PyCamera> {
        whole!(width, height);
        let camera = self.0.resized(width, height);
        camera.check().map_err(Failure::from)?;
        Ok(PyCamera(camera))
    }

    fn __getnewargs__(&self) -> (u32, u32, f32, f32, f32, f32) {
        let nvsprior::Camera { width, height, fx, fy, cx, cy } = self.0;
        (width, height, fx, fy, cx, cy)
    }

    fn __repr__(&self) -> String {
        let nvsprior::Camera { width, height, fx, fy, cx, cy } = self.0;
        format!("Camera({width}, {height}, {fx}, {fy}, {cx}, {cy})")
    }
}

/// How far a matrix's rows may be from unit length and from right angles.
const RIGID: f64 = 1e-4;

/// Where a camera stands: the motion from world to camera, X_camera = R X_world + t. `rotation`: the quaternion
/// (w, x, y, z) of R, of any length but zero. `translation`: t, in the prior's unit. Types: rotation: array | None,
/// translation: array | None.
#[pyclass(frozen, eq, hash, module = "nvsprior", name = "Pose")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyPose(pub Pose);

/// How far the squared length of a quaternion may be from 1, which then stays as it is: so poses come back from what
/// they were written to, to the last bit.
const UNIT: f64 = 1e-12;

impl Hash for PyPose {
    fn hash<H: Hasher>(&self, state: &mut H) {
        hash_numbers(self.0.wxyz().into_iter().chain(self.0.translation.to_array()), state);
    }
}

/// A `Pose`, or a world-to-camera matrix.
impl FromPyObject<'_, '_> for PyPose {
    type Error = PyErr;

    fn extract(given: Borrowed<PyAny>) -> PyResult<PyPose> {
        PyPose::named("pose", &given)
    }
}

/// One pose, or many: in any sequence, or as an array of their matrices.
pub enum Poses {
    One(PyPose),
    Many(Vec<PyPose>),
}

impl FromPyObject<'_, '_> for Poses {
    type Error = PyErr;

    fn extract(given: Borrowed<PyAny>) -> PyResult<Poses> {
        let is_many = match numeric::<f64>(&given) {
            Ok(array) => array.ndim() == 3 || array.is_empty(),
            Err(_) => given.len().is_ok(),
        };
        if !is_many {
            return given.extract().map(Poses::One);
        }
        let each = given.try_iter()?.enumerate();
        let poses = each.map(|(at, pose)| PyPose::named(&format!("poses[{at}]"), &pose?));
        poses.collect::<PyResult<_>>().map(Poses::Many)
    }
}

impl Poses {
    pub fn all(self) -> Vec<PyPose> {
        match self {
            Poses::One(pose) => vec![pose],
            Poses::Many(poses) => poses,
        }
    }
}

impl PyPose {
    fn named(name: &str, given: &Bound<PyAny>) -> PyResult<PyPose> {
        if let Ok(pose) = given.cast::<PyPose>() {
            return Ok(*pose.get());
        }
        match numeric::<f64>(given) {
            Ok(array) if array.ndim() == 2 => PyPose::of_matrix(name, given),
            _ => {
                let due = format!("{name}: a Pose or a 4x4 array, world to camera,");
                Err(wrong_type(given, &due))
            }
        }
    }

    /// A world-to-camera matrix, of 3 or 4 rows.
    pub fn of_matrix(name: &str, matrix: &Bound<PyAny>) -> PyResult<PyPose> {
        let rows = rows::<4>(name, matrix, 3..=4)?;
        let r = [0, 1, 2].map(|i| DVec3::new(rows[i][0], rows[i][1], rows[i][2]));
        let matrix = DMat3::from_cols(r[0], r[1], r[2]).transpose();
        let ends = rows.get(3).is_none_or(|row| *row == [0.0, 0.0, 0.0, 1.0]);
        let rotation = rotation_of(&matrix, RIGID).filter(|_| ends).ok_or_else(|| {
            let text = "no rigid motion from world to camera: the rows of R must be at right angles and of length 1, \
                        its determinant 1, and the last row 0, 0, 0, 1";
            Failure::argument(format!("{name}: {text}"))
        })?;
        let translation = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
        Ok(PyPose(Pose { rotation, translation }))
    }
}

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
        let given = DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
        let is_unit = (given.length_squared() - 1.0).abs() <= UNIT;
        Ok(PyPose(if is_unit { Pose { rotation: given, ..pose } } else { pose }))
    }

    /// The pose of a world-to-camera matrix [R | t], of shape (3, 4) or (4, 4). Types: matrix: array. Returns Pose.
    #[staticmethod]
    fn from_matrix(matrix: &Bound<PyAny>) -> PyResult<PyPose> {
        PyPose::of_matrix("matrix", matrix)
    }

    /// The unit quaternion of R: (w, x, y, z), float64, shape (4,). Type: float64 array.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.wxyz())
    }

    /// t, float64, shape (3,), in the prior's unit. Type: float64 array.
    #[getter]
    fn translation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.translation.to_array())
    }

    /// The camera's place in the world, float64, shape (3,), in the prior's unit. Type: float64 array.
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.centre().to_array())
    }

    /// The matrix [R | t; 0 1], float64, shape (4, 4). Returns float64 array.
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (r, t) = (self.0.matrix(), self.0.translation);
        let row = |i: usize| [r.col(0)[i], r.col(1)[i], r.col(2)[i], t[i]];
        array_of_rows(py, &[row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
    }

    /// The inverse motion. Returns Pose.
    fn inverse(&self) -> PyPose {
        PyPose(self.0.inverse())
    }

    /// The pose after a small motion of the camera: `step` = (rho, theta), six numbers, rho in the prior's unit and
    /// theta in radians, applied from the left. Types: step: array. Returns Pose.
    fn stepped(&self, step: &Bound<PyAny>) -> PyResult<PyPose> {
        Ok(PyPose(self.0.stepped(&numbers("step", step)?)))
    }

    /// The pose on the way to another: `part` 0 is this one, 1 the other. Types: other: Pose | array, part: float.
    /// Returns Pose.
    fn between(&self, other: PyPose, part: f64) -> PyResult<PyPose> {
        if !part.is_finite() {
            return Err(Failure::argument("part: must be finite").into());
        }
        Ok(PyPose(self.0.between(&other.0, part)))
    }

    fn __getnewargs__(&self) -> ([f64; 4], [f64; 3]) {
        (self.0.wxyz(), self.0.translation.to_array())
    }

    fn __repr__(&self) -> String {
        let (q, t) = (self.0.wxyz(), self.0.translation.to_array());
        format!("Pose({q:?}, {t:?})")
    }
}

/// A pose from sensors or an estimator, and how sure it is. `covariance`: shape (6, 6), of the step (rho, theta) from
/// `pose` to the truth, rho in the prior's unit and theta in radians. `deviation`: in its place, six standard
/// deviations. `age`: seconds from when the pose was taken to when the frame was. Types: pose: Pose | array,
/// covariance: array | None, deviation: array | None, age: float.
#[pyclass(frozen, eq, hash, module = "nvsprior", name = "Hint")]
#[derive(PartialEq)]
pub struct PyHint(pub nvsprior::Hint);

impl Hash for PyHint {
    fn hash<H: Hasher>(&self, state: &mut H) {
        PyPose(self.0.pose).hash(state);
        hash_numbers(self.0.covariance.into_iter().flatten().flatten().chain([self.0.age]), state);
    }
}

/// A `Hint`, or a pose of which nothing else is known.
impl FromPyObject<'_, '_> for PyHint {
    type Error = PyErr;

    fn extract(given: Borrowed<PyAny>) -> PyResult<PyHint> {
        if let Ok(hint) = given.cast::<PyHint>() {
            return Ok(PyHint(hint.get().0));
        }
        let pose = given.extract::<PyPose>().map_err(|error| {
            match error.is_instance_of::<PyTypeError>(given.py()) {
                true => wrong_type(&given, "hint: a Pose, a Hint or a 4x4 array, world to camera,"),
                false => error,
            }
        })?;
        Ok(PyHint(nvsprior::Hint::of(pose.0)))
    }
}

#[pymethods]
impl PyHint {
    #[new]
    #[pyo3(signature = (pose, covariance = None, deviation = None, age = 0.0))]
    fn new(
        pose: PyPose,
        covariance: Option<&Bound<PyAny>>,
        deviation: Option<&Bound<PyAny>>,
        age: f64,
    ) -> PyResult<PyHint> {
        let hint = match (covariance, deviation) {
            (None, None) => nvsprior::Hint::of(pose.0),
            (Some(given), None) => {
                let rows = any_rows::<6>("covariance", given, 6..=6)?;
                let covariance = std::array::from_fn(|i| rows[i]);
                nvsprior::Hint::with_covariance(pose.0, &covariance).ok_or_else(|| {
                    let text = "covariance: not symmetric and positive semidefinite";
                    Failure::argument(text)
                })?
            }
            (None, Some(given)) => {
                let deviation = any_numbers("deviation", given)?;
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

    /// The pose. Type: Pose.
    #[getter]
    fn pose(&self) -> PyPose {
        PyPose(self.0.pose)
    }

    /// Float64, shape (6, 6), also if deviations were given; None: it was not stated. Type: float64 array | None.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.0.covariance.as_ref().map(|rows| array_of_rows(py, rows)).transpose()
    }

    /// Seconds. Type: float.
    #[getter]
    fn age(&self) -> f64 {
        self.0.age
    }

    fn __getnewargs__(&self) -> (PyPose, Option<Covariance>, Option<[f64; 6]>, f64) {
        (PyPose(self.0.pose), self.0.covariance, None, self.0.age)
    }

    fn __repr__(&self) -> String {
        let known = if self.0.covariance.is_some() { ", with a covariance" } else { "" };
        format!("<nvsprior.Hint {}, {} s old{known}>", PyPose(self.0.pose).__repr__(), self.0.age)
    }
}
