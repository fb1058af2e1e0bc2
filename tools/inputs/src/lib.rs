//! What the programs share: camera files, pictures and poses on disk, the command-line arguments that name them, and
//! reports.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

/// As `eprintln`, but a log on a full disk ends no program.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($text)*);
    }};
}

/// As `println`, but a full disk or a closed pipe ends no work.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($text)*);
    }};
}

pub mod args;
pub mod camera_file;
mod child;
pub mod colmap;
pub mod estimate;
pub mod ffmpeg;
pub mod frame_file;
pub mod input;
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
