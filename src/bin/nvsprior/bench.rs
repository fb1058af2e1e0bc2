//! `nvsprior bench`: error against run time, for every optimiser, and time by stage.

mod plot;
mod report;

use std::path::PathBuf;

use anyhow::Context;
use nvsprior::refine::{Evaluation, Optimizer};
use nvsprior::render::{Jacobian, Job, Plan};
use nvsprior::vulkan::StageTime;
use nvsprior::{Encoder, EncoderOptions, Engine, FrameStats};

use crate::args::{DeviceArgs, OptimizerArg, PriorArgs, progress};
use crate::encode::{Input, InputArgs};

/// Measure error against run time: for each optimiser the PSNR reached after each render
///
/// Encodes the same frames with each optimiser, and writes every evaluation (bench.csv, bench.json)
/// and a plot (bench.svg). Prints the means and the device's time by stage.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    /// Optimisers to compare
    #[arg(long, value_enum, value_delimiter = ',', default_value = "gauss-newton,bfgs")]
    optimizers: Vec<OptimizerArg>,
    /// See `nvsprior encode`
    #[arg(long, value_name = "MSE", default_value_t = 1e-3)]
    threshold: f64,
    /// Folder for bench.csv, bench.json, bench.svg; made where it is missing
    #[arg(long, value_name = "DIR", default_value = "bench-out")]
    out: PathBuf,
    #[command(flatten)]
    device: DeviceArgs,
}

/// One frame's refinement.
struct FrameRun {
    file: String,
    trace: Vec<Evaluation>,
    stats: FrameStats,
}

/// All frames with one optimiser.
struct OptimizerRun {
    optimizer: Optimizer,
    frames: Vec<FrameRun>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let inputs = args.input.frames()?;
    let first = &inputs[0];
    let engine = args.device.open()?;
    let prior = args.prior.open()?;
    let scene = engine.upload(&prior)?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("making {}", args.out.display()))?;
    let bar = progress(inputs.len() * args.optimizers.len(), "measuring");
    let mut runs = Vec::new();
    for &optimizer in &args.optimizers {
        let mut options = EncoderOptions { threshold: args.threshold, ..Default::default() };
        options.refine.optimizer = optimizer.into();
        let optimizer = options.refine.optimizer;
        let mut encoder = Encoder::new(&engine, &scene, &first.camera, options)?;
        let mut frames = Vec::new();
        for input in &inputs {
            frames.push(measure(&mut encoder, input)?);
            bar.inc(1);
        }
        runs.push(OptimizerRun { optimizer, frames });
    }
    bar.finish_and_clear();
    report::print(&runs);
    let stages = stage_times(&engine, &scene, first)?;
    report::print_stages(&stages);
    report::write(&args.out, engine.device(), &runs, &stages)?;
    plot::write(&args.out.join("bench.svg"), &runs)?;
    args.device.check(&engine)
}

fn measure(encoder: &mut Encoder, input: &Input) -> anyhow::Result<FrameRun> {
    let (_, encoded) = input.encode(encoder)?;
    let trace = encoder.trace().to_vec();
    Ok(FrameRun { file: input.file.clone(), trace, stats: encoded.stats })
}

/// Renders whose stage times are averaged.
const STAGE_RUNS: u32 = 10;

/// Mean device times of the stages: of a picture, and of the normal equations with each Jacobian.
struct Stages {
    picture: Vec<StageTime>,
    flow: Vec<StageTime>,
    exact: Vec<StageTime>,
}

fn stage_times(
    engine: &Engine,
    scene: &std::sync::Arc<nvsprior::render::Scene>,
    input: &Input,
) -> anyhow::Result<Stages> {
    let pose = input.external.context("the first frame has no pose to time renders at")?;
    let jacobians = vec![Jacobian::Flow, Jacobian::Exact];
    let plan = Plan { factors: vec![1], jacobians, search: None, profiled: true };
    let mut renderer = engine.renderer(scene, &input.camera, plan)?;
    let mut mean = |jacobian: Option<Jacobian>| -> anyhow::Result<Vec<StageTime>> {
        let mut sums: Vec<StageTime> = Vec::new();
        // The first run is not counted: drivers finish their work at first use.
        for run in 0..=STAGE_RUNS {
            match jacobian {
                None => renderer.draw(&pose).map(|_| ())?,
                Some(jacobian) => renderer.normal_equations(0, jacobian, &pose).map(|_| ())?,
            }
            let job = jacobian.map_or(Job::Draw, Job::Sums);
            let times = renderer.stage_times(job)?;
            if run > 0 {
                add_by_name(&mut sums, &times);
            }
        }
        for stage in &mut sums {
            stage.milliseconds /= f64::from(STAGE_RUNS);
        }
        Ok(sums)
    };
    Ok(Stages {
        picture: mean(None)?,
        flow: mean(Some(Jacobian::Flow))?,
        exact: mean(Some(Jacobian::Exact))?,
    })
}

/// Adds times to those of the same name: a sort's passes count as one stage.
fn add_by_name(sums: &mut Vec<StageTime>, times: &[StageTime]) {
    for time in times {
        match sums.iter_mut().find(|sum| sum.name == time.name) {
            Some(sum) => sum.milliseconds += time.milliseconds,
            None => sums.push(time.clone()),
        }
    }
}
