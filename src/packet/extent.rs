//! How far a packet reaches, and how much of it is sound, read from its start.

use super::bytes::{Reader, from_u24};
use super::latent::{Follows, check_start, encoded_len};
use super::{
    CAMERA_PART_LEN, Latent, PacketError, Part, RENDER_PART_LEN, camera, render, residual,
};

/// What the start of a packet says of the whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Frame number, modulo 2²⁴.
    pub frame: u32,
    /// Length of the latent part, bytes.
    pub latent: usize,
    /// Length of the packet, bytes; `None` where the bytes end before its residual's length does.
    pub total: Option<usize>,
}

impl Extent {
    /// Reads the first bytes of a packet, 31 or more. If the latent part is there in full, its
    /// check must match; no other check is looked at, see [`sound_len`].
    ///
    /// # Errors
    /// If the bytes are not the start of a packet, or the residual's length fits no packet.
    pub fn read(start: &[u8]) -> Result<Extent, PacketError> {
        let latent = encoded_len(check_start(start)?);
        if start.len() >= latent {
            Latent::read(start)?;
        }
        let mut reader = Reader::new(start, Part::Latent, 5)?;
        let [_, flags] = reader.take();
        let frame = from_u24(reader.take());
        let follows = Follows::of_flags(flags);
        let camera = if follows.camera { CAMERA_PART_LEN } else { 0 };
        let render = if follows.render { RENDER_PART_LEN } else { 0 };
        let head = latent + camera + render;
        let total = if residual::has_part(follows.residual) {
            match residual::part_len(start.get(head..).unwrap_or(&[])) {
                Ok(length) => Some(head + length),
                Err(PacketError::TooShort { .. }) => None,
                Err(error) => return Err(error),
            }
        } else {
            Some(head)
        };
        Ok(Extent { frame, latent, total })
    }
}

/// Bytes at the start of a packet that its own checks vouch for: none, the latent part, that and
/// the fixed parts after it, or the packet.
pub fn sound_len(start: &[u8]) -> usize {
    let Ok((latent, follows, rest)) = Latent::read(start) else { return 0 };
    let (latent_part, _) = start.split_at(start.len() - rest.len());
    let mut sound = latent_part.len();
    if follows.camera {
        if camera::decode(rest, &latent).is_err() {
            return sound;
        }
        sound += CAMERA_PART_LEN;
    }
    if follows.render {
        if render::decode(&start[sound..], latent_part).is_err() {
            return sound;
        }
        sound += RENDER_PART_LEN;
    }
    if residual::has_part(follows.residual)
        && let Ok((length, _)) = residual::checked(&start[sound..], latent_part)
    {
        sound += length;
    }
    sound
}
