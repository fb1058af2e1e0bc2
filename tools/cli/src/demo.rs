//! `nvsprior demo`: the whole job on the embedded scene, and runs of the scenes that are only drawn.

mod drawing;
mod rig;
mod video;

use std::num::NonZeroUsize;
use std::path::PathBuf;

use nvsprior_basin::{Conditions, Dive, Site};
use nvsprior_demo::{Job, draw_dive};
use nvsprior_inputs::args::{DeviceArgs, progress};
use nvsprior_inputs::values;

use drawing::{SceneArgs, draw_mapping_run};
use rig::CourseArg;
use video::VideoArgs;

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
    /// How many of them are searched by the paper's BFGS, too: it takes seconds for each
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = values::count)]
    bfgs_frames: usize,
    /// Quality of the difference pictures, 0 to 100
    #[arg(long, value_name = "Q", default_value_t = 20.0)]
    quality: f32,
    /// Also draws this many views from random places of the basin, to test the search for lost
    /// cameras (`nvsprior bench --lost`)
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = values::count)]
    views: usize,
    #[command(flatten)]
    scene: SceneArgs,
    /// Only draws the site's mapping run, M1, M2, M3 or M4, that a prior is trained from
    #[arg(long, conflicts_with_all = ["run", "draw_only"])]
    mapping_run: bool,
    /// Course of the tower's mapping run; both if it is not there
    #[arg(long, value_name = "COURSE", value_enum, requires = "mapping_run")]
    course: Option<CourseArg>,
    /// Only draws: writes each run's frames and camera file, beside them the basin's prior, and opens no device
    #[arg(long)]
    draw_only: bool,
    #[command(flatten)]
    video: VideoArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// What `nvsprior demo` has decode its packets, in a process of its own.
#[derive(clap::Args)]
pub struct TopsideArgs {
    prior: PathBuf,
}

pub fn serve(args: &TopsideArgs) -> anyhow::Result<()> {
    nvsprior_demo::topside::serve(&args.prior)
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(file) = args.video.file() {
        return args.video.draw(file);
    }
    values::make_folder("--out", &args.out)?;
    let site = args.scene.site()?;
    if args.mapping_run {
        let run = args.scene.mapping_run(args.course)?;
        return draw_mapping_run(&args.out, args.scene.camera()?, run);
    }
    let dives = args.scene.dives()?;
    if site == Site::Basin && !args.draw_only {
        encode_basin(args, dives)?;
    } else {
        draw_dives(args, &dives)?;
    }
    if site == Site::Basin && args.draw_only {
        let prior = args.out.join("prior.nvsg");
        nvsprior::prior::replace_file(&prior, nvsprior_basin::PRIOR)?;
        println!("the prior is {}", prior.display());
    }
    draw_views(args)
}

/// The whole job, on the site whose prior comes with the program.
fn encode_basin(args: &Args, dives: Vec<Dive>) -> anyhow::Result<()> {
    let engine = args.device.open()?;
    let job = Job {
        out: args.out.clone(),
        camera: args.scene.camera()?,
        dives,
        frames: args.frames.get(),
        bfgs_frames: args.bfgs_frames,
        quality: args.quality,
    };
    nvsprior_demo::run(&job, &engine)?;
    args.device.check(&engine)
}

fn draw_dives(args: &Args, dives: &[Dive]) -> anyhow::Result<()> {
    for dive in dives {
        let bar = progress(args.frames.get(), "drawing an inspection run");
        draw_dive(&args.out, args.scene.camera()?, dive, args.frames.get(), |_| bar.inc(1))?;
        bar.finish_and_clear();
        println!("the inspection run is in {}", args.out.join(dive.run.name()).display());
    }
    Ok(())
}

/// Draws the views from random places, if any are asked for.
fn draw_views(args: &Args) -> anyhow::Result<()> {
    if args.views == 0 {
        return Ok(());
    }
    let camera = args.scene.camera()?;
    let bar = progress(args.views, "drawing random views");
    let views = nvsprior_basin::random_views(camera, args.views, Conditions::CALM);
    nvsprior_basin::write_run(&args.out.join("views"), "views", camera, views, |_| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(())
}
