//! Why a packet cannot be made or read.

use std::fmt;

use crate::geometry::CameraError;
use crate::prior::PriorId;

/// Longest payload of a residual, bytes: four groups of seven bits.
pub(super) const MAX_PAYLOAD: usize = (1 << 28) - 1;

/// A part of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Header and pose.
    Latent,
    /// Intrinsics.
    Camera,
    /// Check of the render.
    Render,
    /// Coded difference picture.
    Residual,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Part::Latent => "latent part",
            Part::Camera => "camera part",
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
            PacketError::Coder(_) | PacketError::Reference(_) | PacketError::PayloadLength => {
                Some(Part::Residual)
            }
            PacketError::Camera(_) | PacketError::CameraTag { .. } => Some(Part::Camera),
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
    #[error("not a packet: first byte {0:#04x}")]
    Magic(u8),
    #[error(
        "packet of version {0}, this side knows 1 and 2, in the short form 4 and 7, with updates 8, 11, 13 and 14"
    )]
    Version(u8),
    #[error("{0}: damaged, its check does not match")]
    Check(Part),
    #[error("unknown pose profile {0}")]
    Profile(u8),
    #[error("the pose is no rigid motion, or beyond what a packet can hold")]
    Pose,
    #[error("picture size {width}×{height} does not fit a packet")]
    Size { width: u32, height: u32 },
    #[error("camera part: {0}")]
    Camera(#[from] CameraError),
    #[error("camera of tag {found:#04x}, but the latent part is about {expected:#04x}")]
    CameraTag { expected: u8, found: u8 },
    #[error("session of tag {found:#04x}, but the packet names {packet:#04x}")]
    SessionTag { packet: u8, found: u8 },
    #[error("the short form of a packet holds no camera part")]
    ShortCamera,
    #[error("the pose is too fine for the short form, or beyond its reach")]
    ShortPose,
    #[error("a difference picture with small blocks goes with the short form of a packet alone")]
    SmallBlocks,
    #[error("what the packet is to say is not in the predicted form: write it in the short one")]
    Predicted,
    #[error("unknown residual coder {0}")]
    Coder(u8),
    /// A truth map goes with the wavelet coder alone.
    #[error("a truth map beside a residual of coder {0}: send none")]
    TruthCoder(u8),
    /// The bytes are no truth map.
    #[error("a truth map that is no map")]
    Truth,
    #[error("residual part: {0} bytes, too few to name its reference frame")]
    Reference(usize),
    #[error("residual part: length beyond {max} bytes", max = MAX_PAYLOAD)]
    PayloadLength,
    /// The predicted form: see [`crate::Decoder::hold`].
    #[error(
        "the pose of frame {frame} is predicted from that of frame {reference}, which is not held: \
         wait for a packet that states its pose"
    )]
    PoseNotHeld { frame: u32, reference: u32 },
    #[error("packet about prior {packet}, this side holds {held}")]
    Prior { packet: PriorId, held: PriorId },
}
