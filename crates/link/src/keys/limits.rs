//! What keys are made for.

/// Bytes of a key.
pub const KEY_LEN: usize = 32;
/// Most keys that a side holds.
pub const MAX_KEYS: usize = 4;
/// First numbers lie below this: no link ever counts from there to the end of 64 bits.
pub const MAX_NUMBER: u64 = 1 << 48;
/// Bytes of a tag, unless another length is stated.
pub const DEFAULT_TAG_BYTES: usize = 4;
/// Fewest bytes of a tag.
pub const MIN_TAG_BYTES: usize = 2;
/// Most bytes of a tag.
pub const MAX_TAG_BYTES: usize = 16;
/// Bytes in front of a tag: the stream, and the low bits of the number.
pub const NUMBER_BYTES: usize = 2;
/// Bits of a number that travel.
pub const NUMBER_BITS: u32 = 14;
/// Streams that the bits above them tell.
pub const STREAMS: usize = 1 << (16 - NUMBER_BITS);
