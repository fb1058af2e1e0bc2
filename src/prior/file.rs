//! Reading a prior's file, of any format.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::error::PriorError;
use super::file_content::PriorFile;
use super::{blocked, compact, ply};

type Reader = fn(&[u8]) -> Result<PriorFile, PriorError>;

/// How files of each format start, and what reads them.
const FORMATS: &[(&[u8], Reader)] = &[
    (ply::MAGIC, ply::read_ply),
    (ply::MARKED_MAGIC, ply::read_ply),
    (compact::MAGIC, compact::read),
    (&blocked::MAGIC, blocked::read),
];

/// What reads files that start so.
fn reader_of(start: &[u8]) -> Option<Reader> {
    let format = FORMATS.iter().find(|(magic, _)| start.starts_with(magic));
    format.map(|(_, reader)| *reader)
}

/// What people give for a scene, how it starts, and what to do.
const FOREIGNERS: [(&[u8], &str); 5] = [
    (
        b"version https://git-lfs",
        "a pointer of Git LFS, not the scene itself: `git lfs pull` fetches it",
    ),
    (b"<!do", "a web page: the download gave no scene"),
    (b"<htm", "a web page: the download gave no scene"),
    (b"<?xm", "XML, not a scene"),
    (b"PK\x03\x04", "a ZIP archive: unpack it; of a .sog `nvsprior import` makes a prior"),
];

/// Scenes of which the ending alone tells the kind.
const ENDINGS: [(&str, &str); 2] = [
    (
        "splat",
        "a .splat, which has neither spherical harmonics nor render options: export the scene as .ply",
    ),
    ("ksplat", "a .ksplat, which is not read: export the scene as .ply"),
];

/// Why a file of no known format is refused.
fn unknown(start: &[u8]) -> PriorError {
    let is = |(magic, _): &&(&[u8], &str)| {
        start.get(..magic.len()).is_some_and(|own| own.eq_ignore_ascii_case(magic))
    };
    FOREIGNERS
        .iter()
        .find(is)
        .map_or(PriorError::UnknownFormat, |(_, what)| PriorError::Foreigner(what))
}

/// A refusal with what the file's name tells.
pub(super) fn refusal(error: PriorError, path: &Path) -> PriorError {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    let known = ENDINGS.iter().find(|(own, _)| own.eq_ignore_ascii_case(ending));
    match (error, known) {
        (PriorError::UnknownFormat, Some((_, what))) => PriorError::Foreigner(what),
        (error, _) => error,
    }
}

/// Reads a file's content. The first bytes tell the format.
pub(super) fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    reader_of(bytes).ok_or_else(|| unknown(bytes))?(bytes)
}

/// Longest start of a file that tells what it is, bytes.
const LONGEST_MAGIC: u64 = 23;

/// Reads the file. If its first bytes show another format, reads no further, so that a wrong path
/// (a device, a video) costs neither time nor memory.
pub(super) fn read_prior_file(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    (&mut file).take(LONGEST_MAGIC).read_to_end(&mut bytes)?;
    if reader_of(&bytes).is_some() {
        file.read_to_end(&mut bytes)?;
    }
    Ok(bytes)
}
