//! Priors.

use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{Extras, KeyFrames, ply, replace_file};
use nvsprior::{Prior, RenderOverrides};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arguments::Bytes;
use crate::arrays::numbers;
use crate::errors::Failure;
use crate::geometry::{Poses, PyPose};
use crate::handle::detached;
use crate::prior_arrays::{self, Arrays};

/// A trained 3D Gaussian Splatting scene, checked, in host memory. Both sides of a link hold the same. It never
/// changes; engines upload it when something draws it.
#[pyclass(frozen, module = "nvsprior", name = "Prior")]
pub struct PyPrior(pub Arc<Prior>);

/// Steps of a compact prior's quantisation, as multiples of the usual ones: those of `nvsprior map`.
const FINENESS: f32 = 0.25;

/// Render options that replace those of a prior's file.
fn overrides(
    near: Option<f32>,
    alpha_max: Option<f32>,
    antialiased: Option<bool>,
    background: Option<&Bound<PyAny>>,
    trained_focal: Option<f32>,
) -> PyResult<RenderOverrides> {
    let background = background.map(|given| numbers::<3>("background", given)).transpose()?;
    let background = background.map(|values| values.map(|value| value as f32));
    Ok(RenderOverrides { near, alpha_max, antialiased, background, trained_focal })
}

/// A prior that was read. Warns of what was left out of it.
fn told(py: Python, prior: Prior) -> PyResult<PyPrior> {
    for note in prior.report().notes() {
        let text = CString::new(note.replace('\0', "?")).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)?;
    }
    Ok(PyPrior(Arc::new(prior)))
}

