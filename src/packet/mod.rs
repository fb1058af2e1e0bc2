//! The wire format: one frame, one packet.
//!
//! A packet is a *latent part*, which makes a picture by itself, and up to three parts after it. All
//! numbers are little endian, all floats IEEE 754.
//!
//! The latent part has three forms. The full one names prior, size and camera:
//!
//! | byte | latent part, full form |
//! |---|---|
//! | 0 | high four bits `0xB`, low four bits the version: 1, or 2 if the vehicle's device is not portable |
//! | 1 | flags, below |
//! | 2–4 | frame number, modulo 2²⁴ |
//! | 5–8 | prior id |
//! | 9–11 | 12 bits width − 1, 12 bits height − 1 |
//! | 12–… | pose: compact 16 bytes, paper 28 bytes; see [`mod@pose`] |
//! | next | camera tag: low byte of the camera check below |
//! | next 2 | CRC-16/IBM-3740 of all bytes before |
//!
//! | bits | flags |
//! |---|---|
//! | 0–1 | pose profile: 1 compact, 2 paper, 3 short |
//! | 2 | the pose is not certain: the picture does not confirm it |
//! | 3 | the camera part follows |
//! | 4–6 | residual: 0 none asked for, 1 left out as the budget holds none, 2 to 4 its [`Coder`], 5 of a stream, 6 with a truth map, 7 see below |
//! | 7 | the render part follows |
//!
//! It has 31 bytes in the compact profile, one frame of the smallest modems, and 43 in the paper's.
//!
//! The short form is for a topside that knows the *session*: the prior, the size and the camera. A
//! packet in the full form with a camera part states the session; such a packet is sent again now
//! and then. No camera part follows the short form, so its bit is 0.
//!
//! | byte | latent part, short form: 19 bytes |
//! |---|---|
//! | 0 | high four bits `0xB`, low four bits the version: 4, or 7 if the vehicle's device is not portable |
//! | 1 | flags, as above; pose profile: 3, or 0 if the residual has small blocks |
//! | 2–3 | frame number, modulo 2¹⁶: see [`Latent::frame_near`] |
//! | 4 | [`session_tag`] |
//! | 5–16 | pose: short, 12 bytes; see [`mod@pose`] |
//! | 17–18 | CRC-16/IBM-3740 of all bytes before |
//!
//! A frame that is drawn with [updates](crate::prior::Update) of the prior has versions 8 and 11 in the full form, 13
//! and 14 in the short one; the second of each is of devices that are not portable. Bytes 2–3 are then the frame number
//! modulo 2¹⁶ in both forms. Byte 4 is the number of the newest update, modulo 256. The rest follows: in the full form
//! the [`StateId`](crate::prior::StateId) after that update in place of the prior id, in the short form the
//! [`session_tag`] of that state and the camera. So the full form has as many bytes as without updates, and the short
//! form one more, 20.
//!
//! The *predicted form* is for packets in [protected shares](crate::modem), to a topside that has told which poses it
//! holds. It states the pose as what it differs by from one that both sides compute. The pose is on the short form's
//! grid, so the picture is the same.
//!
//! | byte | latent part, predicted form: 9 to 18 bytes |
//! |---|---|
//! | 0 | high four bits `0x8`, low four bits what follows: the residual's number in the flags, 8 more with small blocks |
//! | 1 | bit 7: the packet ends where its bytes do, else its end is missing; bits 0–6: frame number, modulo 2⁷ |
//! | 2–… | pose: see below; zero bits up to a byte |
//! | next 2 | CRC-16/IBM-3740 of its context, byte 0 and the pose |
//!
//! | bits | pose, predicted form; the first bit of a byte is its highest |
//! |---|---|
//! | 6 | how many frames before this one the *reference* came, − 1 |
//! | 3 | how many frames before the reference the other one came that tells the motion; 0: there is none |
//! | 3, 3 | scale *s* of the centre's numbers, of the rotation's |
//! | … | centre's three numbers, rotation's three: Rice code of parameter *s* + 2 of 0, −1, 1, −2, … |
//!
//! The numbers are steps of the short code, added to the prediction. That is the reference's pose. With another frame
//! it is the pose to which its motion goes on: the centre moves evenly, and so does the quaternion, which is then
//! brought to unit length. The arithmetic is of integers ([`Prediction`]). The quaternion's largest component is that
//! of the reference. The frame has the prior, the update, the camera and the device of the reference. It is certain,
//! and has neither camera nor render part; others have the short form.
//!
//! The *scale* is stated. What a prediction is off by is how the vehicle's motion has changed since the reference, and
//! not what the search leaves open. The topside knows neither.
//!
//! The *context* is the CRC-32 (IEEE) of: the frame number modulo 2¹⁶; the CRC-32 of prior or state, size, intrinsics,
//! portability and update; the reference's pose, and that of the other frame, each as seven numbers. So the check finds
//! another vehicle's poses under the same numbers, and a frame number that was completed wrongly.
//!
//! The first byte differs in two bits from that of the other forms, whose versions are all taken: every other one is
//! one flipped bit from one in use. Topsides that do not know it call it no packet, and do not tell which poses they
//! hold. Shares leave byte 1 out, as they tell the number themselves, and the collector puts it back.
//!
//! | bytes | camera part |
//! |---|---|
//! | 16 | fx, fy, cx, cy as f32 |
//! | 2 | CRC-16/IBM-3740 of bytes 9–11 of the latent part and of these 16 |
//!
//! | bytes | render part |
//! |---|---|
//! | 4 | CRC-32 (IEEE) of the render at this pose, 8-bit RGB row by row |
//! | 2 | CRC-16/IBM-3740 of the latent part and of these 4 |
//!
//! | bytes | residual part |
//! |---|---|
//! | 1–4 | payload length, seven bits per byte, low bits first, high bit set on all but the last |
//! | length | payload |
//! | 4 | CRC-32 (IEEE) of the latent part, the length and the payload; after the full form |
//! | 2 | CRC-16/IBM-3740 of the latent part's CRC-32, the length and the payload; after the short form |
//! | 1 | CRC-8/SMBUS of the CRC-32 of the latent part without byte 1, and of the payload; after the predicted form, whose residual part has no length |
//!
//! The payload of a frame of a stream begins with its reference. Then come the wavelet coder's bytes:
//!
//! | bytes | reference |
//! |---|---|
//! | 1 | how many frames before this one it came, 1 to 255; 0: the frame is intra, and the tag is not there |
//! | 2 | its tag, see below |
//!
//! With code 6 the payload begins with the [truth map](crate::truth), which tells its own length. The lowest two bits
//! of its first byte say what follows it: 0 no residual, as none was asked for; 1 none, as the budget holds none; 2 the
//! wavelet coder's bytes; 3 those of a frame of a stream, from its reference on. Code 7: no residual was asked for, or
//! none was needed, and the truth map is the one by which all is as seen; no residual part follows.
//!
//! With the pose profile 0 of the short form, codes 4, 5 and 6 are of [small blocks](Coder::SmallBlocks): so are the
//! wavelet coder's bytes, by themselves, in a stream, or behind a truth map. No other code goes with it.
//!
//! A *reference* is a frame of the stream that both sides hold: what the topside shows of it, less its render. The tag
//! tells it from a frame of the same number that is of another stream, or came in part. It is the CRC-32 (IEEE) of
//! these bytes, high half and low half combined by exclusive or: fx, fy, cx, cy and the placement (unit quaternion w,
//! x, y, z, then translation, as the stage `project` has them), each as f32; then the difference picture, row by
//! row, as `clamp(shown − render, −128, 127) + 128`. Only packets whose residual is of a stream can be reference
//! frames, and only if all of the residual arrived. Frame numbers of references are told apart modulo 2¹⁶. Both sides
//! hold the last 32 frames of a stream.
//!
//! The residual's check covers the latent part too. So a residual is never added to the picture of
//! another frame. Bytes after the last part are ignored: modems pad. After the predicted form no padding may follow:
//! the collector takes it off.
//!
//! **Later versions** keep the first byte's high four bits, and end their latent part with the CRC-16 of all bytes
//! before it, after 19, 20, 31 or 43 bytes. So a packet of a later version is told from garbage
//! ([`PacketError::Version`]), by a check that one random packet in 16,384 of such a first byte passes.
//!
//! A decoder cannot use a packet if it holds no camera with the packet's tag. It must not use a
//! packet of another prior ([`Session::check`]).
//!
//! **What is missed.** The CRC-16 of a latent part finds every error of one, two or any odd number of bits in a part
//! this short (its polynomial has order 32,767 and the factor x + 1). It also finds every burst of up to sixteen bits
//! before the check. It misses at most one in 30,000 of longer bursts, and of errors of an even number of four and more
//! bits. That holds as long as the part's length is right, which depends on version and profile. No two flipped bits
//! turn one form into the other.
//!
//! | damage | full form | short form | predicted form, beside the share's CRC-16 |
//! |---|---|---|---|
//! | one or two bits of the latent part | never missed | never missed | one never; two 1 in 65,536, if they name another reference |
//! | a random latent part | 1 in 65,536 | 1 in 131,072: a bit of the pose is always zero | 1 in 65,536 |
//! | a random latent part and the residual after it, both | 1 in 2⁴⁸ | 1 in 2³³ | 1 in 2²⁴ |
//! | one bit of a residual's payload or check | never missed | never missed | never missed |
//! | one bit of a residual's length | 1 in 2³² | 1 in 65,536 | there is none |
//! | a random residual part, or that of another packet | 1 in 2³² | 1 in 65,536 | 1 in 256 |
//! | a reference of the right number and another stream | 1 in 65,536 | 1 in 65,536 | 1 in 65,536 |
//! | a prior that is not the vehicle's | 1 in 2³² | 1 in 256 per known camera | 1 in 65,536 |
//! | a camera that is not the vehicle's | 1 in 256 | 1 in 256 | 1 in 65,536 |
//! | a pose that is held under the right number, of another vehicle | | | 1 in 65,536 |
//!
//! Measured in the short form: 966 of 2²⁷ random latent parts were missed, none of 2²⁵ with one, two or three flipped
//! bits, and 69 of 2²² random residual parts.
//!
//! In the predicted form a wrong pose would spoil those that are predicted from it, too, so its check stays as long as
//! the others'. Its residual spoils one picture, and each share that it comes in has a CRC-16 of its own: together they
//! miss 1 in 2²⁴.
//!
//! A pose is as safe in the short form as in the full one. A residual is less safe: a damaged one that passes spoils
//! one picture. The chances of the last two rows count once per vehicle and topside, not once per packet. The next
//! packet in the full form corrects such a mistake, as a topside with another prior refuses it.

