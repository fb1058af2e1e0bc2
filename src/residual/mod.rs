//! The residual: what the camera saw and the render did not, as a coded difference picture.
//!
//! It is always the difference from the 8-bit picture that the decoder will render. Its quality is
//! always measured on the 8-bit picture that the decoder will show.

mod checks;
mod decoder;
mod difference;
#[cfg(feature = "encode")]
mod encoder;
mod error;
mod interest;
mod rate;
mod references;
mod stream;
mod tune;
mod warp;
pub mod wavelet;

use crate::packet::{LONGEST_HEAD, Reference, residual_part_len};

pub use decoder::ResidualDecoder;
pub use difference::{add, difference};
#[cfg(feature = "encode")]
pub use encoder::{CodedResidual, InStream, ResidualEncoder, ResidualSetup};
pub use error::ResidualError;
pub use interest::Interest;
pub use rate::Rate;
pub use references::REFERENCES;
pub use stream::{Acknowledged, Mode, StreamFrame, Structure};
pub use tune::Tune;
pub use warp::{Placement, Viewpoint, warp};

/// Longest payload of a difference picture of a size, by any coder, bytes: libwebp's on noise at quality 100, with room
/// (see the tests of `webp`).
pub fn max_payload_len(width: u32, height: u32) -> usize {
    3 * (width as usize).next_multiple_of(16) * (height as usize).next_multiple_of(16) + 1024
}

/// The largest packet about a picture of this size, with all its parts, bytes.
pub fn packet_bound(width: u32, height: u32) -> usize {
    // A truth map takes 8 % of a packet at most.
    let residual = residual_part_len(Reference::LEN + max_payload_len(width, height));
    LONGEST_HEAD + residual + residual / 8
}
