//! Trains the tables that the wavelet coder has for inter frames: `src/residual/wavelet/stream.nvt`.
//!
//!     cargo run --release -p nvsprior-cli --example stream_tables -- OUT.nvt PRIOR CAMERAS SPLIT [PRIOR CAMERAS …]
//!
//! The frames of each camera file are one run, some 15 frames a second. Every eighth part of twelve frames is held out,
//! and its bytes are printed.

use std::path::Path;

use anyhow::Context as _;
use nvsprior::coder_tables::Tables;
use nvsprior::packet::Packet;
use nvsprior::render::Plan;
use nvsprior::residual::Viewpoint;
use nvsprior::residual::wavelet::Step;
use nvsprior::{Encoder, EncoderOptions, Engine, Picture};
use nvsprior_inputs::args::SizeArgs;
use nvsprior_inputs::input::InputArgs;
use nvsprior_train::coder_tables::{RunFrame, TableOptions, measure_stream, train_stream_tables};

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (out, inputs) = arguments.split_first().context("OUT.nvt PRIOR CAMERAS SPLIT …")?;
    let engine = Engine::new(&Default::default())?;
    let mut runs = Vec::new();
    for input in inputs.chunks_exact(3) {
        runs.extend(run_of(&engine, &input[0], &input[1], &input[2])?);
    }
    let (mut learned, mut held_out) = (Vec::new(), Vec::new());
    for run in &runs {
        for (index, part) in run.chunks(12).enumerate() {
            let to = if index % 8 == 4 { &mut held_out } else { &mut learned };
            to.push(part.to_vec());
        }
    }
    println!("{} parts to learn from, {} held out", learned.len(), held_out.len());
    let start = Tables::generic().for_stream();
    let report = |tables: &Tables, name: &str| {
        for distance in [1, 5] {
            for step in [24, 32, 40] {
                let of =
                    |run: &Vec<RunFrame>| measure_stream(run, tables, Step::new(step), distance);
                let all: Vec<_> = held_out.iter().filter(|run| run.len() > 6).map(of).collect();
                let count = all.len().max(1) as f64;
                let bytes = all.iter().map(|v| v.0).sum::<f64>() / count;
                let psnr = all.iter().map(|v| v.1).sum::<f64>() / count;
                println!("{name} distance {distance} step {step}: {bytes:.1} bytes, {psnr:.3} dB");
            }
        }
    };
    report(&start, "start");
    let rounds = std::env::var("ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(3);
    let options = TableOptions { rounds, ..TableOptions::default() };
    let tables = train_stream_tables(&learned, &options, |progress| {
        println!("{progress:?}");
    });
    report(&tables, "trained");
    std::fs::write(out, tables.write()).with_context(|| out.clone())
}

/// The runs of certain frames of a camera file.
fn run_of(
    engine: &Engine,
    prior: &str,
    cameras: &str,
    split: &str,
) -> anyhow::Result<Vec<Vec<RunFrame>>> {
    let prior = nvsprior_formats::open(Path::new(prior), &Default::default())?;
    let scene = engine.upload(&prior)?;
    let input = InputArgs {
        cameras: Some(cameras.into()),
        split: Some(split.into()),
        limit: None,
        size: SizeArgs::default(),
        starts: "camera-file".into(),
    };
    let frames = input.frames()?;
    let camera = frames[0].camera;
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(engine, &scene, &camera, options)?;
    let plan = Plan { depths: true, ..Plan::picture() };
    let mut renderer = engine.renderer(&scene, &camera, plan)?;
    let (mut runs, mut run) = (Vec::new(), Vec::new());
    for frame in frames {
        let (picture, encoded) = frame.encode(&mut encoder, &frame.read()?)?;
        if !encoded.stats.certain {
            runs.push(std::mem::take(&mut run));
            continue;
        }
        let code = Packet::decode(&encoded.packet)?.latent.pose.words();
        renderer.draw_coded_deep(&code)?;
        let mut render = Picture::new(camera.width, camera.height);
        render.data.copy_from_slice(renderer.rendered());
        let viewpoint = Viewpoint { camera, placement: renderer.placed(&code) };
        let depths = renderer.depths().collect();
        run.push(RunFrame { picture, render, viewpoint, depths });
    }
    runs.push(run);
    Ok(runs)
}
