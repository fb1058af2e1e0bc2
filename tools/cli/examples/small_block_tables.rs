//! Trains the tables that the wavelet coder has for payloads with small blocks: `src/coder_tables/small_blocks.nvt`.
//!
//!     cargo run --release -p nvsprior-cli --example small_block_tables -- OUT.nvt START ROUNDS PRIOR CAMERAS SPLIT
//!         [PRIOR …] [measure PRIOR CAMERAS SPLIT …]
//!
//! START: `library` begins with the library's tables, `nothing` with random ones, as what a set of runs brings can only
//! be seen without it. Frames are varied in light, silt and more; shorter runs are coded more often. A run that is
//! named twice counts twice. A SPLIT of `-` stands for all frames. Every eighth frame of each run is held out. Their
//! bytes by the library's tables and by the trained ones are printed, and those of all frames of the runs behind
//! `measure`.

mod pairs;

use std::path::Path;

use nvsprior::Engine;
use nvsprior::coder_tables::Tables;
use nvsprior::residual::wavelet::Step;
use nvsprior_train::coder_tables::{Pair, TableOptions, measure, train_tables};

use pairs::Run;

/// Quantiser steps that are shown, from a fine picture to a coarse one.
const STEPS: [u8; 3] = [24, 32, 40];

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, start, rounds, inputs @ ..] = arguments.as_slice() else {
        anyhow::bail!("OUT.nvt START ROUNDS PRIOR CAMERAS SPLIT …")
    };
    let (inputs, measured) = match inputs.iter().position(|input| input == "measure") {
        Some(at) => (&inputs[..at], &inputs[at + 1..]),
        None => (inputs, &[][..]),
    };
    let (inputs, measured) = (runs(inputs)?, runs(measured)?);
    anyhow::ensure!(!inputs.is_empty(), "no run to learn from");
    let start = match start.as_str() {
        "library" => Some(Tables::small_blocks()),
        "nothing" => None,
        other => anyhow::bail!("START is library or nothing, not {other}"),
    };
    let rounds = rounds.parse()?;
    let engine = Engine::new(&Default::default())?;
    let (mut learned, mut held_out) = (Vec::new(), Vec::new());
    for input in inputs {
        let run = Run::open(&engine, input)?;
        learned.push(run.learned);
        held_out.push((input, run.held_out));
    }
    for input in measured {
        let Run { mut learned, held_out: other } = Run::open(&engine, input)?;
        learned.extend(other);
        held_out.push((input, learned));
    }
    let options = TableOptions { rounds, epochs: 2, steps_per_frame: 1, vary: true, seed: 7 };
    let report = |progress| println!("{progress:?}");
    let tables = train_tables(&learned, start.as_ref(), &options, report);
    for (input, pairs) in &held_out {
        println!("{input:?}");
        print(pairs, &Tables::small_blocks(), &tables);
    }
    nvsprior::prior::replace_file(Path::new(out), &tables.write())?;
    Ok(())
}

/// Three arguments are a run.
fn runs(arguments: &[String]) -> anyhow::Result<&[[String; 3]]> {
    let (runs, rest) = arguments.as_chunks();
    anyhow::ensure!(rest.is_empty(), "each run is PRIOR CAMERAS SPLIT");
    Ok(runs)
}

/// Prints bytes and PSNR of a run's frames by the library's tables and by others.
fn print(pairs: &[Pair], before: &Tables, after: &Tables) {
    for step in STEPS.map(Step::new) {
        let (bytes_before, psnr_before) = measure(pairs, before, step, true);
        let (bytes, psnr) = measure(pairs, after, step, true);
        println!(
            "  step {:.0}: {bytes_before:.1} → {bytes:.1} bytes, {psnr_before:.2} → {psnr:.2} dB",
            step.value()
        );
    }
}
