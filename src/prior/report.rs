//! What loading a prior found.

use std::fmt;

use super::check::Dropped;
use super::warning::PriorWarning;

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
    /// A format that another reader knows: its name, and the version if it has several.
    Foreign(&'static str, Option<u32>),
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
            PriorFormat::Foreign(name, Some(version)) => {
                return write!(f, "{name}, version {version}");
            }
            PriorFormat::Foreign(name, None) => name,
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
    /// What was left out or understood in another way than the file may mean it.
    pub warnings: Vec<PriorWarning>,
    /// Comments in the file's header, unchanged, without those that are key frames.
    pub comments: Vec<String>,
}

impl LoadReport {
    /// What a user should be told: splats that were dropped, and warnings.
    pub fn notes(&self) -> impl Iterator<Item = String> {
        let dropped = self.dropped.iter().map(Dropped::to_string);
        dropped.chain(self.warnings.iter().map(PriorWarning::to_string))
    }
}
