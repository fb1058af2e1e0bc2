//! The paper's system as it stands: its search by BFGS or Adam, its WebP on the difference picture, its pose of 28
//! bytes.
//!
//! It is here to be compared with, not to be used at sea: it follows no lost camera, knows no masks and no streams, and
//! makes packets of its own, which nothing else reads. The renders, and the error with its derivatives, are the
//! engine's.
//!
//! - [`Encoder`] and [`Decoder`]: the whole system, in two processes if you like.
//! - [`minimise`]: a search alone, on the engine's [`Objective`].
//! - [`Webp`], [`WebpEncoder`]: libwebp in memory lent to it, and at a rate.

#![deny(unsafe_code)]

mod decoder;
mod descent;
mod encoder;
mod error;
#[allow(unsafe_code)] // It wraps a C codec; each block says why it is sound.
mod libwebp;
mod packet;
mod webp;

#[cfg(doc)]
use nvsprior::tracking::Objective;

pub use decoder::Decoder;
pub use descent::{AdamOptions, BfgsOptions, DescentOptions, Optimizer, minimise};
pub use encoder::{Encoder, EncoderOptions};
pub use error::{Error, WebpError};
pub use packet::{HEAD_LEN, POSE_LEN, SESSION_LEN};
pub use webp::{Coded, Payload, Webp, WebpEncoder};
