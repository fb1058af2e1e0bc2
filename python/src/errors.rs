//! Failures of the library as Python's exceptions.

use nvsprior::Error;
use nvsprior::geometry::CameraError;
use nvsprior::image::PixelError;
use nvsprior::keys::{KeyError, Refusal};
use nvsprior::modem::ModemError;
use nvsprior::packet::{PacketError, Part};
use nvsprior::prior::{PriorError, UpdateError};
use nvsprior::residual::ResidualError;
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
    Update,
    State,
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
        Kind::Update,
        Kind::State,
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

impl<E: Kinded + ToString> From<E> for Failure {
    fn from(error: E) -> Failure {
        Failure::new(error.kind(), error)
    }
}

/// An error of a library, and what kind it is.
pub trait Kinded {
    fn kind(&self) -> Kind;
}

impl Kinded for Error {
    fn kind(&self) -> Kind {
        match self {
            Error::Vulkan(error) => error.kind(),
            Error::Prior(error) => error.kind(),
            Error::PriorChanged { .. } => Kind::OtherPrior,
            Error::Update(error) => error.kind(),
            Error::UpdateMissing { .. } => Kind::Update,
            Error::Camera(error) => error.kind(),
            Error::FrameTooLarge { .. } => Kind::Limit,
            Error::Packet(error) => error.kind(),
            Error::Residual(error) => error.kind(),
            Error::Budget { .. } => Kind::Budget,
            Error::NoStart { .. } => Kind::NoStart,
            Error::CameraUnknown { .. } | Error::SessionUnknown { .. } => Kind::CameraUnknown,
            Error::Thread(_) => Kind::OutOfMemory,
            Error::Queue(_) => Kind::Internal,
            Error::Lens(_)
            | Error::Pixels(_)
            | Error::FrameSize { .. }
            | Error::MaskSize { .. }
            | Error::MaskEmpty
            | Error::StreamCoder
            | Error::HintPose { .. }
            | Error::HintFar { .. }
            | Error::HintCovariance { .. }
            | Error::HintAge { .. }
            | Error::FrameTime { .. }
            | Error::FrameTimeBack { .. } => Kind::Argument,
        }
    }
}

impl Kinded for nvsprior::vulkan::Error {
    fn kind(&self) -> Kind {
        use nvsprior::vulkan::Error as E;
        match self {
            E::DeviceLost { .. } | E::Hung { .. } => Kind::DeviceLost,
            E::Unread(error) => error.downcast_ref().map_or(Kind::Prior, PriorError::kind),
            error if error.is_out_of_memory() => Kind::OutOfMemory,
            _ => Kind::Device,
        }
    }
}

impl Kinded for PriorError {
    fn kind(&self) -> Kind {
        match self {
            PriorError::InFile { error, .. } => error.kind(),
            PriorError::Read(error) if error.kind() == std::io::ErrorKind::OutOfMemory => {
                Kind::OutOfMemory
            }
            PriorError::Read(_) | PriorError::Write(_) => Kind::File,
            PriorError::Option { .. } => Kind::Argument,
            PriorError::Newer { .. } => Kind::Newer,
            _ => Kind::Prior,
        }
    }
}

impl Kinded for UpdateError {
    fn kind(&self) -> Kind {
        match self {
            UpdateError::Newer { .. } => Kind::Newer,
            UpdateError::Foreign { .. } => Kind::OtherPrior,
            UpdateError::NoRoom => Kind::State,
            _ => Kind::Update,
        }
    }
}

impl Kinded for PacketError {
    fn kind(&self) -> Kind {
        match self {
            PacketError::Prior { .. } => Kind::OtherPrior,
            PacketError::Version(_) | PacketError::Coder(_) => Kind::Newer,
            error if error.part() == Some(Part::Residual) => Kind::Residual,
            _ => Kind::Packet,
        }
    }
}

impl Kinded for ModemError {
    fn kind(&self) -> Kind {
        use ModemError as E;
        match self {
            E::Memory(_) => Kind::OutOfMemory,
            E::Key(refusal) => refusal.kind(),
            E::Packet(PacketError::Version(_)) => Kind::Newer,
            E::Loss(..)
            | E::RateControl { .. }
            | E::Collector { .. }
            | E::CollectorAge(_)
            | E::ShareCount(_)
            | E::UnprotectedCount(_)
            | E::UnprotectedStream(_)
            | E::UnpacedReports
            | E::UserBytes(_)
            | E::UpdateShare { .. }
            | E::Reserve { .. }
            | E::Mtu(_)
            | E::ShareMtu(_)
            | E::KeyedMtu { .. }
            | E::Stream(_)
            | E::Time(_) => Kind::Argument,
            E::Budget { .. } => Kind::Budget,
            E::NotPlanned | E::NoReports | E::Unpaced | E::NoUpdates => Kind::State,
            E::Waiting { .. } | E::UpdatesFull { .. } => Kind::State,
            E::Update(_) | E::UpdateOrder { .. } | E::UpdateTooLong { .. } => Kind::Update,
            _ => Kind::Modem,
        }
    }
}

impl Kinded for Refusal {
    fn kind(&self) -> Kind {
        match self {
            Refusal::Foreign => Kind::Foreign,
            Refusal::Replayed => Kind::Replayed,
        }
    }
}

impl Kinded for MapError {
    fn kind(&self) -> Kind {
        match self {
            MapError::Splats(error) => error.kind(),
            MapError::NoRoom(_) => Kind::OutOfMemory,
            MapError::Device(error) => error.kind(),
            MapError::NoPictures
            | MapError::Size { .. }
            | MapError::Pose { .. }
            | MapError::Option { .. }
            | MapError::State { .. } => Kind::Argument,
        }
    }
}

impl Kinded for ResidualError {
    fn kind(&self) -> Kind {
        match self {
            ResidualError::InterestSize { .. }
            | ResidualError::InterestWeight { .. }
            | ResidualError::InterestEmpty => Kind::Argument,
            _ => Kind::Residual,
        }
    }
}

impl Kinded for CameraError {
    fn kind(&self) -> Kind {
        Kind::Camera
    }
}

impl Kinded for PixelError {
    fn kind(&self) -> Kind {
        Kind::Argument
    }
}

impl Kinded for KeyError {
    fn kind(&self) -> Kind {
        Kind::Argument
    }
}
