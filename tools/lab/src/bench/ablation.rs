//! `nvsprior-lab ablation`: the paper's ablations ("Ablation studies") on a run of frames.
//!
//! First it compares losses and optimisers from the same starts: the best known poses, moved off along or about one
//! axis. Then it compares sources of starts.

mod features;
mod judge;
mod matching;
mod method;
mod perturbation;
mod reprojection;
mod ribbon;
mod searches;
mod start;
mod summary;
mod table;

use std::num::NonZeroUsize;
use std::path::Path;

use super::RunArgs;
use super::context::Context;
use super::optimum;
use judge::Judge;
use method::Method;
use nvsprior_inputs::args::{progress, with_progress};
use nvsprior_inputs::values;
use perturbation::{Kind, Limits, Perturbation};
use searches::Searches;
use summary::{Ablation, Trial};

/// Measure the paper's ablations (losses, optimisers, starts)
///
/// Writes ablation.csv, ablation-starts.csv, ablation.json, losses.svg and optimizers.svg.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
    /// Starts per kind of perturbation (rotation, translation), the same for every method
    #[arg(long, value_name = "N", default_value = "40")]
    trials: NonZeroUsize,
    /// How many of these starts Adam and Adam→BFGS are measured from; each takes up to 1000 renders
    #[arg(long, value_name = "N", value_parser = values::count)]
    adam_trials: Option<usize>,
    /// Move translations off by up to this, in the prior's unit (paper: 1.58 m)
    #[arg(long, value_name = "U", default_value = "1.58", value_parser = values::positive)]
    units: f64,
}

impl Args {
    fn limits(&self) -> Limits {
        Limits { units: self.units, degrees: perturbation::DEGREES }
    }

    /// Starts of a kind that a method is measured from.
    fn trials(&self, method: Method) -> usize {
        let all = self.trials.get();
        let adam = self.adam_trials.unwrap_or(all);
        if method.slow() { adam.min(all) } else { all }
    }
}

/// Measures, prints and writes it all to a folder.
pub fn run(args: &Args) -> anyhow::Result<()> {
    args.run.measured(|context, folder| ablate(args, context, folder))
}

fn ablate(args: &Args, context: &mut Context, folder: &Path) -> anyhow::Result<()> {
    optimum::find(context)?;
    let limits = args.limits();
    let mut searches = Searches::new(context)?;
    let mut judge = Judge::default();
    let trials = measure(args, context, &mut searches, &mut judge)?;
    let starts = with_progress(start::count(context), "sources of starts", |done| {
        start::measure(context, &mut searches, &mut judge, done)
    })?;
    let ablation = Ablation { limits, trials, starts };
    summary::print(context, &ablation);
    summary::write(&folder.join("ablation.json"), context, &ablation)?;
    table::trials(&folder.join("ablation.csv"), context, &ablation.trials)?;
    table::starts(&folder.join("ablation-starts.csv"), context, &ablation.starts)?;
    ribbon::losses(&folder.join("losses.svg"), &ablation)?;
    ribbon::optimizers(&folder.join("optimizers.svg"), &ablation)
}

/// Every method from every start.
fn measure(
    args: &Args,
    context: &mut Context,
    searches: &mut Searches,
    judge: &mut Judge,
) -> anyhow::Result<Vec<Trial>> {
    // All starts refer to the poses known now: better poses found on the way move none.
    let poses: Vec<_> = context.best.iter().map(|best| best.pose).collect();
    let total: usize = Method::ALL.iter().map(|method| args.trials(*method)).sum();
    let bar = progress(Kind::ALL.len() * total, "trials");
    let mut trials = Vec::new();
    for number in 0..args.trials.get() {
        for kind in Kind::ALL {
            let perturbation = Perturbation::of(kind, &args.limits(), number);
            let shot = number % poses.len();
            let start = poses[shot].stepped(&perturbation.step());
            let methods = Method::ALL.into_iter().filter(|method| number < args.trials(*method));
            // Adam's attempt, from which Adam→BFGS goes on.
            let mut adam = None;
            for method in methods {
                let attempt = searches.search(context, method, shot, &start, adam.as_ref())?;
                if method == Method::ADAM {
                    adam = Some(attempt.clone());
                }
                let outcome = judge.judge(context, shot, method, attempt)?;
                trials.push(Trial { number, perturbation, outcome });
                bar.inc(1);
            }
        }
    }
    Ok(trials)
}
