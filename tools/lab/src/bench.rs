//! `nvsprior bench`: run time and error of a prior on a run of frames, in one report.

mod ablation;
mod codecs;
mod commands;
mod configurations;
pub(crate) mod context;
pub(crate) mod forward;
mod frame_times;
mod optimum;
mod paper;
pub(crate) mod perturbed;
mod plot;
mod poses;
mod print;
mod recovery;
pub(crate) mod report;
mod scaling;
mod similarity;
mod site;
mod sizes;
pub(crate) mod stages;
pub(crate) mod statistics;
pub(crate) mod steady;
mod tables;
pub(crate) mod trials;

use std::path::PathBuf;

use clap::builder::ArgPredicate;
use nvsprior::Prior;
use nvsprior::image::Preprocessor;
use nvsprior::tracking::Optimizer;
use nvsprior::vulkan::MemoryUse;

use context::{Context, OptimizerRun, Shot, host_bytes};
use forward::Forward;
use nvsprior_inputs::args::{DeviceArgs, OptimizerArg, PriorArgs, progress, with_progress};
use nvsprior_inputs::input::InputArgs;
use nvsprior_inputs::values;
pub use perturbed::even;
pub use plot::training as plot_training;
use report::Report;
pub use statistics::median;

/// Measure run time and error on a run of frames; times are in milliseconds and in forward renders
///
/// Looks for the best pose of each frame. Then measures a steady run, starts moved off by up to 3°
/// and 10°, the gradient methods, the device's time by stage, and many settings. Writes
/// report.json, tables (CSV) and plots (SVG), and prints it all. A search has failed if its render
/// stays more than 0.1 dB below that at the best known pose.
#[derive(clap::Args)]
#[command(
    mut_arg("prior", |arg| arg.required(false).required_unless_present("site")
        .default_value_if("site", ArgPredicate::IsPresent, NOT_GIVEN)),
    mut_arg("cameras", |arg| arg.required(false).required_unless_present("site")
        .default_value_if("site", ArgPredicate::IsPresent, NOT_GIVEN))
)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    /// Gradient methods to compare with Gauss–Newton, which is always measured
    #[arg(long, value_enum, value_delimiter = ',', default_value = "bfgs")]
    optimizers: Vec<OptimizerArg>,
    /// Frames that gradient methods are measured on, after a first one; 0: none
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = values::count)]
    bfgs_frames: usize,
    /// Starts moved off by up to 3°, and as many by up to 10°
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = values::count)]
    trials: usize,
    /// Frames that each setting is measured on, after a first one; 0: compare no settings
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = values::count)]
    configurations: usize,
    /// Also measure time against the number of splats (to 2 million) and pixels (to 1280×720)
    #[arg(long)]
    scaling: bool,
    #[command(flatten)]
    ablation: ablation::AblationArgs,
    #[command(flatten)]
    recovery: recovery::RecoveryArgs,
    #[command(flatten)]
    frame_times: frame_times::FrameTimesArgs,
    #[command(flatten)]
    codecs: codecs::CodecsArgs,
    #[command(flatten)]
    paper: paper::PaperArgs,
    #[command(flatten)]
    poses: poses::PosesArgs,
    #[command(flatten)]
    site: site::SiteArgs,
    #[command(flatten)]
    sizes: sizes::SizesArgs,
    /// See `nvsprior encode`
    #[arg(long, value_name = "MSE", default_value_t = 1e-3, value_parser = values::mse, allow_hyphen_values = true)]
    threshold: f64,
    /// Folder for report.json, tables and plots; made if it is missing
    #[arg(long, value_name = "DIR", default_value = "bench-out")]
    report: PathBuf,
    #[command(flatten)]
    device: DeviceArgs,
}

/// The prior and the cameras of a bench that needs none: no file has this name.
const NOT_GIVEN: &str = "/";

