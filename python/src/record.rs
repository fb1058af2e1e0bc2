//! Classes of values: what a call gives.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A class whose fields are all readable. It is pickled and copied by their names.
macro_rules! record {
    (
        $(#[$about:meta])*
        class $name:tt $class:ident { $($(#[$field_about:meta])* $field:ident: $kind:ty,)* }
        $($methods:tt)*
    ) => {
        $(#[$about])*
        #[pyclass(frozen, get_all, module = "nvsprior", name = $name)]
        pub struct $class { $($(#[$field_about])* $field: $kind,)* }

        #[pymethods]
        impl $class {
            #[new]
            #[pyo3(signature = (**fields))]
            fn new(fields: Option<&Bound<pyo3::types::PyDict>>) -> PyResult<$class> {
                Ok($class { $($field: $crate::record::field(fields, stringify!($field))?,)* })
            }

            fn __getnewargs_ex__<'py>(
                record: &Bound<'py, $class>,
            ) -> PyResult<((), Bound<'py, pyo3::types::PyDict>)> {
                let fields = pyo3::types::PyDict::new(record.py());
                for name in [$(stringify!($field)),*] {
                    fields.set_item(name, record.getattr(name)?)?;
                }
                Ok(((), fields))
            }

            $($methods)*
        }
    };
}
pub(crate) use record;

/// A field of a record that is made anew.
pub fn field<'py, T>(fields: Option<&Bound<'py, PyDict>>, name: &str) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'py>,
{
    let found = fields.map(|fields| fields.get_item(name)).transpose()?.flatten();
    let found = found.ok_or_else(|| {
        PyTypeError::new_err(format!(
            "{name} is missing: only a call, pickle and copy make this object"
        ))
    });
    found?.extract().map_err(Into::into)
}
