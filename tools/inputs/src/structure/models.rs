//! The models in a folder.

use std::path::{Path, PathBuf};

use super::StructureError;
use crate::colmap::ColmapModel;

/// The models and their folders; the one with most pictures first.
pub fn models(sparse: &Path) -> Result<Vec<(PathBuf, ColmapModel)>, StructureError> {
    let mut models = Vec::new();
    for entry in std::fs::read_dir(sparse).map_err(StructureError::file(sparse))? {
        let folder = entry.map_err(StructureError::file(sparse))?.path();
        if ColmapModel::is_in(&folder) {
            let model = ColmapModel::open(&folder)?;
            models.push((folder, model));
        }
    }
    models.sort_by(|(a, one), (b, other)| {
        other.views.len().cmp(&one.views.len()).then_with(|| a.cmp(b))
    });
    Ok(models)
}
