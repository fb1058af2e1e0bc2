//! Runs on disk: pictures as PNG files, the camera file beside them, and contact sheets.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

mod contact;
mod png_file;
mod run_writer;
mod sheet;

pub use contact::{SheetRow, write_contact_sheet};
pub use png_file::{PngFileError, png_of, read_png, write_png};
pub use run_writer::{RunView, RunWriter, RunWriterError};
pub use sheet::Sheet;
