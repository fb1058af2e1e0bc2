//! What a vehicle knows of the poses that its topside holds.

use super::{HeldPoses, Latent, PacketError, Session};

/// After so many predicted poses one is stated, for a topside that lacks what the others are predicted from.
const STATED_EVERY: u32 = 16;

/// The poses that were sent, and those of them that the topside is known to hold.
#[derive(Debug)]
pub struct SentPoses {
    sent: HeldPoses,
    held: HeldPoses,
    /// Predicted poses since one was stated.
    since_stated: u32,
}

impl Default for SentPoses {
    fn default() -> SentPoses {
        let (sent, held) = (HeldPoses::with_room(), HeldPoses::with_room());
        SentPoses { sent, held, since_stated: 0 }
    }
}

impl SentPoses {
    /// The topside holds the pose of a frame, or does not. `frame` may be modulo 2¹⁶.
    pub fn acknowledge(&mut self, frame: u32, held: bool) {
        match held {
            true => self.held.take_from(&self.sent, frame),
            false => self.held.forget(frame),
        }
    }

    /// The latent part of a frame: with a predicted pose if the topside can read that, and it takes fewer bytes.
    /// `session`: what the frame is about.
    pub fn predicted(&self, latent: &Latent, session: &Session) -> Result<Latent, PacketError> {
        let due = self.since_stated >= STATED_EVERY;
        let session = session.check()?;
        let predicted = (!due).then(|| self.held.predict(latent, session)).flatten();
        Ok(predicted.unwrap_or(*latent))
    }

    /// A frame was sent.
    ///
    /// # Errors
    /// If the camera's size does not fit a packet.
    pub fn add(&mut self, latent: &Latent, session: &Session) -> Result<(), PacketError> {
        self.since_stated = if latent.predicted.is_some() { self.since_stated + 1 } else { 0 };
        // What the topside held of this number is another frame's.
        self.held.forget(latent.frame);
        self.sent.hold(latent.frame, latent, session)
    }

    /// The topside is not known to hold any.
    pub fn forget_acknowledged(&mut self) {
        self.held.clear();
    }
}
