//! Writes the demo's prior, and frames of its first inspection run, where `make demo` writes them too: for
//! `scripts/gst-test.sh`. Usage: `demo_frames FOLDER FRAMES`.

use std::path::PathBuf;

use nvsprior::Prior;
use nvsprior::prior::ply::write_ply;
use nvsprior_basin::{Conditions, Run};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(folder), Some(frames)) = (arguments.next(), arguments.next()) else {
        return Err("usage: demo_frames FOLDER FRAMES".into());
    };
    let (folder, frames) = (PathBuf::from(folder), frames.parse()?);
    let run = Run::T1;
    std::fs::create_dir_all(folder.join(run.name()))?;
    let prior = Prior::from_bytes(nvsprior_basin::PRIOR, "the demo's prior", &Default::default())?;
    let mut bytes = Vec::new();
    let (splats, options) = (prior.splats(), prior.options());
    write_ply(splats, options, prior.key_frames(), prior.preprocessing(), &mut bytes)?;
    std::fs::write(folder.join("prior.ply"), bytes)?;
    let drawn = nvsprior_basin::inspection_run(run, frames, Conditions::CALM);
    nvsprior_basin::write_run(
        &folder.join(run.name()),
        run.name(),
        nvsprior_basin::CAMERA,
        drawn,
        |_| {},
    )?;
    Ok(())
}
