//! `nvsprior-lab bench`, and the measurements beside it: run time and error of a prior on a run of frames.

pub mod ablation;
pub mod codecs;
mod commands;
mod configurations;
pub(crate) mod context;
pub(crate) mod forward;
pub mod frame_times;
mod optimum;
pub mod paper;
pub(crate) mod perturbed;
mod plot;
pub mod poses;
mod print;
pub mod recovery;
pub(crate) mod report;
pub mod scaling;
pub(crate) mod searcher;
mod similarity;
pub mod site;
pub mod sizes;
pub(crate) mod stages;
pub(crate) mod steady;
mod tables;
pub(crate) mod trials;

use std::path::{Path, PathBuf};

use nvsprior::image::Preprocessor;
use nvsprior::vulkan::MemoryUse;

use crate::args::{OPTIMIZERS, StepArg, check_origin};
use context::{Context, OptimizerRun, Shot, host_bytes};
use forward::Forward;
use nvsprior_inputs::args::{DeviceArgs, PriorArgs, progress, with_progress};
use nvsprior_inputs::input::{Input, InputArgs};
use nvsprior_inputs::values;
use nvsprior_paper::Optimizer;
use report::Report;

/// Measure run time and error on a run of frames; times are in milliseconds and in forward renders
///
/// Looks for the best pose of each frame. Then measures a steady run, starts moved off by up to 3°
/// and 10°, the gradient methods, the device's time by stage, and many settings. Writes
/// report.json, tables (CSV) and plots (SVG), and prints it all. A search has failed if its render
/// stays more than 0.1 dB below that at the best known pose.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
    /// Gradient methods to compare with Gauss–Newton, which is always measured
    #[arg(long, value_delimiter = ',', default_value = "bfgs", value_parser = values::named(&OPTIMIZERS))]
    optimizers: Vec<Optimizer>,
    /// Frames that gradient methods are measured on, after a first one; 0: none
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = values::count)]
    bfgs_frames: usize,
    /// Starts moved off by up to 3°, and as many by up to 10°
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = values::count)]
    trials: usize,
    /// Frames that each setting is measured on, after a first one; 0: compare no settings
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = values::count)]
    configurations: usize,
}

/// The run that is measured on, and where the report goes.
#[derive(clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    start: StartArgs,
    /// See `nvsprior encode`
    #[arg(long, value_name = "MSE", default_value_t = 1e-3, value_parser = values::mse, allow_hyphen_values = true)]
    threshold: f64,
    #[command(flatten)]
    report: ReportArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Where the first frame's search starts.
#[derive(clap::Args)]
pub struct StartArgs {
    /// Moves the first frame's start: ρx,ρy,ρz,θx,θy,θz in the prior's unit and degrees
    #[arg(long, value_name = "STEP", allow_hyphen_values = true)]
    start_offset: Option<StepArg>,
}

/// Where a report goes.
#[derive(clap::Args)]
pub struct ReportArgs {
    /// Folder for the report, its tables and plots; made if it is missing
    #[arg(long, value_name = "DIR", default_value = "bench-out")]
    report: PathBuf,
}

impl StartArgs {
    /// The frames of an input, the first one's start moved.
    pub fn move_first(&self, inputs: &mut [Input]) {
        let first = inputs.first_mut().and_then(|first| first.external.hint.as_mut());
        if let (Some(StepArg(offset)), Some(hint)) = (&self.start_offset, first) {
            hint.pose = hint.pose.stepped(offset);
        }
    }
}

impl ReportArgs {
    /// The folder, which is there then.
    fn folder(&self) -> anyhow::Result<&Path> {
        values::make_folder("--report", &self.report)?;
        Ok(&self.report)
    }
}

impl RunArgs {
    /// Reads the frames, uploads the prior, and measures into the report's folder.
    fn measured(
        &self,
        measure: impl FnOnce(&mut Context, &Path) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        self.measured_from(&self.input.starts, measure)
    }

