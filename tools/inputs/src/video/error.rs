//! Why a video cannot be used.

use std::path::{Path, PathBuf};

use crate::locked_folder::FolderError;

#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    #[error(
        "a video needs a program that decodes it, and neither ffmpeg nor gst-launch-1.0 is on the PATH; on Debian or \
         Ubuntu `apt-get install ffmpeg`"
    )]
    NoDecoder,
    #[error("{program} is not on the PATH; on Debian or Ubuntu `apt-get install {packages}`")]
    NotInstalled { program: &'static str, packages: &'static str },
    #[error("{}: {error}", path.display())]
    File { path: PathBuf, error: std::io::Error },
    #[error("{}: this is an empty file", path.display())]
    Empty { path: PathBuf },
    #[error("{}: it has no track of pictures, only others", path.display())]
    NoPictures { path: PathBuf },
    #[error("{}: no frame can be read; {}: {said}", path.display(), guess(said))]
    NoFrame { path: PathBuf, said: String },
    #[error(
        "{}: {program} has given no frame for {seconds} s and was ended; try the other decoder (--decoder), or convert \
         the video first",
        path.display()
    )]
    Hangs { path: PathBuf, program: &'static str, seconds: u64 },
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error("{}: cannot be written: {error}", path.display())]
    Write { path: PathBuf, error: std::io::Error },
    #[error(
        "{}: only {found} frame could be chosen, since the picture hardly changes; poses are found from pictures that \
         were taken from different places",
        path.display()
    )]
    TooFew { path: PathBuf, found: usize },
}

impl VideoError {
    pub(super) fn file(path: &Path) -> impl Fn(std::io::Error) -> VideoError {
        move |error| VideoError::File { path: path.to_path_buf(), error }
    }

    pub(super) fn write(path: &Path) -> impl Fn(std::io::Error) -> VideoError {
        move |error| VideoError::Write { path: path.to_path_buf(), error }
    }
}

/// What no frame may mean, by the programs' words.
fn guess(said: &str) -> &'static str {
    let of = |words: &[&str]| words.iter().any(|word| said.contains(word));
    if of(&["moov atom not found", "no playable streams"]) {
        "it is no video, or its recording was cut off before its index was written"
    } else if of(&["missing a plug-in", "Decoder not found"]) {
        "a plug-in of the decoder is missing, or another decoder reads it (--decoder)"
    } else {
        "it is no video, or the decoder does not know its kind"
    }
}
