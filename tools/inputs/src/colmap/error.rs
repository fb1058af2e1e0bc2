//! Why a model cannot be read, and where.

use std::path::{Path, PathBuf};

use nvsprior::geometry::LensError;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilePosition {
    /// A byte, counted from 0.
    Byte(usize),
    /// A line, counted from 1.
    Line(usize),
}

impl std::fmt::Display for FilePosition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FilePosition::Byte(byte) => write!(f, "byte {byte}"),
            FilePosition::Line(line) => write!(f, "line {line}"),
        }
    }
}

/// Why a sparse model cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ColmapError {
    #[error("{}: {error}", path.display())]
    Read { path: PathBuf, error: std::io::Error },
    #[error("{}: neither cameras.bin nor cameras.txt in it; give the folder of a COLMAP model, such \
        as sparse/0", folder.display())]
    Missing { folder: PathBuf },
    #[error("{}: {at}: {fault}", path.display())]
    Content { path: PathBuf, at: FilePosition, fault: ColmapFault },
}

/// What is wrong at a place of a model's file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ColmapFault {
    #[error("the file ends before {what}; is it cut off?")]
    Cut { what: &'static str },
    #[error("{count} more bytes follow than the file says")]
    Rest { count: usize },
    #[error("{what} is missing")]
    Missing { what: &'static str },
    #[error("\"{found}\" as {what}")]
    Word { what: &'static str, found: String },
    #[error(
        "{count} words: neither observations, three numbers for each, nor a picture's pose and name"
    )]
    Observations { count: usize },
    #[error("the text is not UTF-8")]
    Text,
    #[error("the picture has no name")]
    Name,
    #[error("{what} stands there twice")]
    Twice { what: String },
    #[error(
        "camera model {model} is not read, but SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, \
        OPENCV, OPENCV_FISHEYE and FULL_OPENCV are; run `colmap image_undistorter`, and use the model and \
        pictures that it writes"
    )]
    Model { model: String },
    #[error("{found} camera parameters; {model} has {due}")]
    Parameters { model: &'static str, due: usize, found: usize },
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error("{name}: camera {camera} is not among the cameras")]
    Camera { name: String, camera: u32 },
    #[error("{name}: its quaternion must be of length 1, and its translation finite")]
    Pose { name: String },
    #[error("a point whose position or error is not finite")]
    Point,
}

pub struct Wrong {
    pub at: FilePosition,
    pub fault: ColmapFault,
}

impl Wrong {
    pub fn new(at: FilePosition, fault: impl Into<ColmapFault>) -> Wrong {
        Wrong { at, fault: fault.into() }
    }

    pub fn of(self, path: &Path) -> ColmapError {
        ColmapError::Content { path: path.to_path_buf(), at: self.at, fault: self.fault }
    }
}
