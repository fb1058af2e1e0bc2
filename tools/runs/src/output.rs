//! Files and folders that are written to, tried before any work.

use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("{option} {}: this is a file; give a folder", path.display())]
    File { option: &'static str, path: PathBuf },
    #[error("{option} {}: this is a folder; give a file", path.display())]
    Folder { option: &'static str, path: PathBuf },
    #[error("{option} {}: cannot be written: {error}", path.display())]
    Write { option: &'static str, path: PathBuf, error: std::io::Error },
}

/// Makes a folder to write to, with those above it.
pub fn make_folder(option: &'static str, path: &Path) -> Result<(), OutputError> {
    let path = path.to_path_buf();
    if path.exists() && !path.is_dir() {
        return Err(OutputError::File { option, path });
    }
    std::fs::create_dir_all(&path).map_err(|error| OutputError::Write { option, path, error })
}

/// Finds out whether a file can be written, and leaves what is there as it is.
pub fn check_file(option: &'static str, path: &Path) -> Result<(), OutputError> {
    if path.is_dir() {
        return Err(OutputError::Folder { option, path: path.to_path_buf() });
    }
    let there = path.exists();
    let opened = std::fs::OpenOptions::new().create(true).append(true).open(path).map(drop);
    let tried = opened.and_then(|()| if there { Ok(()) } else { std::fs::remove_file(path) });
    tried.map_err(|error| OutputError::Write { option, path: path.to_path_buf(), error })
}
