//! What modem frames are made for.

/// The smallest MTU, bytes: that of the smallest modems.
pub const MIN_MTU: usize = 8;
/// The smallest MTU of modem frames with a check of their own, and of protected shares, bytes.
pub const MIN_CHECKED_MTU: usize = 16;
/// The largest MTU, bytes.
pub const MAX_MTU: usize = 65_535;
/// Most shares of a protected packet.
pub const MAX_SHARES: usize = 256;
/// Most shares of an unprotected packet: their indices have eleven bits.
pub const MAX_UNPROTECTED: usize = 2048;
/// The same of small modem frames, whose indices have three.
pub const MAX_SMALL: usize = 8;
/// Streams on one link.
pub const STREAMS: u8 = 4;
/// Shares name their packet by its frame number modulo this.
pub const NUMBERS: u32 = 256;
/// Small shares by how many packets went before it, modulo this.
pub const SMALL_NUMBERS: u32 = 8;
