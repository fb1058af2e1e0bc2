//! `report.json`: other programs rely on its names. It has medians and 95th percentiles.

use std::path::Path;

use anyhow::Context as _;
use serde_json::{Map, Value, json};

use super::configurations::{Row, recommended};
use super::context::{Best, Context, OptimizerRun, Sample, Shot, host_bytes};
use super::perturbed::SHORT;
use super::scaling;
use super::stages::{Stage, Stages};
use super::statistics::Spread;
use super::steady::Rates;

/// All that was measured.
pub struct Report {
    /// The steady run, then gradient methods on the first frames of the same.
    pub runs: Vec<OptimizerRun>,
    pub rates: Rates,
    pub near: Vec<Sample>,
    pub far: Vec<Sample>,
    pub stages: Stages,
    pub configurations: Vec<Row>,
    pub scaling: Vec<scaling::Row>,
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

/// The figures of some samples.
pub struct Figures {
    pub frame_ms: Spread,
    pub in_forward_renders: Spread,
    pub db_short: Spread,
    /// Distance from the best known pose, the prior's unit.
    pub units: Spread,
    /// Angle to it, degrees.
    pub degrees: Spread,
    pub submissions: Spread,
    /// Evaluations and pictures by level, finest first, means.
    pub renders: Vec<f64>,
    pub failures: usize,
    pub trials: usize,
}

impl Figures {
    pub fn of(context: &Context, samples: &[Sample]) -> Figures {
        let spread = |figure: &dyn Fn(&Sample) -> f64| Spread::of(samples.iter().map(figure));
        let levels = samples.iter().map(|s| s.stats.renders.len()).max().unwrap_or(0);
        let of_level = |level: usize| {
            let count = |s: &Sample| s.stats.renders.get(level).copied().map_or(0.0, f64::from);
            samples.iter().map(count).sum::<f64>() / samples.len() as f64
        };
        Figures {
            frame_ms: spread(&Sample::frame_ms),
            in_forward_renders: spread(&Sample::in_forward_renders),
            db_short: spread(&|s| context.short(s)),
            units: spread(&|s| context.pose_error(s)[0]),
            degrees: spread(&|s| context.pose_error(s)[1]),
            submissions: spread(&|s| f64::from(s.stats.submissions)),
            renders: (0..levels).map(of_level).collect(),
            // A figure that is no number has not been reached either.
            failures: samples.iter().filter(|s| !(context.short(s) <= SHORT)).count(),
            trials: samples.len(),
        }
    }

