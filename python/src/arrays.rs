//! NumPy's arrays in and out. What is wrong with one is told with the argument's name.

use numpy::prelude::*;
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyReadonlyArrayDyn, PyUntypedArray, dtype};
use nvsprior::Picture;
use pyo3::exceptions::PyTypeError;
use pyo3::intern;
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
        let advice = if due.is_equiv_to(&dtype::<u8>(py)) { advice(found.kind()) } else { "" };
        return Err(PyTypeError::new_err(format!(
            "{name}: dtype {found}, but {due} is due{advice}"
        )));
    }
    given.extract::<PyReadonlyArrayDyn<T>>()
}

/// How values of a kind of dtype become 0 to 255.
fn advice(kind: u8) -> &'static str {
    match kind {
        b'f' => ": if values lie in [0, 1], multiply by 255, round, and `astype(np.uint8)`",
        b'b' => ": multiply by 255, and `astype(np.uint8)`",
        b'i' | b'u' => {
            ": `astype(np.uint8)` if values lie in 0 to 255; of 16 bits, divide by 257 and round before"
        }
        _ => "",
    }
}

pub fn wrong_shape(name: &str, found: &[usize], due: &str) -> Failure {
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

/// An array of numbers, or what NumPy makes an array of. It is C-contiguous, and aligned.
pub fn numeric<'py, T: Element>(given: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let py = given.py();
    let require = py.import(intern!(py, "numpy"))?.getattr(intern!(py, "require"))?;
    let array = require.call1((given, dtype::<T>(py), ("C", "A")))?;
    array.extract::<PyReadonlyArrayDyn<T>>()
}

/// So many finite numbers.
pub fn numbers<const N: usize>(name: &str, given: &Bound<PyAny>) -> PyResult<[f64; N]> {
    let values = any_numbers(name, given)?;
    check_finite(name, &values)?;
    Ok(values)
}

/// So many numbers, infinite ones and NaN among them.
pub fn any_numbers<const N: usize>(name: &str, given: &Bound<PyAny>) -> PyResult<[f64; N]> {
    let due = || PyTypeError::new_err(format!("{name}: {N} numbers are due"));
    let array = numeric::<f64>(given).map_err(|_| due())?;
    if array.shape() != [N] {
        return Err(wrong_shape(name, array.shape(), &format!("({N},)")).into());
    }
    Ok(std::array::from_fn(|i| array.as_array()[i]))
}

fn check_finite(name: &str, values: &[f64]) -> Result<(), Failure> {
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(()),
        false => Err(Failure::argument(format!("{name}: all numbers must be finite"))),
    }
}

/// Rows of finite numbers; `rows` says how many there may be.
pub fn rows<const N: usize>(
    name: &str,
    given: &Bound<PyAny>,
    rows: std::ops::RangeInclusive<usize>,
) -> PyResult<Vec<[f64; N]>> {
    let values = any_rows(name, given, rows)?;
    check_finite(name, values.as_flattened())?;
    Ok(values)
}

/// Rows of numbers, infinite ones and NaN among them.
pub fn any_rows<const N: usize>(
    name: &str,
    given: &Bound<PyAny>,
    rows: std::ops::RangeInclusive<usize>,
) -> PyResult<Vec<[f64; N]>> {
    let due = || PyTypeError::new_err(format!("{name}: rows of {N} numbers are due"));
    let array = numeric::<f64>(given).map_err(|_| due())?;
    match *array.shape() {
        [count, columns] if columns == N && rows.contains(&count) => {
            let values = array.as_slice().map_err(|_| due())?;
            Ok(values.as_chunks::<N>().0.to_vec())
        }
        _ => Err(wrong_shape(name, array.shape(), &format!("(rows, {N})")).into()),
    }
}

/// A new array of rows.
pub fn array_of_rows<'py, const N: usize>(
    py: Python<'py>,
    rows: &[[f64; N]],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}
