//! Trains the display filter's weights that come with the library: `src/filter_weights/generic.nvf`.
//!
//!     cargo run --release -p nvsprior-cli --example filter_weights -- OUT.nvf STEPS PRIOR CAMERAS SPLIT [PRIOR …]
//!
//! Each run of frames counts alike. A SPLIT of `-` stands for all frames. Every eighth frame of each run is held out,
//! and what the filter gains on it is printed.

mod pairs;

use nvsprior::Engine;
use nvsprior::coder_tables::Tables;
use nvsprior_train::filter::{FilterOptions, filter_examples, gains, train_filter};

use pairs::Run;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, steps, inputs @ ..] = arguments.as_slice() else {
        anyhow::bail!("OUT.nvf STEPS PRIOR CAMERAS SPLIT …")
    };
    let engine = Engine::new(&Default::default())?;
    let (mut learned, mut held_out) = (Vec::new(), Vec::new());
    for input in inputs.as_chunks::<3>().0 {
        let run = Run::open(&engine, input)?;
        learned.push(filter_examples(&run.learned, &Tables::generic(), 6, 1));
        held_out.push((input, filter_examples(&run.held_out, &Tables::generic(), 5, 2)));
    }
    let sets: Vec<_> = learned.iter().map(Vec::as_slice).collect();
    let options = FilterOptions { steps: steps.parse()?, vary: true, ..FilterOptions::default() };
    let weights = train_filter(&sets, None, &options, |done, loss| {
        if done % 1000 == 0 {
            println!("{done}: {loss:.4}");
        }
    })?;
    for (input, examples) in &held_out {
        println!("{input:?}");
        gains(examples, &weights).iter().for_each(|gain| println!("  {gain:.2?}"));
    }
    std::fs::write(out, weights.write())?;
    Ok(())
}
