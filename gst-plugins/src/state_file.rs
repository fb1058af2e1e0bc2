//! What an end of a link goes on with after a restart, in a file.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
#[error("property state-file: {}: {error}", file.display())]
pub struct StateFileError {
    file: PathBuf,
    error: std::io::Error,
}

/// What the file holds; nothing if there is none yet, or no file is named.
pub fn read(file: Option<&str>) -> Result<Vec<u8>, StateFileError> {
    let Some(file) = file else { return Ok(Vec::new()) };
    match std::fs::read(file) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        read => read.map_err(|error| StateFileError { file: file.into(), error }),
    }
}

/// Replaces what it holds: all of it, or nothing.
pub fn write(file: &str, state: &[u8]) -> Result<(), StateFileError> {
    let whole = |file: &Path| {
        let mut name = file.as_os_str().to_owned();
        name.push(".new");
        let mut new = std::fs::File::create(&name)?;
        new.write_all(state)?;
        new.sync_all()?;
        std::fs::rename(&name, file)
    };
    whole(file.as_ref()).map_err(|error| StateFileError { file: file.into(), error })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_come_back_and_files_that_cannot_be_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state").display().to_string();
        assert!(read(Some(&file)).unwrap().is_empty());
        for state in [&b"one"[..], b"another"] {
            write(&file, state).unwrap();
            assert_eq!(read(Some(&file)).unwrap(), state);
        }
        assert!(read(None).unwrap().is_empty());
        let text = write("/no/such/folder/state", b"").unwrap_err().to_string();
        assert!(text.contains("state-file") && text.contains("/no/such/folder/state"), "{text}");
    }
}
