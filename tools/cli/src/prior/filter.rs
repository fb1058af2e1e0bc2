//! `nvsprior prior filter`: the display filter's weights for a scene, trained on the frames of the mapping run.

use std::path::PathBuf;
use std::sync::Arc;

use nvsprior::coder_tables::Tables;
use nvsprior::filter_weights::FilterWeights;
use nvsprior::prior::Extras;
use nvsprior_inputs::args::{PriorArgs, progress};
use nvsprior_train::filter::{FilterExample, FilterOptions, filter_examples, gains, train_filter};

use crate::mapping_run::MappingRunArgs;
use crate::prior_file::PriorFile;
use nvsprior_inputs::report::row;

/// Train the display filter for a prior's scene on the frames of its mapping run
///
/// Finds the pose of each frame, starting from the one in the camera file, and draws the prior there. A small network
/// learns what lies between the decoded picture and the frame. Frames without a certain pose are left out. Every eighth
/// frame is held out, and the program prints what the filter gains on these. Only a topside that filters needs the
/// weights (`decode --filter`): they are no part of the prior's identity.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    run: MappingRunArgs,
    /// Steps of training
    #[arg(long, value_name = "N", default_value_t = STEPS,
        value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    steps: u32,
    /// A copy of the prior with the weights in it: .nvsg, or .nvsb if the prior is one [default: they are put into
    /// PRIOR, or, if that is of a foreign format, into PRIOR.nvsx, which is read with it]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

const STEPS: u32 = 4000;
/// How often a frame is coded to learn from, at most, and how many pictures of all frames are kept.
const CODINGS: (usize, usize) = (10, 1500);

pub fn run(args: &Args) -> anyhow::Result<()> {
    let file = PriorFile::open(&args.prior.prior, args.out.as_deref())?;
    let prior = file.prior.clone().with_overrides(&args.prior.overrides.overrides())?;
    let run = args.run.pairs(&prior)?;
    run.print();
    let tables = prior.coder_tables().map_or_else(Tables::generic, |tables| (**tables).clone());
    let frames: usize = run.learned.iter().map(Vec::len).sum();
    let codings = (CODINGS.1 / frames).clamp(3, CODINGS.0);
    let learned: Vec<_> =
        run.learned.iter().map(|pairs| filter_examples(pairs, &tables, codings, 1)).collect();
    let learned: Vec<_> = learned.iter().map(Vec::as_slice).collect();
    let options = FilterOptions { steps: args.steps as usize, ..FilterOptions::default() };
    let bar = progress(options.steps, "training");
    let start = FilterWeights::generic();
    let start = (start != FilterWeights::zero()).then_some(&start);
    let weights = train_filter(&learned, start, &options, |done, _| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    let filter_weights = Some(Arc::new(weights.clone()));
    let written = file.save_extras(&Extras { filter_weights, ..prior.extras().clone() })?;
    print_gains(&filter_examples(&run.held_out, &tables, GAINS, 2), &weights);
    row("written", written);
    Ok(())
}

/// Codings of a held-out frame.
const GAINS: usize = 5;

/// Prints what weights gain on frames that they have not seen, from fine pictures to coarse ones.
fn print_gains(held_out: &[FilterExample], weights: &FilterWeights) {
    let mut best = f64::NEG_INFINITY;
    for gain in gains(held_out, weights) {
        let [before, after] = gain.psnr;
        best = best.max(after - before);
        let text = format!("{before:.2} → {after:.2} dB, {:+.2}", after - before);
        row(&format!("step {:.0}", gain.step), text);
    }
    if best <= 0.0 {
        tell!("the filter gains nothing on frames that it has not seen; train on more frames");
    }
}
