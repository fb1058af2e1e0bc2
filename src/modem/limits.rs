//! What modem frames are made for.

/// The smallest MTU of unprotected packets, bytes: that of the smallest modems, and the compact latent part's length.
pub const MIN_MTU: usize = 31;
/// The smallest MTU of protected shares, bytes.
pub const MIN_SHARE_MTU: usize = 16;
/// The largest MTU, bytes.
pub const MAX_MTU: usize = 65_535;
/// Most shares of a protected packet.
pub const MAX_SHARES: usize = 256;
/// Most shares of an unprotected packet: their indices have twelve bits.
pub const MAX_UNPROTECTED: usize = 4096;
/// Streams on one link.
pub const STREAMS: u8 = 4;
/// Shares name their packet by its frame number modulo this.
pub const NUMBERS: u32 = 128;
/// Pieces that yield an update, at most.
pub const MAX_SOURCES: usize = 224;
/// Pieces of an update, all different.
pub const MAX_PIECES: usize = 256;
