//! `nvsprior map`: a prior trained on the device from the posed pictures of a mapping run.

mod course;
mod inputs;
mod memory;
mod report;
mod saved;
mod structure;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use nvsprior::prior::compact::Quantisation;
use nvsprior::prior::replace_file;
use nvsprior::{Camera, Engine, Prior};
use nvsprior_inputs::args::{DeviceArgs, OverrideArgs};
use nvsprior_inputs::values;
use nvsprior_lab::bench::median;
use nvsprior_train::mapper::{MapOptions, Mapper};

use crate::container::Container;
use crate::key_frames;
use crate::picture_renderer::PictureRenderer;
use course::{Budget, Course};
use inputs::{InputArgs, MapInputs};
use report::Report;
use saved::Saved;
use structure::StructureArgs;

/// Train a prior from posed pictures
///
/// 3D Gaussian Splatting on any Vulkan device, by the renderer that will draw the prior: the splats of a fixed budget
/// move to where pictures need them (3DGS-MCMC). Progress shows PSNR on pictures that are held out. The state is saved
/// now and then beside the prior (OUT.training): the same command with --resume goes on from there, to the same prior.
/// For pictures without poses (PICTURES in place of --cameras), COLMAP is run first.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    structure: StructureArgs,
    #[command(flatten)]
    inputs: InputArgs,
    /// Most splats
    #[arg(long, value_name = "N", default_value_t = 40_000,
        value_parser = clap::value_parser!(u32).range(1..=16_000_000))]
    splats: u32,
    /// Degree of the spherical harmonics: how much colours may depend on the direction
    #[arg(long, value_name = "0-3", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=3))]
    sh_degree: u32,
    /// Steps, each towards one picture [default: 8000]
    #[arg(long, value_name = "N", conflicts_with = "minutes",
        value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    iterations: Option<u32>,
    /// Train for so long instead
    #[arg(long, value_name = "M", value_parser = minutes)]
    minutes: Option<f64>,
    /// Share of SSIM in the loss, beside the error of each value
    #[arg(long, value_name = "SHARE", default_value_t = 0.2, value_parser = values::share)]
    ssim: f32,
    /// Errors below it, of 1, count by their squares, larger ones as they are (Huber's loss); 0: all as they are
    #[arg(long, value_name = "ERROR", default_value_t = 0.1, value_parser = values::share)]
    knee: f32,
    /// Fit each picture's light, and train on the pictures without it: for lamps and daylight that change
    #[arg(long)]
    exposure: bool,
    /// Correct the pictures' poses by the prior, now and then
    #[arg(long)]
    correct_poses: bool,
    /// Seed of all that is random
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// The prior: .ply (as Splatfacto writes it) or .nvsg (compact)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Go on from the state that an interrupted run left beside OUT
    #[arg(long)]
    resume: bool,
    /// Seconds between saved states
    #[arg(long, value_name = "SECONDS", default_value_t = 60,
        value_parser = clap::value_parser!(u32).range(0..=86_400))]
    save_every: u32,
    /// Folder for report.json, curve.csv, curve.svg and preview.png
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

fn minutes(text: &str) -> Result<f64, String> {
    let value = values::positive(text)?;
    if value <= 100_000.0 { Ok(value) } else { Err("must lie between 0 and 100,000".into()) }
}

/// Steps of a compact prior's quantisation, as multiples of the usual ones, which cost bytes of every packet
/// (docs/decisions.md, 14).
const FINENESS: f32 = 0.25;
/// Steps if neither their number nor a time is given.
const ITERATIONS: u32 = 8_000;

impl Args {
    fn options(&self) -> MapOptions {
        let mut options = MapOptions {
            render: self.overrides.overrides().over(MapOptions::default().render),
            splats: self.splats,
            sh_degree: self.sh_degree,
            exposure: self.exposure,
            correct_poses: self.correct_poses,
            seed: self.seed,
            ..MapOptions::default()
        };
        options.schedule.ssim = self.ssim;
        options.schedule.knee = self.knee;
        options
    }

    fn budget(&self) -> Budget {
        match self.minutes {
            Some(minutes) => Budget::Seconds(60.0 * minutes),
            None => Budget::Iterations(self.iterations.unwrap_or(ITERATIONS)),
        }
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let container = Container::of(&args.out, Quantisation::default().scaled(FINENESS))?;
    let options = args.options();
    options.render.check()?;
    saved::check_out(&args.out)?;
    if let Some(folder) = &args.report {
        saved::check_report(folder)?;
    }
    args.inputs.check()?;
    let engine = args.device.open()?;
    let preprocessing = args.inputs.preprocessing();
    let found = args.structure.find(&args.out, args.inputs.masks())?;
    let listed = args.inputs.list(found)?;
    memory::check(&engine, &listed, &options)?;
    let MapInputs { train, held_out, points } = args.inputs.read(listed)?;
    let fingerprint = inputs::fingerprint(&train, &points, &options, &args.budget());
    let mut mapper = Mapper::new(&engine, train, &points, &options)?;
    let saved = Saved::beside(&args.out, fingerprint);
    if args.resume {
        saved.resume(&mut mapper)?;
    }
    let save = |mapper: &Mapper| saved.save(mapper);
    let mut report = Report::new(args.report.as_deref(), held_out);
    let save_every = Duration::from_secs(args.save_every.into());
    Course { budget: args.budget(), save: &save, save_every }.run(&mut mapper, &mut report)?;
    let splats = mapper.splats()?;
    let cameras = mapper.views().iter().map(|view| view.camera);
    let views: Vec<_> = cameras.zip(mapper.poses().iter().copied()).collect();
    let key_frames = key_frames::of_run(&splats, options.render.near, &views)?;
    let bytes = container.write(&splats, &options.render, &key_frames, None, &preprocessing)?;
    replace_file(&args.out, &bytes)?;
    // A prior is there: what was saved on the way to it is not needed any more.
    saved.remove()?;
    let prior = Prior::open(&args.out, &Default::default())?;
    let forward = forward_seconds(&engine, &prior, &mapper)?;
    report.finish(&mut mapper, prior.len(), forward)?;
    println!("{}: {} splats, {} bytes", args.out.display(), prior.len(), bytes.len());
    args.device.check(&engine)
}

/// Seconds of a forward render of the prior, the median of some.
fn forward_seconds(engine: &Engine, prior: &Prior, mapper: &Mapper) -> anyhow::Result<f64> {
    const RENDERS: usize = 30;
    let mut renderer = PictureRenderer::new(engine, prior)?;
    let camera: Camera = mapper.views()[0].camera;
    let mut times = Vec::new();
    for view in mapper.views().iter().cycle().take(RENDERS) {
        let start = Instant::now();
        renderer.render(&camera, &view.pose)?;
        times.push(start.elapsed().as_secs_f64());
    }
    Ok(median(times))
}
