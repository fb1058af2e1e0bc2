//! Pictures as the topside has them before the filter.

use nvsprior::Picture;
use nvsprior::coder_tables::Tables;
use nvsprior::random::Random;
use nvsprior::residual::wavelet::{Step, WaveletEncoder};
use rayon::prelude::*;

use crate::coder_tables::Pair;

/// A frame, its render, and the picture that a topside has of it.
pub struct FilterExample {
    /// What the camera saw.
    pub frame: Picture,
    /// What the prior shows.
    pub render: Picture,
    /// The render and the decoded residual, at some steps of the quantiser.
    pub decoded: Vec<(u8, Picture)>,
}

/// Numbers of the quantiser's steps that are trained for: from a thousand bytes and more down to a few.
const STEPS: std::ops::Range<u8> = 18..58;

/// Codes and decodes frames, each at `count` steps, spread over all.
pub fn filter_examples(
    pairs: &[Pair],
    tables: &Tables,
    count: usize,
    seed: u64,
) -> Vec<FilterExample> {
    let of_pair = |(number, pair): (usize, &Pair)| {
        let mut random = Random::new(seed ^ number as u64);
        let Picture { width, height, .. } = pair.frame;
        let mut encoder = WaveletEncoder::new(width, height, tables);
        encoder.set(&pair.frame, &pair.render, true);
        let mut bytes = Vec::with_capacity(8 * pair.frame.data.len() + 64);
        let width = f32::from(STEPS.end - STEPS.start) / count as f32;
        let decoded = (0..count).map(|k| {
            let number = f32::from(STEPS.start) + width * (k as f32 + random.within(0.0, 1.0));
            let step = Step::new(number as u8);
            encoder.choose_blocks(step);
            encoder.encode(step, &mut bytes);
            let mut picture = pair.render.clone();
            encoder.add_to(&mut picture);
            (step.index(), picture)
        });
        let decoded = decoded.collect();
        FilterExample { frame: pair.frame.clone(), render: pair.render.clone(), decoded }
    };
    pairs.par_iter().enumerate().map(of_pair).collect()
}
