//! Snapshots and recordings on disk.

use std::fs::File;
use std::io::{BufWriter, Error, Write};
use std::path::PathBuf;

use nvsprior::prior::replace_file;

use super::state::RecordingState;
use super::{disk, recording};
use crate::journal;

/// Writes to a folder, which is made with the first file.
pub struct Keeper {
    folder: PathBuf,
    recording: Option<Recording>,
}

struct Recording {
    path: PathBuf,
    file: BufWriter<File>,
    began: f64,
    frames: u64,
    bytes: u64,
}

impl Recording {
    /// Begins a file. If it cannot be written, there is none.
    fn begin(path: PathBuf, began: f64) -> std::io::Result<Recording> {
        let mut file = BufWriter::new(File::create_new(&path)?);
        let written = recording::write_head(&mut file).and_then(|()| file.flush());
        written.inspect_err(|_| _ = std::fs::remove_file(&path))?;
        Ok(Recording { path, file, began, frames: 0, bytes: 0 })
    }
}

impl Keeper {
    pub fn new(folder: PathBuf) -> Keeper {
        Keeper { folder, recording: None }
    }

    /// Bytes that the disk has room for; `None`: the system does not tell.
    pub fn free(&self) -> Option<u64> {
        disk::free(&self.folder)
    }

    /// A file that is not there yet, named by the time.
    fn file(&self, now: f64, ending: &str) -> std::io::Result<PathBuf> {
        std::fs::create_dir_all(&self.folder)?;
        let name = journal::written(now).replace(':', "-");
        Ok(self.folder.join(format!("{name}.{ending}")))
    }

    /// Keeps a picture, and what was known of it, both or none. Returns the picture's file.
    pub fn snapshot(&self, now: f64, png: &[u8], state: &str) -> std::io::Result<PathBuf> {
        let path = self.file(now, "png")?;
        let known = path.with_extension("json");
        let known_written = replace_file(&known, state.as_bytes());
        known_written.and_then(|()| replace_file(&path, png)).map_err(|error| {
            let _ = std::fs::remove_file(&known);
            Error::other(error)
        })?;
        Ok(path)
    }

    /// Begins a recording, or ends it. Returns its file.
    pub fn record(&mut self, now: f64, on: bool) -> std::io::Result<Option<PathBuf>> {
        match (self.recording.take(), on) {
            (Some(running), true) => self.recording = Some(running),
            (Some(mut ended), false) => {
                ended.file.flush()?;
                return Ok(Some(ended.path));
            }
            (None, false) => {}
            (None, true) => {
                self.recording = Some(Recording::begin(self.file(now, "nvsr")?, now)?);
            }
        }
        Ok(self.recording.as_ref().map(|recording| recording.path.clone()))
    }

    /// Records a modem frame, if a recording runs. It ends with a failure.
    pub fn keep(&mut self, time: f64, bytes: &[u8]) -> std::io::Result<()> {
        let Some(running) = &mut self.recording else { return Ok(()) };
        let kept = recording::write_frame(&mut running.file, time, bytes);
        running.frames += 1;
        running.bytes += (recording::HEAD + bytes.len()) as u64;
        self.end_if_failed(kept)
    }

    /// Has what was recorded on disk.
    pub fn flush(&mut self) -> std::io::Result<()> {
        let Some(running) = &mut self.recording else { return Ok(()) };
        let flushed = running.file.flush();
        self.end_if_failed(flushed)
    }

    fn end_if_failed(&mut self, result: std::io::Result<()>) -> std::io::Result<()> {
        result.map_err(|error| match self.recording.take() {
            Some(ended) => Error::new(error.kind(), format!("{}: {error}", ended.path.display())),
            None => error,
        })
    }

    /// The recording; `None`: none runs.
    pub fn recorded(&self, now: f64) -> Option<RecordingState> {
        self.recording.as_ref().map(|recording| RecordingState {
            frames: recording.frames,
            bytes: recording.bytes,
            seconds: (now - recording.began).max(0.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::console::recording::Player;

    #[test]
    fn what_is_recorded_can_be_played() {
        let folder = tempfile::tempdir().unwrap();
        let mut keeper = Keeper::new(folder.path().join("kept"));
        keeper.keep(1.0, b"before").unwrap();
        let path = keeper.record(1e9, true).unwrap().unwrap();
        assert_eq!(keeper.record(2e9, true).unwrap().as_ref(), Some(&path), "it goes on");
        keeper.keep(1e9, b"one").unwrap();
        keeper.flush().unwrap();
        keeper.keep(1e9 + 1.0, b"two").unwrap();
        let running = RecordingState { frames: 2, bytes: 2 * (12 + 3), seconds: 1.5 };
        assert_eq!(keeper.recorded(1e9 + 1.5), Some(running));
        assert_eq!(keeper.record(0.0, false).unwrap().as_ref(), Some(&path));
        assert_eq!((keeper.recorded(0.0), keeper.record(0.0, false).unwrap()), (None, None));
        let player = Player::open(File::open(&path).unwrap(), &path).unwrap();
        let frames: Vec<_> = player.frames().map(|frame| frame.bytes).collect();
        assert_eq!(frames, [b"one", b"two"]);
        assert_eq!(path.file_name().unwrap(), "2001-09-09T01-46-40.000Z.nvsr");
    }
}
