//! The trials by method and size of the perturbation: medians and quartiles, as JSON and as text.

use std::path::Path;

use anyhow::Context as _;
use serde_json::{Value, json};

use super::super::context::{Best, Context, Shot};
use super::super::perturbed::SHORT;
use super::super::statistics::{Quartiles, median};
use super::judge::Verdict;
use super::method::{Attempt, Method};
use super::perturbation::{BINS, Kind};
use super::start::{METHODS, StartSource};
use super::{Ablation, Trial};

/// How far a render is below that of the best known pose, dB.
pub fn short(context: &Context, shot: usize, verdict: &Verdict) -> f64 {
    context.best[shot].psnr - verdict.psnr()
}

/// Whether the best known pose is found, or one as good.
pub fn found(context: &Context, shot: usize, verdict: &Verdict) -> bool {
    // A figure that is no number has not been reached either.
    short(context, shot, verdict) <= SHORT
}

impl Ablation {
    /// The results of a method whose perturbation lies in a bin.
    pub fn bin(&self, method: Method, kind: Kind, bin: usize) -> Vec<Result<'_>> {
        let inside = |trial: &&Trial| {
            let perturbation = &trial.perturbation;
            let same = (trial.method, perturbation.kind) == (method, kind);
            same && self.limits.bin(perturbation) == bin
        };
        self.trials.iter().filter(inside).map(|t| (t.shot, &t.attempt, &t.verdict)).collect()
    }
}

/// A frame, what a search came to, and what that is worth.
pub type Result<'a> = (usize, &'a Attempt, &'a Verdict);

/// Number, share found, and quartiles of everything.
fn figures(context: &Context, results: &[Result]) -> Value {
    let of = |figure: &dyn Fn(&Result) -> f64| Quartiles::of(results.iter().map(figure)).json();
    let found = results.iter().filter(|(shot, _, verdict)| found(context, *shot, verdict)).count();
    json!({
        "trials": results.len(),
        "found": found,
        "share_found": (!results.is_empty()).then(|| found as f64 / results.len() as f64),
        "render_psnr": Quartiles::of_gains(results.iter().map(|(_, _, v)| v.psnr())).json(),
        "db_short": of(&|(shot, _, v)| short(context, *shot, v)),
        "energy": of(&|(_, _, v)| v.energy),
        "bytes": of(&|(_, _, v)| v.bytes as f64),
        "iterations": of(&|(_, a, _)| a.iterations as f64),
        "full_renders": of(&|(_, a, _)| f64::from(a.full_renders)),
        "milliseconds": of(&|(_, a, _)| a.milliseconds),
        "in_forward_renders": of(&|(_, a, _)| a.in_forward_renders()),
    })
}

fn with(mut figures: Value, entries: Value) -> Value {
    if let (Value::Object(figures), Value::Object(entries)) = (&mut figures, entries) {
        figures.extend(entries);
    }
    figures
}

/// Writes the summary.
pub fn write(path: &Path, context: &Context, ablation: &Ablation) -> anyhow::Result<()> {
    let best = |(shot, best): (&Shot, &Best)| json!({ "file": shot.file, "psnr": best.psnr });
    let forward = median(context.forward.times.iter().copied());
    let camera = &context.shots[0].camera;
    let root = json!({
        "device": context.engine.device().to_string(),
        "frames": context.shots.len(),
        "size": [camera.width, camera.height],
        "splats": context.prior.splats().len(),
        "forward_render_ms": forward,
        "limits": { "units": ablation.limits.units, "degrees": ablation.limits.degrees },
        "best_known": context.shots.iter().zip(&context.best).map(best).collect::<Value>(),
        "bins": bins(context, ablation),
        "starts": starts(context, ablation),
    });
    let text = serde_json::to_string_pretty(&root)?;
    std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))
}

/// Each method's bins of each kind.
fn bins(context: &Context, ablation: &Ablation) -> Value {
    let mut bins = Vec::new();
    for kind in Kind::ALL {
        for method in Method::ALL {
            for bin in 0..BINS {
                let results = ablation.bin(method, kind, bin);
                let [from, to] = ablation.limits.bounds(kind, bin);
                bins.push(with(
                    figures(context, &results),
                    json!({ "method": method.name(), "loss": method.loss(), "kind": kind.name(),
                        "unit": kind.unit(), "from": from, "to": to }),
                ));
            }
        }
    }
    bins.into()
}

/// Results of a method from a source of starts.
fn from_source(ablation: &Ablation, source: StartSource, method: Method) -> Vec<Result<'_>> {
    let of = ablation.starts.iter().filter(|t| t.source == source && t.method == method);
    of.map(|t| (t.shot, &t.attempt, &t.verdict)).collect()
}

fn starts(context: &Context, ablation: &Ablation) -> Value {
    let mut starts = Vec::new();
    for source in StartSource::ALL {
        for method in METHODS {
            let results = from_source(ablation, source, method);
            if results.is_empty() {
                continue;
            }
            let figures = figures(context, &results);
            let names = json!({ "source": source.name(), "method": method.name() });
            starts.push(with(figures, names));
        }
    }
    starts.into()
}

/// Prints the short tables.
pub fn print(context: &Context, ablation: &Ablation) {
    println!("{}", context.engine.device());
    println!("{} frames, {} splats", context.shots.len(), context.prior.splats().len());
    let best = median(context.best.iter().map(|best| best.psnr));
    println!("best known poses: {best:.2} dB in the median");
    for kind in Kind::ALL {
        println!("\n{} by up to {}", kind.name(), ablation.limits.of(kind));
        heading(&format!("|{}|", kind.unit()));
        for method in Method::ALL {
            for bin in 0..BINS {
                let [from, to] = ablation.limits.bounds(kind, bin);
                let results = ablation.bin(method, kind, bin);
                row(context, method, &format!("{from:.2} to {to:.2}"), &results);
            }
        }
    }
    println!("\nstarts");
    heading("source");
    for method in METHODS {
        for source in StartSource::ALL {
            row(context, method, source.name(), &from_source(ablation, source, method));
        }
    }
}

fn heading(second: &str) {
    println!(
        "{:14} {second:16} {:>9} {:>8} {:>8} {:>6} {:>10} {:>8} {:>8}",
        "method", "found", "dB", "energy", "bytes", "iterations", "renders", "forward"
    );
}

/// Prints medians of some results; nothing if there are none.
fn row(context: &Context, method: Method, second: &str, results: &[Result]) {
    if results.is_empty() {
        return;
    }
    let of = |figure: &dyn Fn(&Result) -> f64| median(results.iter().map(figure));
    let count = results.iter().filter(|(shot, _, verdict)| found(context, *shot, verdict)).count();
    println!(
        "{:14} {second:16} {:>9} {:8.2} {:8.5} {:6.0} {:10.0} {:8.0} {:8.1}",
        method.name(),
        format!("{count}/{}", results.len()),
        Quartiles::of_gains(results.iter().map(|(_, _, v)| v.psnr())).median,
        of(&|(_, _, v)| v.energy),
        of(&|(_, _, v)| v.bytes as f64),
        of(&|(_, a, _)| a.iterations as f64),
        of(&|(_, a, _)| f64::from(a.full_renders)),
        of(&|(_, a, _)| a.in_forward_renders()),
    );
}
