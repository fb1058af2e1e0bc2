//! A folder that this program works in: locked, with a record of what was done in it.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use nvsprior::prior::replace_file;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// What was done in a folder: a JSON file there.
pub trait FolderRecord: Default + Serialize + DeserializeOwned {
    /// The file's name.
    const FILE: &'static str;
    /// What the folder holds, for errors.
    const KEPT: &'static str;
    /// Who may be at work in it, for errors.
    const WORKER: &'static str;
}

#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    #[error("{}: {error}", path.display())]
    File { path: PathBuf, error: std::io::Error },
    #[error("{}: holds other things than {kept}; move it, or write the prior elsewhere", path.display())]
    Foreign { path: PathBuf, kept: &'static str },
    #[error("{}: {worker} is at work in it", path.display())]
    Busy { path: PathBuf, worker: &'static str },
}

impl FolderError {
    fn file(path: &Path) -> impl Fn(std::io::Error) -> FolderError {
        move |error| FolderError::File { path: path.to_path_buf(), error }
    }
}

const LOCK: &str = "lock";

pub struct LockedFolder<R> {
    /// Absolute.
    pub path: PathBuf,
    pub record: R,
    /// The folder is locked as long as this file is open, here or in a program that was given it.
    pub lock: File,
}

impl<R: FolderRecord> LockedFolder<R> {
    /// Makes the folder, or takes up what is in it.
    pub fn open(path: &Path) -> Result<LockedFolder<R>, FolderError> {
        std::fs::create_dir_all(path).map_err(FolderError::file(path))?;
        let path = std::path::absolute(path).map_err(FolderError::file(path))?;
        // Nothing is written into a foreign folder.
        record::<R>(&path)?;
        let file = path.join(LOCK);
        let failed = FolderError::file(&file);
        let lock = File::options().create(true).append(true).open(&file).map_err(&failed)?;
        match try_for_a_moment(&lock) {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(FolderError::Busy { path, worker: R::WORKER });
            }
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        // It may have changed before the lock was had.
        let record = record(&path)?;
        Ok(LockedFolder { path, record, lock })
    }

    /// Writes the record.
    pub fn write(&self) -> Result<(), FolderError> {
        let path = self.path.join(R::FILE);
        let failed = FolderError::file(&path);
        let bytes =
            serde_json::to_vec_pretty(&self.record).map_err(|error| failed(error.into()))?;
        replace_file(&path, &bytes).map_err(|error| failed(std::io::Error::other(error)))
    }
}

/// A lock that was given up may live on for a moment, in a program that another thread is just starting: the new
/// process holds all open files until it runs that program.
fn try_for_a_moment(lock: &File) -> Result<(), TryLockError> {
    const TRIES: u32 = 20;
    for _ in 1..TRIES {
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(10)),
            tried => return tried,
        }
    }
    lock.try_lock()
}

/// The record of a folder; an empty one if the folder holds nothing but a lock.
pub fn record<R: FolderRecord>(folder: &Path) -> Result<R, FolderError> {
    let path = folder.join(R::FILE);
    let foreign = || FolderError::Foreign { path: folder.to_path_buf(), kept: R::KEPT };
    match std::fs::read(&path) {
        Ok(bytes) => serde_json::from_slice(&bytes).map_err(|_| foreign()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let entries = std::fs::read_dir(folder).map_err(FolderError::file(folder))?;
            let only_lock = entries.flatten().all(|entry| entry.file_name() == LOCK);
            if only_lock { Ok(R::default()) } else { Err(foreign()) }
        }
        Err(error) => Err(FolderError::File { path, error }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl FolderRecord for Vec<u32> {
        const FILE: &'static str = "numbers.json";
        const KEPT: &'static str = "numbers";
        const WORKER: &'static str = "another test";
    }

    #[test]
    fn records_come_back_and_foreign_folders_are_refused() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("folder");
        let open = || LockedFolder::<Vec<u32>>::open(&folder);
        let mut first = open().unwrap();
        assert!(first.record.is_empty());
        assert!(matches!(open(), Err(FolderError::Busy { .. })));
        first.record.push(3);
        first.write().unwrap();
        drop(first);
        assert_eq!(open().unwrap().record, [3]);
        let file = folder.join(Vec::FILE);
        std::fs::write(&file, "{}").unwrap();
        assert!(matches!(open(), Err(FolderError::Foreign { .. })));
        std::fs::rename(file, folder.join("notes.txt")).unwrap();
        assert!(matches!(open(), Err(FolderError::Foreign { .. })));
        std::fs::remove_file(folder.join("notes.txt")).unwrap();
        assert!(open().unwrap().record.is_empty());
    }
}
