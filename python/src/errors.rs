//! Failures of the library as Python's exceptions.

use nvsprior::ErrorKind;
use nvsprior_link::LinkError;
use nvsprior_link::modem::ModemError;
use nvsprior_train::mapper::MapError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// The classes of `nvsprior/errors.py`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Argument,
    Device,
    DeviceLost,
    OutOfMemory,
    File,
    Prior,
    Camera,
    NoStart,
    Budget,
    Limit,
    Packet,
    OtherPrior,
    CameraUnknown,
    Residual,
    Newer,
    Modem,
    Foreign,
    Replayed,
    State,
    Forked,
    Busy,
    Internal,
}

impl Kind {
    const ALL: [Kind; 22] = [
        Kind::Argument,
        Kind::Device,
        Kind::DeviceLost,
        Kind::OutOfMemory,
        Kind::File,
        Kind::Prior,
        Kind::Camera,
        Kind::NoStart,
        Kind::Budget,
        Kind::Limit,
        Kind::Packet,
        Kind::OtherPrior,
        Kind::CameraUnknown,
        Kind::Residual,
        Kind::Newer,
        Kind::Modem,
        Kind::Foreign,
        Kind::Replayed,
        Kind::State,
        Kind::Forked,
        Kind::Busy,
        Kind::Internal,
    ];
}

/// By number of the kind.
static CLASSES: PyOnceLock<Vec<Py<PyType>>> = PyOnceLock::new();

/// Looks for the classes when the module is imported, so that none is missing later.
pub fn load(py: Python) -> PyResult<()> {
    classes(py).map(|_| ())
}

fn classes(py: Python<'_>) -> PyResult<&Vec<Py<PyType>>> {
    CLASSES.get_or_try_init(py, || {
        let module = py.import("nvsprior.errors")?;
        let class = |kind: Kind| {
            let class = module.getattr(format!("{kind:?}Error"))?;
            Ok(class.cast_into::<PyType>()?.unbind())
        };
        Kind::ALL.into_iter().map(class).collect()
    })
}

/// Why a call fails.
#[derive(Debug)]
pub struct Failure {
    kind: Kind,
    text: String,
}

impl Failure {
    pub fn new(kind: Kind, text: impl ToString) -> Failure {
        Failure { kind, text: text.to_string() }
    }

    pub fn argument(text: impl ToString) -> Failure {
        Failure::new(Kind::Argument, text)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> PyErr {
        Python::attach(|py| match classes(py) {
            Ok(classes) => {
                let class = classes[failure.kind as usize].bind(py).clone();
                PyErr::from_type(class, failure.text)
            }
            Err(error) => error,
        })
    }
}

impl From<ErrorKind> for Kind {
    fn from(kind: ErrorKind) -> Kind {
        match kind {
            ErrorKind::Argument | ErrorKind::Image => Kind::Argument,
            ErrorKind::DeviceLost => Kind::DeviceLost,
            ErrorKind::Memory => Kind::OutOfMemory,
            ErrorKind::File => Kind::File,
            ErrorKind::Prior => Kind::Prior,
            ErrorKind::Camera => Kind::Camera,
            ErrorKind::NoStart => Kind::NoStart,
            ErrorKind::Budget => Kind::Budget,
            ErrorKind::Limit => Kind::Limit,
            ErrorKind::Packet => Kind::Packet,
            ErrorKind::OtherPrior => Kind::OtherPrior,
            ErrorKind::SessionUnknown => Kind::CameraUnknown,
            ErrorKind::Residual | ErrorKind::Reference | ErrorKind::Unsupported => Kind::Residual,
            ErrorKind::Newer => Kind::Newer,
            ErrorKind::Modem => Kind::Modem,
            ErrorKind::Foreign => Kind::Foreign,
            ErrorKind::Replayed => Kind::Replayed,
            ErrorKind::State | ErrorKind::Unfinished => Kind::State,
            ErrorKind::Poisoned | ErrorKind::Internal => Kind::Internal,
            // No device, or a Vulkan call.
            _ => Kind::Device,
        }
    }
}

/// For each error of a library: what kind it is, and its text.
macro_rules! failures {
    ($($error:ty),*) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Failure {
                Failure::new(error.kind().into(), error)
            }
        }
    )*};
}

failures!(
    nvsprior::Error,
    nvsprior::geometry::CameraError,
    nvsprior::image::PixelError,
    nvsprior_link::keys::KeyError,
    nvsprior_link::keys::Refusal,
    nvsprior::packet::PacketError,
    nvsprior::prior::PriorError,
    nvsprior::residual::ResidualError,
    nvsprior::vulkan::Error
);

impl From<ModemError> for Failure {
    fn from(error: ModemError) -> Failure {
        use ModemError as E;
        // The same kind says that a packet does not fit a modem. Here the caller's MTU or number does not.
        let argument =
            matches!(error, E::Mtu(_) | E::ShareMtu(_) | E::KeyedMtu { .. } | E::Stream(_));
        Failure::new(if argument { Kind::Argument } else { error.kind().into() }, error)
    }
}

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Failure {
        match error {
            LinkError::Modem(error) => error.into(),
            LinkError::Key(error) => error.into(),
            LinkError::Picture(error) => error.into(),
            LinkError::Option { .. } | LinkError::State { .. } | LinkError::Epoch { .. } => {
                Failure::argument(error)
            }
        }
    }
}

impl From<MapError> for Failure {
    fn from(error: MapError) -> Failure {
        let kind = match &error {
            MapError::Splats(error) => error.kind().into(),
            MapError::Device(error) => error.kind().into(),
            MapError::NoRoom(_) => Kind::OutOfMemory,
            MapError::NoPictures
            | MapError::Size { .. }
            | MapError::Pose { .. }
            | MapError::Option { .. }
            | MapError::State { .. } => Kind::Argument,
        };
        Failure::new(kind, error)
    }
}
