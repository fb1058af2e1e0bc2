//! Libwebp, which works in memory lent to it: no call allocates once its arena is made.

mod decode;
mod encode;
mod memory;

pub use decode::{decode_rgb, features};
pub use encode::{Lossy, encode_rgb};
pub use memory::Arena;
