//! Training the weights of the display filter on frames, their renders, and what the coder makes of them.

mod adam;
mod examples;
mod network;
mod patches;

use nvsprior::filter_weights::{FilterWeights, FilterWeightsError};
use nvsprior::random::Random;
use nvsprior::render::filter::definition::filtered;
use nvsprior::residual::wavelet::Step;
use rayon::prelude::*;

use adam::Adam;
use network::{Network, Workspace};
use patches::Patch;

pub use examples::{FilterExample, filter_examples};

#[derive(Clone, Copy, Debug)]
pub struct FilterOptions {
    /// Steps of training.
    pub steps: usize,
    /// Pictures are lit otherwise, and their colours exchanged: for weights that are to do for any scene.
    pub vary: bool,
    /// Seed of everything that is chosen at random.
    pub seed: u64,
}

impl Default for FilterOptions {
    fn default() -> Self {
        FilterOptions { steps: 4000, vary: false, seed: 1 }
    }
}

/// Patches of a step.
const BATCH: usize = 16;
/// Parts of a batch whose gradients are summed apart, then in order: the same sums with any number of threads.
const PARTS: usize = 4;

/// Trains weights, from `start` if there is one. `sets` are chosen from alike, however many examples each has; within a
/// set, all examples alike. `progress` gets the number of steps done, and the mean loss of the last hundred: the
/// natural logarithm of the mean squared error, less that without the filter.
///
/// # Errors
/// If the weights have grown beyond what the filter holds exactly.
pub fn train_filter(
    sets: &[&[FilterExample]],
    start: Option<&FilterWeights>,
    options: &FilterOptions,
    mut progress: impl FnMut(usize, f64),
) -> Result<FilterWeights, FilterWeightsError> {
    let mut random = Random::new(options.seed);
    let mut network = match start {
        Some(weights) => Network::of(weights),
        None => Network::random(&mut random),
    };
    let mut adam = Adam::new(network.len());
    let mut spaces: Vec<_> = (0..PARTS).map(|_| (Workspace::default(), network.zeros())).collect();
    let mut loss = 0.0;
    for done in 0..options.steps {
        let batch: Vec<_> =
            (0..BATCH).map(|_| Patch::random(sets, options.vary, &mut random)).collect();
        let rounded = network.rounded();
        let parts = spaces.par_iter_mut().zip(batch.par_chunks(BATCH / PARTS));
        let losses: Vec<f64> = parts
            .map(|((space, gradient), patches)| {
                gradient.clear();
                patches.iter().map(|patch| rounded.learn(patch, space, gradient)).sum()
            })
            .collect();
        let (sum, rest) = spaces.split_at_mut(1);
        rest.iter().for_each(|(_, gradient)| sum[0].1.add(gradient));
        adam.step(&mut network, &sum[0].1, BATCH, done as f32 / options.steps as f32);
        loss += losses.iter().sum::<f64>() / BATCH as f64;
        if (done + 1) % 100 == 0 {
            progress(done + 1, std::mem::take(&mut loss) / 100.0);
        }
    }
    network.quantised()
}

/// What a filter gains at one step of the quantiser.
#[derive(Clone, Copy, Debug)]
pub struct FilterGain {
    /// The step, levels, as geometric mean.
    pub step: f64,
    /// Mean PSNR before and after the filter, dB.
    pub psnr: [f64; 2],
}

/// What weights gain on examples that were all coded equally often: by number of the coding, from fine to coarse.
pub fn gains(examples: &[FilterExample], weights: &FilterWeights) -> Vec<FilterGain> {
    let codings = examples.iter().map(|example| example.decoded.len()).min().unwrap_or(0);
    let gain = |coding: usize| {
        let of = |example: &FilterExample| {
            let (step, decoded) = &example.decoded[coding];
            let shown = filtered(weights, *step, &example.render, decoded);
            let psnr = [decoded, &shown].map(|picture| picture.psnr(&example.frame));
            (Step::new(*step).value().ln(), psnr)
        };
        let all: Vec<_> = examples.par_iter().map(of).collect();
        let count = all.len() as f64;
        let psnr = [0, 1].map(|which| all.iter().map(|(_, psnr)| psnr[which]).sum::<f64>() / count);
        let step = all.iter().map(|(step, _)| step).sum::<f64>() / count;
        FilterGain { step: step.exp(), psnr }
    };
    (0..codings).map(gain).collect()
}

#[cfg(test)]
mod tests;
