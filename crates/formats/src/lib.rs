//! Trained scenes in the formats of other programs, as priors: SPZ, binary glTF, PlayCanvas's SOG and compressed PLY.
//!
//! [`open`], [`from_file`] and [`from_bytes`] read what [`Prior`]'s functions of these names read, and these formats.
//! `nvsprior import` makes a file of ours of them, which then holds all that belongs to the prior.

mod compressed_ply;
#[cfg(test)]
mod fields;
mod gltf;
mod sh_rotation;
mod sog;
mod spz;

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use nvsprior::prior::{PriorError, PriorFile};
use nvsprior::{Prior, RenderOverrides};

type Reader = fn(&[u8]) -> Result<PriorFile, PriorError>;

/// How files of each format start, and what reads them.
const FORMATS: [(&[u8], Reader); 4] = [
    (spz::MAGICS[0], spz::read),
    (spz::MAGICS[1], spz::read),
    (gltf::MAGIC, gltf::read),
    (sog::MAGIC, sog::read),
];

/// What reads files that start so, unless it is the library.
fn reader_of(start: &[u8]) -> Option<Reader> {
    let format = FORMATS.iter().find(|(magic, _)| start.starts_with(magic));
    format.map(|(_, reader)| *reader)
}

/// What a file holds; `None`: it is of no format that this crate adds.
fn read(bytes: &[u8]) -> Option<Result<PriorFile, PriorError>> {
    match reader_of(bytes) {
        Some(reader) => Some(reader(bytes)),
        None => compressed_ply::read(bytes),
    }
}

/// As [`Prior::open`].
pub fn open(path: &Path, overrides: &RenderOverrides) -> Result<Prior, PriorError> {
    from_file(path, read_file(path)?, overrides)
}

/// As [`Prior::read_file`].
pub fn read_file(path: &Path) -> Result<Vec<u8>, PriorError> {
    let mut start = Vec::new();
    let first = |file: File| file.take(LONGEST_MAGIC).read_to_end(&mut start);
    match File::open(path).and_then(first).is_ok() && reader_of(&start).is_some() {
        true => fs::read(path).map_err(|error| named(path, PriorError::Read(error))),
        // It names what is wrong with the file, too.
        false => Prior::read_file(path),
    }
}

/// Longest start of a file that tells its format, bytes.
const LONGEST_MAGIC: u64 = 4;

/// As [`Prior::from_file`].
pub fn from_file(
    path: &Path,
    bytes: Vec<u8>,
    overrides: &RenderOverrides,
) -> Result<Prior, PriorError> {
    match read(&bytes) {
        Some(file) => {
            drop(bytes);
            Prior::from_file_content(path, file.map_err(|error| named(path, error))?, overrides)
        }
        None => Prior::from_file(path, bytes, overrides),
    }
}

/// As [`Prior::from_bytes`].
pub fn from_bytes(
    bytes: &[u8],
    name: &str,
    overrides: &RenderOverrides,
) -> Result<Prior, PriorError> {
    match read(bytes) {
        Some(file) => {
            Prior::from_content(file.map_err(|error| error.in_file(name))?, name, overrides)
        }
        None => Prior::from_bytes(bytes, name, overrides),
    }
}

fn named(path: &Path, error: PriorError) -> PriorError {
    error.in_file(&path.display().to_string())
}