    /// As [`RunArgs::measured`], with other poses from outside than `--starts` says.
    fn measured_from(
        &self,
        starts: &str,
        measure: impl FnOnce(&mut Context, &Path) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let folder = self.report.folder()?;
        let mut context = self.open(starts)?;
        measure(&mut context, folder)?;
        self.device.check(&context.engine)
    }

    fn open(&self, starts: &str) -> anyhow::Result<Context> {
        self.prior.check_whole("for measurements")?;
        let prior = self.prior.open()?;
        let mut preprocessor = Preprocessor::new(prior.preprocessing());
        let mut inputs = self.input.frames_from(starts)?;
        self.start.move_first(&mut inputs);
        let shots = inputs.iter().map(|input| Shot::read(input, &mut preprocessor));
        let shots = shots.collect::<anyhow::Result<Vec<_>>>()?;
        anyhow::ensure!(shots.len() > 1, "one frame is no run, as the first one does not count");
        let engine = self.device.open()?;
        let scene = engine.upload(&prior)?;
        check_origin(&scene)?;
        let forward = Forward::new(&engine, &scene);
        let (best, threshold) = (Vec::new(), self.threshold);
        let device_memory = MemoryUse::default();
        Ok(Context { engine, prior, scene, shots, best, forward, threshold, device_memory })
    }
}

/// Measures, prints, and writes the report.
pub fn run(args: &Args) -> anyhow::Result<()> {
    args.run.measured(|context, folder| {
        let report = measure(args, context)?;
        print::print(context, &report);
        report::write(&folder.join("report.json"), context, &report)?;
        tables::write(folder, context, &report)?;
        plot::trace(&folder.join("trace.svg"), &report.runs)?;
        plot::trials(&folder.join("trials.svg"), context, &report.trials())?;
        plot::roofline(&folder.join("roofline.svg"), &report.stages)?;
        if !report.configurations.is_empty() {
            plot::configurations(&folder.join("configurations.svg"), &report.configurations)?;
        }
        Ok(())
    })
}

fn measure(args: &Args, context: &mut Context) -> anyhow::Result<Report> {
    let frames = context.shots.len();
    optimum::find(context)?;
    let samples = with_progress(frames, "steady run", |done| {
        steady::measure(context, context.options(), frames, || always(done))
    })?;
    let rates = steady::rates(context)?;
    let host_bytes_steady = host_bytes();
    let mut runs = vec![OptimizerRun { optimizer: Optimizer::GaussNewton, samples }];
    let mut off = |what, magnitude| {
        with_progress(args.trials, what, |done| {
            trials::measure(context, magnitude, args.trials, || always(done))
        })
    };
    let near = off("starts put off a little", perturbed::NEAR)?;
    let far = off("starts put off", perturbed::FAR)?;
    runs.extend(gradient(args, context)?);
    let stages = stages::measure(context)?;
    let mut configurations = Vec::new();
    if args.configurations > 0 {
        configurations = with_progress(configurations::count(context), "settings", |done| {
            configurations::measure(context, args.configurations, &runs, done)
        })?;
    }
    Ok(Report { runs, rates, near, far, stages, configurations, host_bytes_steady })
}

/// Goes on after each part.
fn always(done: &dyn Fn()) -> bool {
    done();
    true
}

fn gradient(args: &Args, context: &mut Context) -> anyhow::Result<Vec<OptimizerRun>> {
    let frames = args.bfgs_frames.min(context.shots.len() - 1);
    if frames == 0 {
        return Ok(Vec::new());
    }
    let optimizers = args.optimizers.iter().copied();
    let gradient = optimizers.filter(|optimizer| *optimizer != Optimizer::GaussNewton);
    let bar = progress(args.optimizers.len() * (frames + 1), "gradient methods");
    gradient
        .map(|optimizer| steady::descend(context, optimizer, frames + 1, || bar.inc(1)))
        .collect()
}
