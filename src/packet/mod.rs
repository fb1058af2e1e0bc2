//! The wire format: one frame, one packet.
//!
//! A packet is a *latent part*, which makes a picture by itself, and up to three parts after it: camera, render check
//! and residual. The latent part has three forms. The *full* one names prior, size and camera. The *short* one is for a
//! topside that knows the *session*: prior, size and camera; packets in the full form with a camera part state it, and
//! are sent again now and then. The *predicted* one is for packets in [protected shares](crate::modem), to a topside
//! that has told which poses it holds: it states the pose as what it differs by from one that both sides compute
//! ([`Prediction`]).
//!
//! All bytes, what must be refused, what later versions may change and what damage is missed: `docs/format/packet.md`.
//!
//! Why it is so:
//!
//! - The *scale* of a predicted pose is stated. What a prediction is off by is how the vehicle's motion has changed
//!   since the reference, and not what the search leaves open. The topside knows neither.
//! - The check of a predicted pose covers its *context*: session, reference and frame number. So it finds another
//!   vehicle's poses under the same numbers, and a frame number that was completed wrongly.
//! - The first byte of the predicted form differs in two bits from that of the other forms, whose versions are all
//!   taken: every other one is one flipped bit from one in use. Topsides that do not know it call it no packet, and do
//!   not tell which poses they hold.
//! - The residual's check covers the latent part too. So a residual is never added to the picture of another frame.
//! - In the predicted form a wrong pose would spoil those that are predicted from it, too, so its check stays as long
//!   as the others'. Its residual spoils one picture, and each share that it comes in has a CRC-16 of its own: together
//!   they miss 1 in 2²⁴.
//!
//! Measured in the short form: 966 of 2²⁷ random latent parts were missed, none of 2²⁵ with one, two or three flipped
//! bits, and 69 of 2²² random residual parts.

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
