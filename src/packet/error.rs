//! Why a packet cannot be made or read.

use std::fmt;

use crate::geometry::CameraError;
use crate::prior::PriorId;

/// A part of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Header and pose.
    Latent,
    /// Prior and camera.
    Session,
    /// Check of the render.
    Render,
    /// Coded difference picture.
    Residual,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Part::Latent => "latent part",
            Part::Session => "session part",
            Part::Render => "render part",
            Part::Residual => "residual part",
        })
    }
}

impl PacketError {
    /// The part that cannot be read, if it is known.
    pub fn part(&self) -> Option<Part> {
        match self {
            PacketError::TooShort { part, .. } | PacketError::Check(part) => Some(*part),
            PacketError::Coder(_) | PacketError::Truth | PacketError::Reference => {
                Some(Part::Residual)
            }
            PacketError::Camera(_) | PacketError::SessionTag { .. } => Some(Part::Session),
            _ => None,
        }
    }
}

/// Why a packet cannot be made or read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum PacketError {
    #[error("{part}: {found} bytes, but {needed} are due")]
    TooShort { part: Part, needed: usize, found: usize },
    #[error("packet of a later version: update this side")]
    Version,
    #[error("{0}: damaged, its check does not match")]
    Check(Part),
    #[error("the pose is no rigid motion, or beyond what a packet can hold")]
    Pose,
    #[error("picture size {width}×{height} does not fit a packet")]
    Size { width: u32, height: u32 },
    #[error("session part: {0}")]
    Camera(#[from] CameraError),
    #[error("prior and camera of tag {found:#06x}, but the packet names {packet:#06x}")]
    SessionTag { packet: u16, found: u16 },
    #[error("unknown residual {0}")]
    Coder(u8),
    /// The bytes are no truth map.
    #[error("a truth map that is no map, or is missing in part")]
    Truth,
    #[error("residual part: a reference 0 frames before")]
    Reference,
    /// See [`crate::Decoder::hold`].
    #[error(
        "the pose of frame {frame} is predicted from that of frame {reference}, which is not held: \
         wait for a packet that states its pose"
    )]
    PoseNotHeld { frame: u32, reference: u32 },
    #[error("packet about prior {packet}, this side holds {held}")]
    Prior { packet: PriorId, held: PriorId },
}
