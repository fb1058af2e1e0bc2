//! The frames of a run with the prior's renders, for the examples that train what comes with the library.

use anyhow::Context as _;
use nvsprior::{Encoder, EncoderOptions, Engine};
use nvsprior_inputs::args::SizeArgs;
use nvsprior_inputs::input::InputArgs;
use nvsprior_train::coder_tables::Pair;

/// To learn from, and to measure on.
pub struct Run {
    pub learned: Vec<Pair>,
    pub held_out: Vec<Pair>,
}

impl Run {
    /// Of a prior, a camera file and a split; `-` stands for all frames. Every eighth frame with a certain pose is held
    /// out.
    pub fn open(engine: &Engine, input: &[String; 3]) -> anyhow::Result<Run> {
        let mut run = Run { learned: Vec::new(), held_out: Vec::new() };
        for (index, pair) in pairs_of(engine, input)?.into_iter().enumerate() {
            if index % 8 == 4 { &mut run.held_out } else { &mut run.learned }.push(pair);
        }
        println!("{input:?}: {} frames, {} held out", run.learned.len(), run.held_out.len());
        Ok(run)
    }
}

/// The frames of a run with a certain pose, with the prior's renders.
fn pairs_of(engine: &Engine, [prior, cameras, split]: &[String; 3]) -> anyhow::Result<Vec<Pair>> {
    let scene = engine.upload(&nvsprior_formats::open(prior.as_ref(), &Default::default())?)?;
    let input = InputArgs {
        cameras: Some(cameras.into()),
        split: (split != "-").then(|| split.clone()),
        limit: None,
        size: SizeArgs::default(),
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
