//! What a console keeps to go on after a restart within the same dive. Nothing of a key is in it.

use std::path::PathBuf;

use anyhow::Context;
use nvsprior::Camera;
use nvsprior::prior::replace_file;
use nvsprior_link::Region;
use serde::{Deserialize, Serialize};

/// Seconds after which it is another dive.
const DIVE: f64 = 600.0;
/// Seconds between two writings if nothing has changed: what is kept grows old else.
const EVERY: f64 = 30.0;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResumeState {
    /// When the vehicle was heard last, UTC.
    pub time: f64,
    /// The prior's identity, and which key.
    pub prior: String,
    pub key: Option<String>,
    /// The vehicle's.
    pub camera: Option<Camera>,
    pub region: Option<Region>,
    pub is_recording: bool,
}

/// Writes it, if it can.
pub struct Resume {
    path: PathBuf,
    written: Option<ResumeState>,
    has_failed: bool,
}

impl Resume {
    pub fn new(folder: &std::path::Path) -> Resume {
        Resume { path: folder.join("console.resume"), written: None, has_failed: false }
    }

    /// What was kept within this dive, of the same prior and key.
    pub fn read(&self, now: f64, prior: &str, key: Option<&str>) -> Option<ResumeState> {
        let kept: ResumeState = serde_json::from_slice(&std::fs::read(&self.path).ok()?).ok()?;
        let is_same = kept.prior == prior && kept.key.as_deref() == key;
        (is_same && (0.0..DIVE).contains(&(now - kept.time))).then_some(kept)
    }

    /// Writes what is another than before.
    ///
    /// # Errors
    /// If it cannot be written: once, until it can be again.
    pub fn keep(&mut self, kept: ResumeState) -> anyhow::Result<()> {
        let is_known = self.written.as_ref().is_some_and(|written| {
            ResumeState { time: written.time, ..kept.clone() } == *written
                && kept.time - written.time < EVERY
        });
        if is_known {
            return Ok(());
        }
        let text = serde_json::to_vec(&kept)?;
        self.written = Some(kept);
        let done = self.write(&text);
        let had_failed = std::mem::replace(&mut self.has_failed, done.is_err());
        done.or_else(|error| if had_failed { Ok(()) } else { Err(error) })
    }

    fn write(&self, text: &[u8]) -> anyhow::Result<()> {
        let keeping = || format!("{}: a restart will begin anew", self.path.display());
        let folder = self.path.parent().unwrap_or(&self.path);
        std::fs::create_dir_all(folder).with_context(keeping)?;
        replace_file(&self.path, text).with_context(keeping)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_of_the_same_dive_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut resume = Resume::new(&folder.path().join("kept"));
        let region = Region::new([0.0, 0.0, 0.5, 0.5], 3);
        let key = Some("the key in a.key, epoch 1".to_owned());
        let kept = ResumeState {
            time: 1e9,
            prior: "12345678".into(),
            key: key.clone(),
            camera: None,
            region,
            is_recording: true,
        };
        resume.keep(kept.clone()).unwrap();
        let read = |now, prior, key: Option<&str>| resume.read(now, prior, key);
        assert_eq!(read(1e9 + 60.0, "12345678", key.as_deref()), Some(kept.clone()));
        for now in [1e9 - 1.0, 1e9 + 3600.0] {
            assert_eq!(read(now, "12345678", key.as_deref()), None, "another dive");
        }
        assert_eq!(read(1e9, "87654321", key.as_deref()), None, "another prior");
        assert_eq!(read(1e9, "12345678", None), None, "without the key");
        std::fs::write(&resume.path, b"{\"time\":1e9").unwrap();
        assert_eq!(resume.read(1e9, "12345678", key.as_deref()), None, "half a file");
        resume.keep(ResumeState { time: 1e9 + 1.0, ..kept.clone() }).unwrap();
        assert_eq!(std::fs::read(&resume.path).unwrap().len(), 11, "nothing has changed");
        resume.keep(ResumeState { is_recording: false, ..kept.clone() }).unwrap();
        assert!(std::fs::read(&resume.path).unwrap().len() > 50);
        // A disk that fails is told once.
        std::fs::remove_dir_all(folder.path().join("kept")).unwrap();
        std::fs::write(folder.path().join("kept"), "no folder").unwrap();
        let later = |seconds: f64| ResumeState { time: kept.time + seconds, ..kept.clone() };
        assert!(resume.keep(later(60.0)).is_err());
        assert!(resume.keep(later(120.0)).is_ok());
    }
}
