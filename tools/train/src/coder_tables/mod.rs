//! Training the tables of the wavelet coder on frames and their renders.

mod examples;
mod float_networks;
mod optimiser;
mod silt;
mod stream;
mod vary;

use nvsprior::Picture;
use nvsprior::coder_tables::{MAGNITUDES, RANKS, Tables};
use nvsprior::residual::wavelet::Step;
use nvsprior::residual::wavelet::training::Sampler;
use rayon::prelude::*;

use examples::{Collector, Example};
use float_networks::{quantise, random_weights};
use nvsprior::random::Random;
use vary::vary;

pub use stream::{RunFrame, measure_stream, train_stream_tables};
pub use vary::Pair;

#[derive(Clone, Copy, Debug)]
pub struct TableOptions {
    /// Rounds of coding all frames and learning from it: each codes with the tables of the one before.
    pub rounds: usize,
    /// Times that the networks see each coefficient, in a round.
    pub epochs: usize,
    /// Quantiser steps that each frame is coded at, in a round.
    pub steps_per_frame: usize,
    /// Frames are mirrored, lit otherwise, and now and then beside another frame's render: for tables that are to do
    /// for any scene. Frames of shorter runs are then coded more often, so that runs count alike.
    pub vary: bool,
    /// Seed of everything that is chosen at random.
    pub seed: u64,
}

impl Default for TableOptions {
    fn default() -> Self {
        TableOptions { rounds: 3, epochs: 4, steps_per_frame: 3, vary: false, seed: 1 }
    }
}

/// How many times as often as those of the longest run the frames of a short one are coded, at most.
const MOST_TIMES: usize = 4;

/// Quantiser steps to train for: from a few bytes to finer than most links allow.
const STEPS: std::ops::Range<u8> = 16..54;

#[derive(Clone, Copy, Debug)]
pub struct TableProgress {
    /// Number of the round that has ended, from 0.
    pub round: usize,
    /// Coefficients that it learned from.
    pub examples: usize,
    /// Bits per coded frame, in training.
    pub bits: f64,
}

/// Trains tables on runs of frames, from `start` if there is one.
pub fn train_tables(
    runs: &[Vec<Pair>],
    start: Option<&Tables>,
    options: &TableOptions,
    mut progress: impl FnMut(TableProgress),
) -> Tables {
    let mut random = Random::new(options.seed);
    let mut tables = start.cloned().unwrap_or_else(Tables::zero);
    let mut weights = match start {
        Some(tables) => float_networks::weights_of(tables),
        None => random_weights(|| random.within(0.0, 1.0)),
    };
    for round in 0..options.rounds {
        let (examples, coded) = collect(runs, &tables, options, &mut random);
        offsets(&examples, &mut tables);
        let bits = optimiser::fit(&mut weights, &examples, options.epochs, &mut random);
        quantise(&weights, &mut tables);
        progress(TableProgress { round, examples: examples.len(), bits: bits / coded as f64 });
    }
    tables
}

/// Codes all frames at random steps. Coefficients to learn from, and how often a frame was coded.
fn collect(
    runs: &[Vec<Pair>],
    tables: &Tables,
    options: &TableOptions,
    random: &mut Random,
) -> (Vec<Example>, usize) {
    let longest = runs.iter().map(Vec::len).max().unwrap_or(0);
    let times = |run: &[Pair]| {
        let more = (longest / run.len().max(1)).clamp(1, MOST_TIMES);
        options.steps_per_frame * if options.vary { more } else { 1 }
    };
    let frames = runs.iter().flat_map(|run| run.iter().map(move |pair| (pair, run)));
    let frames: Vec<_> = frames.map(|(pair, run)| (pair, run, random.bits())).collect();
    let of_pair = |(pair, run, seed): &(&Pair, &Vec<Pair>, u64)| {
        let mut random = Random::new(*seed);
        let mut collector = Collector::new(random.bits());
        let Picture { width, height, .. } = pair.frame;
        let mut sampler = Sampler::new(width, height, tables);
        for _ in 0..times(run) {
            let varied = options.vary.then(|| vary(pair, run, &mut random));
            let pair = varied.as_ref().unwrap_or(pair);
            let before = collector.examples.len();
            let span = u64::from(STEPS.end - STEPS.start);
            let step = Step::new(STEPS.start + (random.bits() % span) as u8);
            // One coding in five does as a device that is not portable does.
            let sees_render = !random.bits().is_multiple_of(5);
            // One in four is coded without blocks, as most frames of a well-mapped site are.
            sampler.set_small_blocks(!random.bits().is_multiple_of(4));
            sampler.encoder().set(&pair.frame, &pair.render, sees_render);
            sampler.visit(step, |sample| collector.take(sample));
            collector.even_out(before);
        }
        collector.examples
    };
    let examples: Vec<Vec<_>> = frames.par_iter().map(of_pair).collect();
    let coded = runs.iter().map(|run| run.len() * times(run)).sum();
    (examples.into_iter().flatten().collect(), coded)
}

/// Where coefficients lie in their intervals, in the mean; little is claimed from few of them.
fn offsets(examples: &[Example], tables: &mut Tables) {
    const DOUBT: f64 = 20.0;
    let mut sums = [[[(0.0, 0.0); MAGNITUDES]; RANKS]; 3];
    let mut all = [(0.0, 0.0); MAGNITUDES];
    for example in examples.iter().filter(|e| e.value != 0) {
        let [rank, _, plane] = example.band.map(usize::from);
        let magnitude = i32::from(example.value).unsigned_abs();
        let less = f64::from(magnitude) - f64::from(example.wanted.abs());
        let class = magnitude.min(MAGNITUDES as u32) as usize - 1;
        for sum in [&mut sums[plane][rank][class], &mut all[class]] {
            *sum = (sum.0 + less, sum.1 + 1.0);
        }
    }
    for (tables, sums) in tables.offsets.iter_mut().zip(&sums) {
        for (tables, sums) in tables.iter_mut().zip(sums) {
            for ((to, sum), all) in tables.iter_mut().zip(sums).zip(&all) {
                let mean = all.0 / f64::max(all.1, 1.0);
                let less = (sum.0 + DOUBT * mean) / (sum.1 + DOUBT);
                *to = (256.0 * less).round().clamp(-127.0, 127.0) as i8;
            }
        }
    }
}

/// Bytes per frame that tables give, and PSNR, at a step: for reports.
pub fn measure(pairs: &[Pair], tables: &Tables, step: Step, sees_render: bool) -> (f64, f64) {
    let of_pair = |pair: &Pair| {
        let Picture { width, height, .. } = pair.frame;
        let mut sampler = Sampler::new(width, height, tables);
        sampler.set_small_blocks(true);
        let mut bytes = Vec::with_capacity(8 * pair.frame.data.len() + 64);
        sampler.encoder().set(&pair.frame, &pair.render, sees_render);
        sampler.encoder().choose_blocks(step);
        sampler.encoder().encode(step, &mut bytes);
        let mut shown = pair.render.clone();
        sampler.encoder().add_to(&mut shown);
        (bytes.len() as f64, shown.psnr(&pair.frame))
    };
    let all: Vec<_> = pairs.par_iter().map(of_pair).collect();
    let count = all.len().max(1) as f64;
    (all.iter().map(|v| v.0).sum::<f64>() / count, all.iter().map(|v| v.1).sum::<f64>() / count)
}
