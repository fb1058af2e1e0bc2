//! A rough guess of what coding a frame comes to, from how large its coefficients are.

use super::fineness::Fineness;

/// Sizes per octave that are told apart.
const PER_OCTAVE: usize = 16;
/// Bits of an `f32` below its exponent and the first places of its fraction, which tell [`PER_OCTAVE`] sizes apart.
const REST: u32 = 19;
/// The smallest size that is told from zero, levels of 8 bits; octaves from there on.
const SMALLEST: f32 = 0.25;
const OCTAVES: usize = 16;
const BINS: usize = OCTAVES * PER_OCTAVE;

/// Coefficients below this are zero in the end, steps: without a price on bits, and what the price adds.
const DEAD: f64 = 0.5;
const DEAD_PER_LAMBDA: f64 = 1.9;
/// Bits of a coefficient that is not zero, and of each octave above; and of a payload without any.
const BITS: f64 = 3.7;
const BITS_PER_OCTAVE: f64 = 1.1;
const BITS_MIN: f64 = 16.0;

/// How many coefficients of about one size a frame has.
#[derive(Clone, Copy, Default)]
struct Bin {
    count: u32,
    /// Sum of their squares.
    energy: f64,
}

impl Bin {
    fn take(&mut self, energy: f64) {
        self.count += 1;
        self.energy += energy;
    }
}

/// What a frame may come to, at any fineness.
#[derive(Clone)]
pub struct Model {
    bins: [Bin; BINS],
    count: u32,
}

impl Model {
    /// Makes a model that has seen no coefficient.
    pub fn new() -> Model {
        Model { bins: [Bin::default(); BINS], count: 0 }
    }

    /// Takes coefficients of unit norm, in levels of 8 bits.
    pub fn take(&mut self, sizes: impl Iterator<Item = f32>) {
        // Most are small: their bin stays at hand.
        let [mut small, ..] = self.bins;
        for size in sizes {
            let energy = f64::from(size * size);
            let place = (size.to_bits() >> REST).saturating_sub(SMALLEST.to_bits() >> REST);
            if place == 0 {
                small.take(energy);
            } else {
                self.bins[(place as usize).min(BINS - 1)].take(energy);
            }
            self.count += 1;
        }
        self.bins[0] = small;
    }

    /// PSNR, dB.
    pub fn psnr(&self, fineness: Fineness) -> f64 {
        let step = fineness.step().value();
        let error: f64 = self
            .shares(fineness)
            .map(|(bin, _, dead)| {
                let kept = (1.0 - dead) * f64::from(bin.count);
                dead * bin.energy + kept * step * step / 12.0
            })
            .sum();
        let mean = error / f64::from(self.count.max(1));
        10.0 * libm::log10(65_025.0 / mean.max(1e-9))
    }

    pub fn bytes(&self, fineness: Fineness) -> f64 {
        let step = fineness.step().value();
        let bits: f64 = self
            .shares(fineness)
            .map(|(bin, size, dead)| {
                let octaves = libm::log2(size / step).max(0.0);
                (1.0 - dead) * f64::from(bin.count) * (BITS + BITS_PER_OCTAVE * octaves)
            })
            .sum();
        (BITS_MIN + bits) / 8.0
    }

    /// The bins, their least size, and which share of them is zero in the end.
    fn shares(&self, fineness: Fineness) -> impl Iterator<Item = (&Bin, f64, f64)> {
        let dead = DEAD + DEAD_PER_LAMBDA * f64::from(fineness.lambda());
        let threshold = dead * fineness.step().value();
        self.bins.iter().enumerate().filter(|(_, bin)| bin.count > 0).map(move |(i, bin)| {
            let bound = |i: usize| {
                f64::from(f32::from_bits(((SMALLEST.to_bits() >> REST) + i as u32) << REST))
            };
            // The first bin holds all that is smaller, too.
            let low = if i == 0 { 0.0 } else { bound(i) };
            let below = (threshold - low) / (bound(i + 1) - low);
            (bin, low, below.clamp(0.0, 1.0))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_knows_what_is_lost_and_what_is_kept() {
        let mut model = Model::new();
        model.take([0.0; 90].into_iter());
        model.take([100.0; 10].into_iter());
        // All are kept at the finest step, none at the coarsest.
        let (finest, coarsest) = (Fineness::new(0.5), Fineness::new(63.5));
        let of_error = |error: f64| 10.0 * (65_025.0 / error).log10();
        assert!((model.psnr(coarsest) - of_error(1000.0)).abs() < 1e-6);
        assert!((model.psnr(finest) - of_error(0.1 * 4.0 / 12.0)).abs() < 1e-6);
        assert_eq!(model.bytes(coarsest), 2.0);
        assert!(model.bytes(finest) > 10.0);
    }

    #[test]
    fn any_size_has_a_place() {
        let mut model = Model::new();
        model.take([0.0, 1e-30, 0.25, 1.0, 1e9, f32::MAX].into_iter());
        assert_eq!(model.count, 6);
        assert!(model.psnr(Fineness::new(20.0)).is_finite());
    }
}
