//! `nvsprior map`: a prior trained on the device from the posed pictures of a mapping run.

mod budget;
mod check;
mod course;
mod from;
mod inputs;
mod memory;
mod parts;
mod rehearsal;
mod report;
mod run;
mod saved;
mod shown;
mod sides;
mod structure;
mod video;
mod worth;

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::builder::ArgPredicate;
use nvsprior::{Engine, Prior};
use nvsprior_inputs::args::{DeviceArgs, OverrideArgs};
use nvsprior_inputs::statistics::median;
use nvsprior_inputs::values;
use nvsprior_train::mapper::{MapOptions, Mapper};

use crate::picture_renderer::{PictureRenderer, timed};
use budget::Budget;
use course::Course;
use from::FromArgs;
use inputs::{InputArgs, MapInputs};
use report::Report;
pub use run::run;
use saved::Saved;
use structure::StructureArgs;
use video::VideoArgs;

/// Train a prior from posed pictures
///
/// 3D Gaussian Splatting on any Vulkan device, by the renderer that will draw the prior: the splats of a fixed budget
/// move to where pictures need them (3DGS-MCMC). Progress shows PSNR on pictures that are held out. The state is saved
/// now and then beside the prior (OUT.training): the same command with --resume goes on from there, to the same prior.
/// For pictures without poses (PICTURES in place of --cameras), COLMAP is run first; PICTURES may be a video. --from
/// goes on with a prior, by the pictures of a later dive.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    inputs: InputArgs,
    /// Most splats [default: 40000; with --from a tenth more than that prior has]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16_000_000))]
    splats: Option<u32>,
    /// Degree of the spherical harmonics: how much colours may depend on the direction [default: 1]
    #[arg(long, value_name = "0-3", value_parser = clap::value_parser!(u32).range(0..=3))]
    sh_degree: Option<u32>,
    /// Steps, each towards one picture [default: 8000; with --from 600]
    #[arg(long, value_name = "N", conflicts_with = "minutes",
        value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    iterations: Option<u32>,
    /// Train for so long instead
    #[arg(long, value_name = "M", value_parser = minutes)]
    minutes: Option<f64>,
    /// Errors below it, of 1, count by their squares, larger ones as they are (Huber's loss); 0: all as they are
    #[arg(long, value_name = "ERROR", default_value_t = 0.1, value_parser = values::share)]
    knee: f32,
    /// Fit each picture's light, and train on the pictures without it: for lamps and daylight that change
    #[arg(long)]
    exposure: bool,
    /// Correct the pictures' poses by the prior, now and then
    #[arg(long)]
    correct_poses: bool,
    /// Train the run in so many parts along it, one after the other, in the memory of one part. --splats and
    /// --iterations are then for each part
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=1000),
        conflicts_with_all = ["from", "exposure", "correct_poses"])]
    parts: Option<u16>,
    /// Part of the training, 0 to 1, that is spent once more to learn how far off poses will be on a dive: without some
    /// stretches of the run, whose pictures are then looked for. The prior keeps it; 0: not measured
    #[arg(long, value_name = "SHARE", default_value_t = 0.3, value_parser = values::share)]
    rehearsal: f32,
    /// Seed of all that is random
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// Read all pictures, cameras, masks and frames, say what counts and what cannot be used, and train nothing
    #[arg(long)]
    check: bool,
    /// The prior: .nvsg or .nvsb, with all that belongs to it, or .ply, its splats alone as Splatfacto writes them
    #[arg(
        long,
        value_name = "FILE",
        required = false,
        required_unless_present = "check",
        default_value_if("check", ArgPredicate::IsPresent, "checked.nvsg")
    )]
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
    // Their headings hold for all that follows.
    #[command(flatten)]
    structure: StructureArgs,
    #[command(flatten)]
    video: VideoArgs,
    #[command(flatten)]
    from: FromArgs,
}

fn minutes(text: &str) -> Result<f64, String> {
    let value = values::positive(text)?;
    if value <= 100_000.0 { Ok(value) } else { Err("must lie between 0 and 100,000".into()) }
}

/// Steps if neither their number nor a time is given.
const ITERATIONS: u32 = 8_000;

impl Args {
    /// `from`: the prior that the training goes on with.
    fn options(&self, from: Option<&Prior>) -> MapOptions {
        let new = MapOptions::default();
        let mut options = MapOptions {
            render: self.overrides.overrides().over(new.render),
            splats: self.splats.unwrap_or(new.splats),
            sh_degree: self.sh_degree.unwrap_or(new.sh_degree),
            exposure: self.exposure,
            correct_poses: self.correct_poses,
            seed: self.seed,
            ..MapOptions::default()
        };
        options.schedule.knee = self.knee;
        match from {
            Some(prior) => self.from.options(prior, self.splats, options),
            None => options,
        }
    }

    fn budget(&self, from: Option<&Prior>) -> Budget {
        let usual = if from.is_some() { from::ITERATIONS } else { ITERATIONS };
        match self.minutes {
            Some(minutes) => Budget::Seconds(60.0 * minutes),
            None => Budget::Iterations(self.iterations.unwrap_or(usual)),
        }
    }

    /// What is spent on a rehearsal; `None`: there is none. A prior that is gone on with keeps what it was worth.
    fn rehearsal(&self, from: &Option<Prior>) -> Option<Budget> {
        let wanted = self.rehearsal > 0.0 && from.is_none();
        wanted.then(|| self.budget(None).times(self.rehearsal.into()))
    }

    fn save_every(&self) -> Duration {
        Duration::from_secs(self.save_every.into())
    }
}

/// A training from nothing.
struct Training<'a> {
    args: &'a Args,
    engine: &'a Engine,
    options: &'a MapOptions,
    budget: Budget,
}

impl Training<'_> {
    /// Trains until the budget is used up. The state is saved beside `out`, and an earlier one gone on with if that was
    /// asked for.
    fn train(
        &self,
        out: &Path,
        report: Option<&Path>,
        mut inputs: MapInputs,
    ) -> anyhow::Result<(Mapper, Report)> {
        let Training { args, engine, options, budget } = *self;
        let saved = Saved::beside(out, inputs::fingerprint(&inputs, options, &budget));
        let held_out = inputs.whole_run();
        let mut mapper = Mapper::new(engine, inputs.train, &inputs.points, options)?;
        mapper.hold_out(&held_out);
        let mut report = Report::new(report, inputs.held_out);
        if args.resume {
            saved.resume(&mut mapper)?;
        }
        let save = |mapper: &Mapper| saved.save(mapper);
        let save_every = args.save_every();
        Course { budget, save: &save, save_every }.run(&mut mapper, &mut report)?;
        Ok((mapper, report))
    }
}

/// Seconds of a forward render of the prior, the median of some.
fn forward_seconds(engine: &Engine, prior: &Prior, mapper: &Mapper) -> anyhow::Result<f64> {
    const RENDERS: usize = 30;
    let mut renderer = PictureRenderer::new(engine, prior)?;
    let camera = mapper.views()[0].camera;
    let views = mapper.views().iter().cycle().take(RENDERS);
    let times = views.map(|view| timed(&mut renderer, &camera, &view.pose));
    Ok(median(times.collect::<anyhow::Result<Vec<f64>>>()?) / 1e3)
}
