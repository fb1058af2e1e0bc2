//! What was done in a work folder: `steps.json`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use nvsprior::prior::replace_file;

use super::StructureError;

/// The locked file of a work folder.
pub const LOCK: &str = "lock";

/// A step that was begun.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Begun {
    pub arguments: Vec<String>,
    /// Whether it ended well.
    pub finished: bool,
    /// How long it took.
    #[serde(default)]
    pub seconds: f64,
}

/// The steps that were begun, in their order, and of which pictures.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    pub pictures: String,
    /// All but the last are finished.
    pub steps: Vec<Begun>,
}

/// What a record says of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It was finished with the same arguments.
    Finished,
    /// It was begun with the same arguments.
    Begun,
    /// It was begun with others.
    Other,
    New,
}

impl Record {
    /// Reads the record of a folder; an empty one if the folder holds nothing but a lock.
    pub fn open(folder: &Path) -> Result<Record, StructureError> {
        let path = place(folder);
        let foreign = || StructureError::Foreign { path: folder.to_path_buf() };
        match std::fs::read(&path) {
            Ok(bytes) => serde_json::from_slice(&bytes).map_err(|_| foreign()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let entries = std::fs::read_dir(folder).map_err(StructureError::file(folder))?;
                let only_lock = entries.flatten().all(|entry| entry.file_name() == LOCK);
                if only_lock { Ok(Record::default()) } else { Err(foreign()) }
            }
            Err(error) => Err(StructureError::File { path, error }),
        }
    }

    pub fn write(&self, folder: &Path) -> Result<(), StructureError> {
        let path = place(folder);
        let failed = |error: std::io::Error| StructureError::File { path: path.clone(), error };
        let bytes = serde_json::to_vec_pretty(self).map_err(|error| failed(error.into()))?;
        replace_file(&path, &bytes).map_err(|error| failed(std::io::Error::other(error)))
    }

    pub fn standing(&self, step: usize, arguments: &[String]) -> Standing {
        match self.steps.get(step) {
            None => Standing::New,
            Some(begun) if begun.arguments != arguments => Standing::Other,
            Some(begun) if begun.finished => Standing::Finished,
            Some(_) => Standing::Begun,
        }
    }

    /// Notes that a step begins. What came after it does not count any more.
    pub fn begin(&mut self, step: usize, arguments: &[String]) {
        self.steps.truncate(step);
        self.steps.push(Begun { arguments: arguments.to_vec(), finished: false, seconds: 0.0 });
    }

    /// Notes that the last step ended well, in so much time.
    pub fn finish(&mut self, time: Duration) {
        if let Some(last) = self.steps.last_mut() {
            last.finished = true;
            last.seconds = time.as_secs_f64();
        }
    }

    /// How long a step took.
    pub fn seconds(&self, step: usize) -> f64 {
        self.steps.get(step).map_or(0.0, |step| step.seconds)
    }
}

fn place(folder: &Path) -> PathBuf {
    folder.join("steps.json")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_done_only_if_it_and_all_before_it_are() {
        let words = |text: &str| vec![text.to_owned()];
        let mut record = Record::default();
        assert_eq!(record.standing(0, &words("a")), Standing::New);
        record.begin(0, &words("a"));
        assert_eq!(record.standing(0, &words("a")), Standing::Begun);
        record.finish(Duration::from_secs(2));
        record.begin(1, &words("b"));
        record.finish(Duration::from_secs(2));
        assert_eq!(record.standing(0, &words("a")), Standing::Finished);
        assert_eq!(record.standing(1, &words("c")), Standing::Other);
        record.begin(0, &words("other"));
        assert_eq!(record.standing(0, &words("other")), Standing::Begun);
        assert_eq!(record.standing(1, &words("b")), Standing::New);
    }

    #[test]
    fn records_come_back_and_foreign_folders_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Record::open(folder.path()).unwrap(), Record::default());
        std::fs::write(folder.path().join(LOCK), "").unwrap();
        assert_eq!(Record::open(folder.path()).unwrap(), Record::default());
        let mut record = Record { pictures: "3 pictures".into(), ..Record::default() };
        record.begin(0, &["a".into()]);
        record.write(folder.path()).unwrap();
        assert_eq!(Record::open(folder.path()).unwrap(), record);
        std::fs::write(place(folder.path()), "{}").unwrap();
        let error = Record::open(folder.path()).unwrap_err();
        assert!(matches!(error, StructureError::Foreign { .. }), "{error}");
        std::fs::rename(place(folder.path()), folder.path().join("notes.txt")).unwrap();
        let error = Record::open(folder.path()).unwrap_err();
        assert!(matches!(error, StructureError::Foreign { .. }), "{error}");
    }
}
