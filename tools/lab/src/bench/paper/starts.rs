//! The starts of a pose regressor, as `tools/paper` writes them.

use std::path::{Path, PathBuf};

use nvsprior::Pose;
use nvsprior_inputs::frame_file::{FrameFileError, read_known_by};

use crate::bench::context::Shot;

#[derive(Debug, thiserror::Error)]
pub enum StartsError {
    #[error(transparent)]
    File(#[from] FrameFileError),
    #[error("{}: no start of frame \"{name}\"", path.display())]
    Missing { path: PathBuf, name: String },
    #[error("{}: \"{name}\" is no frame of the run", path.display())]
    Unknown { path: PathBuf, name: String },
}

/// Reads a pose for each frame, by its name without ending: `name,qw,qx,qy,qz,tx,ty,tz`.
pub fn read(path: &Path, shots: &[Shot]) -> Result<Vec<Pose>, StartsError> {
    let known = read_known_by("name", path)?;
    let unknown = known.keys().filter(|name| shots.iter().all(|shot| shot.name != **name)).min();
    if let Some(name) = unknown {
        return Err(StartsError::Unknown { path: path.to_path_buf(), name: name.clone() });
    }
    let pose = |shot: &Shot| {
        let hint = known.get(&shot.name).and_then(|known| known.hint);
        let missing = || StartsError::Missing { path: path.to_path_buf(), name: shot.name.clone() };
        Ok(hint.ok_or_else(missing)?.pose)
    };
    shots.iter().map(pose).collect()
}
