//! `report.json`: other programs rely on its names. It has medians and 95th percentiles.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::commands::FrameCommands;
use super::configurations::{Row, recommended};
use super::context::{Best, Context, OptimizerRun, Sample, Shot, host_bytes};
use super::perturbed::SHORT;
use super::stages::{Stage, Stages};
use super::steady::Rates;
use crate::ceilings::Ceilings;
use nvsprior_inputs::report::write_json;
use nvsprior_inputs::statistics::Spread;

pub struct Report {
    /// The steady run, then gradient methods on the first frames of the same.
    pub runs: Vec<OptimizerRun>,
    pub rates: Rates,
    pub near: Vec<Sample>,
    pub far: Vec<Sample>,
    pub stages: Stages,
    pub configurations: Vec<Row>,
    /// Peak of host memory when the steady run was done, bytes.
    pub host_bytes_steady: Option<u64>,
}

impl Report {
    /// The steady run with Gauss–Newton.
    pub fn steady(&self) -> &[Sample] {
        &self.runs[0].samples
    }

    /// The names and samples of the kinds of trials.
    pub fn trials(&self) -> [(&'static str, &[Sample]); 2] {
        [("perturbed_3deg", &self.near), ("perturbed_10deg", &self.far)]
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    pub frame_ms: f64,
    pub frame_ms_p95: f64,
    pub in_forward_renders: f64,
    pub in_forward_renders_p95: f64,
    pub failures: usize,
    pub trials: usize,
    pub db_short: Spread,
    /// Distance from the best known pose, the prior's unit.
    pose_error_units: Spread,
    /// Angle to it.
    pose_error_degrees: Spread,
    submissions: Spread,
    /// Evaluations and pictures by level, finest first, means.
    #[serde(rename = "renders_by_level")]
    pub renders: Vec<f64>,
}

impl Figures {
    pub fn of(context: &Context, samples: &[Sample]) -> Figures {
        let spread = |figure: &dyn Fn(&Sample) -> f64| Spread::of(samples.iter().map(figure));
        let levels = samples.iter().map(|s| s.stats.renders.len()).max().unwrap_or(0);
        let of_level = |level: usize| {
            let count = |s: &Sample| s.stats.renders.get(level).copied().map_or(0.0, f64::from);
            samples.iter().map(count).sum::<f64>() / samples.len() as f64
        };
        let frame_ms = spread(&Sample::frame_ms);
        let in_forward_renders = spread(&Sample::in_forward_renders);
        Figures {
            frame_ms: frame_ms.median,
            frame_ms_p95: frame_ms.p95,
            in_forward_renders: in_forward_renders.median,
            in_forward_renders_p95: in_forward_renders.p95,
            // A figure that is no number has not been reached either.
            failures: samples.iter().filter(|s| !(context.short(s) <= SHORT)).count(),
            trials: samples.len(),
            db_short: spread(&|s| context.short(s)),
            pose_error_units: spread(&|s| context.pose_error(s)[0]),
            pose_error_degrees: spread(&|s| context.pose_error(s)[1]),
            submissions: spread(&|s| f64::from(s.stats.submissions)),
            renders: (0..levels).map(of_level).collect(),
        }
    }
}

/// Mean squared error, values in [0, 1], of a PSNR.
pub fn mse(psnr: f64) -> f64 {
    10f64.powf(-0.1 * psnr)
}

/// Mean final errors of a gradient method and of Gauss–Newton on the same frames.
pub fn errors(run: &OptimizerRun, steady: &[Sample]) -> [f64; 2] {
    let mean = |samples: &[Sample]| {
        let sum: f64 = samples.iter().map(|s| mse(s.stats.render_psnr)).sum();
        sum / samples.len() as f64
    };
    [mean(&run.samples), mean(&steady[..run.samples.len()])]
}

#[derive(Serialize)]
struct Root<'a> {
    #[serde(flatten)]
    about: About,
    best_known: Vec<BestKnown<'a>>,
    device_memory_bytes: u64,
    device_memory_used_bytes: u64,
    forward_render_ms_p95: f64,
    steady: Steady,
    #[serde(flatten)]
    trials: BTreeMap<&'static str, Figures>,
    #[serde(flatten)]
    gradient: BTreeMap<&'static str, Gradient>,
    host_memory_bytes_steady: Option<u64>,
    host_memory_bytes: Option<u64>,
    ceilings: Ceilings,
    stages: &'a [Stage],
    commands: FrameCommands,
    configurations: &'a [Row],
    recommended: Option<&'a str>,
}

/// What was measured on: the head of several reports.
#[derive(Serialize)]
pub struct About {
    device: String,
    frames: usize,
    splats: usize,
    size: [u32; 2],
    forward_render_ms: f64,
}

impl About {
    pub fn of(context: &Context) -> About {
        let camera = &context.shots[0].camera;
        About {
            device: context.engine.device().to_string(),
            frames: context.shots.len(),
            splats: context.prior.splats().len(),
            size: [camera.width, camera.height],
            forward_render_ms: Spread::of(context.forward.times.iter().copied()).median,
        }
    }
}

/// PSNR of a frame at its best known pose.
#[derive(Serialize)]
pub struct BestPsnr<'a> {
    file: &'a str,
    psnr: f64,
}

