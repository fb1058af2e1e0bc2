//! Details for nothing: what coefficients that are zero are worth, told by the render.
//!
//! Light that differs from the map's makes the difference picture look like the render. Coefficients too small to be
//! coded still lean that way, so a level's zeros of the first plane are decoded as `g · guess + o · own`: `own` is the
//! render's coefficient, `guess` that coefficient times the change of light that the decoded coarser picture shows.
//! The encoder fits both gains for each level.

use super::context::BandContext;
use super::geometry::MAX_LEVELS;
use super::quantised::Quantised;
use super::render_value::RenderValue;
use crate::range_coder::{EVEN, Probability, RangeDecoder, RangeEncoder};

/// The gains of a level, in parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Gains {
    /// Gain of the guess, eighths.
    guess: i8,
    /// Gain of the render's own coefficient, 64ths.
    own: i8,
}

pub type LevelGains = [Gains; MAX_LEVELS + 1];

/// Parts of a gain of one.
const PARTS: (i32, i32) = (8, 64);
/// Largest magnitude of a gain, parts.
const LARGEST: i8 = 12;
/// A zero is decoded as at most this, features: half a step.
const LARGEST_VALUE: i32 = 32;
/// Largest features that gains are multiplied with.
const LARGEST_SEEN: i32 = 1 << 14;
/// Chance that a gain is below zero, if it is not zero.
const NEGATIVE: Probability = 1 << 14;

impl Gains {
    /// Whether zeros stay zero.
    pub fn is_zero(self) -> bool {
        self == Gains::default()
    }

    /// What a zero is decoded as, a feature in steps.
    pub fn value(self, render: RenderValue) -> i32 {
        let of = |seen: i32| seen.clamp(-LARGEST_SEEN, LARGEST_SEEN);
        let guess = i32::from(self.guess) * (PARTS.1 / PARTS.0) * of(render.guess);
        let sum = guess + i32::from(self.own) * of(render.own);
        (sum / PARTS.1).clamp(-LARGEST_VALUE, LARGEST_VALUE)
    }

    pub fn write(self, level: usize, encoder: &mut RangeEncoder) {
        for (gain, code) in self.with_codes(level) {
            encoder.put(gain != 0, code.some);
            if gain != 0 {
                encoder.put(gain < 0, NEGATIVE);
                let more = gain.unsigned_abs() - 1;
                for _ in 0..more >> code.places {
                    encoder.put(true, EVEN);
                }
                encoder.put(false, EVEN);
                for bit in (0..code.places).rev() {
                    encoder.put(more >> bit & 1 > 0, EVEN);
                }
            }
        }
    }

    pub fn read(level: usize, decoder: &mut RangeDecoder) -> Option<Gains> {
        let mut gains = [0; 2];
        for (to, (_, code)) in gains.iter_mut().zip(Gains::default().with_codes(level)) {
            if !decoder.get(code.some)? {
                continue;
            }
            let negative = decoder.get(NEGATIVE)?;
            let mut more = 0;
            while more < LARGEST >> code.places && decoder.get(EVEN)? {
                more += 1;
            }
            for _ in 0..code.places {
                more = more << 1 | i8::from(decoder.get(EVEN)?);
            }
            let size = (more + 1).min(LARGEST);
            *to = if negative { -size } else { size };
        }
        let [guess, own] = gains;
        Some(Gains { guess, own })
    }

    fn bits(self, level: usize) -> f64 {
        let of = |(gain, code): (i8, Code)| match gain.unsigned_abs() {
            0 => -libm::log2(1.0 - f64::from(code.some) / 65_536.0),
            size => {
                let sign = if gain < 0 { 2.0 } else { 0.4 };
                let unary = f64::from(((size - 1) >> code.places) + 1);
                sign + unary + f64::from(code.places) - libm::log2(f64::from(code.some) / 65_536.0)
            }
        };
        self.with_codes(level).into_iter().map(of).sum()
    }

    /// Gives both gains with how they are coded: by Rice's code.
    fn with_codes(self, level: usize) -> [(i8, Code); 2] {
        // Counted on the reef's training frames and on the basin's.
        let (guess, own) = match level {
            0..=2 => (Code { some: 1 << 15, places: 2 }, Code { some: 40_000, places: 2 }),
            3 => (Code { some: 1 << 14, places: 2 }, Code { some: 1 << 14, places: 1 }),
            4 => (Code { some: 1 << 13, places: 1 }, Code { some: 1 << 13, places: 0 }),
            _ => (Code { some: 1 << 11, places: 0 }, Code { some: 1 << 13, places: 0 }),
        };
        [(self.guess, guess), (self.own, own)]
    }
}

