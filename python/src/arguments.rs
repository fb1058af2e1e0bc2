//! Arguments that Python gives in more than one form, and what is said of a wrong one.

use std::ops::Deref;

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyMemoryView};

use crate::errors::Failure;

/// A whole number of the range that is due.
pub trait Whole<T> {
    /// # Errors
    /// `ArgumentError` with the name if it is out of range.
    fn whole(self, name: &str) -> Result<T, Failure>;
}

impl<T: TryFrom<i128>> Whole<T> for i128 {
    fn whole(self, name: &str) -> Result<T, Failure> {
        let most = u128::MAX >> (128 - 8 * size_of::<T>());
        let text = format!("{name}: {self}, must be a whole number from 0 to {most}");
        T::try_from(self).map_err(|_| Failure::argument(text))
    }
}

impl<T: TryFrom<i128>> Whole<Option<T>> for Option<i128> {
    fn whole(self, name: &str) -> Result<Option<T>, Failure> {
        self.map(|value| value.whole(name)).transpose()
    }
}

/// Turns arguments into the unsigned types that they are used as.
macro_rules! whole {
    ($($name:ident),*) => {
        $(let $name = $crate::arguments::Whole::whole($name, stringify!($name))?;)*
    };
}
pub(crate) use whole;

/// An argument of another type than one that is due.
pub fn wrong_type(given: &Bound<PyAny>, due: &str) -> PyErr {
    let name = given.get_type().name();
    let name = name.map_or_else(|_| "something else".into(), |name| name.to_string());
    PyTypeError::new_err(format!("{due} is due, not {name}"))
}

/// The bytes of any object that has some: bytes, bytearray, memoryview, an array of uint8.
pub struct Bytes<'py>(Bound<'py, PyBytes>);

impl<'py> FromPyObject<'_, 'py> for Bytes<'py> {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Bytes<'py>> {
        if let Ok(bytes) = given.cast::<PyBytes>() {
            return Ok(Bytes(bytes.to_owned()));
        }
        let wrong = || wrong_type(&given, "an object with bytes (bytes, bytearray, memoryview)");
        let view = PyMemoryView::from(&given).map_err(|_| wrong())?;
        if view.getattr("itemsize")?.extract::<usize>()? != 1 {
            return Err(wrong());
        }
        Ok(Bytes(view.call_method0("tobytes")?.cast_into::<PyBytes>()?))
    }
}

impl Deref for Bytes<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.0.as_bytes()
    }
}
