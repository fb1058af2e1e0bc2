//! The measurements as tables: CSV files, and the shorter ones that are printed.

use std::path::Path;

use nvsprior::image::psnr_of_mse;
use nvsprior::tracking::Evaluation;

use super::configurations;
use super::context::{Context, Sample};
use super::report::{Figures, Report};
use super::stages::Stage;
use nvsprior_inputs::report::{Table, fixed};

/// Writes trace.csv, frames.csv, trials.csv, stages.csv, and configurations.csv if these were measured.
pub fn write(folder: &Path, context: &Context, report: &Report) -> anyhow::Result<()> {
    let runs: Vec<_> =
        report.runs.iter().map(|run| (run.optimizer.name(), &run.samples[..])).collect();
    trace(&runs).write_csv(&folder.join("trace.csv"))?;
    samples(context, "optimizer", &runs).write_csv(&folder.join("frames.csv"))?;
    samples(context, "start", &report.trials()).write_csv(&folder.join("trials.csv"))?;
    stages(&report.stages.stages).write_csv(&folder.join("stages.csv"))?;
    if !report.configurations.is_empty() {
        settings(&report.configurations).write_csv(&folder.join("configurations.csv"))?;
    }
    Ok(())
}

/// A row per evaluation.
fn trace(runs: &[(&str, &[Sample])]) -> Table {
    let samples = runs.iter().flat_map(|(name, samples)| samples.iter().map(move |s| (*name, s)));
    let rows = samples.flat_map(|(name, s)| s.trace.iter().enumerate().map(move |e| (name, s, e)));
    let rows: Vec<(&str, &Sample, (usize, &Evaluation))> = rows.collect();
    Table::of(
        &rows,
        &[
            ("optimizer", &|(name, ..)| name.to_string()),
            ("frame", &|(_, s, _)| s.shot.to_string()),
            ("evaluation", &|(.., (index, _))| index.to_string()),
            ("level", &|(.., (_, e))| e.level.to_string()),
            ("psnr", &|(.., (_, e))| fixed(psnr_of_mse(e.mse), 4)),
            ("milliseconds", &|(.., (_, e))| fixed(e.milliseconds, 3)),
        ],
    )
}

/// A row per frame.
fn samples(context: &Context, kind: &str, kinds: &[(&str, &[Sample])]) -> Table {
    let rows = kinds.iter().flat_map(|(name, samples)| samples.iter().map(move |s| (*name, s)));
    let rows: Vec<(&str, &Sample)> = rows.collect();
    let renders =
        |s: &Sample| s.stats.renders.iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
    Table::of(
        &rows,
        &[
            (kind, &|(name, _)| name.to_string()),
            ("file", &|(_, s)| context.shots[s.shot].file.clone()),
            ("forward_ms", &|(_, s)| fixed(s.forward_ms, 3)),
            ("frame_ms", &|(_, s)| fixed(s.frame_ms(), 3)),
            ("in_forward_renders", &|(_, s)| fixed(s.in_forward_renders(), 3)),
            ("code_ms", &|(_, s)| fixed(s.stats.code_milliseconds, 3)),
            ("render_psnr", &|(_, s)| fixed(s.stats.render_psnr, 4)),
            ("db_short", &|(_, s)| fixed(context.short(s), 4)),
            ("pose_error_units", &|(_, s)| fixed(context.pose_error(s)[0], 5)),
            ("pose_error_degrees", &|(_, s)| fixed(context.pose_error(s)[1], 5)),
            ("bytes", &|(_, s)| s.stats.bytes.to_string()),
            ("submissions", &|(_, s)| s.stats.submissions.to_string()),
            ("renders_by_level", &|(_, s)| renders(s)),
            ("start", &|(_, s)| s.stats.start.name().to_owned()),
        ],
    )
}

fn stages(stages: &[Stage]) -> Table {
    Table::of(
        stages,
        &[
            ("job", &|s| s.job.to_owned()),
            ("stage", &|s| s.name.to_owned()),
            ("ms", &|s| fixed(s.ms, 4)),
            ("bytes", &|s| fixed(s.work.bytes, 0)),
            ("flops", &|s| fixed(s.work.flops, 0)),
            ("share_of_copy", &|s| fixed(s.share_of_copy, 4)),
            ("share_of_fma", &|s| fixed(s.share_of_fma, 4)),
            ("bound", &|s| s.bound.to_owned()),
        ],
    )
}

/// A row per setting; also printed.
pub fn settings(rows: &[configurations::Row]) -> Table {
    Table::of(
        rows,
        &[
            ("configuration", &|r| r.name.clone()),
            ("db_short", &|r| fixed(r.loss.median, 4)),
            ("db_short_p95", &|r| fixed(r.loss.p95, 4)),
            ("frame_ms", &|r| fixed(r.frame_ms.median, 3)),
            ("frame_ms_p95", &|r| fixed(r.frame_ms.p95, 3)),
            ("in_forward_renders", &|r| fixed(r.in_forward_renders.median, 3)),
            ("in_forward_renders_p95", &|r| fixed(r.in_forward_renders.p95, 3)),
            ("pose_error_units", &|r| fixed(r.units.median, 5)),
            ("pose_error_degrees", &|r| fixed(r.degrees.median, 5)),
            ("bytes_quality_10", &|r| fixed(r.bytes.median, 0)),
            ("pareto", &|r| r.pareto.to_string()),
        ],
    )
}

/// To print: a row per run.
pub fn starts(context: &Context, report: &Report) -> Table {
    let steady = [("steady", report.steady())];
    let runs = report.runs[1..].iter().map(|run| (run.optimizer.name(), &run.samples[..]));
    let all = steady.into_iter().chain(report.trials()).chain(runs);
    let rows: Vec<_> = all.map(|(name, samples)| (name, Figures::of(context, samples))).collect();
    let renders = |f: &Figures| f.renders.iter().map(|r| fixed(*r, 1)).collect::<Vec<_>>();
    Table::of(
        &rows,
        &[
            ("run", &|(name, _)| name.to_string()),
            ("frame ms", &|(_, f)| fixed(f.frame_ms, 2)),
            ("95 %", &|(_, f)| fixed(f.frame_ms_p95, 2)),
            ("forward", &|(_, f)| fixed(f.in_forward_renders, 2)),
            ("95 %", &|(_, f)| fixed(f.in_forward_renders_p95, 2)),
            ("failures", &|(_, f)| format!("{}/{}", f.failures, f.trials)),
            ("dB short", &|(_, f)| fixed(f.db_short.median, 4)),
            ("95 %", &|(_, f)| fixed(f.db_short.p95, 4)),
            ("renders by level", &|(_, f)| renders(f).join(" ")),
        ],
    )
}

/// To print: the stages of a job.
pub fn job(stages: &[Stage]) -> Table {
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    // Thousand millions per second.
    let rate = |amount: f64, ms: f64| fixed(if ms > 0.0 { amount / ms * 1e-6 } else { 0.0 }, 2);
    Table::of(
        stages,
        &[
            ("  stage", &|s| format!("  {}", s.name)),
            ("ms", &|s| fixed(s.ms, 3)),
            ("GB/s", &|s| rate(s.work.bytes, s.ms)),
            ("of copy", &|s| percent(s.share_of_copy)),
            ("GFLOP/s", &|s| rate(s.work.flops, s.ms)),
            ("of best", &|s| percent(s.share_of_fma)),
            ("bound", &|s| s.bound.to_owned()),
        ],
    )
}
