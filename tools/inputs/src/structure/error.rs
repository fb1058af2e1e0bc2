//! Why poses cannot be found.

use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use crate::colmap::ColmapError;
use crate::locked_folder::FolderError;
use crate::navigation::NavigationError;
use crate::posed::PosedError;
use crate::video::VideoError;

/// How a command ended that did not end well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ended(pub(super) ExitStatus);

impl std::fmt::Display for Ended {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "failed ({})", self.0)
    }
}

impl Ended {
    /// Its exit code, unless a signal ended it.
    pub fn code(self) -> Option<i32> {
        self.0.code()
    }
}

#[derive(Debug, thiserror::Error)]
pub enum StructureError {
    #[error(
        "pictures without poses need COLMAP 4 or the Python package pycolmap ({why}); install COLMAP 4, or Python 3 \
         with venv and a network, or name a program with --poses. Debian's colmap works too, but takes hours for some \
         hundred pictures. With poses from elsewhere, give --cameras"
    )]
    NotInstalled { why: String },
    #[error("{}: neither a COLMAP nor a Python with pycolmap", path.display())]
    NoColmap { path: PathBuf },
    #[error("{}: {error}", path.display())]
    File { path: PathBuf, error: std::io::Error },
    #[error("{}: no pictures (PNG, JPEG, WebP) in this folder or below it", path.display())]
    Empty { path: PathBuf },
    #[error("{}: the only picture; poses are found from at least two of one scene", path.display())]
    One { path: PathBuf },
    #[error("{}: a name that is not UTF-8, or has a line break", path.display())]
    Name { path: PathBuf },
    #[error("{}: {}×{}, but {} is {}×{}: if several cameras took the pictures, put those of each in \
        a folder and give --lenses folder, or give --lenses picture", path.display(), found.0,
        found.1, first.display(), expected.0, expected.1)]
    Sizes { path: PathBuf, found: (u32, u32), first: PathBuf, expected: (u32, u32) },
    #[error("{program} {command} {ended}; its last words: {last}; all of them: {}", log.display())]
    Step { program: &'static str, command: String, ended: Ended, last: String, log: PathBuf },
    #[error("{program} found no two pictures to begin with: they must be sharp, overlap, show texture, and be taken \
        from different places; what it tried: {}", log.display())]
    NoModel { program: &'static str, log: PathBuf },
    #[error("{program} found the pose of {found} picture; all that it tried: {}", log.display())]
    TooFew { program: &'static str, found: usize, log: PathBuf },
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    #[error(transparent)]
    Posed(#[from] PosedError),
    #[error(transparent)]
    Navigation(#[from] NavigationError),
    #[error(transparent)]
    Video(#[from] VideoError),
}

impl StructureError {
    pub(super) fn file(path: &Path) -> impl Fn(std::io::Error) -> StructureError {
        move |error| StructureError::File { path: path.to_path_buf(), error }
    }
}
