//! Keys against strangers.

use nvsprior_link::keys::{Key, Keys};
use pyo3::prelude::*;

use crate::arguments::{Bytes, whole};
use crate::errors::Failure;

/// The keys that a side holds, at most four. It makes tags by the first one, and takes those by any of them.
///
/// `text`: the content of a key file, as `nvsprior key` writes it: 64 hexadecimal digits a line. `tag_bytes`: bytes of
/// a tag, 2 to 16. `epoch`: a number of the dive. Both sides need the same. `number`: of the first thing that this side
/// sends; a side that starts again within an epoch goes on counting. Types: text: str, tag_bytes: int, epoch: int,
/// number: int.
#[pyclass(frozen, module = "nvsprior", name = "Keys")]
pub struct PyKeys(pub Keys);

#[pymethods]
impl PyKeys {
    #[new]
    #[pyo3(signature = (text, *, tag_bytes = 4, epoch = 0, number = 0))]
    fn new(text: &str, tag_bytes: i128, epoch: i128, number: i128) -> PyResult<PyKeys> {
        PyKeys::with(Keys::parse(text).map_err(Failure::from)?, tag_bytes, epoch, number)
    }

    /// Keys of 32 random bytes each. Types: keys: list[bytes-like], tag_bytes: int, epoch: int, number: int. Returns
    /// Keys.
    #[staticmethod]
    #[pyo3(signature = (keys, *, tag_bytes = 4, epoch = 0, number = 0))]
    fn from_bytes(
        keys: Vec<Bytes>,
        tag_bytes: i128,
        epoch: i128,
        number: i128,
    ) -> PyResult<PyKeys> {
        let key = |bytes: &Bytes| match <[u8; Key::LEN]>::try_from(&bytes[..]) {
            Ok(bytes) => Ok(Key::new(bytes)),
            Err(_) => Err(Failure::argument(format!(
                "keys: {} bytes, a key has {}",
                bytes.len(),
                Key::LEN
            ))),
        };
        let keys = keys.iter().map(key).collect::<Result<Vec<_>, _>>()?;
        PyKeys::with(Keys::new(keys).map_err(Failure::from)?, tag_bytes, epoch, number)
    }

    /// Names of the keys that tell nothing of them; the first is that of the key that makes tags. Type: list[str].
    #[getter]
    fn ids(&self) -> Vec<String> {
        self.0.ids().map(|id| id.to_string()).collect()
    }

    /// Bytes that number and tag take of each modem frame. Type: int.
    #[getter]
    fn overhead(&self) -> usize {
        self.0.overhead()
    }

    fn __repr__(&self) -> String {
        format!("<nvsprior.Keys {}>", self.ids().join(", "))
    }
}

impl PyKeys {
    fn with(keys: Keys, tag_bytes: i128, epoch: i128, number: i128) -> PyResult<PyKeys> {
        whole!(tag_bytes, epoch, number);
        let keys = keys.with_epoch(epoch).with_tag_bytes(tag_bytes);
        let keys = keys.and_then(|keys| keys.with_number(number));
        Ok(PyKeys(keys.map_err(Failure::from)?))
    }
}
