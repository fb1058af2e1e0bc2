//! `nvsprior demo`: the whole job on the embedded scene, and runs of the scenes that are only drawn.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use nvsprior::Camera;
use nvsprior_basin::{Dive, Rig, Run, Site, camera_of_width};
use nvsprior_demo::{Job, draw_dive};
use nvsprior_inputs::args::{DeviceArgs, progress};
use nvsprior_inputs::values;

/// Run the whole job on a scene that the program draws itself
///
/// Draws a basin with a yellow structure, seen through water. Its prior was trained from the mapping
/// run M1 by `nvsprior map`, and comes with the program. Encodes two inspection runs (T1: the scene as mapped; T2: with
/// a new object and a safety line), or the run that `--run` names. Decodes their packets in another process, compares,
/// and prints a table like the paper's.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for runs, prior, packets, pictures and the table
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    /// Frames of each inspection run
    #[arg(long, value_name = "N", default_value = "5")]
    frames: NonZeroUsize,
    /// Only this run: T1, T2, T4 (weeks later: growth, a brace that is gone, a new chain, other light) or T5 (months
    /// later: more of it, and a pipe that has fallen). T3 along a quay, T6 along three structures and T7 at a tower in
    /// black water are drawn, and not encoded: no prior of them comes with the program
    #[arg(long, value_name = "RUN")]
    run: Option<Run>,
    /// Only draws: writes each run's frames and camera file, beside them the basin's prior, and opens no device
    #[arg(long)]
    draw_only: bool,
    /// Frames per second of the runs
    #[arg(long, alias = "rate", value_name = "FPS", default_value_t = nvsprior_basin::FRAME_RATE,
        value_parser = values::frame_rate, allow_hyphen_values = true)]
    fps: f64,
    /// Width of the pictures. Height and focal length follow: 16:9, the same field of view
    #[arg(long, value_name = "PIXELS", default_value_t = nvsprior_basin::CAMERA.width,
        value_parser = clap::value_parser!(u32).range(LEAST_WIDTH..=i64::from(Camera::MAX_SIDE)))]
    width: u32,
    /// Quality of the difference pictures, 0 to 100
    #[arg(long, value_name = "Q", default_value_t = 20.0)]
    quality: f32,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Narrower pictures show too little of the scene to search by.
const LEAST_WIDTH: i64 = 160;
/// Frames that are searched by the paper's BFGS, too: it takes seconds for each.
const BFGS_FRAMES: usize = 1;

/// What `nvsprior demo` has decode its packets, in a process of its own.
#[derive(clap::Args)]
pub struct TopsideArgs {
    prior: PathBuf,
}

pub fn serve(args: &TopsideArgs) -> anyhow::Result<()> {
    nvsprior_demo::topside::serve(&args.prior)
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    values::make_folder("--out", &args.out)?;
    let runs = args.run.map_or(vec![Run::T1, Run::T2], |run| vec![run]);
    let site = runs[0].site();
    let dives =
        runs.into_iter().map(|run| Dive { rate: args.fps, ..Dive::of(run) }).collect::<Vec<_>>();
    if site == Site::Basin && !args.draw_only {
        return encode_basin(args, dives);
    }
    draw_dives(args, site, &dives)?;
    if site == Site::Basin {
        let prior = args.out.join("prior.nvsg");
        nvsprior::prior::replace_file(&prior, nvsprior_basin::PRIOR)?;
        say!("the prior is {}", prior.display());
    }
    Ok(())
}

/// The whole job, on the site whose prior comes with the program.
fn encode_basin(args: &Args, dives: Vec<Dive>) -> anyhow::Result<()> {
    let engine = args.device.open()?;
    let job = Job {
        out: args.out.clone(),
        camera: camera_of_width(args.width),
        dives,
        frames: args.frames.get(),
        bfgs_frames: BFGS_FRAMES,
        quality: args.quality,
    };
    nvsprior_demo::run(&job, &engine)?;
    args.device.check(&engine)
}

fn draw_dives(args: &Args, site: Site, dives: &[Dive]) -> anyhow::Result<()> {
    let camera = match site.has_lamps() {
        true => Rig::default().pinhole(args.width),
        false => camera_of_width(args.width),
    };
    for dive in dives {
        let bar = progress(args.frames.get(), "drawing an inspection run");
        draw_dive(&args.out, camera, dive, args.frames.get(), |_| bar.inc(1))?;
        bar.finish_and_clear();
        say!("the inspection run is in {}", args.out.join(dive.run.name()).display());
    }
    Ok(())
}
