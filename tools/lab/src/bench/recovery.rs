//! `nvsprior-lab recovery`: how a lost camera is found again, and whether the encoder knows that it
//! is lost.
//!
//! *Found*: the prior's render at the encoder's pose is at most [`SHORT`](super::perturbed::SHORT) dB below that at the
//! best known pose, both against the clean frame, and the two poses are near each other. *Wrong*: more than
//! [`probe::WRONG`] dB below it, or far from the best known pose. *False certain*: wrong, and the encoder is certain.

mod capture;
mod chart;
mod condition;
mod dropouts;
mod foreign;
mod measurement;
mod nothing;
pub(super) mod pixels;
mod print;
mod probe;
mod roll;
mod summary;
mod table;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use nvsprior::Prior;

use super::RunArgs;
use super::context::Context;
use super::optimum;
pub(super) use condition::Condition;
use measurement::Measurement;
use nvsprior_inputs::values;
use probe::Run;

/// Measure how a lost camera is found again
///
/// Every frame must have its pose in the camera file. Writes recovery.csv, recovery.json and recovery.svg.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
    /// Number of starts per figure, and of rolled copies of the frames
    #[arg(long, value_name = "N", default_value = "100")]
    trials: NonZeroUsize,
    /// Only these measurements [default: all, foreign if --foreign is given]
    #[arg(long, value_name = "WHAT", value_enum, value_delimiter = ',')]
    only: Vec<Measurement>,
    /// Only these conditions, for frames without any known pose [default: all]
    #[arg(long, value_name = "WHAT", value_enum, value_delimiter = ',')]
    conditions: Vec<Condition>,
    /// The prior of another scene, which the frames must not be found in
    #[arg(long, value_name = "PRIOR", required_if_eq("only", "foreign"))]
    foreign: Option<PathBuf>,
    /// Places of the run at which dropouts begin
    #[arg(long, value_name = "N", default_value = "3")]
    places: NonZeroUsize,
    /// Lengths of dropouts, frames
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "1,4,15,60")]
    dropouts: Vec<NonZeroUsize>,
    /// Frames per second of the run, if the frames' times are not known
    #[arg(long, value_name = "FPS", default_value = "3", value_parser = values::positive)]
    rate: f64,
}

impl Args {
    fn measures(&self, measurement: Measurement) -> bool {
        if self.only.is_empty() {
            return measurement != Measurement::Foreign || self.foreign.is_some();
        }
        self.only.contains(&measurement)
    }

    fn conditions(&self) -> &[Condition] {
        if self.conditions.is_empty() { &Condition::ALL } else { &self.conditions }
    }
}

/// Measures, prints and writes it all to a folder.
pub fn run(args: &Args) -> anyhow::Result<()> {
    args.run.measured(|context, folder| recover(args, context, folder))
}

fn recover(args: &Args, context: &mut Context, folder: &Path) -> anyhow::Result<()> {
    for shot in &context.shots {
        anyhow::ensure!(
            shot.known.is_some(),
            "{}: its pose is not in the camera file, but this command needs the pose of every frame",
            shot.file
        );
    }
    let foreign = args.foreign.as_deref().filter(|_| args.measures(Measurement::Foreign));
    let foreign = foreign.map(|path| Prior::open(path, &Default::default())).transpose()?;
    optimum::find(context)?;

    let runs = measure(args, context, foreign.as_ref())?;
    let columns = summary::columns(&runs);
    print::print(context, &columns);
    table::write(&folder.join("recovery.csv"), &runs)?;
    summary::write(&folder.join("recovery.json"), context, &columns)?;
    chart::draw(&folder.join("recovery.svg"), &columns)
}

fn measure(
    args: &Args,
    context: &mut Context,
    foreign: Option<&Prior>,
) -> anyhow::Result<Vec<Run>> {
    let trials = args.trials.get();
    let mut runs = Vec::new();
    if args.measures(Measurement::Capture) {
        runs.extend(capture::measure(context, trials)?);
    }
    if args.measures(Measurement::Nothing) {
        runs.extend(nothing::measure(context, args.conditions(), trials)?);
    }
    if args.measures(Measurement::Dropouts) {
        let lengths: Vec<usize> = args.dropouts.iter().map(|n| n.get()).collect();
        let places = args.places.get();
        runs.extend(dropouts::measure(context, &lengths, places, args.rate)?);
    }
    if let Some(prior) = foreign {
        runs.extend(foreign::measure(context, prior)?);
    }
    Ok(runs)
}
