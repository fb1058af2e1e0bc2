//! The measurements as CSV.

use std::path::Path;

use anyhow::Context as _;
use nvsprior::image::psnr_of_mse;

use super::context::{Context, OptimizerRun, Sample};
use super::report::Report;
use super::stages::Stages;
use super::{configurations, scaling};

/// Writes trace.csv, frames.csv, trials.csv, stages.csv, and configurations.csv and scaling.csv if
/// these were measured.
pub fn write(folder: &Path, context: &Context, report: &Report) -> anyhow::Result<()> {
    let write = |name: &str, rows: Vec<Vec<String>>| {
        let path = folder.join(name);
        table(&path, &rows).with_context(|| format!("writing {}", path.display()))
    };
    write("trace.csv", trace(&report.runs))?;
    let steady: Vec<_> =
        report.runs.iter().map(|run| (run.optimizer.name(), &run.samples[..])).collect();
    write("frames.csv", samples(context, "optimizer", &steady))?;
    write("trials.csv", samples(context, "start", &report.trials()))?;
    write("stages.csv", stages(&report.stages))?;
    if !report.configurations.is_empty() {
        write("configurations.csv", settings(&report.configurations))?;
    }
    if !report.scaling.is_empty() {
        write("scaling.csv", scales(&report.scaling))?;
    }
    Ok(())
}

fn table(path: &Path, rows: &[Vec<String>]) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_path(path)?;
    for row in rows {
        csv.write_record(row)?;
    }
    Ok(csv.flush()?)
}

fn header(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// A row per evaluation.
fn trace(runs: &[OptimizerRun]) -> Vec<Vec<String>> {
    let names = ["optimizer", "frame", "evaluation", "level", "psnr", "milliseconds"];
    let mut rows = vec![header(&names)];
    for run in runs {
        for sample in &run.samples {
            rows.extend(sample.trace.iter().enumerate().map(|(index, evaluation)| {
                vec![
                    run.optimizer.name().to_owned(),
                    sample.shot.to_string(),
                    index.to_string(),
                    evaluation.level.to_string(),
                    format!("{:.4}", psnr_of_mse(evaluation.mse)),
                    format!("{:.3}", evaluation.milliseconds),
                ]
            }));
        }
    }
    rows
}

/// A row per frame.
fn samples(context: &Context, kind: &str, kinds: &[(&str, &[Sample])]) -> Vec<Vec<String>> {
    let mut rows = vec![header(&[
        kind,
        "file",
        "forward_ms",
        "frame_ms",
        "in_forward_renders",
        "code_ms",
        "render_psnr",
        "db_short",
        "pose_error_units",
        "pose_error_degrees",
        "bytes",
        "submissions",
        "renders_by_level",
        "start",
    ])];
    for (name, samples) in kinds {
        rows.extend(samples.iter().map(|s| {
            let [units, degrees] = context.pose_error(s);
            let renders: Vec<String> = s.stats.renders.iter().map(u32::to_string).collect();
            vec![
                (*name).to_owned(),
                context.shots[s.shot].file.clone(),
                format!("{:.3}", s.forward_ms),
                format!("{:.3}", s.frame_ms()),
                format!("{:.3}", s.in_forward_renders()),
                format!("{:.3}", s.stats.code_milliseconds),
                format!("{:.4}", s.stats.render_psnr),
                format!("{:.4}", context.short(s)),
                format!("{units:.5}"),
                format!("{degrees:.5}"),
                s.stats.bytes.to_string(),
                s.stats.submissions.to_string(),
                renders.join(" "),
                s.stats.start.name().to_owned(),
            ]
        }));
    }
    rows
}

fn stages(stages: &Stages) -> Vec<Vec<String>> {
    let names = ["job", "stage", "ms", "bytes", "flops", "share_of_copy", "share_of_fma", "bound"];
    let row = |s: &super::stages::Stage| {
        vec![
            s.job.to_owned(),
            s.name.to_owned(),
            format!("{:.4}", s.ms),
            format!("{:.0}", s.work.bytes),
            format!("{:.0}", s.work.flops),
            format!("{:.4}", s.share_of_copy),
            format!("{:.4}", s.share_of_fma),
            s.bound().to_owned(),
        ]
    };
    std::iter::once(header(&names)).chain(stages.stages.iter().map(row)).collect()
}

fn settings(rows: &[configurations::Row]) -> Vec<Vec<String>> {
    let names = [
        "configuration",
        "db_short",
        "db_short_p95",
        "frame_ms",
        "frame_ms_p95",
        "in_forward_renders",
        "in_forward_renders_p95",
        "pose_error_units",
        "pose_error_degrees",
        "bytes_quality_10",
        "pareto",
    ];
    let row = |r: &configurations::Row| {
        vec![
            r.name.clone(),
            format!("{:.4}", r.loss.median),
            format!("{:.4}", r.loss.p95),
            format!("{:.3}", r.frame_ms.median),
            format!("{:.3}", r.frame_ms.p95),
            format!("{:.3}", r.in_forward_renders.median),
            format!("{:.3}", r.in_forward_renders.p95),
            format!("{:.5}", r.units.median),
            format!("{:.5}", r.degrees.median),
            format!("{:.0}", r.bytes.median),
            r.pareto.to_string(),
        ]
    };
    std::iter::once(header(&names)).chain(rows.iter().map(row)).collect()
}

fn scales(rows: &[scaling::Row]) -> Vec<Vec<String>> {
    let names = ["splats", "width", "height", "forward_ms", "evaluation_ms", "error"];
    let row = |r: &scaling::Row| {
        let (forward, evaluation, error) = match &r.times {
            Ok(t) => (format!("{:.3}", t.forward_ms), format!("{:.3}", t.evaluation_ms), ""),
            Err(error) => (String::new(), String::new(), error.as_str()),
        };
        let size = [r.splats.to_string(), r.width.to_string(), r.height.to_string()];
        size.into_iter().chain([forward, evaluation, error.to_owned()]).collect()
    };
    std::iter::once(header(&names)).chain(rows.iter().map(row)).collect()
}
