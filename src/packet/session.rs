//! What packets are about: the prior and the camera. A packet names both by a tag of 16 bits, and states them in full
//! in its session part, now and then.

use crate::Camera;
use crate::prior::PriorId;

use super::bytes::{Reader, crc16, from_u24, to_u24};
use super::{PacketError, Part};

/// Length of the session part, bytes.
pub(super) const LEN: usize = 25;

/// A prior and a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Session {
    /// The prior to render.
    pub prior: PriorId,
    /// The camera to render with.
    pub camera: Camera,
}

impl Session {
    /// What distinguishes it from others: the CRC-32 of the prior id, the size and fx, fy, cx, cy, as the session part
    /// holds them.
    ///
    /// # Errors
    /// If the camera's size does not fit a packet.
    pub fn check(&self) -> Result<u32, PacketError> {
        Ok(crc32fast::hash(&self.fields()?))
    }

    /// The low 16 bits of [`Session::check`], by which packets name it. Two sessions share a tag with a chance of 1 in
    /// 65,536.
    ///
    /// # Errors
    /// As for [`Session::check`].
    pub fn tag(&self) -> Result<u16, PacketError> {
        Ok(self.check()? as u16)
    }

    fn fields(&self) -> Result<[u8; LEN - 2], PacketError> {
        let Camera { width, height, fx, fy, cx, cy } = self.camera;
        let mut fields = [0; LEN - 2];
        fields[..4].copy_from_slice(&self.prior.to_bytes());
        fields[4..7].copy_from_slice(&size_bytes(width, height)?);
        for (slot, value) in fields[7..].chunks_exact_mut(4).zip([fx, fy, cx, cy]) {
            slot.copy_from_slice(&value.to_le_bytes());
        }
        Ok(fields)
    }

    /// Appends the session part.
    pub(super) fn write(&self, bytes: &mut Vec<u8>) -> Result<(), PacketError> {
        self.camera.check()?;
        let fields = self.fields()?;
        bytes.extend_from_slice(&fields);
        bytes.extend_from_slice(&crc16(&[&fields]).to_le_bytes());
        Ok(())
    }

    /// Reads the session part of a packet that names it by a tag.
    pub(super) fn read(bytes: &[u8], tag: u16) -> Result<Session, PacketError> {
        let mut reader = Reader::new(bytes, Part::Session, LEN)?;
        let prior = PriorId::from_bytes(reader.take());
        let size = from_u24(reader.take());
        let [fx, fy, cx, cy] = [(); 4].map(|()| f32::from_le_bytes(reader.take()));
        if crc16(&[reader.taken()]) != u16::from_le_bytes(reader.take()) {
            return Err(PacketError::Check(Part::Session));
        }
        let (width, height) = ((size & 0xFFF) + 1, (size >> 12) + 1);
        let session = Session { prior, camera: Camera { width, height, fx, fy, cx, cy } };
        let found = session.tag()?;
        if found != tag {
            return Err(PacketError::SessionTag { packet: tag, found });
        }
        session.camera.check()?;
        Ok(session)
    }
}

/// A picture size as the session part holds it.
fn size_bytes(width: u32, height: u32) -> Result<[u8; 3], PacketError> {
    let sides = 1..=Camera::MAX_SIDE;
    if !sides.contains(&width) || !sides.contains(&height) {
        return Err(PacketError::Size { width, height });
    }
    Ok(to_u24((width - 1) | (height - 1) << 12))
}

/// Whether bytes begin with a session part whose check matches.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
    bytes
        .get(..LEN)
        .and_then(|part| part.split_last_chunk())
        .is_some_and(|(fields, check)| crc16(&[fields]).to_le_bytes() == *check)
}
