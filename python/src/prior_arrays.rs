//! A prior's splats as arrays, in gsplat's names and shapes.

use std::sync::Arc;

use numpy::PyArray1;
use numpy::prelude::*;
use nvsprior::prior::{Besides, Extras, PriorFile, PriorFormat, Splats, origin_of};
use nvsprior::{Prior, RenderOptions, RenderOverrides};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{self, numeric, wrong_shape};
use crate::errors::Failure;
use crate::handle::detached;

/// `is_raw`: logarithms of scales, logits of opacities and quaternions of any length, as they are held.
pub fn arrays<'py>(py: Python<'py>, splats: &Splats, is_raw: bool) -> PyResult<Bound<'py, PyDict>> {
    let count = splats.len();
    let array = |values: &[f32], shape: &[usize]| {
        Ok::<_, PyErr>(PyArray1::from_slice(py, values).reshape(shape)?.into_any())
    };
    let arrays = PyDict::new(py);
    arrays.set_item("means", array(splats.positions.as_flattened(), &[count, 3])?)?;
    let scales = splats.log_scales.as_flattened();
    let quats = splats.rotations.as_flattened();
    if is_raw {
        arrays.set_item("scales", array(scales, &[count, 3])?)?;
        arrays.set_item("quats", array(quats, &[count, 4])?)?;
        arrays.set_item("opacities", array(&splats.opacity_logits, &[count])?)?;
    } else {
        let scales: Vec<f32> = scales.iter().map(|scale| scale.exp()).collect();
        let quats: Vec<_> = (0..count).map(|index| splats.unit_rotation(index)).collect();
        let opacities: Vec<f32> = (0..count).map(|index| splats.opacity(index) as f32).collect();
        arrays.set_item("scales", array(&scales, &[count, 3])?)?;
        arrays.set_item("quats", array(quats.as_flattened(), &[count, 4])?)?;
        arrays.set_item("opacities", array(&opacities, &[count])?)?;
    }
    let coefficients = splats.sh_stride() / 3;
    arrays.set_item("sh", array(&splats.sh, &[count, coefficients, 3])?)?;
    Ok(arrays)
}

/// Numbers, and the array's shape.
fn floats(name: &str, given: &Bound<PyAny>) -> PyResult<(Vec<f32>, Vec<usize>)> {
    let due = || PyTypeError::new_err(format!("{name}: an array of numbers is due"));
    let array = numeric::<f32>(given).map_err(|_| due())?;
    Ok((array.as_slice().map_err(|_| due())?.to_vec(), array.shape().to_vec()))
}

/// Rows of so many numbers, one for each splat.
fn rows<const N: usize>(
    name: &str,
    given: &Bound<PyAny>,
    count: Option<usize>,
) -> PyResult<Vec<[f32; N]>> {
    let (values, shape) = floats(name, given)?;
    let due = [count.unwrap_or(shape.first().copied().unwrap_or_default()), N];
    if shape != due {
        return Err(wrong_shape(name, &shape, &format!("{due:?}")).into());
    }
    Ok(values.as_chunks::<N>().0.to_vec())
}

fn is_moved(origin: &[f64; 3]) -> bool {
    *origin != [0.0; 3]
}

/// The arrays of a prior.
pub struct Arrays<'a, 'py> {
    pub means: &'a Bound<'py, PyAny>,
    pub scales: &'a Bound<'py, PyAny>,
    pub quats: &'a Bound<'py, PyAny>,
    pub opacities: &'a Bound<'py, PyAny>,
    pub sh: &'a Bound<'py, PyAny>,
}

impl Arrays<'_, '_> {
    /// `origin`: what the means count from. `None`: zero, or a point near to them if they lie far from there.
    fn splats(&self, is_raw: bool, origin: Option<[f64; 3]>) -> PyResult<Splats> {
        let means = arrays::any_rows::<3>("means", self.means, 0..=usize::MAX)?;
        let (moved, shown) = match origin {
            Some(origin) => ([0.0; 3], origin),
            None => {
                let origin = origin_of(&means).unwrap_or_default();
                (origin, origin)
            }
        };
        let from = |p: &[f64; 3]| std::array::from_fn(|axis| (p[axis] - moved[axis]) as f32);
        let positions: Vec<[f32; 3]> = means.iter().map(from).collect();
        let count = positions.len();
        let mut log_scales = rows::<3>("scales", self.scales, Some(count))?;
        let rotations = rows::<4>("quats", self.quats, Some(count))?;
        let (mut opacity_logits, shape) = floats("opacities", self.opacities)?;
        if shape != [count] {
            return Err(wrong_shape("opacities", &shape, &format!("[{count}]")).into());
        }
        let (sh, shape) = floats("sh", self.sh)?;
        let degree = (0..=Splats::MAX_SH_DEGREE)
            .find(|degree| shape == [count, (*degree as usize + 1).pow(2), 3]);
        let due = format!("[{count}, K, 3] with K of 1, 4, 9 or 16");
        let sh_degree = degree.ok_or_else(|| wrong_shape("sh", &shape, &due))?;
        if !is_raw {
            log_scales.as_flattened_mut().iter_mut().for_each(|scale| *scale = scale.ln());
            let logit = |p: f32| (f64::from(p) / (1.0 - f64::from(p))).ln() as f32;
            opacity_logits.iter_mut().for_each(|opacity| *opacity = logit(*opacity));
        }
        Ok(Splats {
            origin: shown,
            positions,
            log_scales,
            rotations,
            opacity_logits,
            sh,
            sh_degree,
        })
    }

    /// The prior of these splats, with all else of another one.
    pub fn prior(&self, py: Python, is_raw: bool, like: Option<&Arc<Prior>>) -> PyResult<Prior> {
        let splats = self.splats(is_raw, like.map(|like| like.splats().origin).filter(is_moved))?;
        let options = like.map_or(RenderOptions::GSPLAT, |like| *like.options());
        let count = splats.len();
        let mut file = PriorFile::new(splats, options, PriorFormat::Memory);
        if let Some(like) = like {
            let Besides { frame, coder_tables, extras, .. } = like.besides();
            (file.frame, file.coder_tables) = (frame.copied(), coder_tables.cloned());
            let doubt = extras.doubt.clone().filter(|doubt| doubt.len() == count);
            file.extras = Extras { doubt, ..extras.clone() };
        }
        let none = RenderOverrides::default();
        let read = || Ok::<_, Failure>(Prior::from_content(file, "arrays", &none)?);
        Ok(detached(py, read)?)
    }
}
