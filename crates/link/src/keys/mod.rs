//! Keys against strangers: tags by which a side knows that a modem frame or a packet is the other side's.
//!
//! Both sides hold a [`Key`]. What is sent gets a number and a tag in front, which [`Authenticator`] makes, and
//! [`Verifier`] checks them before anything else is read: it refuses what was made without the key, and what came
//! before. The bytes: `docs/format/modem.md`. What that promises and what not: `docs/security.md`.
//!
//! The tag is BLAKE3 with a key, cut to [`Keys::tag_bytes`]. It covers the content, its kind, its stream, its number
//! and the epoch. A side counts numbers on for as long as an epoch lasts. Of a number fourteen bits travel; the epoch
//! does not. State another epoch on both sides for each dive, and nothing of an earlier one passes.
//!
//! Nothing here allocates once it is made.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use nvsprior_link::keys::{Authenticator, Content, Keys, Verifier};
//! let keys = Keys::parse("000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f")?.with_epoch(7);
//! let mut vehicle = Authenticator::new(&keys, Content::Frame);
//! let mut topside = Verifier::new(&keys, Content::Frame);
//! let mut frame = Vec::new();
//! vehicle.write(0, b"a modem frame", &mut frame);
//! assert_eq!(topside.verify(&frame)?.content, b"a modem frame");
//! assert!(topside.verify(&frame).is_err(), "it came before");
//! # Ok(()) }
//! ```

mod authenticator;
mod error;
mod key;
mod key_set;
mod limits;
mod tag;
mod verifier;
mod window;

pub use authenticator::Authenticator;
pub use error::{KeyError, Refusal};
pub use key::{Key, KeyId};
pub use key_set::{Keys, Seen};
pub use limits::{DEFAULT_TAG_BYTES, MAX_KEYS, MAX_TAG_BYTES, MIN_TAG_BYTES};
pub use tag::Content;
pub use verifier::{Verified, Verifier};