pub(crate) mod bytes;
mod camera;
mod camera_tag;
mod error;
mod extent;
mod form;
mod held;
mod latent;
mod parsed;
pub mod pose;
mod predicted;
mod render;
mod residual;
mod sent;
mod session;
pub(crate) mod truth;

use crate::Camera;

use form::Follows;
use residual::Check;

pub use camera_tag::camera_tag;
pub use error::{PacketError, Part};
pub use extent::{Extent, valid_len};
pub use held::{HeldPoses, session_check};
pub use latent::Latent;
pub use parsed::Parsed;
pub use pose::{PoseProfile, QuantisedPose};
pub use predicted::Prediction;
pub(crate) use predicted::{is_predicted, mark_whole};
pub use render::RenderCheck;
pub use residual::{Coder, Reference, Residual, ResidualStart, residual_part_len};
pub(crate) use sent::SentPoses;
pub use session::{Session, session_tag};

/// Length of the latent part in the paper's profile, the longer one, bytes.
pub const LONGEST_LATENT: usize = form::FIXED_LEN + pose::LONGEST;

/// Length of the latent part in the short form, bytes.
pub const SHORT_LATENT_LEN: usize = form::SHORT_LATENT_LEN;

/// Length of the latent part in the short form of a frame that is drawn with updates, bytes.
pub const LEARNT_SHORT_LEN: usize = form::LEARNT_SHORT_LEN;

