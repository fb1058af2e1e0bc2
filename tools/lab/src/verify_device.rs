//! `nvsprior verify-device`: whether a device draws final pictures to the same bytes as every other one.

mod compare;
mod scenes;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use compare::{Compared, Difference};
use nvsprior::{Engine, Prior, RenderOverrides};
use nvsprior_inputs::args::{DeviceArgs, progress};
use nvsprior_inputs::camera_file::{CameraFile, View};
use scenes::{GOLDEN, Scene};
use serde::{Deserialize, Serialize};

/// Tell whether a device draws the same bytes as every other one
///
/// Draws built-in random scenes, ordinary and extreme. Compares pictures, depths and transmittances with the host's
/// own, bit for bit. Compares the host's with committed check sums. Prints "portable", or the first stage that differs,
/// with its input and output.
///
/// Exit codes: 0 portable, 1 not portable or something failed, 2 wrong usage.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    /// Scenes to draw; each gives a picture at a pose and one at a packet's pose
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    scenes: u64,
    /// Compares pictures of this prior, too, at the poses of --cameras
    #[arg(long, value_name = "FILE", requires = "cameras")]
    prior: Option<PathBuf>,
    /// cameras.json, or nerfstudio's transforms.json
    #[arg(long, value_name = "FILE", requires = "prior")]
    cameras: Option<PathBuf>,
    /// Only the views of this split of the camera file
    #[arg(long, value_name = "NAME", requires = "cameras")]
    split: Option<String>,
}

/// Compares; the exit code says whether the device is portable.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let views = views(args)?;
    let engine = args.device.open()?;
    check_host()?;
    let compared = match built_in(&engine, args.scenes, || true)?.0 {
        Ok(pictures) => given(&engine, &views)?.map(|more| pictures + more),
        different => different,
    };
    args.device.check(&engine)?;
    Ok(match compared {
        Ok(pictures) => {
            println!("portable: {pictures} pictures, no byte differs");
            ExitCode::SUCCESS
        }
        Err((of, difference)) => {
            println!("NOT portable: {}", engine.device());
            println!("{of}: {difference}");
            ExitCode::FAILURE
        }
    })
}

/// How many pictures are the same, or the first that differs: what it is of, and how.
type Same = Result<u64, (String, Difference)>;

/// Compares built-in scenes as long as it may go on. Also returns how many were.
fn built_in(
    engine: &Engine,
    scenes: u64,
    goes_on: impl Fn() -> bool,
) -> anyhow::Result<(Same, u64)> {
    let bar = progress(scenes as usize, "scenes");
    let (mut pictures, mut done) = (0, 0);
    while done < scenes && (done == 0 || goes_on()) {
        let seed = done;
        done += 1;
        if let Some(Scene { prior, camera, pose }) = Scene::of(seed) {
            let compared = Compared::new(engine, &prior).and_then(|c| c.compare(&camera, &pose));
            match compared.with_context(|| format!("scene {seed}"))? {
                Ok(count) => pictures += count,
                Err(difference) => return Ok((Err((format!("scene {seed}"), difference)), done)),
            }
        }
        bar.inc(1);
    }
    Ok((Ok(pictures), done))
}

/// What a comparison of a device with the host came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Whether no byte differs, and the host draws what every host draws.
    pub portable: bool,
    /// Scenes that were drawn.
    pub scenes: u64,
    /// Pictures of which no byte differs.
    pub pictures: u64,
    /// The first difference.
    pub difference: Option<String>,
    /// Check sums (CRC-32) of what the host draws of the first scenes.
    pub check_sums: Vec<String>,
}

/// Compares up to `scenes` built-in scenes, as long as it may go on; one at least.
pub fn verify(engine: &Engine, scenes: u64, goes_on: impl Fn() -> bool) -> anyhow::Result<Verdict> {
    let sums: Vec<u32> = (0..GOLDEN.len() as u64).map(scenes::check_sum).collect();
    let (compared, scenes) = built_in(engine, scenes, goes_on)?;
    let (pictures, difference) = match compared {
        Ok(pictures) => (pictures, check_sums(&sums).err().map(|error| error.to_string())),
        Err((of, difference)) => (0, Some(format!("{of}: {difference}"))),
    };
    let check_sums = sums.iter().map(|sum| format!("{sum:08x}")).collect();
    Ok(Verdict { portable: difference.is_none(), scenes, pictures, difference, check_sums })
}

/// A prior given, and the views of a camera file.
type Views = Option<(Prior, Vec<View>)>;

fn views(args: &Args) -> anyhow::Result<Views> {
    let (Some(prior), Some(cameras)) = (&args.prior, &args.cameras) else { return Ok(None) };
    let views = CameraFile::open(cameras)?.select(args.split.as_deref())?;
    Ok(Some((Prior::open(prior, &RenderOverrides::default())?, views)))
}

/// Compares the views of the prior given.
fn given(engine: &Engine, views: &Views) -> anyhow::Result<Same> {
    let Some((prior, views)) = views else { return Ok(Ok(0)) };
    let compared = Compared::new(engine, prior)?;
    let bar = progress(views.len(), "views");
    let mut pictures = 0;
    for view in views {
        let Some(pose) = &view.pose else { continue };
        match compared.compare(&view.camera, pose).with_context(|| view.name.clone())? {
            Ok(count) => pictures += count,
            Err(difference) => return Ok(Err((view.name.clone(), difference))),
        }
        bar.inc(1);
    }
    Ok(Ok(pictures))
}

/// Fails unless this host computes what every other host does.
fn check_host() -> anyhow::Result<()> {
    check_sums(&(0..GOLDEN.len() as u64).map(scenes::check_sum).collect::<Vec<_>>())
}

/// Fails unless these are the check sums of every host.
fn check_sums(sums: &[u32]) -> anyhow::Result<()> {
    for (seed, (found, expected)) in sums.iter().zip(GOLDEN).enumerate() {
        anyhow::ensure!(
            *found == expected,
            "this host computes other results: scene {seed} has check sum {found:08x}, not {expected:08x}. \
             Report it with the name of the processor and of the compiler",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_host_draws_what_every_host_draws() {
        let found: Vec<String> = (0..GOLDEN.len() as u64)
            .map(|seed| format!("0x{:08x}", scenes::check_sum(seed)))
            .collect();
        let expected: Vec<String> = GOLDEN.iter().map(|sum| format!("0x{sum:08x}")).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_host_that_computes_other_results_is_named() {
        let mut sums = GOLDEN.to_vec();
        assert!(check_sums(&sums).is_ok());
        sums[3] ^= 1;
        let error = check_sums(&sums).unwrap_err().to_string();
        assert!(error.starts_with("this host computes other results: scene 3 "), "{error}");
    }

    #[test]
    fn a_difference_names_its_stage() {
        let text =
            Difference::new("project", 7, "splat 3, z = 2", "0x3f800000", "0x3f800001").to_string();
        assert!(text.contains("stage project") && text.contains("splat 3"), "{text}");
    }
}
