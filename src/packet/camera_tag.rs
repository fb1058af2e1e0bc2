//! The tag by which a latent part names its camera, and the bytes that it is made of.

use crate::Camera;

use super::PacketError;
use super::bytes::{crc16, to_u24};

/// Names a camera in the latent part, so that a decoder notices when the camera it remembers is not
/// the one meant: the low byte of the camera part's check.
///
/// # Errors
/// If the camera's size does not fit a packet.
pub fn camera_tag(camera: &Camera) -> Result<u8, PacketError> {
    let size = size_bytes(camera.width, camera.height)?;
    Ok(crc16(&[&size, &intrinsics(camera)]) as u8)
}

/// A picture size as the header holds it.
pub(super) fn size_bytes(width: u32, height: u32) -> Result<[u8; 3], PacketError> {
    let sides = 1..=Camera::MAX_SIDE;
    if !sides.contains(&width) || !sides.contains(&height) {
        return Err(PacketError::Size { width, height });
    }
    Ok(to_u24((width - 1) | (height - 1) << 12))
}

pub(super) fn intrinsics(camera: &Camera) -> [u8; 16] {
    let mut bytes = [0; 16];
    let fields = [camera.fx, camera.fy, camera.cx, camera.cy];
    for (slot, value) in bytes.chunks_exact_mut(4).zip(fields) {
        slot.copy_from_slice(&value.to_le_bytes());
    }
    bytes
}
