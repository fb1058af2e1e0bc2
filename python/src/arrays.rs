//! NumPy's arrays in and out. What is wrong with one is told with the argument's name.

use numpy::prelude::*;
use numpy::{
    AllowTypeChange, Element, PyArray1, PyArray2, PyArray3, PyArrayLike1, PyArrayLike2,
    PyReadonlyArrayDyn, PyUntypedArray, dtype,
};
use nvsprior::Picture;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::errors::Failure;

/// An array of a type, as it is.
///
/// # Errors
/// `TypeError` with the name if it is no array, or of another type.
fn typed<'py, T: Element>(
    name: &str,
    given: &Bound<'py, PyAny>,
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let py = given.py();
    let Ok(array) = given.cast::<PyUntypedArray>() else {
        let kind = given.get_type();
        return Err(PyTypeError::new_err(format!("{name}: a NumPy array is due, not {kind}")));
    };
    if !array.dtype().is_equiv_to(&dtype::<T>(py)) {
        let (found, due) = (array.dtype(), dtype::<T>(py));
        return Err(PyTypeError::new_err(format!("{name}: dtype {found}, but {due} is due")));
    }
    given.extract::<PyReadonlyArrayDyn<T>>()
}

fn wrong_shape(name: &str, found: &[usize], due: &str) -> Failure {
    Failure::argument(format!("{name}: an array of shape {found:?}, but {due} is due"))
}

/// Copies an array of any layout into a picture that has memory already. A C-contiguous one is copied at once.
pub fn read_picture(name: &str, given: &Bound<PyAny>, into: &mut Picture) -> PyResult<()> {
    let array = typed::<u8>(name, given)?;
    let &[height, width, 3] = array.shape() else {
        return Err(wrong_shape(name, array.shape(), "(height, width, 3)").into());
    };
    let side = |length: usize| {
        u32::try_from(length).map_err(|_| Failure::argument(format!("{name}: a side of {length}")))
    };
    into.resize(side(width)?, side(height)?);
    match array.as_slice() {
        // It takes Fortran's order, too, in which other values lie side by side.
        Ok(bytes) if array.is_c_contiguous() => into.data.copy_from_slice(bytes),
        _ => {
            let values = array.as_array();
            into.data.iter_mut().zip(values.iter()).for_each(|(into, value)| *into = *value);
        }
    }
    Ok(())
}

/// Which pixels count: an array of bool, or of uint8, of which 128 and more counts.
pub fn read_mask(
    name: &str,
    given: &Bound<PyAny>,
    (width, height): (u32, u32),
) -> PyResult<Vec<bool>> {
    let size = [height as usize, width as usize];
    let check = |found: &[usize]| match found == size {
        true => Ok(()),
        false => Err(wrong_shape(name, found, &format!("{size:?}, (height, width)"))),
    };
    if let Ok(array) = typed::<bool>(name, given) {
        check(array.shape())?;
        return Ok(array.as_array().iter().copied().collect());
    }
    let array = typed::<u8>(name, given)?;
    check(array.shape())?;
    Ok(array.as_array().iter().map(|value| *value >= nvsprior::image::Mask::WHITE).collect())
}

/// Finds out before any work whether a picture of this size can be written to an array.
pub fn check_out(name: &str, out: &Bound<PyAny>, (width, height): (u32, u32)) -> PyResult<()> {
    let array = typed::<u8>(name, out)?;
    let size = [height as usize, width as usize, 3];
    if array.shape() != size {
        return Err(wrong_shape(name, array.shape(), &format!("{size:?}")).into());
    }
    let writeable = out.getattr("flags")?.getattr("writeable")?.extract::<bool>()?;
    if !(writeable && array.is_c_contiguous()) {
        let text = format!("{name}: the array must be writeable and C-contiguous");
        return Err(Failure::argument(text).into());
    }
    Ok(())
}

/// Writes a picture to `out`, or to a new array: uint8, (height, width, 3). An `out` was checked.
pub fn write_picture<'py>(
    py: Python<'py>,
    picture: &Picture,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let size = [picture.height as usize, picture.width as usize, 3];
    let Some(out) = out else {
        return Ok(PyArray1::from_slice(py, &picture.data).reshape(size)?.into_any());
    };
    check_out("out", out, (picture.width, picture.height))?;
    let mut array = out
        .cast::<PyArray3<u8>>()?
        .try_readwrite()
        .map_err(|error| Failure::argument(format!("out: another call uses the array: {error}")))?;
    let bytes = array.as_slice_mut().map_err(|error| Failure::argument(format!("out: {error}")))?;
    bytes.copy_from_slice(&picture.data);
    Ok(out.clone())
}

/// So many finite numbers.
pub fn numbers<const N: usize>(name: &str, given: &Bound<PyAny>) -> PyResult<[f64; N]> {
    let due = || PyTypeError::new_err(format!("{name}: {N} numbers are due"));
    let array = given.extract::<PyArrayLike1<f64, AllowTypeChange>>().map_err(|_| due())?;
    let values = array.as_array();
    if values.len() != N {
        return Err(wrong_shape(name, array.shape(), &format!("({N},)")).into());
    }
    let values: [f64; N] = std::array::from_fn(|i| values[i]);
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(values),
        false => Err(Failure::argument(format!("{name}: all numbers must be finite")).into()),
    }
}

/// Rows of finite numbers; `rows` says how many there may be.
pub fn rows<const N: usize>(
    name: &str,
    given: &Bound<PyAny>,
    rows: std::ops::RangeInclusive<usize>,
) -> PyResult<Vec<[f64; N]>> {
    let due = || PyTypeError::new_err(format!("{name}: rows of {N} numbers are due"));
    let array = given.extract::<PyArrayLike2<f64, AllowTypeChange>>().map_err(|_| due())?;
    let values = array.as_array();
    if values.ncols() != N || !rows.contains(&values.nrows()) {
        return Err(wrong_shape(name, array.shape(), &format!("(rows, {N})")).into());
    }
    if !values.iter().all(|value| value.is_finite()) {
        return Err(Failure::argument(format!("{name}: all numbers must be finite")).into());
    }
    Ok(values.rows().into_iter().map(|row| std::array::from_fn(|i| row[i])).collect())
}

/// A new array of rows.
pub fn array_of_rows<'py, const N: usize>(
    py: Python<'py>,
    rows: &[[f64; N]],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}
