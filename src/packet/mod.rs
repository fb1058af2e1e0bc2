//! The wire format: one frame, one packet.
//!
//! A packet is a *latent part*, which makes a picture by itself, and up to three parts after it: session, render check
//! and residual. The latent part names prior and camera by a tag. Packets with a session part state both in full, now
//! and then. A pose is stated by itself, or, to a topside that has told which poses it holds, as what it differs by
//! from one that both sides compute ([`Prediction`]).
//!
//! All bytes, what must be refused, what later versions may change and what damage is missed: `docs/format/packet.md`.
//!
//! Why it is so:
//!
//! - Fields are orthogonal, each in its bits. Those that tell how long the latent part is make a code of distance
//!   three, so the latent part's check finds every one or two flipped bits.
//! - A packet ends where its bytes do, but for zeros: no payload ends with a zero. So no length travels, and a modem
//!   may fill up its frames with zeros.
//! - The *scale* of a predicted pose is stated. What a prediction is off by is how the vehicle's motion has changed
//!   since the reference, and not what the search leaves open. The topside knows neither.
//! - The check of a predicted pose covers its *context*: prior, camera and the poses that it is predicted from. So it
//!   finds another vehicle's poses under the same numbers.
//! - The residual's check covers the latent part too, and so the tag. A residual is never added to the picture of
//!   another frame.

mod bytes;
mod error;
mod head;
mod held;
mod known;
mod latent;
mod parsed;
pub mod pose;
mod predicted;
mod render;
mod residual;
#[cfg(feature = "encode")]
mod sent;
mod session;
pub(crate) mod truth;

use head::Head;
use known::Confidence;
use residual::Content;

pub use bytes::crc16;
pub use error::{PacketError, Part};
pub use head::{LEN as HEAD_LEN, is_predicted};
pub use held::HeldPoses;
pub use known::{KnownPose, PoseBound};
pub use latent::{Latent, nearest_frame};
pub use parsed::{Extent, Parsed};
pub use pose::{PoseProfile, QuantisedPose};
pub use predicted::Prediction;
pub use render::RenderCheck;
pub use residual::{Reference, Residual, ResidualStart, residual_part_len, without_zeros};
#[cfg(feature = "encode")]
pub use sent::SentPoses;
pub use session::Session;

/// Length of the latent part of a pose in the short profile that is stated by itself, bytes.
pub const SHORT_LATENT_LEN: usize = 8 + pose::SHORT_LEN;

/// Length of the session part, bytes.
pub const SESSION_PART_LEN: usize = session::LEN;

/// Length of the render part, bytes.
pub const RENDER_PART_LEN: usize = render::LEN;

/// Most bytes before the residual part.
pub const LONGEST_HEAD: usize = 8 + pose::COMPACT_LEN + SESSION_PART_LEN + RENDER_PART_LEN;

/// One frame as it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Packet<'a> {
    /// What makes a picture by itself.
    pub latent: Latent,
    /// Prior and camera. Sent first, when they change, and again now and then.
    pub session: Option<Session>,
    /// A check of the render, if the vehicle sends one.
    pub render: Option<RenderCheck>,
    /// The difference picture.
    pub residual: Residual<'a>,
    /// The truth map of the picture, as [`crate::truth`] writes it; `None`: none is sent.
    pub truth: Option<&'a [u8]>,
}

impl<'a> Packet<'a> {
    /// The bytes to send.
    ///
    /// # Errors
    /// If the picture size does not fit a packet, or the session is not the one that the latent part names. If a packet
    /// cannot hold the pose, or the truth map is none.
    pub fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let mut bytes = Vec::with_capacity(self.encoded_len());
        self.write(&mut bytes)?;
        Ok(bytes)
    }

    /// As [`Packet::encode`], but replaces the content of `bytes`.
    pub fn write(&self, bytes: &mut Vec<u8>) -> Result<(), PacketError> {
        bytes.clear();
        self.latent.write(&self.head(), bytes)?;
        let latent_len = bytes.len();
        if let Some(session) = &self.session {
            let (packet, found) = (self.latent.tag, session.tag()?);
            if found != packet {
                return Err(PacketError::SessionTag { packet, found });
            }
            session.write(bytes)?;
        }
        if let Some(check) = self.render {
            let part = render::encode(check, &bytes[..latent_len]);
            bytes.extend_from_slice(&part);
        }
        self.content().write(latent_len, bytes)
    }

    fn content(&self) -> Content<'_> {
        Content { residual: &self.residual, truth: self.truth }
    }

    fn head(&self) -> Head {
        let mut head = Head {
            session: self.session.is_some(),
            render: self.render.is_some(),
            confidence: Confidence::of(self.latent.uncertain, self.latent.known),
            portable: self.latent.portable,
            ..Head::new(self.latent.pose_kind(), head::Kind::None)
        };
        self.content().announce(&mut head);
        head
    }

    /// Length of all parts before the residual's, bytes.
    pub fn head_len(&self) -> usize {
        let session = self.session.map_or(0, |_| SESSION_PART_LEN);
        let render = self.render.map_or(0, |_| RENDER_PART_LEN);
        self.latent.encoded_len() + session + render
    }

    /// Length of [`Packet::encode`]'s bytes.
    pub fn encoded_len(&self) -> usize {
        self.head_len() + self.content().len()
    }

    /// Length of the longest truth map with which the packet has at most `budget` bytes.
    pub(crate) fn truth_room(&self, budget: usize) -> usize {
        self.content().truth_room(budget.saturating_sub(self.head_len()))
    }

    /// Reads a packet; all its parts must be valid.
    ///
    /// # Errors
    /// If a part is damaged, or not all of it is there. If the pose is predicted from another one.
    pub fn decode(bytes: &'a [u8]) -> Result<Packet<'a>, PacketError> {
        let parsed = Parsed::of(bytes)?;
        Ok(Packet {
            latent: *parsed.latent(),
            session: parsed.session().clone()?,
            render: parsed.render().clone()?,
            residual: parsed.residual(bytes)?,
            truth: parsed.truth(bytes),
        })
    }
}

#[cfg(test)]
mod tests;
