//! The trials by method and size of the perturbation: medians and quartiles, as JSON and as text.

use std::path::Path;

use serde::Serialize;

use super::super::context::Context;
use super::super::perturbed::SHORT;
use super::super::report::{About, BestPsnr};
use super::judge::Judged;
use super::method::Method;
use super::perturbation::{BINS, Kind, Limits, Perturbation};
use super::start::{METHODS, StartSource, StartTrial};
use nvsprior_inputs::report::{Table, fixed, write_json};
use nvsprior_inputs::statistics::{Quartiles, median};

/// One start with one method.
pub struct Trial {
    /// Which start of its kind.
    pub number: usize,
    pub perturbation: Perturbation,
    pub outcome: Judged,
}

pub struct Ablation {
    pub limits: Limits,
    pub trials: Vec<Trial>,
    pub starts: Vec<StartTrial>,
}

/// How far a render is below that of the best known pose, dB.
pub fn short(context: &Context, outcome: &Judged) -> f64 {
    context.best[outcome.shot].psnr - outcome.verdict.psnr()
}

/// Whether the best known pose is found, or one as good.
pub fn found(context: &Context, outcome: &Judged) -> bool {
    // A figure that is no number has not been reached either.
    short(context, outcome) <= SHORT
}

impl Ablation {
    /// The outcomes of a method whose perturbation lies in a bin.
    pub fn bin(&self, method: Method, kind: Kind, bin: usize) -> Vec<&Judged> {
        let of_bin = self.trials.iter().filter(|trial| {
            let perturbation = &trial.perturbation;
            perturbation.kind == kind && self.limits.bin(perturbation) == bin
        });
        of_bin.map(|trial| &trial.outcome).filter(|outcome| outcome.method == method).collect()
    }

    fn of_source(&self, source: StartSource, method: Method) -> Vec<&Judged> {
        let of_source = self.starts.iter().filter(|trial| trial.source == source);
        of_source.map(|trial| &trial.outcome).filter(|outcome| outcome.method == method).collect()
    }
}

/// Number, share found, and quartiles of everything.
#[derive(Serialize)]
struct Figures {
    trials: usize,
    found: usize,
    share_found: Option<f64>,
    render_psnr: Quartiles,
    db_short: Quartiles,
    energy: Quartiles,
    bytes: Quartiles,
    iterations: Quartiles,
    full_renders: Quartiles,
    milliseconds: Quartiles,
    in_forward_renders: Quartiles,
}

impl Figures {
    fn of(context: &Context, outcomes: &[&Judged]) -> Figures {
        let of = |figure: &dyn Fn(&Judged) -> f64| {
            Quartiles::of(outcomes.iter().map(|outcome| figure(outcome)))
        };
        let found = outcomes.iter().filter(|outcome| found(context, outcome)).count();
        Figures {
            trials: outcomes.len(),
            found,
            share_found: (!outcomes.is_empty()).then(|| found as f64 / outcomes.len() as f64),
            render_psnr: Quartiles::of_gains(outcomes.iter().map(|o| o.verdict.psnr())),
            db_short: of(&|o| short(context, o)),
            energy: of(&|o| o.verdict.energy),
            bytes: of(&|o| o.verdict.bytes as f64),
            iterations: of(&|o| o.attempt.iterations as f64),
            full_renders: of(&|o| f64::from(o.attempt.full_renders)),
            milliseconds: of(&|o| o.attempt.milliseconds),
            in_forward_renders: of(&|o| o.attempt.in_forward_renders()),
        }
    }
}

#[derive(Serialize)]
struct Root<'a> {
    #[serde(flatten)]
    about: About,
    limits: Limits,
    best_known: Vec<BestPsnr<'a>>,
    bins: Vec<Bin>,
    starts: Vec<Start>,
}

/// A method's outcomes in a bin.
#[derive(Serialize)]
struct Bin {
    method: &'static str,
    loss: &'static str,
    kind: &'static str,
    unit: &'static str,
    from: f64,
    to: f64,
    #[serde(flatten)]
    figures: Figures,
}

/// A method's outcomes from a source.
#[derive(Serialize)]
struct Start {
    source: &'static str,
    method: &'static str,
    #[serde(flatten)]
    figures: Figures,
}

/// Each method's bins of a kind.
fn bins(context: &Context, ablation: &Ablation, kind: Kind) -> Vec<Bin> {
    let of = |method: Method, bin| {
        let [from, to] = ablation.limits.bounds(kind, bin);
        let figures = Figures::of(context, &ablation.bin(method, kind, bin));
        let (kind, unit) = (kind.name(), kind.unit());
        Bin { method: method.name(), loss: method.loss(), kind, unit, from, to, figures }
    };
    Method::ALL.into_iter().flat_map(|method| (0..BINS).map(move |bin| of(method, bin))).collect()
}

/// Each method's outcomes from each source that there is.
fn starts(context: &Context, ablation: &Ablation) -> Vec<Start> {
    let mut starts = Vec::new();
    for source in StartSource::ALL {
        for method in METHODS {
            let figures = Figures::of(context, &ablation.of_source(source, method));
            if figures.trials > 0 {
                starts.push(Start { source: source.name(), method: method.name(), figures });
            }
        }
    }
    starts
}

pub fn write(path: &Path, context: &Context, ablation: &Ablation) -> anyhow::Result<()> {
    let root = Root {
        about: About::of(context),
        limits: ablation.limits,
        best_known: BestPsnr::all(context),
        bins: Kind::ALL.into_iter().flat_map(|kind| bins(context, ablation, kind)).collect(),
        starts: starts(context, ablation),
    };
    write_json(path, &root)
}

pub fn print(context: &Context, ablation: &Ablation) {
    println!("{}", context.engine.device());
    println!("{} frames, {} splats", context.shots.len(), context.prior.splats().len());
    let best = median(context.best.iter().map(|best| best.psnr));
    println!("best known poses: {best:.2} dB in the median");
    for kind in Kind::ALL {
        println!("\n{} by up to {}", kind.name(), ablation.limits.of(kind));
        let rows = bins(context, ablation, kind);
        let row = |bin: Bin| (bin.method, format!("{:.2} to {:.2}", bin.from, bin.to), bin.figures);
        table(&format!("|{}|", kind.unit()), rows.into_iter().map(row)).print();
    }
    println!("\nstarts");
    let mut rows = starts(context, ablation);
    rows.sort_by_key(|row| METHODS.iter().position(|method| method.name() == row.method));
    let row = |start: Start| (start.method, start.source.to_owned(), start.figures);
    table("source", rows.into_iter().map(row)).print();
}

/// Medians, of those that have trials.
fn table(second: &str, rows: impl Iterator<Item = (&'static str, String, Figures)>) -> Table {
    let rows: Vec<_> = rows.filter(|(.., figures)| figures.trials > 0).collect();
    Table::of(
        &rows,
        &[
            ("method", &|(method, ..)| method.to_string()),
            (second, &|(_, second, _)| second.clone()),
            ("found", &|(.., f)| format!("{}/{}", f.found, f.trials)),
            ("dB", &|(.., f)| fixed(f.render_psnr.median, 2)),
            ("energy", &|(.., f)| fixed(f.energy.median, 5)),
            ("bytes", &|(.., f)| fixed(f.bytes.median, 0)),
            ("iterations", &|(.., f)| fixed(f.iterations.median, 0)),
            ("renders", &|(.., f)| fixed(f.full_renders.median, 0)),
            ("forward", &|(.., f)| fixed(f.in_forward_renders.median, 1)),
        ],
    )
}
