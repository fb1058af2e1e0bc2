//! `nvsprior merge`: a prior with what its updates add to it.

use std::path::{Path, PathBuf};

use nvsprior::Prior;
use nvsprior::prior::compact::Quantisation;
use nvsprior::prior::{Learnt, UpdateChain, replace_file};

use crate::container::{Container, FINENESS};
use crate::updates::chain_of;
use crate::{beside, record, row};
use nvsprior_inputs::args::OverrideArgs;
use nvsprior_inputs::values;

/// Write a prior with what its updates add to it
///
/// Takes the updates of one chain in any order, from the first one on without a gap: files of single ones, and the
/// dive.nvsu of a side. What they learnt becomes a part of the prior, for the next dive. The merged prior has another
/// identity: both sides of a link must hold it.
#[derive(clap::Args)]
pub struct Args {
    /// The trained scene that the vehicle had on the dive
    #[arg(value_name = "PRIOR")]
    prior: PathBuf,
    /// The updates, .nvsu
    #[arg(value_name = "UPDATE", required = true)]
    updates: Vec<PathBuf>,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// The merged prior: .nvsg (compact, quantised) or .ply
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// What the record of the merged prior calls the dive, such as its date [default: its number]
    #[arg(long, value_name = "NAME", value_parser = record::dive_name)]
    dive: Option<String>,
    /// Steps of a compact prior's quantisation, as multiples of the usual ones
    #[arg(long, value_name = "FACTOR", default_value_t = FINENESS)]
    coarseness: f32,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let quantisation = Quantisation::default().scaled(args.coarseness);
    let container = Container::of(&args.out, quantisation)?;
    values::check_file("--out", &args.out)?;
    beside::check_key_frames(&args.out)?;
    let prior = Prior::open(&args.prior, &args.overrides.overrides())?;
    let chain = chain_of(prior.id(), &args.updates)?;
    let merged = prior.with_learnt(chain.learnt())?;
    let bytes = container.write(
        merged.splats(),
        merged.options(),
        merged.key_frames(),
        merged.coder_tables().map(AsRef::as_ref),
        merged.preprocessing(),
    )?;
    let filter = prior.filter_weights().map(AsRef::as_ref);
    beside::check_tables(&merged, container, &args.out)?;
    beside::check_filter(filter, &args.out)?;
    beside::place_tables(&merged, container, &args.out)?;
    beside::place_filter(filter, &args.out)?;
    replace_file(&args.out, &bytes)?;
    // A compact file is quantised, which makes it another prior once more.
    let written = Prior::open(&args.out, &Default::default())?;
    record(args, &prior, &chain, &written)?;
    print(&prior, chain.learnt(), &merged, (&args.out, &written))
}

/// Writes what the merged prior has learnt, on this dive and before, beside it.
fn record(args: &Args, prior: &Prior, chain: &UpdateChain, written: &Prior) -> anyhow::Result<()> {
    let mut rows = record::open_beside(&args.prior, prior)?;
    let dive = args.dive.clone().unwrap_or_else(|| record::next_dive(&rows));
    rows.extend(record::rows_of(chain, &dive)?);
    Ok(record::save(&rows, &args.out, written)?)
}

fn print(
    prior: &Prior,
    learnt: &Learnt,
    merged: &Prior,
    written: (&Path, &Prior),
) -> anyhow::Result<()> {
    let new = learnt.splats().len();
    let kept = merged.len() - new;
    let faded = |position: &&[f32; 3]| learnt.fade_of(**position) < 1.0;
    let faded = prior.splats().positions.iter().filter(faded).count();
    let gone = prior.len() - kept;
    row("prior", format!("{}, {} splats", prior.id(), prior.len()));
    row("updates", format!("{}, which lead to state {}", learnt.number(), learnt.state()));
    row("learnt", format!("{new} splats"));
    row("faded", format!("{faded} splats, {gone} of them left out"));
    let (out, written) = written;
    let bytes = std::fs::metadata(out)?.len();
    row("merged", format!("{}, {} splats, {bytes} bytes", out.display(), written.len()));
    row("identity", written.id().to_string());
    Ok(())
}
