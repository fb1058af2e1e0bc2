//! The prior that comes with the program.

use std::path::Path;

use nvsprior::prior::ply::write_ply;
use nvsprior::prior::{Extras, extras_file, replace_file};
use nvsprior::{Camera, Prior, RenderOptions};
use nvsprior_basin::CAMERA;

pub fn shipped() -> anyhow::Result<Prior> {
    Ok(Prior::from_bytes(nvsprior_basin::PRIOR, "the demo's prior", &Default::default())?)
}

/// Writes the prior as a file that viewers read, too, with its doubt beside it. For pictures of another size than it
/// was trained at, it states its own. That makes it another prior, whose doubt is not known.
pub fn write(path: &Path, camera: &Camera) -> anyhow::Result<Prior> {
    let shipped = shipped()?;
    let is_usual = *camera == CAMERA;
    let trained_focal = (!is_usual).then_some(CAMERA.fx);
    let options = RenderOptions { trained_focal, ..*shipped.options() };
    let (splats, own) = (shipped.splats(), shipped.extras());
    let mut bytes = Vec::new();
    write_ply(splats, &options, &own.key_frames, &own.preprocessing, &mut bytes)?;
    let written = Prior::from_bytes(&bytes, "the demo's prior", &Default::default())?;
    let doubt = own.doubt.clone().filter(|_| is_usual);
    let extras = Extras { doubt, ..own.clone() };
    replace_file(path, &bytes)?;
    let beside = extras_file::to_bytes(&extras, written.id(), written.len());
    replace_file(&extras_file::path_beside(path), &beside)?;
    let prior = Prior::open(path, &Default::default())?;
    say!("prior: {} splats and {} key frames", prior.len(), prior.key_frames().len());
    Ok(prior)
}