/// Length of the camera part, bytes.
pub const CAMERA_PART_LEN: usize = camera::LEN;

/// Length of the render part, bytes.
pub const RENDER_PART_LEN: usize = render::LEN;

/// One frame as it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Packet<'a> {
    /// What makes a picture by itself.
    pub latent: Latent,
    /// The camera. Sent when it changed, and again now and then.
    pub camera: Option<Camera>,
    /// A check of the render, if the vehicle sends one.
    pub render: Option<RenderCheck>,
    /// The difference picture.
    pub residual: Residual<'a>,
    /// The truth map of the picture, as [`crate::truth`] writes it; `None`: none is sent. Not with VP8 or WebP.
    pub truth: Option<&'a [u8]>,
}

/// What a packet with damaged parts still gives.
#[derive(Clone, Debug)]
pub struct Salvage<'a> {
    /// The latent part: valid, or there would be nothing.
    pub latent: Latent,
    /// The camera part, `None` if none was sent.
    pub camera: Result<Option<Camera>, PacketError>,
    /// The render part, `None` if none was sent.
    pub render: Result<Option<RenderCheck>, PacketError>,
    /// The residual part.
    pub residual: Result<Residual<'a>, PacketError>,
    /// The residual's start, if only its end is missing. Nothing checks it. Use it only if the
    /// bytes are known to be the undamaged start of a packet.
    pub residual_start: Option<ResidualStart<'a>>,
    /// The truth map; `None`: none was sent, or it is missing in part. If the residual is damaged, it is as reliable as
    /// `residual_start`.
    pub truth: Option<&'a [u8]>,
}

