//! Files beside a prior's: `prior.ply.keys` beside `prior.ply`.

use std::fs::{self, File};
use std::io::{Error, ErrorKind, Read};
use std::path::{Path, PathBuf};

use super::error::PriorError;

/// The path of a prior's file with an ending added.
pub fn path(prior: &Path, ending: &str) -> PathBuf {
    prior.with_added_extension(ending)
}

/// Whether there is no such file.
pub fn is_absent(path: &Path) -> bool {
    fs::metadata(path).is_err_and(|error| {
        // If a name is too long for a file, there is no such file.
        matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidFilename)
    })
}

/// Reads a file. Refuses more than `max` bytes, and devices and pipes. `what` says in errors what the file should
/// hold.
pub fn read(path: &Path, max: u64, what: &str) -> Result<Vec<u8>, PriorError> {
    let refuse = |text: String| PriorError::Read(Error::other(text));
    if !fs::metadata(path).map_err(PriorError::Read)?.is_file() {
        return Err(refuse(format!("no file of {what}")));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(PriorError::Read)?;
    file.take(max + 1).read_to_end(&mut bytes).map_err(PriorError::Read)?;
    if bytes.len() as u64 > max {
        return Err(refuse(format!("too long for a file of {what}")));
    }
    Ok(bytes)
}
