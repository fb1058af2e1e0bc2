//! What a latent part is about: the prior and the camera, stated in full or by a tag.

use crate::Camera;
use crate::prior::PriorId;

use super::PacketError;
use super::bytes::crc16;
use super::camera_tag::{camera_tag, intrinsics, size_bytes};

/// What a latent part is about, and how it says so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Session {
    /// The full form: any topside that holds the prior and the camera can tell.
    Stated {
        /// The prior to render.
        prior: PriorId,
        /// Picture width, pixels.
        width: u32,
        /// Picture height, pixels.
        height: u32,
        /// [`camera_tag`] of the camera to render with.
        camera_tag: u8,
    },
    /// The short form: the [`session_tag`] of prior and camera. Packets in the full form have stated both.
    Tagged(u8),
}

impl Session {
    /// Stated in full.
    pub fn stated(prior: PriorId, camera: &Camera) -> Result<Session, PacketError> {
        let Camera { width, height, .. } = *camera;
        Ok(Session::Stated { prior, width, height, camera_tag: camera_tag(camera)? })
    }

    /// Names the session by its tag.
    pub fn tagged(prior: PriorId, camera: &Camera) -> Result<Session, PacketError> {
        session_tag(prior, camera).map(Session::Tagged)
    }

    /// Checks that it is about a prior and a camera.
    pub fn check(&self, held: PriorId, camera: &Camera) -> Result<(), PacketError> {
        match *self {
            Session::Stated { prior, width, height, camera_tag: expected } => {
                if prior != held {
                    return Err(PacketError::Prior { packet: prior, held });
                }
                let found = camera_tag(camera)?;
                if found != expected || (camera.width, camera.height) != (width, height) {
                    return Err(PacketError::CameraTag { expected, found });
                }
            }
            Session::Tagged(packet) => {
                let found = session_tag(held, camera)?;
                if found != packet {
                    return Err(PacketError::SessionTag { packet, found });
                }
            }
        }
        Ok(())
    }
}

/// Names prior and camera in the short form: the low byte of a CRC-16/IBM-3740 of the prior id, the
/// size as the full form holds it, and fx, fy, cx, cy. Two sessions share a tag with a chance of 1
/// in 256.
///
/// # Errors
/// If the camera's size does not fit a packet.
pub fn session_tag(prior: PriorId, camera: &Camera) -> Result<u8, PacketError> {
    let size = size_bytes(camera.width, camera.height)?;
    Ok(crc16(&[&prior.to_bytes(), &size, &intrinsics(camera)]) as u8)
}
