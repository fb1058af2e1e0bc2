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

/// Reads a file's content. The first bytes tell the format.
pub(super) fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    // What is of no format is refused as a PLY file is.
    reader_of(bytes).unwrap_or(ply::read_ply)(bytes)
}

/// Longest start of a file that tells its format, bytes.
const LONGEST_MAGIC: u64 = 4;

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
