//! The forms of a latent part, and their lengths.

use super::pose::{PoseProfile, SHORT_LEN};

/// Bytes of the full form that are not the pose.
pub(super) const FIXED_LEN: usize = 15;
/// Bytes of the short form.
pub(super) const SHORT_LATENT_LEN: usize = 7 + SHORT_LEN;
/// Bytes of the short form of a frame that is drawn with updates.
pub(super) const LEARNT_SHORT_LEN: usize = SHORT_LATENT_LEN + 1;
/// Frame numbers are sent modulo this.
pub(super) const FRAMES: u32 = 1 << 24;
/// In the short form, and if the frame is drawn with updates, modulo this.
pub(super) const SHORT_FRAMES: u32 = 1 << 16;

/// In the predicted form, modulo this.
pub(super) const PREDICTED_FRAMES: u32 = 1 << 7;

/// Bit of the second byte in the predicted form: the packet ends where its bytes end.
pub(super) const WHOLE: u8 = 1 << 7;

/// What the first two bytes say of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Form {
    /// The profile of the full form; `None`: the short form.
    pub full: Option<PoseProfile>,
    /// The frame is drawn with updates.
    pub learnt: bool,
    /// Length of the part in the predicted form, bytes; `None`: it has another one.
    pub predicted: Option<usize>,
}

impl Form {
    /// Length of the part, bytes.
    pub(super) fn latent_len(self) -> usize {
        if let Some(len) = self.predicted {
            return len;
        }
        match (self.full, self.learnt) {
            (Some(profile), _) => FIXED_LEN + profile.encoded_len(),
            (None, false) => SHORT_LATENT_LEN,
            (None, true) => LEARNT_SHORT_LEN,
        }
    }

    /// Frame numbers are sent modulo this.
    pub(super) fn frames(self) -> u32 {
        match self.predicted {
            Some(_) => PREDICTED_FRAMES,
            None if self.full.is_some() && !self.learnt => FRAMES,
            None => SHORT_FRAMES,
        }
    }
}

/// Which parts come after the latent part.
pub(super) struct Follows {
    pub(super) camera: bool,
    pub(super) render: bool,
    pub(super) residual: u8,
}
