//! How far a packet reaches, and how much of it is valid, read from its start.

use super::bytes::{Reader, from_u24};
use super::latent::{Follows, check_start, nearest_frame};
use super::residual::Check;
use super::{
    CAMERA_PART_LEN, Latent, PacketError, Part, RENDER_PART_LEN, camera, render, residual,
};

/// What the start of a packet says about the whole packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Frame number, as the packet states it.
    pub frame: u32,
    /// It is stated modulo this: 2²⁴, in the short form 2¹⁶.
    pub frames: u32,
    /// Length of the latent part, bytes.
    pub latent: usize,
    /// Bytes before the residual: the latent part, and camera and render check if they are there. They make a picture.
    pub head: usize,
    /// Bytes after them up to the end of the truth map; 0: there is none, or not all of it is there.
    pub told: usize,
    /// Length of the packet, bytes; `None` if the bytes end before the residual's length field does.
    pub total: Option<usize>,
}

impl Extent {
    /// Reads the first bytes of a packet: 31 or more, in the short form 19 or more. If the whole latent part is there,
    /// its check must match. Other checks are not tested: see [`valid_len`].
    ///
    /// # Errors
    /// If the bytes are not the start of a packet, or the residual's length fits no packet.
    pub fn read(start: &[u8]) -> Result<Extent, PacketError> {
        let form = check_start(start)?;
        let latent = form.latent_len();
        if start.len() >= latent {
            Latent::read(start)?;
        }
        let mut reader = Reader::new(start, Part::Latent, 5)?;
        let [_, flags] = reader.take();
        let frames = form.frames();
        // The low bytes come first in all forms.
        let frame = from_u24(reader.take()) % frames;
        let follows = Follows::of_flags(flags);
        let camera = if follows.camera { CAMERA_PART_LEN } else { 0 };
        let render = if follows.render { RENDER_PART_LEN } else { 0 };
        let head = latent + camera + render;
        let rest = start.get(head..).unwrap_or(&[]);
        let told = residual::told_len(follows.residual, rest);
        let total = if residual::has_part(follows.residual) {
            match residual::part_len(rest, Check::of(form)) {
                Ok(length) => Some(head + length),
                Err(PacketError::TooShort { .. }) => None,
                Err(error) => return Err(error),
            }
        } else {
            Some(head)
        };
        Ok(Extent { frame, frames, latent, head, told, total })
    }

    /// Replaces the frame number by the one modulo 2²⁴ that is nearest to another packet's.
    pub(crate) fn near(self, last: Option<u32>) -> Extent {
        Extent { frame: nearest_frame(self.frame, self.frames, last), ..self }
    }

    /// Whether the packet may be of a frame number, modulo 2²⁴.
    pub(crate) fn may_be(&self, frame: u32) -> bool {
        frame.wrapping_sub(self.frame).is_multiple_of(self.frames)
    }
}

/// Bytes at the start of a packet that its own checks vouch for: none, the latent part, the latent
/// part with the fixed parts after it, or the whole packet.
pub fn valid_len(start: &[u8]) -> usize {
    let Ok((latent, follows, rest)) = Latent::read(start) else { return 0 };
    let (latent_part, _) = start.split_at(start.len() - rest.len());
    let mut valid = latent_part.len();
    if follows.camera {
        if camera::decode(rest, &latent).is_err() {
            return valid;
        }
        valid += CAMERA_PART_LEN;
    }
    if follows.render {
        if render::decode(&start[valid..], latent_part).is_err() {
            return valid;
        }
        valid += RENDER_PART_LEN;
    }
    if residual::has_part(follows.residual)
        && let Ok((length, _)) =
            residual::checked(&start[valid..], latent_part, Check::of(latent.form()))
    {
        valid += length;
    }
    valid
}
