//! The most that a prior may hold.

/// Splats: what a 32-bit index reaches.
pub const MAX_SPLATS: usize = u32::MAX as usize;
/// Degree of spherical harmonics.
pub const MAX_SH_DEGREE: u32 = 3;
/// Key frames.
pub const MAX_KEY_FRAMES: usize = 65_536;
