//! How finely a frame is coded, as one number; and the search for it.

use super::step::{STEPS, Step};

/// What a bit is worth, squared quantiser steps.
pub const LAMBDA: f32 = 0.13;

/// The quantiser's index and, between two of them, what a bit is worth: from 0, the finest, to [`STEPS`].
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Fineness(f64);

/// Range of lambda at one step, octaves. A step is worth a quarter of one. Far from [`LAMBDA`] the same picture takes
/// more bytes (docs/decisions.md, 21).
const LAMBDA_OCTAVES: f64 = 0.7;
/// Index of the step at quality 0.
const COARSEST_QUALITY: f64 = 42.0;
const COARSEST: f64 = STEPS as f64 - 0.001;

impl Fineness {
    /// The nearest that there is.
    pub fn new(value: f64) -> Fineness {
        Fineness(value.clamp(0.0, COARSEST))
    }

    /// The fineness of a quality, 0 to 100.
    pub fn of_quality(quality: f32) -> Fineness {
        let index = COARSEST_QUALITY * (1.0 - f64::from(quality) / 100.0);
        Fineness::new(index.round() + 0.5)
    }

    pub fn step(self) -> Step {
        Step::new(self.0 as u8)
    }

    /// What a bit is worth, squared steps: [`LAMBDA`] amid two steps. The ranges of two steps overlap, so that no
    /// length is left out between them.
    pub fn lambda(self) -> f32 {
        LAMBDA * libm::exp2(LAMBDA_OCTAVES * (self.0.fract() - 0.5)) as f32
    }
}

/// A search for the fineness at which a number, which falls with it, has a value.
///
/// A rough model of the number is put right by what is told: by how far it is off, the same everywhere, or between two
/// places by as much more or less as they are apart.
pub struct Bracket<M> {
    target: f64,
    /// The number at a fineness, roughly.
    model: M,
    told: [Told; MOST_TOLD],
    count: usize,
    /// How far the model is expected to be below the number.
    off: f64,
}

/// A number that was told.
#[derive(Clone, Copy, Default)]
struct Told {
    at: f64,
    value: f64,
    /// How far the model is below it.
    off: f64,
}

/// Numbers that can be told.
pub const MOST_TOLD: usize = 16;
/// The search ends if a trial that is too fine and one that is too coarse are nearer than this. The next trial stays so
/// far from the earlier ones, unless they are too near to each other.
const ASIDE: f64 = 0.02;
/// If the last two trials were on one side, the next one stays this share of the distance away from both ends.
const SHARE_ASIDE: f64 = 0.3;

impl<M: Fn(Fineness) -> f64> Bracket<M> {
    /// Begins at where the model has the target, if it is below the number by `off`.
    pub fn new(target: f64, off: f64, model: M) -> Bracket<M> {
        Bracket { target, model, told: [Told::default(); MOST_TOLD], count: 0, off }
    }

    /// How far the model was below the number that was told last; `None`: none was.
    pub fn last_off(&self) -> Option<f64> {
        self.told[..self.count].last().map(|told| told.off)
    }

    /// The number at a fineness.
    pub fn tell(&mut self, at: Fineness, value: f64) {
        if let Some(told) = self.told.get_mut(self.count) {
            *told = Told { at: at.0, value, off: value - (self.model)(at) };
            self.count += 1;
        }
    }

    /// Another target. What was told holds.
    pub fn aim(&mut self, target: f64) {
        self.target = target;
    }

    /// What to try next; `None`: no more is to be found.
    pub fn next(&self) -> Option<Fineness> {
        let told = &self.told[..self.count];
        if told.len() == MOST_TOLD {
            return None;
        }
        let too_fine = |told: &&Told| told.value >= self.target;
        let fine = told.iter().filter(too_fine).max_by(|a, b| a.at.total_cmp(&b.at));
        let behind = |told: &&Told| fine.is_none_or(|fine| fine.at < told.at);
        let coarse = told.iter().filter(|told| !too_fine(told)).filter(behind);
        let coarse = coarse.min_by(|a, b| a.at.total_cmp(&b.at));
        let next = match (fine, coarse) {
            (None, None) => self.root((0.0, self.off), (COARSEST, self.off)),
            (Some(fine), Some(coarse)) if coarse.at - fine.at < ASIDE => return None,
            (Some(fine), Some(coarse)) => {
                let root = self.root((fine.at, fine.off), (coarse.at, coarse.off));
                let again = matches!(told, [.., a, b] if too_fine(&a) == too_fine(&b));
                let share = SHARE_ASIDE * (coarse.at - fine.at);
                let aside = if again { share } else { share.min(ASIDE) };
                root.clamp(fine.at + aside, coarse.at - aside)
            }
            (Some(fine), None) if fine.at >= COARSEST => return None,
            (None, Some(coarse)) if coarse.at <= 0.0 => return None,
            (Some(Told { at, off, .. }), None) => {
                let root = self.root((*at, *off), (COARSEST, *off));
                root.max(at + ASIDE).min(COARSEST)
            }
            (None, Some(Told { at, off, .. })) => {
                let root = self.root((0.0, *off), (*at, *off));
                root.min(at - ASIDE).max(0.0)
            }
        };
        Some(Fineness::new(next))
    }

    /// Where the model has the target. It is off by so much at both ends, and between them by what lies between.
    fn root(&self, fine: (f64, f64), coarse: (f64, f64)) -> f64 {
        let ((mut low, off_low), (mut high, off_high)) = (fine, coarse);
        let (begin, slope) = (low, (off_high - off_low) / (high - low).max(1e-9));
        for _ in 0..16 {
            let middle = 0.5 * (low + high);
            let off = off_low + slope * (middle - begin);
            if (self.model)(Fineness(middle)) + off >= self.target {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tries until the number is within a tolerance of the target. How many it takes.
    fn tries(number: impl Fn(f64) -> f64, model: impl Fn(f64) -> f64, tolerance: f64) -> u32 {
        let mut bracket = Bracket::new(30.0, 0.0, |fineness: Fineness| model(fineness.0));
        for tries in 1..30 {
            let at = bracket.next().expect("a target within reach");
            let value = number(at.0);
            if (value - 30.0).abs() < tolerance {
                return tries;
            }
            bracket.tell(at, value);
        }
        panic!("not found");
    }

    #[test]
    fn a_target_is_found_soon() {
        let number = |x: f64| 50.0 - 0.4 * x - 0.002 * x * x;
        assert_eq!(tries(number, number, 1e-2), 1);
        assert!(tries(number, |x| number(x) + 3.0, 1e-2) <= 3);
        assert!(tries(number, |x| 45.0 - 0.2 * x, 1e-2) <= 6);
        // A number that jumps back at every whole one, as lengths do.
        let saw = |x: f64| number(x.floor()) - 0.8 * x.fract();
        assert!(tries(saw, |x| number(x) + 2.0, 2e-2) <= 7);
    }

    #[test]
    fn a_target_out_of_reach_ends_the_search() {
        for value in [20.0, 40.0] {
            let mut bracket = Bracket::new(30.0, 0.0, |fineness: Fineness| 40.0 - fineness.0);
            let mut tries = 0;
            while let Some(at) = bracket.next() {
                bracket.tell(at, value);
                tries += 1;
            }
            assert!(tries < 10, "{tries}");
        }
    }
}
