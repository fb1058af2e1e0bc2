//! Scene coder tables: what the wavelet coder has learned about the prior's scene.
//!
//! They travel with the prior: in a compact prior, or in a file beside a prior of any format. They are part of its
//! identity, since with other tables the same packet gives another picture.

use std::path::{Path, PathBuf};

use super::beside;
use super::error::PriorError;
use super::replace::replace_file;
use crate::coder_tables::{Tables, TablesError};

/// What errors call them.
const FORMAT: &str = "coder tables";

/// The file of tables beside a prior's file: `prior.ply.tables` beside `prior.ply`.
pub fn path_beside(prior: &Path) -> PathBuf {
    beside::path(prior, "tables")
}

/// Reads a file of tables. Errors name it.
pub fn open(path: &Path) -> Result<Tables, PriorError> {
    let read = || {
        let max = Tables::encoded_len() as u64;
        let bytes = beside::read(path, max, FORMAT)?;
        Tables::read(&bytes).map_err(|error| refusal(FORMAT, 0, &error))
    };
    read().map_err(|error| error.in_file(&path.display().to_string()))
}

/// Reads the tables in the file beside a prior's; `None` if there is no such file.
pub fn open_beside(prior: &Path) -> Result<Option<Tables>, PriorError> {
    let path = path_beside(prior);
    if beside::is_absent(&path) { Ok(None) } else { open(&path).map(Some) }
}

/// Writes a file of tables, which is there whole or not at all.
pub fn save(tables: &Tables, path: &Path) -> Result<(), PriorError> {
    replace_file(path, &tables.write())
}

/// Why bytes that begin at byte `at` of a file are no tables.
pub(super) fn refusal(format: &'static str, at: usize, error: &TablesError) -> PriorError {
    let within = match *error {
        TablesError::Magic => 0,
        TablesError::Length { expected, found } => expected.min(found),
    };
    PriorError::Field { format, offset: (at + within) as u64, reason: error.to_string() }
}

#[cfg(test)]
pub(crate) mod tests;