    fn json(&self) -> Map<String, Value> {
        let entries = [
            ("frame_ms", json!(self.frame_ms.median)),
            ("frame_ms_p95", json!(self.frame_ms.p95)),
            ("in_forward_renders", json!(self.in_forward_renders.median)),
            ("in_forward_renders_p95", json!(self.in_forward_renders.p95)),
            ("failures", json!(self.failures)),
            ("trials", json!(self.trials)),
            ("db_short", self.db_short.json()),
            ("pose_error_units", self.units.json()),
            ("pose_error_degrees", self.degrees.json()),
            ("submissions", self.submissions.json()),
            ("renders_by_level", json!(self.renders)),
        ];
        entries.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
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

/// Writes `report.json`.
pub fn write(path: &Path, context: &Context, report: &Report) -> anyhow::Result<()> {
    let mut root = setting(context);
    let mut put = |name: &str, value: Value| root.insert(name.into(), value);
    put("steady", steady(context, report));
    for (name, samples) in report.trials() {
        put(name, Value::Object(Figures::of(context, samples).json()));
    }
    for run in &report.runs[1..] {
        put(run.optimizer.name(), gradient(context, run, report.steady()));
    }
    put("host_memory_bytes_steady", json!(report.host_bytes_steady));
    put("host_memory_bytes", json!(host_bytes()));
    let ceilings = &report.stages.ceilings;
    put("ceilings", json!({ "flops": ceilings.flops, "copy_bytes": ceilings.bytes }));
    put("stages", report.stages.stages.iter().map(stage).collect());
    put("configurations", report.configurations.iter().map(configuration).collect());
    put("recommended", json!(recommended(&report.configurations).map(|row| &row.name)));
    put("scaling", report.scaling.iter().map(scale).collect());
    std::fs::write(path, serde_json::to_string_pretty(&root)? + "\n")
        .with_context(|| format!("writing {}", path.display()))
}

/// What was measured on.
fn setting(context: &Context) -> Map<String, Value> {
    let forward = Spread::of(context.forward.times.iter().copied());
    let camera = &context.shots[0].camera;
    let best = |(shot, best): (&Shot, &Best)| {
        let (q, t) = (best.pose.wxyz(), best.pose.translation.to_array());
        json!({ "file": shot.file, "psnr": best.psnr, "qvec": q, "tvec": t })
    };
    let best: Value = context.shots.iter().zip(&context.best).map(best).collect();
    let entries = [
        ("device", json!(context.engine.device().to_string())),
        ("frames", json!(context.shots.len())),
        ("splats", json!(context.prior.splats().len())),
        ("size", json!([camera.width, camera.height])),
        ("forward_render_ms", json!(forward.median)),
        ("forward_render_ms_p95", json!(forward.p95)),
        ("best_known", best),
        ("device_memory_bytes", json!(context.device_memory.reserved)),
        ("device_memory_used_bytes", json!(context.device_memory.used)),
    ];
    entries.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

fn steady(context: &Context, report: &Report) -> Value {
    let samples = report.steady();
    let spread = |figure: &dyn Fn(&Sample) -> f64| Spread::of(samples.iter().map(figure)).json();
    let mut out = Figures::of(context, samples).json();
    let mut put = |name: &str, value: Value| out.insert(name.into(), value);
    put("code_ms", spread(&|s| s.stats.code_milliseconds));
    put("bytes_quality_10", spread(&|s| s.stats.bytes as f64));
    put("render_psnr", spread(&|s| s.stats.render_psnr));
    put("psnr", spread(&|s| s.stats.psnr));
    put("frames_a_second", json!(report.rates.latency));
    put("frames_a_second_pipelined", json!(report.rates.pipelined));
    Value::Object(out)
}

fn gradient(context: &Context, run: &OptimizerRun, steady: &[Sample]) -> Value {
    let mut out = Figures::of(context, &run.samples).json();
    let [mse, gauss_newton] = errors(run, steady);
    out.insert("mse".into(), json!(mse));
    out.insert("gauss_newton_mse".into(), json!(gauss_newton));
    Value::Object(out)
}

fn stage(stage: &Stage) -> Value {
    json!({
        "job": stage.job,
        "name": stage.name,
        "ms": stage.ms,
        "bytes": stage.work.bytes,
        "flops": stage.work.flops,
        "share_of_copy": stage.share_of_copy,
        "share_of_fma": stage.share_of_fma,
        "bound": stage.bound(),
    })
}

fn configuration(row: &Row) -> Value {
    json!({
        "name": row.name,
        "db_short": row.loss.json(),
        "frame_ms": row.frame_ms.json(),
        "in_forward_renders": row.in_forward_renders.json(),
        "pose_error_units": row.units.json(),
        "pose_error_degrees": row.degrees.json(),
        "bytes_quality_10": row.bytes.json(),
        "pareto": row.pareto,
    })
}

fn scale(row: &scaling::Row) -> Value {
    let (times, error) = match &row.times {
        Ok(times) => (Some(times), None),
        Err(error) => (None, Some(error)),
    };
    json!({
        "splats": row.splats,
        "width": row.width,
        "height": row.height,
        "forward_ms": times.map(|t| t.forward_ms),
        "evaluation_ms": times.map(|t| t.evaluation_ms),
        "error": error,
    })
}
