//! What the programs share: camera files, pictures and poses on disk, the command-line arguments that name them, and
//! reports.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

#[macro_use]
extern crate nvsprior_runs;

pub use nvsprior_runs::{say, tell};

pub mod args;
pub mod camera_file;
mod child;
pub mod colmap;
pub mod estimate;
pub mod ffmpeg;
pub mod frame_file;
pub mod input;
pub mod jpeg;
pub mod keys;
pub mod locked_folder;
pub mod mode;
pub mod navigation;
pub mod plot;
pub mod points;
pub mod posed;
pub mod progress;
pub mod report;
pub mod statistics;
pub mod structure;
pub mod summary;
pub mod track_file;
pub mod tune;
pub mod undistort;
pub mod values;
pub mod video;
pub mod video_input;
