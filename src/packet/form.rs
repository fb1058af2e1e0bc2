//! The two forms of a latent part, and their lengths.

use super::pose::{PoseProfile, SHORT_LEN};

/// Bytes of the full form that are not the pose.
pub(super) const FIXED_LEN: usize = 15;
/// Bytes of the short form.
pub(super) const SHORT_LATENT_LEN: usize = 7 + SHORT_LEN;
/// Frame numbers are sent modulo this.
pub(super) const FRAMES: u32 = 1 << 24;
/// In the short form, modulo this.
pub(super) const SHORT_FRAMES: u32 = 1 << 16;

/// What the first two bytes say of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Full(PoseProfile),
    Short,
}

impl Form {
    /// Length of the part, bytes.
    pub(super) fn latent_len(self) -> usize {
        match self {
            Form::Full(profile) => FIXED_LEN + profile.encoded_len(),
            Form::Short => SHORT_LATENT_LEN,
        }
    }

    /// Frame numbers are sent modulo this.
    pub(super) fn frames(self) -> u32 {
        match self {
            Form::Full(_) => FRAMES,
            Form::Short => SHORT_FRAMES,
        }
    }
}
