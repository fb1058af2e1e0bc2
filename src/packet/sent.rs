//! What a vehicle knows of the poses that its topside holds.

use super::{HeldPoses, Latent};

/// After so many predicted poses one is stated, for a topside that lacks what the others are predicted from.
const STATED_EVERY: u32 = 16;

/// The poses that were sent, and those of them that the topside is known to hold.
#[derive(Debug)]
pub(crate) struct SentPoses {
    sent: HeldPoses,
    held: HeldPoses,
    /// Predicted poses since one was stated.
    since_stated: u32,
}

impl SentPoses {
    pub fn new() -> SentPoses {
        let (sent, held) = (HeldPoses::with_room(), HeldPoses::with_room());
        SentPoses { sent, held, since_stated: 0 }
    }

    /// The topside holds the pose of a frame, or does not. `frame` may be modulo 2¹⁶.
    pub fn acknowledge(&mut self, frame: u32, held: bool) {
        match held {
            true => self.held.take_from(&self.sent, frame),
            false => self.held.forget(frame),
        }
    }

    /// The latent part of a frame: in the predicted form if the topside can read that, and it takes fewer bytes.
    /// `session`: its [`session_check`](super::session_check).
    pub fn predicted(&self, frame: u32, latent: &Latent, session: u32) -> Latent {
        let due = self.since_stated >= STATED_EVERY;
        let predicted = || self.held.predict(frame, latent, session);
        (!due).then(predicted).flatten().unwrap_or(*latent)
    }

    /// A frame was sent.
    pub fn add(&mut self, frame: u32, latent: &Latent, session: u32) {
        self.since_stated = if latent.is_predicted() { self.since_stated + 1 } else { 0 };
        // What the topside held of this number is another frame's.
        self.held.forget(frame);
        self.sent.hold(frame, latent, session);
    }

    /// The topside is not known to hold any.
    pub fn forget_acknowledged(&mut self) {
        self.held.clear();
    }
}
