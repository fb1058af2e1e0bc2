//! The latent part: header and pose, a picture by itself.

use crate::Camera;
use crate::prior::PriorId;

use super::bytes::{Reader, crc16, from_u24, to_u24};
use super::camera_tag::{camera_tag, size_bytes};
use super::{PacketError, Part, PoseProfile, QuantisedPose};

/// High four bits of the first byte.
const MAGIC: u8 = 0xB;
/// Version of the format, low four bits of the first byte, if the render is the same on every portable device.
pub(super) const VERSION: u8 = 1;
/// In its place if the encoder's device is not portable. The layout is the same.
const VERSION_NOT_PORTABLE: u8 = 2;
/// Bytes of the latent part that are not the pose.
pub(super) const FIXED_LEN: usize = 15;

const FLAG_UNCERTAIN: u8 = 1 << 2;
const FLAG_CAMERA: u8 = 1 << 3;
const FLAG_RENDER: u8 = 1 << 7;

/// What a packet says first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latent {
    /// Frame number; its low 24 bits travel.
    pub frame: u32,
    /// The prior to render.
    pub prior: PriorId,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// [`camera_tag`] of the camera to render with.
    pub camera_tag: u8,
    /// The pose to render at.
    pub pose: QuantisedPose,
    /// The pose is not certain: the picture does not confirm it.
    pub uncertain: bool,
    /// The encoder's device draws what every portable device draws.
    pub portable: bool,
}

/// Which parts come after the latent part.
pub(super) struct Follows {
    pub(super) camera: bool,
    pub(super) render: bool,
    /// Code of the residual.
    pub(super) residual: u8,
}

impl Follows {
    pub(super) fn of_flags(flags: u8) -> Follows {
        Follows {
            camera: flags & FLAG_CAMERA != 0,
            render: flags & FLAG_RENDER != 0,
            residual: flags >> 4 & 0b111,
        }
    }
}

impl Latent {
    /// Frame numbers are sent modulo this.
    pub const FRAMES: u32 = 1 << 24;

    /// The latent part of a frame seen by `camera`, on a portable device.
    pub fn new(
        frame: u32,
        prior: PriorId,
        camera: &Camera,
        pose: QuantisedPose,
        uncertain: bool,
    ) -> Result<Latent, PacketError> {
        let Camera { width, height, .. } = *camera;
        let frame = frame % Self::FRAMES;
        let camera_tag = camera_tag(camera)?;
        Ok(Latent { frame, prior, width, height, camera_tag, pose, uncertain, portable: true })
    }

    /// Reads the latent part at the start of `bytes`, and nothing of what follows.
    pub fn decode(bytes: &[u8]) -> Result<Latent, PacketError> {
        Latent::read(bytes).map(|(latent, _, _)| latent)
    }

    /// Checks that the packet is about the prior at hand.
    pub fn check_prior(&self, held: PriorId) -> Result<(), PacketError> {
        if self.prior == held {
            Ok(())
        } else {
            Err(PacketError::Prior { packet: self.prior, held })
        }
    }

    /// Checks that `camera` is the one that the packet is about.
    pub fn check_camera(&self, camera: &Camera) -> Result<(), PacketError> {
        let found = camera_tag(camera)?;
        if found == self.camera_tag && (camera.width, camera.height) == (self.width, self.height) {
            Ok(())
        } else {
            Err(PacketError::CameraTag { expected: self.camera_tag, found })
        }
    }

    /// Length of the part, bytes.
    pub fn encoded_len(&self) -> usize {
        encoded_len(self.pose.profile())
    }

    /// Writes the part at the start of an empty packet.
    pub(super) fn write(&self, follows: &Follows, bytes: &mut Vec<u8>) -> Result<(), PacketError> {
        let flags = self.pose.profile().code()
            | if self.uncertain { FLAG_UNCERTAIN } else { 0 }
            | if follows.camera { FLAG_CAMERA } else { 0 }
            | if follows.render { FLAG_RENDER } else { 0 }
            | follows.residual << 4;
        let version = if self.portable { VERSION } else { VERSION_NOT_PORTABLE };
        bytes.extend_from_slice(&[MAGIC << 4 | version, flags]);
        bytes.extend_from_slice(&to_u24(self.frame));
        bytes.extend_from_slice(&self.prior.to_bytes());
        bytes.extend_from_slice(&size_bytes(self.width, self.height)?);
        self.pose.write(bytes);
        bytes.push(self.camera_tag);
        let check = crc16(&[bytes]);
        bytes.extend_from_slice(&check.to_le_bytes());
        Ok(())
    }

    /// The latent part, what follows, and the bytes after it.
    pub(super) fn read(bytes: &[u8]) -> Result<(Latent, Follows, &[u8]), PacketError> {
        let profile = check_start(bytes)?;
        let len = encoded_len(profile);
        let mut reader = Reader::new(bytes, Part::Latent, len)?;
        let [first, flags] = reader.take();
        let frame = from_u24(reader.take());
        let prior = PriorId::from_bytes(reader.take());
        let size = from_u24(reader.take());
        let pose = QuantisedPose::read(&mut reader, profile);
        let [camera_tag] = reader.take();
        let check = crc16(&[reader.taken()]);
        if check != u16::from_le_bytes(reader.take()) {
            return Err(PacketError::Check(Part::Latent));
        }
        let latent = Latent {
            frame,
            prior,
            width: (size & 0xFFF) + 1,
            height: (size >> 12) + 1,
            camera_tag,
            pose: pose?,
            uncertain: flags & FLAG_UNCERTAIN != 0,
            portable: first & 0xF == VERSION,
        };
        Ok((latent, Follows::of_flags(flags), &bytes[len..]))
    }
}

/// Checks the first two bytes, on which the part's length depends.
pub(super) fn check_start(bytes: &[u8]) -> Result<PoseProfile, PacketError> {
    let needed = encoded_len(PoseProfile::Compact);
    let [first, flags] = Reader::new(bytes, Part::Latent, needed)?.take();
    if first >> 4 != MAGIC {
        return Err(PacketError::Magic(first));
    }
    if ![VERSION, VERSION_NOT_PORTABLE].contains(&(first & 0xF)) {
        return Err(PacketError::Version(first & 0xF));
    }
    PoseProfile::of_code(flags & 0b11)
}

pub(super) fn encoded_len(profile: PoseProfile) -> usize {
    FIXED_LEN + profile.encoded_len()
}
