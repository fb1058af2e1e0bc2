//! What a side with keys stores, so that it can start again within an epoch: a file beside the key file.

use std::io;
use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::prior::{PriorError, replace_file};
use nvsprior_inputs::values::WrongUsage;
use nvsprior_link::LinkError;

/// Who of a link's two sides stores it: both may use one key file.
#[derive(Clone, Copy)]
pub enum Side {
    Vehicle,
    Topside,
}

pub struct StateFile {
    path: PathBuf,
}

impl StateFile {
    /// What this side has stored before; empty: nothing.
    pub fn open(key: &Path, side: Side) -> anyhow::Result<(Vec<u8>, StateFile)> {
        let path = key.with_added_extension(match side {
            Side::Vehicle => "vehicle",
            Side::Topside => "topside",
        });
        let state = match std::fs::read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            read => read.with_context(|| path.display().to_string())?,
        };
        Ok((state, StateFile { path }))
    }

    /// Stores a state in place of the one before.
    pub fn write(&self, state: &[u8]) -> Result<(), PriorError> {
        replace_file(&self.path, state)
    }
}

/// Names the file if an end cannot be made for its sake. Else its options are wrong.
pub fn check<T>(made: Result<T, LinkError>, file: &StateFile) -> anyhow::Result<()> {
    match made {
        Ok(_) => Ok(()),
        Err(error @ (LinkError::State { .. } | LinkError::Epoch { .. })) => {
            Err(anyhow::Error::new(error).context(file.path.display().to_string()))
        }
        Err(error) => Err(WrongUsage(error.to_string()).into()),
    }
}
