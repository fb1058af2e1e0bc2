//! What loading a prior found.

use std::fmt;

use super::check::Dropped;

/// Where a prior's splats came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PriorFormat {
    /// Handed over in memory.
    Memory,
    /// A PLY file in text.
    PlyAscii,
    /// A binary PLY file, little endian.
    PlyLittleEndian,
    /// A binary PLY file, big endian.
    PlyBigEndian,
    /// A compact prior.
    Compact,
    /// A prior in blocks.
    Blocked,
    /// A PLY file packed by PlayCanvas's tools.
    #[cfg(feature = "formats")]
    PlyCompressed,
    /// A scene in Niantic's format, of this version.
    #[cfg(feature = "formats")]
    Spz(u32),
    /// A binary glTF file.
    #[cfg(feature = "formats")]
    Gltf,
    /// A scene in PlayCanvas's format SOG.
    #[cfg(feature = "formats")]
    Sog,
}

impl PriorFormat {
    /// Whether it is one of our own, whose files hold all that belongs to a prior.
    pub fn is_own(self) -> bool {
        matches!(self, PriorFormat::Compact | PriorFormat::Blocked)
    }
}

impl fmt::Display for PriorFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PriorFormat::Memory => "memory",
            PriorFormat::PlyAscii => "PLY, ascii",
            PriorFormat::PlyLittleEndian => "PLY, binary little endian",
            PriorFormat::PlyBigEndian => "PLY, binary big endian",
            PriorFormat::Compact => "compact prior",
            PriorFormat::Blocked => "blocked prior",
            #[cfg(feature = "formats")]
            PriorFormat::PlyCompressed => "PLY, compressed",
            #[cfg(feature = "formats")]
            PriorFormat::Spz(version) => return write!(f, "SPZ, version {version}"),
            #[cfg(feature = "formats")]
            PriorFormat::Gltf => "glTF, binary",
            #[cfg(feature = "formats")]
            PriorFormat::Sog => "SOG, version 2",
        })
    }
}

/// What loading a prior found.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadReport {
    /// Container the splats came in.
    pub format: PriorFormat,
    /// Splats in the file.
    pub read: usize,
    /// Splats kept.
    pub kept: usize,
    /// Splats left out, by reason; empty if all were valid.
    pub dropped: Vec<Dropped>,
    /// Splats whose opacity logit was infinite, and became ±[`INFINITE_LOGIT`](super::INFINITE_LOGIT).
    pub clamped_logits: usize,
    /// Comments in the file's header, unchanged, without those that are key frames.
    pub comments: Vec<String>,
}
