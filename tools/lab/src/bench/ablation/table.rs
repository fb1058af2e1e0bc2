//! Every trial as CSV.

use std::path::Path;

use anyhow::Context as _;

use super::super::context::Context;
use super::judge::Verdict;
use super::method::{Attempt, Method};
use super::start::StartTrial;
use super::{Trial, summary};

/// Columns that all tables end with.
const FIGURES: [&str; 14] = [
    "method",
    "loss",
    "render_psnr",
    "db_short",
    "found",
    "energy",
    "bytes",
    "iterations",
    "full_renders",
    "milliseconds",
    "in_forward_renders",
    "pose_error_units",
    "pose_error_degrees",
    "stop",
];

/// Writes the trials, a row each.
pub fn trials(path: &Path, context: &Context, trials: &[Trial]) -> anyhow::Result<()> {
    let first = ["kind", "trial", "file", "axis", "perturbation", "size", "unit"];
    let row = |trial: &Trial| {
        let perturbation = &trial.perturbation;
        let first = [
            perturbation.kind.name().to_owned(),
            trial.number.to_string(),
            context.shots[trial.shot].file.clone(),
            perturbation.axis_name().to_owned(),
            format!("{:.5}", perturbation.value),
            format!("{:.5}", perturbation.value.abs()),
            perturbation.kind.unit().to_owned(),
        ];
        let figures = figures(context, trial.shot, trial.method, &trial.attempt, &trial.verdict);
        first.into_iter().chain(figures).collect()
    };
    write(path, &first, trials.iter().map(row))
}

/// Writes the starts from each source, a row each.
pub fn starts(path: &Path, context: &Context, trials: &[StartTrial]) -> anyhow::Result<()> {
    let row = |trial: &StartTrial| {
        let first = [trial.source.name().to_owned(), context.shots[trial.shot].file.clone()];
        let figures = figures(context, trial.shot, trial.method, &trial.attempt, &trial.verdict);
        first.into_iter().chain(figures).collect()
    };
    write(path, &["source", "file"], trials.iter().map(row))
}

fn figures(
    context: &Context,
    shot: usize,
    method: Method,
    attempt: &Attempt,
    verdict: &Verdict,
) -> [String; FIGURES.len()] {
    let best = &context.best[shot].pose;
    let distance = (attempt.pose.centre() - best.centre()).length();
    [
        method.name().to_owned(),
        method.loss().to_owned(),
        format!("{:.4}", verdict.psnr()),
        format!("{:.4}", summary::short(context, shot, verdict)),
        summary::found(context, shot, verdict).to_string(),
        format!("{:.7}", verdict.energy),
        verdict.bytes.to_string(),
        attempt.iterations.to_string(),
        attempt.full_renders.to_string(),
        format!("{:.3}", attempt.milliseconds),
        format!("{:.3}", attempt.in_forward_renders()),
        format!("{distance:.5}"),
        format!("{:.5}", attempt.pose.angle_to(best).to_degrees()),
        attempt.stop.clone(),
    ]
}

fn write(
    path: &Path,
    first: &[&str],
    rows: impl Iterator<Item = Vec<String>>,
) -> anyhow::Result<()> {
    let write = || {
        let mut csv = csv::Writer::from_path(path)?;
        csv.write_record(first.iter().chain(&FIGURES))?;
        rows.into_iter().try_for_each(|row| csv.write_record(&row))?;
        Ok::<_, csv::Error>(csv.flush()?)
    };
    write().with_context(|| format!("writing {}", path.display()))
}
