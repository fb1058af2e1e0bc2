//! The camera part.

use crate::Camera;

use super::bytes::{Reader, crc16};
use super::camera_tag::{camera_tag, intrinsics, size_bytes};
use super::{Latent, PacketError, Part, Session};

/// Length of the part, bytes.
pub(super) const LEN: usize = 18;

pub(super) fn encode(camera: &Camera, latent: &Latent) -> Result<[u8; LEN], PacketError> {
    camera.check()?;
    let Session::Stated { width, height, camera_tag: expected, .. } = latent.session else {
        return Err(PacketError::ShortCamera);
    };
    let found = camera_tag(camera)?;
    if found != expected || (camera.width, camera.height) != (width, height) {
        return Err(PacketError::CameraTag { expected, found });
    }
    let fields = intrinsics(camera);
    let check = crc16(&[&size_bytes(camera.width, camera.height)?, &fields]);
    let mut part = [0; LEN];
    part[..16].copy_from_slice(&fields);
    part[16..].copy_from_slice(&check.to_le_bytes());
    Ok(part)
}

pub(super) fn decode(bytes: &[u8], latent: &Latent) -> Result<Camera, PacketError> {
    let mut reader = Reader::new(bytes, Part::Camera, LEN)?;
    let [fx, fy, cx, cy] = [(); 4].map(|()| f32::from_le_bytes(reader.take()));
    let Session::Stated { width, height, camera_tag: expected, .. } = latent.session else {
        return Err(PacketError::ShortCamera);
    };
    let check = crc16(&[&size_bytes(width, height)?, reader.taken()]);
    if check != u16::from_le_bytes(reader.take()) {
        return Err(PacketError::Check(Part::Camera));
    }
    let found = check as u8;
    if found != expected {
        return Err(PacketError::CameraTag { expected, found });
    }
    let camera = Camera { width, height, fx, fy, cx, cy };
    camera.check()?;
    Ok(camera)
}