/// Measures, prints, and writes the report. `demo_prior`: what `--site` copies if no prior is given.
pub fn run(args: &Args, demo_prior: impl Fn() -> anyhow::Result<Prior>) -> anyhow::Result<()> {
    let folder = &args.report;
    values::make_folder("--report", folder)?;
    if args.site.site {
        let scene = || match args.prior.prior.as_os_str() == NOT_GIVEN {
            true => demo_prior(),
            false => args.prior.open(),
        };
        return site::run(&args.site, scene, &args.device, folder);
    }
    let (prior, input) = (&args.prior, &args.input);
    if args.sizes.sizes {
        return sizes::run(&args.sizes, prior, input, &args.device, folder);
    }
    let mut context = open(args, prior, input)?;
    if args.ablation.ablation {
        ablation::run(&args.ablation, &mut context, folder)?;
        return args.device.check(&context.engine);
    }
    if args.recovery.recovery {
        recovery::run(&args.recovery, &mut context, folder)?;
        return args.device.check(&context.engine);
    }
    if let Some(bound) = args.frame_times.frame_times {
        frame_times::run(bound, &mut context, folder)?;
        return args.device.check(&context.engine);
    }
    if args.codecs.codecs {
        codecs::run(&args.codecs, &mut context, folder)?;
        return args.device.check(&context.engine);
    }
    if args.paper.paper {
        paper::run(&args.paper, input, &mut context, folder)?;
        return args.device.check(&context.engine);
    }
    if let Some(conditions) = &args.poses.poses {
        poses::run(conditions, args.poses.poses_starts, &context, folder)?;
        return args.device.check(&context.engine);
    }
    let report = measure(args, &mut context)?;
    print::print(&context, &report);
    report::write(&folder.join("report.json"), &context, &report)?;
    tables::write(folder, &context, &report)?;
    plot::trace(&folder.join("trace.svg"), &report.runs)?;
    plot::trials(&folder.join("trials.svg"), &context, &report.trials())?;
    plot::roofline(&folder.join("roofline.svg"), &report.stages)?;
    if !report.configurations.is_empty() {
        plot::configurations(&folder.join("configurations.svg"), &report.configurations)?;
    }
    if !report.scaling.is_empty() {
        plot::scaling(&folder.join("scaling.svg"), &report.scaling)?;
    }
    args.device.check(&context.engine)
}

/// Reads the frames and uploads the prior.
fn open(args: &Args, prior: &PriorArgs, input: &InputArgs) -> anyhow::Result<Context> {
    prior.check_whole("for measurements")?;
    let prior = prior.open()?;
    let mut preprocessor = Preprocessor::new(prior.preprocessing());
    let read = |input| Shot::read(input, &mut preprocessor);
    let inputs = input.frames_from(args.paper.starts(input))?;
    let shots = inputs.iter().map(read).collect::<anyhow::Result<Vec<_>>>()?;
    anyhow::ensure!(shots.len() > 1, "one frame is no run, as the first one does not count");
    let engine = args.device.open()?;
    let scene = engine.upload(&prior)?;
    let forward = Forward::new(&engine, &scene);
    let (best, threshold, device_memory) = (Vec::new(), args.threshold, MemoryUse::default());
    Ok(Context { engine, prior, scene, shots, best, forward, threshold, device_memory })
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
    let mut scaling = Vec::new();
    if args.scaling {
        scaling = with_progress(scaling::COUNT, "sizes", |done| scaling::measure(context, done));
    }
    Ok(Report { runs, rates, near, far, stages, configurations, scaling, host_bytes_steady })
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
    let optimizers = args.optimizers.iter().map(|optimizer| Optimizer::from(*optimizer));
    let gradient = optimizers.filter(|optimizer| *optimizer != Optimizer::GaussNewton);
    let bar = progress(args.optimizers.len() * (frames + 1), "gradient methods");
    gradient
        .map(|optimizer| steady::descend(context, optimizer, frames + 1, || bar.inc(1)))
        .collect()
}
