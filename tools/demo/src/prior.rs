//! The prior that comes with the program.

use std::io::ErrorKind;
use std::path::Path;

use anyhow::Context;
use nvsprior::prior::ply::write_ply;
use nvsprior::prior::{Doubt, replace_file};
use nvsprior::{Camera, Prior, RenderOptions};
use nvsprior_basin::CAMERA;

pub fn shipped() -> anyhow::Result<Prior> {
    Ok(Prior::from_bytes(nvsprior_basin::PRIOR, "the demo's prior", &Default::default())?)
}

/// Writes the prior as a file that viewers read, too. For pictures of another size than it was trained at, it states
/// its own. That makes it another prior: what comes with the program of its doubt is not about that one.
pub fn write(path: &Path, camera: &Camera) -> anyhow::Result<Prior> {
    let shipped = shipped()?;
    let is_usual = *camera == CAMERA;
    let trained_focal = (!is_usual).then_some(CAMERA.fx);
    let options = RenderOptions { trained_focal, ..*shipped.options() };
    let mut bytes = Vec::new();
    write_ply(
        shipped.splats(),
        &options,
        shipped.key_frames(),
        shipped.preprocessing(),
        &mut bytes,
    )?;
    replace_file(path, &bytes)?;
    let doubt = Doubt::path_beside(path);
    if is_usual {
        replace_file(&doubt, nvsprior_basin::DOUBT)?;
    } else if let Err(error) = std::fs::remove_file(&doubt)
        && error.kind() != ErrorKind::NotFound
    {
        return Err(error).with_context(|| format!("removing {}", doubt.display()));
    }
    let prior = Prior::open(path, &Default::default())?;
    println!("prior: {} splats and {} key frames", prior.len(), prior.key_frames().len());
    Ok(prior)
}
