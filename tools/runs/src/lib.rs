//! Runs on disk: pictures as PNG files, the camera file beside them, contact sheets, and folders of a file per frame.
//! And lines for the screen.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

/// As `eprintln`, but a log on a full disk ends no program.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => {
        $crate::put(&mut std::io::stderr(), format_args!($($text)*))
    };
}

/// As `println`, but a full disk or a closed pipe ends no work.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => {
        $crate::put(&mut std::io::stdout(), format_args!($($text)*))
    };
}

/// Lines of the program that could not be written.
static UNTOLD: AtomicUsize = AtomicUsize::new(0);

/// Writes a line, or counts it.
pub fn put(to: &mut impl Write, line: Arguments<'_>) {
    if writeln!(to, "{line}").is_err() {
        UNTOLD.fetch_add(1, Ordering::Relaxed);
    }
}

/// How many lines could not be written.
pub fn untold() -> usize {
    UNTOLD.load(Ordering::Relaxed)
}

use std::fmt::Arguments;
use std::io::Write;
use std::sync::atomic::{AtomicUsize, Ordering};

mod contact;
mod frame_folder;
mod output;
mod png_file;
mod run_writer;
mod sheet;

pub use contact::{SheetRow, write_contact_sheet};
pub use frame_folder::{
    FrameFolder, FrameFolderError, FrameKind, end_replacing, files_of, remove_own,
};
pub use output::{OutputError, check_file, make_folder};
pub use png_file::{PngFileError, marked_png, png_of, read_png, write_png};
pub use run_writer::{RunView, RunWriter, RunWriterError};
pub use sheet::Sheet;
