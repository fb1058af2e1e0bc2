//! What kind of failure an error is: for callers that act on it, and for the bindings, which name it.

use crate::geometry::{CameraError, LensError};
use crate::image::PixelError;
use crate::packet::{PacketError, Part};
use crate::prior::PriorError;
use crate::queue::QueueError;
use crate::residual::ResidualError;
use crate::{Error, vulkan};

/// Kinds of failures. The error's text says what failed, and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// An argument is out of its range.
    Argument,
    /// An image's size or shape does not fit.
    Image,
    /// No Vulkan loader, or no device that fits.
    NoDevice,
    /// The device was lost, or did not end its work in time.
    DeviceLost,
    /// Host or device memory could not be allocated.
    Memory,
    /// A Vulkan call failed.
    Vulkan,
    /// A file cannot be read or written.
    File,
    /// The content of a prior is not valid.
    Prior,
    /// No picture can be rendered with this camera.
    Camera,
    /// There is no pose to start from.
    NoStart,
    /// The budget does not even hold the pose.
    Budget,
    /// A picture has more pixels than are allowed.
    Limit,
    /// The bytes are no packet, or its latent part is damaged.
    Packet,
    /// It is about another prior.
    OtherPrior,
    /// The packet that states prior and camera is missing.
    SessionUnknown,
    /// The difference picture is damaged.
    Residual,
    /// The reference frame of a difference picture is missing.
    Reference,
    /// Of a newer format than this library knows.
    Newer,
    /// What was built without it, or a device, cannot do this.
    Unsupported,
    /// No modem frame of a packet, or the packet does not fit the modem.
    Modem,
    /// No key that is held has made the tag.
    Foreign,
    /// It has the right tag, and comes a second time.
    Replayed,
    /// There is nothing to do that to now.
    State,
    /// What was begun is not finished.
    Unfinished,
    /// An earlier call failed inside the library.
    Poisoned,
    /// A fault of the library itself.
    Internal,
}

impl Error {
    /// What kind of failure it is.
    ///
    /// ```
    /// use nvsprior::{ErrorKind, Prior, RenderOverrides};
    ///
    /// let error = Prior::open("no such file.ply".as_ref(), &RenderOverrides::default()).unwrap_err();
    /// assert_eq!(error.kind(), ErrorKind::File);
    /// ```
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Vulkan(error) => error.kind(),
            Error::Prior(error) => error.kind(),
            Error::PriorChanged { .. } => ErrorKind::OtherPrior,
            Error::Camera(error) => error.kind(),
            Error::Lens(error) => error.kind(),
            Error::FrameTooLarge { .. } => ErrorKind::Limit,
            Error::Packet(error) => error.kind(),
            Error::Residual(error) => error.kind(),
            Error::Pixels(error) => error.kind(),
            Error::FrameSize { .. } => ErrorKind::Image,
            Error::Budget { .. } => ErrorKind::Budget,
            Error::NoStart { .. } => ErrorKind::NoStart,
            Error::SessionUnknown { .. } => ErrorKind::SessionUnknown,
            Error::Estranged { .. } => ErrorKind::OtherPrior,
            Error::Thread(_) => ErrorKind::Memory,
            Error::Queue(error) => error.kind(),
            Error::MaskSize { .. }
            | Error::MaskEmpty
            | Error::HintPose { .. }
            | Error::HintFar { .. }
            | Error::HintCovariance { .. }
            | Error::HintAge { .. }
            | Error::FrameTime { .. }
            | Error::FrameTimeBack { .. }
            | Error::FrameTimeShort { .. } => ErrorKind::Argument,
        }
    }
}

impl vulkan::Error {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        use vulkan::Error as E;
        match self {
            E::NoLoader(_)
            | E::NoDevice { .. }
            | E::UnknownDevice { .. }
            | E::GivenDevice { .. }
            | E::NoValidationLayer => ErrorKind::NoDevice,
            E::DeviceLost { .. } | E::Hung { .. } => ErrorKind::DeviceLost,
            E::Unread(error) => error.downcast_ref().map_or(ErrorKind::Prior, PriorError::kind),
            E::Interrupted => ErrorKind::State,
            error if error.is_out_of_memory() => ErrorKind::Memory,
            _ => ErrorKind::Vulkan,
        }
    }
}

impl PriorError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            PriorError::InFile { error, .. } => error.kind(),
            PriorError::Read(error) if error.kind() == std::io::ErrorKind::OutOfMemory => {
                ErrorKind::Memory
            }
            PriorError::Read(_) | PriorError::Write(_) => ErrorKind::File,
            PriorError::Option { .. } => ErrorKind::Argument,
            PriorError::Newer { .. } => ErrorKind::Newer,
            _ => ErrorKind::Prior,
        }
    }
}

impl PacketError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            PacketError::Prior { .. } => ErrorKind::OtherPrior,
            PacketError::Version | PacketError::Coder(_) => ErrorKind::Newer,
            error if error.part() == Some(Part::Residual) => ErrorKind::Residual,
            _ => ErrorKind::Packet,
        }
    }
}

impl ResidualError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            ResidualError::ReferenceMissing { .. } => ErrorKind::Reference,
            ResidualError::InterestSize { .. }
            | ResidualError::InterestWeight { .. }
            | ResidualError::InterestEmpty => ErrorKind::Argument,
            _ => ErrorKind::Residual,
        }
    }
}

impl QueueError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            QueueError::Full | QueueError::Ending | QueueError::UnderWay => ErrorKind::Unfinished,
            QueueError::Empty => ErrorKind::State,
            QueueError::Panicked => ErrorKind::Internal,
            QueueError::Poisoned => ErrorKind::Poisoned,
        }
    }
}

impl CameraError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Camera
    }
}

impl LensError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Argument
    }
}

impl PixelError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Image
    }
}
