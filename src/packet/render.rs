//! The render part: a check of the prior's render. It tells the topside whether its own render is the same. A device
//! that is not portable may round differently.

use super::bytes::{Reader, crc16};
use super::{PacketError, Part};
use crate::Picture;

/// Length of the part, bytes.
pub(super) const LEN: usize = 6;

/// CRC-32 (IEEE) of a render's bytes, RGB, row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderCheck(pub u32);

impl RenderCheck {
    /// The check of a render.
    pub fn of(render: &Picture) -> RenderCheck {
        RenderCheck(crc32fast::hash(&render.data))
    }
}

/// The part of a packet that begins with these bytes of latent part.
pub(super) fn encode(check: RenderCheck, latent: &[u8]) -> [u8; LEN] {
    let [a, b, c, d] = check.0.to_le_bytes();
    let [e, f] = crc16(&[latent, &[a, b, c, d]]).to_le_bytes();
    [a, b, c, d, e, f]
}

pub(super) fn decode(bytes: &[u8], latent: &[u8]) -> Result<RenderCheck, PacketError> {
    let mut reader = Reader::new(bytes, Part::Render, LEN)?;
    let check = RenderCheck(u32::from_le_bytes(reader.take()));
    if crc16(&[latent, reader.taken()]) != u16::from_le_bytes(reader.take()) {
        return Err(PacketError::Check(Part::Render));
    }
    Ok(check)
}
