//! Every trial as CSV.

use std::path::Path;

use super::super::context::Context;
use super::judge::Judged;
use super::perturbation::Perturbation;
use super::start::StartTrial;
use super::summary::{self, Trial};
use nvsprior_inputs::report::{Column, Table, fixed};

/// Writes the trials, a row each.
pub fn trials(path: &Path, context: &Context, trials: &[Trial]) -> anyhow::Result<()> {
    let of = |trial: &Trial| -> Perturbation { trial.perturbation };
    write(
        path,
        context,
        trials,
        &[
            ("kind", &|t| of(t).kind.name().to_owned()),
            ("trial", &|t| t.number.to_string()),
            ("file", &|t| context.shots[t.outcome.shot].file.clone()),
            ("axis", &|t| of(t).axis_name().to_owned()),
            ("perturbation", &|t| fixed(of(t).value, 5)),
            ("size", &|t| fixed(of(t).value.abs(), 5)),
            ("unit", &|t| of(t).kind.unit().to_owned()),
        ],
        &|trial| &trial.outcome,
    )
}

/// Writes the starts from each source, a row each.
pub fn starts(path: &Path, context: &Context, trials: &[StartTrial]) -> anyhow::Result<()> {
    write(
        path,
        context,
        trials,
        &[
            ("source", &|t| t.source.name().to_owned()),
            ("file", &|t| context.shots[t.outcome.shot].file.clone()),
        ],
        &|trial| &trial.outcome,
    )
}

/// Writes `first` columns, then those of all outcomes.
fn write<T>(
    path: &Path,
    context: &Context,
    trials: &[T],
    first: &[Column<T>],
    outcome: &dyn Fn(&T) -> &Judged,
) -> anyhow::Result<()> {
    let best = |o: &Judged| &context.best[o.shot].pose;
    let distance = |o: &Judged| (o.attempt.pose.centre() - best(o).centre()).length();
    let degrees = |o: &Judged| o.attempt.pose.angle_to(best(o)).to_degrees();
    let figures: [Column<Judged>; 14] = [
        ("method", &|o| o.method.name().to_owned()),
        ("loss", &|o| o.method.loss().to_owned()),
        ("render_psnr", &|o| fixed(o.verdict.psnr(), 4)),
        ("db_short", &|o| fixed(summary::short(context, o), 4)),
        ("found", &|o| summary::found(context, o).to_string()),
        ("energy", &|o| fixed(o.verdict.energy, 7)),
        ("bytes", &|o| o.verdict.bytes.to_string()),
        ("iterations", &|o| o.attempt.iterations.to_string()),
        ("full_renders", &|o| o.attempt.full_renders.to_string()),
        ("milliseconds", &|o| fixed(o.attempt.milliseconds, 3)),
        ("in_forward_renders", &|o| fixed(o.attempt.in_forward_renders(), 3)),
        ("pose_error_units", &|o| fixed(distance(o), 5)),
        ("pose_error_degrees", &|o| fixed(degrees(o), 5)),
        ("stop", &|o| o.attempt.stop.clone()),
    ];
    let names = first.iter().map(|(name, _)| name);
    let mut table = Table::new(names.chain(figures.iter().map(|(name, _)| name)));
    for trial in trials {
        let own = first.iter().map(|(_, cell)| cell(trial));
        table.push(own.chain(figures.iter().map(|(_, cell)| cell(outcome(trial)))));
    }
    table.write_csv(path)
}
