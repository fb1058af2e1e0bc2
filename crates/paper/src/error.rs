//! What fails in the paper's system.

use nvsprior::PriorId;

/// Why a picture cannot be coded by WebP, or a payload not be decoded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum WebpError {
    #[error("picture of {width}×{height} with {bytes} bytes")]
    Shape { width: u32, height: u32, bytes: usize },
    #[error("picture of {}×{}, but {}×{} is due", found.0, found.1, expected.0, expected.1)]
    Size { expected: (u32, u32), found: (u32, u32) },
    #[error("WebP encoder: {0}")]
    Encode(String),
    #[error("WebP payload: {0}")]
    Payload(&'static str),
}

/// Anything that can fail in the paper's system.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum Error {
    #[error(transparent)]
    Library(#[from] nvsprior::Error),
    #[error(transparent)]
    Webp(#[from] WebpError),
    #[error("frame {frame}: no pose to start from, neither from outside nor from a frame before")]
    NoStart { frame: u32 },
    #[error("a packet of {found} bytes: {needed} are due")]
    TooShort { found: usize, needed: usize },
    #[error("no packet of the paper's system, or a damaged one: its check does not match")]
    Check,
    #[error("its pose is none")]
    Pose,
    #[error("it is about prior {found}, not about {expected}")]
    OtherPrior { expected: PriorId, found: PriorId },
    #[error("the packet that states prior and camera is missing: decode from the first one on")]
    SessionUnknown,
}

impl From<nvsprior::vulkan::Error> for Error {
    fn from(error: nvsprior::vulkan::Error) -> Error {
        Error::Library(error.into())
    }
}
