//! `nvsprior prior tables`: scene coder tables, trained on the frames of the mapping run.

mod gain;

use std::path::PathBuf;

use crate::container::check_not_over;
use crate::mapping_run::MappingRunArgs;
use crate::prior_file::PriorFile;
use nvsprior::coder_tables::Tables;
use nvsprior_inputs::args::{PriorArgs, progress};
use nvsprior_inputs::report::row;
use nvsprior_train::coder_tables::{Pair, TableOptions, train_tables};

/// Train coder tables for a prior's scene on the frames of its mapping run
///
/// Finds the pose of each frame, starting from the one in the camera file, and draws the prior there. The tables of the
/// wavelet coder learn from frames and renders. Frames without a certain pose are left out. Every eighth frame is held
/// out, and the program prints what the tables save on these. The tables are part of the prior's identity: both sides
/// of a link need them.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    run: MappingRunArgs,
    /// Steps of training: each codes all frames and learns from it
    #[arg(long, alias = "rounds", value_name = "N", default_value_t = ROUNDS,
        value_parser = clap::value_parser!(u32).range(1..=100))]
    steps: u32,
    /// A copy of the prior with the tables in it: .nvsg, or .nvsb if the prior is one
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

const ROUNDS: u32 = 3;

pub fn run(args: &Args) -> anyhow::Result<()> {
    check_not_over(&args.prior.prior, &args.out)?;
    let file = PriorFile::open(&args.prior.prior, Some(&args.out))?;
    let prior = file.prior.clone().with_overrides(&args.prior.overrides.overrides())?;
    let run = args.run.pairs(&prior)?;
    run.print();
    let tables = train(&run.learned, args.steps as usize);
    let written = file.save_tables(&tables)?;
    gain::print(&run.held_out, &tables);
    row("written", written);
    row("identity", format!("{}", prior.with_coder_tables(Some(tables)).id()));
    Ok(())
}

/// Trains tables, beginning with the library's.
fn train(runs: &[Vec<Pair>], rounds: usize) -> Tables {
    let options = TableOptions { rounds, ..TableOptions::default() };
    let bar = progress(rounds, "training");
    bar.tick();
    train_tables(runs, Some(&Tables::generic()), &options, |_| bar.inc(1))
}