impl<'a> Packet<'a> {
    /// The bytes to send.
    ///
    /// # Errors
    /// If the picture size does not fit the header. If the camera is not the one that the latent part is about. If the
    /// payload has 2²⁸ bytes or more. If the short form is asked for with a camera, or with a pose that it cannot hold.
    pub fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let mut bytes = Vec::with_capacity(self.encoded_len());
        self.write(&mut bytes)?;
        Ok(bytes)
    }

    /// As [`Packet::encode`], but replaces the content of `bytes`.
    pub fn write(&self, bytes: &mut Vec<u8>) -> Result<(), PacketError> {
        bytes.clear();
        let follows = Follows {
            camera: self.camera.is_some(),
            render: self.render.is_some(),
            residual: residual::code_of(&self.residual, self.truth)?,
        };
        self.latent.write(&follows, bytes)?;
        let latent_len = bytes.len();
        if let Some(camera) = &self.camera {
            bytes.extend_from_slice(&camera::encode(camera, &self.latent)?);
        }
        if let Some(check) = self.render {
            let part = render::encode(check, &bytes[..latent_len]);
            bytes.extend_from_slice(&part);
        }
        let check = Check::of(self.latent.form());
        residual::write(&self.residual, self.truth, latent_len, check, bytes)
    }

    /// Length of [`Packet::encode`]'s bytes.
    pub fn encoded_len(&self) -> usize {
        let camera = if self.camera.is_some() { CAMERA_PART_LEN } else { 0 };
        let render = if self.render.is_some() { RENDER_PART_LEN } else { 0 };
        let check = Check::of(self.latent.form());
        let residual = residual::encoded_len(&self.residual, self.truth, check);
        self.latent.encoded_len() + camera + render + residual
    }

    /// Length of the longest truth map with which the packet has at most `budget` bytes.
    pub(crate) fn truth_room(&self, budget: usize) -> usize {
        let check = Check::of(self.latent.form());
        let own = residual::encoded_len(&self.residual, self.truth, check);
        let others = self.encoded_len() - own;
        residual::truth_room(&self.residual, check, budget.saturating_sub(others))
    }

    /// Reads a packet; all its parts must be valid.
    ///
    /// # Errors
    /// If a part is damaged, or not all of it is there. If the pose is predicted from another one.
    pub fn decode(bytes: &'a [u8]) -> Result<Packet<'a>, PacketError> {
        let Salvage { latent, camera, render, residual, truth, .. } = Packet::salvage(bytes)?;
        Ok(Packet { latent, camera: camera?, render: render?, residual: residual?, truth })
    }

    /// Reads what is valid in a truncated or damaged packet.
    ///
    /// # Errors
    /// If the latent part is not valid, or predicted from a pose: the packet is then of no use.
    pub fn salvage(bytes: &'a [u8]) -> Result<Salvage<'a>, PacketError> {
        Packet::salvage_with(bytes, &HeldPoses::default())
    }

    /// As [`Packet::salvage`], with the poses that the packet's may be predicted from.
    pub fn salvage_with(bytes: &'a [u8], held: &HeldPoses) -> Result<Salvage<'a>, PacketError> {
        if predicted::is_predicted(bytes) {
            let (latent, follows, len) = held.read(bytes)?;
            let (latent_bytes, rest) = bytes.split_at(len);
            let found = residual::decode(follows.residual, rest, latent_bytes, Check::Crc8);
            let residual::Found { residual, start: residual_start, truth } = found;
            let (camera, render) = (Ok(None), Ok(None));
            return Ok(Salvage { latent, camera, render, residual, residual_start, truth });
        }
        let (latent, follows, rest) = Latent::read(bytes)?;
        let latent_bytes = &bytes[..bytes.len() - rest.len()];
        // Both lengths are fixed, so damage in these parts does not hide those after them.
        let (camera, rest) = if follows.camera {
            let camera = camera::decode(rest, &latent).map(Some);
            (camera, rest.get(CAMERA_PART_LEN..).unwrap_or(&[]))
        } else {
            (Ok(None), rest)
        };
        let (render, rest) = if follows.render {
            let check = render::decode(rest, latent_bytes).map(Some);
            (check, rest.get(RENDER_PART_LEN..).unwrap_or(&[]))
        } else {
            (Ok(None), rest)
        };
        let check = Check::of(latent.form());
        let found = residual::decode(follows.residual, rest, latent_bytes, check);
        let residual::Found { residual, start: residual_start, truth } = found;
        Ok(Salvage { latent, camera, render, residual, residual_start, truth })
    }
}

#[cfg(test)]
mod tests;
