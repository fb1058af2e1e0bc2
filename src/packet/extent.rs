//! How far a packet reaches, and how much of it is valid, read from its start.

use super::bytes::{Reader, from_u24};
use super::form::{Follows, PREDICTED_FRAMES};
use super::latent::{check_start, nearest_frame};
use super::predicted::{Stated, is_predicted};
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
    /// Length of the packet, bytes; `None` if the bytes end before the residual's length field does, or if there is no
    /// such field: the packet is [open](Extent::is_open).
    pub total: Option<usize>,
    /// Bytes of the residual part that are not its content: its length and its check; 0: there is none, or its length
    /// is not there.
    pub framing: usize,
    /// It does not say where it ends: whoever has its bytes must know. Such packets are in the predicted form.
    pub is_open: bool,
    /// Bytes of the latent part that shares do not carry, as they tell the frame number by themselves.
    pub told_by_shares: usize,
}

impl Extent {
    /// Reads the first bytes of a packet: 31 or more, in the short form 19 or more. If the whole latent part is there,
    /// its check must match. Other checks are not tested: see [`valid_len`].
    ///
    /// # Errors
    /// If the bytes are not the start of a packet, or the residual's length fits no packet.
    pub fn read(start: &[u8]) -> Result<Extent, PacketError> {
        if is_predicted(start) {
            return Extent::of_predicted(start);
        }
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
        let told = residual::told_len(follows.residual, rest, Check::of(form));
        let total = if residual::has_part(follows.residual) {
            match residual::part_len(rest, Check::of(form)) {
                Ok(length) => Some(head + length),
                Err(PacketError::TooShort { .. }) => None,
                Err(error) => return Err(error),
            }
        } else {
            Some(head)
        };
        let framing = match residual::has_part(follows.residual) {
            true => residual::framing_len(rest, Check::of(form)),
            false => 0,
        };
        let (is_open, told_by_shares) = (false, 0);
        Ok(Extent { frame, frames, latent, head, told, total, framing, is_open, told_by_shares })
    }

    /// No check is tested: whether the latent part is valid is known to who holds the poses that it is predicted from.
    fn of_predicted(start: &[u8]) -> Result<Extent, PacketError> {
        let Stated { frame, follows, len, .. } = Stated::read(start)?;
        let is_open = residual::has_part(follows.residual);
        Ok(Extent {
            frame,
            frames: PREDICTED_FRAMES,
            latent: len,
            head: len,
            told: residual::told_len(follows.residual, &start[len..], Check::Crc8),
            total: (!is_open).then_some(len),
            framing: if is_open { residual::framing_len(&[], Check::Crc8) } else { 0 },
            is_open,
            told_by_shares: 1,
        })
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
///
/// In the predicted form the latent part's own check needs the poses that it is predicted from. So the part counts here
/// if it can be read.
pub fn valid_len(start: &[u8]) -> usize {
    if is_predicted(start) {
        return valid_predicted(start).unwrap_or(0);
    }
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

fn valid_predicted(start: &[u8]) -> Option<usize> {
    let Stated { follows, len, .. } = Stated::read(start).ok()?;
    let (latent, rest) = start.split_at(len);
    let part =
        residual::has_part(follows.residual).then(|| residual::checked(rest, latent, Check::Crc8));
    Some(len + part.and_then(Result::ok).map_or(0, |(part, _)| part))
}
