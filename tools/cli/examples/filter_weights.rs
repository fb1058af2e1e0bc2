//! Trains the display filter's weights that come with the library: `src/filter_weights/generic.nvf`.
//!
//!     cargo run --release -p nvsprior-cli --example filter_weights -- OUT.nvf STEPS PRIOR CAMERAS SPLIT [PRIOR …]
//!
//! Each run of frames counts alike. A SPLIT of `-` stands for all frames. Every eighth frame of each run is held out,
//! and what the filter gains on it is printed.

use std::path::Path;

use anyhow::Context as _;
use nvsprior::coder_tables::Tables;
use nvsprior::prior::filter_file;
use nvsprior::{Encoder, EncoderOptions, Engine, Prior};
use nvsprior_inputs::args::SizeArgs;
use nvsprior_inputs::input::InputArgs;
use nvsprior_train::coder_tables::Pair;
use nvsprior_train::filter::{FilterOptions, filter_examples, gains, train_filter};

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, steps, inputs @ ..] = arguments.as_slice() else {
        anyhow::bail!("OUT.nvf STEPS PRIOR CAMERAS SPLIT …")
    };
    let engine = Engine::new(&Default::default())?;
    let (mut learned, mut held_out) = (Vec::new(), Vec::new());
    for input in inputs.as_chunks::<3>().0 {
        let pairs = pairs_of(&engine, input)?;
        let (mut to_learn, mut to_hold) = (Vec::new(), Vec::new());
        for (index, pair) in pairs.into_iter().enumerate() {
            if index % 8 == 4 { &mut to_hold } else { &mut to_learn }.push(pair);
        }
        println!("{input:?}: {} frames, {} held out", to_learn.len(), to_hold.len());
        learned.push(filter_examples(&to_learn, &Tables::generic(), 6, 1));
        held_out.push((input, filter_examples(&to_hold, &Tables::generic(), 5, 2)));
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
    filter_file::save(&weights, Path::new(out))?;
    Ok(())
}

/// The frames of a run with a certain pose, with the prior's renders.
fn pairs_of(engine: &Engine, [prior, cameras, split]: &[String; 3]) -> anyhow::Result<Vec<Pair>> {
    let scene = engine.upload(&Prior::open(prior.as_ref(), &Default::default())?)?;
    let input = InputArgs {
        cameras: cameras.into(),
        split: (split != "-").then(|| split.clone()),
        limit: None,
        size: SizeArgs::default(),
        start_offset: None,
        starts: "camera-file".into(),
    };
    let frames = input.frames()?;
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let first = frames.first().context("no frames")?;
    let mut encoder = Encoder::new(engine, &scene, &first.camera, options)?;
    let mut pairs = Vec::new();
    for frame in &frames {
        let (picture, encoded) = frame.encode(&mut encoder, &frame.read()?)?;
        if encoded.stats.certain {
            pairs.push(Pair { frame: picture, render: encoded.render });
        }
    }
    Ok(pairs)
}
