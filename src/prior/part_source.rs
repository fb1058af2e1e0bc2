//! Where a prior's parts came from.

use std::fmt;

/// Where a prior's key frames, or its coder tables, came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PartSource {
    /// There are none.
    #[default]
    None,
    /// The prior's own file.
    InFile,
    /// A file beside it: `NAME.EXT.keys`, `NAME.EXT.tables`.
    Beside,
    /// Handed over in memory.
    Memory,
}

impl PartSource {
    /// The source of a part in the prior's own file, if it is there.
    pub(super) fn in_file(there: bool) -> PartSource {
        if there { PartSource::InFile } else { PartSource::None }
    }
}

impl fmt::Display for PartSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PartSource::None => "none",
            PartSource::InFile => "in the file",
            PartSource::Beside => "in the file beside it",
            PartSource::Memory => "from memory",
        })
    }
}