/// How a gain is coded.
#[derive(Clone, Copy)]
struct Code {
    /// Chance that it is not zero.
    some: Probability,
    /// Last places of the magnitude that are coded as they are.
    places: u32,
}

/// Finds a level's gains by least squares.
#[derive(Default)]
pub struct GainFit {
    /// Sums of products: guess², guess · own, own², and both with what is wanted.
    guess_guess: f64,
    guess_own: f64,
    own_own: f64,
    guess_wanted: f64,
    own_wanted: f64,
}

impl GainFit {
    /// Takes the zeros of a band. `wanted`: the coefficients to code, in steps.
    pub fn take(&mut self, context: &BandContext, quantised: &Quantised, wanted: &[f32]) {
        context.zeros(quantised, |index, render| {
            let of = |seen: i32| f64::from(seen.clamp(-LARGEST_SEEN, LARGEST_SEEN)) / 64.0;
            let (guess, own) = (of(render.guess), of(render.own));
            let wanted = f64::from(wanted[index]);
            self.guess_guess += guess * guess;
            self.guess_own += guess * own;
            self.own_own += own * own;
            self.guess_wanted += guess * wanted;
            self.own_wanted += own * wanted;
        });
    }

    /// The best gains. `lambda`: what a bit is worth, squared steps.
    pub fn solve(&self, level: usize, lambda: f32) -> Gains {
        let (a, b, c) = (self.guess_guess, self.guess_own, self.own_own);
        let (u, v) = (self.guess_wanted, self.own_wanted);
        let determinant = a * c - b * b;
        let both = ((c * u - b * v) / determinant, (a * v - b * u) / determinant);
        let candidates = [both, (u / a, 0.0), (0.0, v / c)];
        let mut best = (-f64::from(lambda) * Gains::default().bits(level), Gains::default());
        for (guess, own) in candidates {
            let gains = Gains { guess: parts(guess, PARTS.0), own: parts(own, PARTS.1) };
            let gain = self.less_error(gains) - f64::from(lambda) * gains.bits(level);
            if gain > best.0 {
                best = (gain, gains);
            }
        }
        best.1
    }

    /// How much gains lessen the squared error, steps.
    fn less_error(&self, gains: Gains) -> f64 {
        let guess = f64::from(gains.guess) / f64::from(PARTS.0);
        let own = f64::from(gains.own) / f64::from(PARTS.1);
        let energy = guess * guess * self.guess_guess
            + 2.0 * guess * own * self.guess_own
            + own * own * self.own_own;
        2.0 * (guess * self.guess_wanted + own * self.own_wanted) - energy
    }
}

/// A gain in parts; 0 if it is not a number.
fn parts(gain: f64, parts: i32) -> i8 {
    // NaN becomes 0.
    (gain * f64::from(parts)).round().clamp(-f64::from(LARGEST), f64::from(LARGEST)) as i8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::range_coder::Tail;

    #[test]
    fn gains_come_back_at_their_price() {
        for level in 1..=MAX_LEVELS {
            for guess in -LARGEST..=LARGEST {
                for own in -LARGEST..=LARGEST {
                    let gains = Gains { guess, own };
                    let mut bytes = Vec::new();
                    let mut encoder = RangeEncoder::new(&mut bytes, 100);
                    gains.write(level, &mut encoder);
                    assert!(encoder.finish());
                    assert!(bytes.len() as f64 <= gains.bits(level) / 8.0 + 2.0, "{gains:?}");
                    let mut decoder = RangeDecoder::new(&bytes, Tail::Zeros);
                    assert_eq!(Gains::read(level, &mut decoder), Some(gains));
                }
            }
        }
    }

    #[test]
    fn a_fit_finds_the_gains_that_made_the_zeros() {
        let mut fit = GainFit::default();
        for i in 0..200 {
            let (guess, own) = (f64::from(i % 7) - 3.0, f64::from(i % 5) - 2.0);
            let wanted = 0.5 * guess - own / 16.0;
            fit.guess_guess += guess * guess;
            fit.guess_own += guess * own;
            fit.own_own += own * own;
            fit.guess_wanted += guess * wanted;
            fit.own_wanted += own * wanted;
        }
        assert_eq!(fit.solve(1, 0.13), Gains { guess: 4, own: -4 });
        assert_eq!(GainFit::default().solve(1, 0.13), Gains::default());
    }
}
