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
pub enum PacketError {
    /// The bytes end before the part does.
    #[error("{part}: {found} bytes, but {needed} are due")]
    TooShort {
        /// The part.
        part: Part,
        /// Bytes that the part takes.
        needed: usize,
        /// Bytes that are there.
        found: usize,
    },
    /// The first byte is not that of a packet.
    #[error("not a packet: first byte {0:#04x}")]
    Magic(u8),
    /// The packet is of another version of the format.
    #[error("packet of version {0}, this side knows 1 and 2, in the short form 4 and 7")]
    Version(u8),
    /// The part's check does not match its bytes.
    #[error("{0}: damaged, its check does not match")]
    Check(Part),
    /// The pose profile is none of the known ones.
    #[error("unknown pose profile {0}")]
    Profile(u8),
    /// The pose is not valid: a component is not finite, or its quaternion is too short or too long.
    #[error("the pose is no rigid motion, or beyond what a packet can hold")]
    Pose,
    /// The picture size does not fit the header.
    #[error("picture size {width}×{height} does not fit a packet")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// The intrinsics are not those of a camera.
    #[error("camera part: {0}")]
    Camera(#[from] CameraError),
    /// The camera is not the one that the latent part is about.
    #[error("camera of tag {found:#04x}, but the latent part is about {expected:#04x}")]
    CameraTag {
        /// Tag in the latent part.
        expected: u8,
        /// Tag of the camera.
        found: u8,
    },
    /// The session is not the one that a packet of the short form names.
    #[error("session of tag {found:#04x}, but the packet names {packet:#04x}")]
    SessionTag {
        /// Tag in the latent part.
        packet: u8,
        /// Tag of the prior and the camera at hand.
        found: u8,
    },
    /// A packet of the short form has, or was to have, a camera part.
    #[error("the short form of a packet holds no camera part")]
    ShortCamera,
    /// A pose was to be written in the short form, which cannot hold it.
    #[error("the pose is too fine for the short form, or beyond its reach")]
    ShortPose,
    /// The residual's coder is not known.
    #[error("unknown residual coder {0}")]
    Coder(u8),
    /// A stream's residual ends before it has named its reference.
    #[error("residual part: {0} bytes, too few to name its reference frame")]
    Reference(usize),
    /// The residual's length does not fit its field.
    #[error("residual part: length beyond {max} bytes", max = MAX_PAYLOAD)]
    PayloadLength,
    /// The packet is about another prior than the one at hand.
    #[error("packet about prior {packet}, this side holds {held}")]
    Prior {
        /// The packet's.
        packet: PriorId,
        /// The one at hand.
        held: PriorId,
    },
}
