//! Coefficients to learn from, as the coder meets them.

use nvsprior::coder_tables::networks::{MAGNITUDE_INPUTS, SIGN_INPUTS};
use nvsprior::residual::wavelet::training::Sample;

use nvsprior::random::Random;

/// A coefficient, and how many like it stand for it.
pub struct Example {
    pub magnitude: [i16; MAGNITUDE_INPUTS],
    pub sign: [i16; SIGN_INPUTS],
    pub band: [u8; 3],
    pub value: i16,
    pub wanted: f32,
    pub weight: f32,
    /// What its frame counts.
    pub share: f32,
}

/// Levels from here on are coarse: all of their coefficients are kept.
const COARSE: u8 = 4;
/// Of zeros among zeros one in so many is kept; of zeros near others, one in so many.
const FAR: u64 = 24;
const NEAR: u64 = 2;

pub struct Collector {
    pub examples: Vec<Example>,
    random: Random,
}

impl Collector {
    pub fn new(seed: u64) -> Collector {
        Collector { examples: Vec::new(), random: Random::new(seed) }
    }

    /// Takes a coefficient, or lets one of many like it stand for it.
    pub fn take(&mut self, sample: Sample) {
        let [rank, ..] = sample.band;
        let keep = if sample.value != 0 || rank == 0 || rank >= COARSE {
            1
        } else if sample.magnitude[..9].iter().any(|count| *count > 0) {
            NEAR
        } else {
            FAR
        };
        if keep > 1 && !self.random.bits().is_multiple_of(keep) {
            return;
        }
        let Sample { magnitude, sign, band, value, wanted } = sample;
        let weight = keep as f32;
        self.examples.push(Example { magnitude, sign, band, value, wanted, weight, share: 1.0 });
    }

    /// Weighs the examples from `first` on, those of one coded frame, by how few of them count: a frame of a hundred
    /// bytes is to be learned from as well as one of ten thousand.
    pub fn even_out(&mut self, first: usize) {
        const USUAL: f32 = 1000.0;
        let examples = &mut self.examples[first..];
        let count = examples.iter().filter(|example| example.value != 0).count();
        let share = (USUAL / (count as f32 + 20.0)).sqrt();
        examples.iter_mut().for_each(|example| example.share = share);
    }
}