impl<'a> BestPsnr<'a> {
    /// Of each frame.
    pub fn all(context: &'a Context) -> Vec<BestPsnr<'a>> {
        let of = |(shot, best): (&'a Shot, &Best)| BestPsnr { file: &shot.file, psnr: best.psnr };
        context.shots.iter().zip(&context.best).map(of).collect()
    }
}

#[derive(Serialize)]
struct BestKnown<'a> {
    #[serde(flatten)]
    psnr: BestPsnr<'a>,
    qvec: [f64; 4],
    tvec: [f64; 3],
}

#[derive(Serialize)]
struct Steady {
    #[serde(flatten)]
    figures: Figures,
    code_ms: Spread,
    bytes_quality_10: Spread,
    render_psnr: Spread,
    psnr: Spread,
    #[serde(flatten)]
    rates: Rates,
}

impl Steady {
    fn of(context: &Context, report: &Report) -> Steady {
        let samples = report.steady();
        let spread = |figure: &dyn Fn(&Sample) -> f64| Spread::of(samples.iter().map(figure));
        Steady {
            figures: Figures::of(context, samples),
            code_ms: spread(&|s| s.stats.code_milliseconds),
            bytes_quality_10: spread(&|s| s.stats.bytes as f64),
            render_psnr: spread(&|s| s.stats.render_psnr),
            psnr: spread(&|s| s.stats.psnr),
            rates: report.rates,
        }
    }
}

/// A gradient method's figures, and its mean final error beside Gauss–Newton's.
#[derive(Serialize)]
struct Gradient {
    #[serde(flatten)]
    figures: Figures,
    mse: f64,
    gauss_newton_mse: f64,
}

/// Writes `report.json`.
pub fn write(path: &Path, context: &Context, report: &Report) -> anyhow::Result<()> {
    let known = |(psnr, best): (_, &Best)| {
        let (qvec, tvec) = (best.pose.wxyz(), best.pose.translation.to_array());
        BestKnown { psnr, qvec, tvec }
    };
    let gradient = |run: &OptimizerRun| {
        let [mse, gauss_newton_mse] = errors(run, report.steady());
        let figures = Figures::of(context, &run.samples);
        (run.optimizer.name(), Gradient { figures, mse, gauss_newton_mse })
    };
    let trials = report.trials().map(|(name, samples)| (name, Figures::of(context, samples)));
    let root = Root {
        about: About::of(context),
        best_known: BestPsnr::all(context).into_iter().zip(&context.best).map(known).collect(),
        device_memory_bytes: context.device_memory.reserved,
        device_memory_used_bytes: context.device_memory.used,
        forward_render_ms_p95: Spread::of(context.forward.times.iter().copied()).p95,
        steady: Steady::of(context, report),
        trials: trials.into(),
        gradient: report.runs[1..].iter().map(gradient).collect(),
        host_memory_bytes_steady: report.host_bytes_steady,
        host_memory_bytes: host_bytes(),
        ceilings: report.stages.ceilings,
        stages: &report.stages.stages,
        commands: report.stages.commands,
        configurations: &report.configurations,
        recommended: recommended(&report.configurations).map(|row| row.name.as_str()),
    };
    write_json(path, &root)
}