#[pymethods]
impl PyPrior {
    /// Reads a prior from a file: .ply, .nvsg, .nvsb, .spz, .glb, .sog or .compressed.ply; the content tells the
    /// format. Beside a foreign file its PATH.nvsx is read, too. The other arguments replace the file's render options.
    /// Types: path: str | PathLike, near: float | None, alpha_max: float | None, antialiased: bool | None, background:
    /// array | None, trained_focal: float | None. Returns Prior.
    #[staticmethod]
    #[pyo3(signature = (path, *, near = None, alpha_max = None, antialiased = None, background = None,
        trained_focal = None))]
    fn open(
        py: Python,
        path: PathBuf,
        near: Option<f32>,
        alpha_max: Option<f32>,
        antialiased: Option<bool>,
        background: Option<&Bound<PyAny>>,
        trained_focal: Option<f32>,
    ) -> PyResult<PyPrior> {
        let overrides = overrides(near, alpha_max, antialiased, background, trained_focal)?;
        told(py, detached(py, || Ok(nvsprior_formats::open(&path, &overrides)?))?)
    }

    /// Reads a prior from a file's content. `name` stands for the file in errors. Types: content: bytes-like, name:
    /// str, near: float | None, alpha_max: float | None, antialiased: bool | None, background: array | None,
    /// trained_focal: float | None. Returns Prior.
    #[staticmethod]
    #[pyo3(signature = (content, name = "prior", *, near = None, alpha_max = None, antialiased = None,
        background = None, trained_focal = None))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn from_bytes(
        py: Python,
        content: Bytes,
        name: &str,
        near: Option<f32>,
        alpha_max: Option<f32>,
        antialiased: Option<bool>,
        background: Option<&Bound<PyAny>>,
        trained_focal: Option<f32>,
    ) -> PyResult<PyPrior> {
        let overrides = overrides(near, alpha_max, antialiased, background, trained_focal)?;
        let content = &content[..];
        told(py, detached(py, || Ok(nvsprior_formats::from_bytes(content, name, &overrides)?))?)
    }

    /// The splats in gsplat's names and shapes, as float32: `means` (N, 3), `scales` (N, 3), `quats` (N, 4) as (w, x,
    /// y, z) of length 1, `opacities` (N,), `sh` (N, K, 3). `raw`: logarithms of scales, logits of opacities,
    /// quaternions of any length, as a prior holds them. Types: raw: bool. Returns dict[str, float32 array].
    #[pyo3(signature = (*, raw = false))]
    fn arrays<'py>(&self, py: Python<'py>, raw: bool) -> PyResult<Bound<'py, PyDict>> {
        prior_arrays::arrays(py, self.0.splats(), raw)
    }

    /// A prior of such arrays. `like`: a prior that gives all else: render options, key frames, coder tables; None:
    /// gsplat's options, and nothing else. If `like` has an `origin`, means count from it; else means in float64 that
    /// lie far from zero keep their digits, and the prior gets an origin. `raw`: as `arrays` gives it; with `like` the
    /// identity then comes back. Without `raw`, values are rounded anew, so what comes back may be another prior.
    /// Types: means: array, scales: array, quats: array, opacities: array, sh: array, raw: bool, like: Prior | None.
    /// Returns Prior.
    #[staticmethod]
    #[pyo3(signature = (means, scales, quats, opacities, sh, *, raw = false, like = None))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn from_arrays(
        py: Python,
        means: &Bound<PyAny>,
        scales: &Bound<PyAny>,
        quats: &Bound<PyAny>,
        opacities: &Bound<PyAny>,
        sh: &Bound<PyAny>,
        raw: bool,
        like: Option<&PyPrior>,
    ) -> PyResult<PyPrior> {
        let arrays = Arrays { means, scales, quats, opacities, sh };
        told(py, arrays.prior(py, raw, like.map(|like| &like.0))?)
    }

    /// Number of splats. Returns int.
    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// The identity: eight hexadecimal digits. If it is not equal on both sides of a link, their pictures differ. Type:
    /// str.
    #[getter]
    fn id(&self) -> String {
        self.0.id().to_string()
    }

    /// The format that it was read from. Type: str.
    #[getter]
    fn format(&self) -> String {
        self.0.report().format.to_string()
    }

    /// What was left out when it was read, a line for each reason; empty if all splats were valid. Type: list[str].
    #[getter]
    fn dropped(&self) -> Vec<String> {
        self.0.report().dropped.iter().map(ToString::to_string).collect()
    }

    /// The world's point that the means of `arrays` count from: not zero if the scene lies far from its coordinates'
    /// origin. Poses are the world's everywhere. Type: tuple[float, float, float].
    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.0.origin().into()
    }

    /// The poses at which a lost camera is looked for. Type: list[Pose].
    #[getter]
    fn key_frames(&self) -> Vec<PyPose> {
        let origin = self.0.origin();
        self.0.key_frames().poses().iter().map(|pose| PyPose(pose.absolute_from(origin))).collect()
    }

    /// The same prior with other key frames. They are no part of its identity. Types: poses: list[Pose | array] |
    /// array. Returns Prior.
    fn with_key_frames(&self, poses: Poses) -> PyResult<PyPrior> {
        let origin = self.0.origin();
        let poses = poses.all().iter().map(|pose| pose.0.relative_to(origin)).collect();
        let key_frames = KeyFrames::new(poses).map_err(Failure::from)?;
        Ok(PyPrior(Arc::new(self.0.as_ref().clone().with_key_frames(key_frames))))
    }

    /// Writes it to a file, by the name's ending: .nvsg (compact, quantised: another identity) with all that it holds,
    /// or .ply, which holds no coder tables, no weights of the display filter and no doubt. Types: path: str |
    /// PathLike. Returns None.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        detached(py, || save(&self.0, &path))?;
        Ok(())
    }

    fn __repr__(&self) -> String {
        format!("<nvsprior.Prior {}, {} splats>", self.0.id(), self.0.len())
    }
}

fn save(prior: &Prior, path: &Path) -> Result<(), Failure> {
    let (splats, besides) = (prior.splats(), prior.besides());
    let mut bytes = Vec::new();
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("nvsg") => {
            let quantisation = Quantisation::default().scaled(FINENESS);
            compact::write(splats, &besides, &quantisation, &mut bytes)?;
        }
        Some("ply") if besides.coder_tables.is_some() => {
            return Err(Failure::argument("path: a .ply holds no coder tables; save a .nvsg"));
        }
        Some("ply") => {
            let Extras { key_frames, preprocessing, .. } = besides.extras;
            ply::write_ply(splats, besides.options, key_frames, preprocessing, &mut bytes)?;
        }
        _ => {
            let path = path.display();
            return Err(Failure::argument(format!("path: {path} does not end in .nvsg or .ply")));
        }
    }
    Ok(replace_file(path, &bytes)?)
}
