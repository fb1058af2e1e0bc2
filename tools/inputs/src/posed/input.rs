//! A posed picture, as any list names it.

use std::path::PathBuf;

use nvsprior::Pose;
use nvsprior::geometry::Lens;

/// A picture that was taken at a known pose.
#[derive(Clone, Debug)]
pub struct PosedInput {
    /// Its name in the file that lists it.
    pub name: String,
    pub file: PathBuf,
    /// What it was taken with.
    pub lens: Lens,
    /// World to camera.
    pub pose: Pose,
    /// Which part of the pictures it belongs to, if that is known: `train`, `test`.
    pub split: Option<String>,
    /// A picture of the same shape: its white pixels count. If there is none, all count.
    pub mask: Option<PathBuf>,
}
