//! `nvsprior devices`: the Vulkan devices of this machine, and whether one is portable.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use nvsprior::vulkan::{ListedDevice, devices};
use nvsprior::{Engine, Prior, RenderOverrides};
use nvsprior_inputs::args::{DeviceArgs, progress};
use nvsprior_inputs::camera_file::{CameraFile, View};
use nvsprior_reference::device_check::{Compared, Same, built_in, check_host};

/// List the Vulkan devices of this machine, or tell whether one draws the same bytes as every other
///
/// The number, or a part of the name or the driver's name, is what --device takes. --check draws built-in random
/// scenes, ordinary and extreme. It compares pictures, depths and transmittances with the host's own, bit for bit, and
/// the host's with committed check sums. It prints "portable", or the first stage that differs, with its input and
/// output.
///
/// Exit codes: 0 listed, or portable; 1 not portable or something failed, 2 wrong usage.
#[derive(clap::Args)]
pub struct Args {
    /// Compare the device's pictures with the host's, of so many scenes; each gives a picture at a pose and one at a
    /// packet's pose [SCENES: 64 if it is left out]
    #[arg(long, value_name = "SCENES", num_args = 0..=1, default_missing_value = "64",
        value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    check: Option<u64>,
    /// Compares pictures of this prior, too, at the poses of --cameras
    #[arg(long, value_name = "FILE", requires_all = ["cameras", "check"])]
    prior: Option<PathBuf>,
    /// cameras.json, or nerfstudio's transforms.json
    #[arg(long, value_name = "FILE", requires = "prior")]
    cameras: Option<PathBuf>,
    /// Only the views of this split of the camera file
    #[arg(long, value_name = "NAME", requires = "cameras")]
    split: Option<String>,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Lists, or compares; the exit code says whether the device is portable.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match args.check {
        Some(scenes) => check(args, scenes),
        None => list().map(|()| ExitCode::SUCCESS),
    }
}

fn check(args: &Args, scenes: u64) -> anyhow::Result<ExitCode> {
    let views = views(args)?;
    let engine = args.device.open()?;
    check_host()?;
    let bar = progress(scenes as usize, "scenes");
    let goes_on = || {
        bar.inc(1);
        true
    };
    let compared = match built_in(&engine, scenes, goes_on)?.0 {
        Ok(pictures) => given(&engine, &views)?.map(|more| pictures + more),
        different => different,
    };
    bar.finish_and_clear();
    args.device.check(&engine)?;
    Ok(match compared {
        Ok(pictures) => {
            say!("portable: {pictures} pictures, no byte differs");
            ExitCode::SUCCESS
        }
        Err((of, difference)) => {
            say!("NOT portable: {}", engine.device());
            say!("{of}: {difference}");
            ExitCode::FAILURE
        }
    })
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
        let pose = pose.relative_to(prior.origin());
        match compared.compare(&view.camera, &pose).with_context(|| view.name.clone())? {
            Ok(count) => pictures += count,
            Err(difference) => return Ok(Err((view.name.clone(), difference))),
        }
        bar.inc(1);
    }
    Ok(Ok(pictures))
}

fn list() -> anyhow::Result<()> {
    for (number, ListedDevice { info, memory, unfit }) in devices()?.iter().enumerate() {
        let (major, minor) = info.api;
        say!("{number}: {}", info.name);
        say!("   {}, {}, Vulkan {major}.{minor}", info.kind.name(), info.driver);
        say!("   {} MB of memory, subgroups of {}", memory / 1_000_000, info.subgroup);
        match unfit {
            None => say!("   can run nvsprior"),
            Some(why) => say!("   cannot run nvsprior: it {why}"),
        }
    }
    Ok(())
}
