//! What `tools/paper` reads: frames, renders at the poses of BFGS, and difference pictures in the paper's form.

use std::path::Path;

use nvsprior::Picture;
use nvsprior_inputs::input::InputArgs;
use nvsprior_inputs::values::make_folder;
use nvsprior_runs::write_png;
use serde::Serialize;

use crate::bench::codecs::run::Run;
use crate::bench::context::Context;
use nvsprior_inputs::report::write_json;

/// Writes it of a run's frames.
pub fn write(
    folder: &Path,
    input: &InputArgs,
    context: &Context,
    invs: &Run,
) -> anyhow::Result<()> {
    let set = input.split.as_deref().unwrap_or("all");
    let cameras = &input.cameras()?.file_name().unwrap_or_default().to_string_lossy();
    let kinds = ["frames", "renders", "differences"].map(|kind| folder.join(kind));
    for kind in &kinds {
        make_folder("--report", kind)?;
    }
    let [frames, renders, differences] = kinds;
    for (index, shot) in context.shots.iter().enumerate() {
        let (file, render) = (format!("{}.png", shot.name), &invs.renders[index]);
        write_png(&frames.join(&file), &shot.picture)?;
        write_png(&renders.join(&file), render)?;
        write_png(&differences.join(&file), &halved(&shot.picture, render))?;
    }
    let camera = context.shots[0].camera;
    let names: Vec<&str> = context.shots.iter().map(|shot| shot.name.as_str()).collect();
    let manifest = Manifest {
        set,
        width: camera.width,
        height: camera.height,
        frames: names,
        prior: format!("{:08x}", context.scene.id().0),
        cameras,
    };
    write_json(&folder.join("manifest.json"), &manifest)
}

/// `manifest.json`.
#[derive(Serialize)]
struct Manifest<'a> {
    set: &'a str,
    width: u32,
    height: u32,
    frames: Vec<&'a str>,
    prior: String,
    cameras: &'a str,
}

/// The paper's difference picture: half of frame less render, around the middle, rounded up.
fn halved(frame: &Picture, render: &Picture) -> Picture {
    let mut halved = frame.clone();
    for (value, render) in halved.data.iter_mut().zip(&render.data) {
        *value = ((256 + u16::from(*value) - u16::from(*render)) / 2) as u8;
    }
    halved
}

/// The picture that such a difference picture makes of a render.
pub fn added(render: &Picture, halved: &Picture) -> Picture {
    let mut shown = render.clone();
    for (value, halved) in shown.data.iter_mut().zip(&halved.data) {
        *value = (i16::from(*value) + 2 * i16::from(*halved) - 255).clamp(0, 255) as u8;
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_difference_loses_one_level_at_most() {
        let all: Vec<u8> = (0..=255).collect();
        for level in [0, 1, 100, 254, 255] {
            let frame = Picture::from_rgb(256, 1, all.iter().flat_map(|v| [*v; 3]).collect());
            let frame = frame.expect("its size");
            let mut render = frame.clone();
            render.data.fill(level);
            let shown = added(&render, &halved(&frame, &render));
            let off = frame.data.iter().zip(&shown.data).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off <= Some(1), "{off:?}");
        }
        let grey = Picture::new(4, 1);
        assert_eq!(halved(&grey, &grey).data, [128; 12]);
    }
}
