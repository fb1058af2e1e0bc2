//! The folder of a mapping's frames: pictures, and `frames.json`, which tells where each comes from.

use std::collections::HashMap;
use std::path::Path;
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use super::{Video, VideoError};
use crate::locked_folder::{self, FolderRecord, LockedFolder};

/// What a run was asked for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    pub videos: Vec<AskedVideo>,
    pub decoder: String,
    /// Share that neighbours have in common, about.
    pub overlap: f64,
    /// At most so many frames.
    pub most: Option<usize>,
}

/// A video's file, as it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AskedVideo {
    pub path: String,
    pub bytes: u64,
    /// Seconds since 1970.
    pub modified: Option<f64>,
}

impl AskedVideo {
    pub fn of(path: &Path) -> Result<AskedVideo, VideoError> {
        let failed = VideoError::file(path);
        let metadata = std::fs::metadata(path).map_err(&failed)?;
        let since = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        let path = std::path::absolute(path).map_err(&failed)?;
        let path = path.to_string_lossy().into_owned();
        Ok(AskedVideo {
            path,
            bytes: metadata.len(),
            modified: since.map(|time| time.as_secs_f64()),
        })
    }
}

/// `frames.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Whether all frames are there.
    pub finished: bool,
    pub asked: Asked,
    pub videos: Vec<VideoRecord>,
    pub frames: Vec<FrameRecord>,
}

/// A video, as it was read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VideoRecord {
    pub path: String,
    /// Of its pictures, in this folder.
    pub folder: String,
    pub decoder: String,
    pub width: u32,
    pub height: u32,
    /// Frames that were read, and the time of the last one, seconds.
    pub frames: usize,
    pub last: f64,
    /// What is said of it: that it is cut off, or breaks.
    pub notes: Vec<String>,
    /// Tracks that are neither pictures nor sound.
    pub other_tracks: Vec<String>,
}

/// A picture of the folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// From this folder.
    pub file: String,
    /// Number of its video, from 0.
    pub video: usize,
    /// Number of the frame in its video, from 0.
    pub index: usize,
    /// Time stamp in its video, seconds.
    pub time: f64,
    pub sharpness: f64,
    /// Share in common with the picture before, of the same video.
    pub overlap: Option<f64>,
    /// Poses are found on these; those of the others follow from them.
    pub first: bool,
}

/// A folder of frames.
pub type Folder = LockedFolder<Record>;

impl FolderRecord for Record {
    const FILE: &'static str = "frames.json";
    const KEPT: &'static str = "frames that were chosen before";
    const WORKER: &'static str = "another run";
}

impl Folder {
    /// Whether an earlier run wrote all that is asked for.
    pub fn has(&self, asked: &Asked) -> bool {
        let there = |frame: &FrameRecord| {
            std::fs::metadata(self.path.join(&frame.file)).is_ok_and(|file| file.len() > 0)
        };
        let Record { finished, asked: before, frames, .. } = &self.record;
        *finished && before == asked && frames.iter().all(there)
    }

    /// Removes the pictures of an earlier run, and notes what is begun.
    pub fn begin(&mut self, record: Record) -> Result<(), VideoError> {
        let earlier = std::mem::replace(&mut self.record, record);
        self.write()?;
        for video in &earlier.videos {
            let path = self.path.join(&video.folder);
            // A record that was changed by hand names no folder elsewhere.
            let own = video.folder.starts_with(|c: char| c.is_ascii_digit());
            if own && !video.folder.contains(['/', '\\']) && path.is_dir() {
                std::fs::remove_dir_all(&path).map_err(VideoError::write(&path))?;
            }
        }
        for video in &self.record.videos {
            let path = self.path.join(&video.folder);
            std::fs::create_dir_all(&path).map_err(VideoError::write(&path))?;
        }
        Ok(())
    }
}

/// Times of the pictures of a folder by their names, seconds, if they are frames of one video: else there are none.
pub fn frame_times(folder: &Path) -> Result<HashMap<String, f64>, VideoError> {
    if !folder.join(Record::FILE).is_file() {
        return Ok(HashMap::new());
    }
    let record: Record = locked_folder::record(folder)?;
    let one = record.videos.len() == 1;
    let times = record.frames.into_iter().filter(|_| one).map(|frame| (frame.file, frame.time));
    Ok(times.collect())
}

/// The name of a video's folder: its number, and its file's name as far as every program takes it.
pub fn folder_name(number: usize, video: &Video) -> String {
    let stem = video.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let kept = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    let name: String = stem.chars().map(kept).take(60).collect();
    format!("{:02}-{name}", number + 1)
}
