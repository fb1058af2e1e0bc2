//! How finely a frame is coded, as one number; and the search for it.

use super::encoder::LAMBDA;
use super::step::{STEPS, Step};

/// The quantiser's index and, between two of them, what a bit is worth: from 0, the finest, to [`STEPS`].
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Fineness(f64);

/// Index of the step at quality 0.
const COARSEST_QUALITY: f64 = 42.0;
/// The coarsest.
const COARSEST: f64 = STEPS as f64 - 0.001;

impl Fineness {
    /// The nearest that there is.
    pub fn new(value: f64) -> Fineness {
        Fineness(value.clamp(0.0, COARSEST))
    }

    /// Of a quality, 0 to 100.
    pub fn of_quality(quality: f32) -> Fineness {
        let index = COARSEST_QUALITY * (1.0 - f64::from(quality) / 100.0);
        Fineness::new(index.round() + 0.5)
    }

    /// The coarsest at which something holds that holds for all finer ones; the finest if it holds for none.
    pub fn coarsest(mut holds: impl FnMut(Step) -> bool) -> Fineness {
        let (mut fine, mut coarse) = (0, STEPS);
        while coarse - fine > 1 {
            let middle = (fine + coarse) / 2;
            if holds(Step::new(middle)) { fine = middle } else { coarse = middle }
        }
        Fineness::new(f64::from(fine) + 0.5)
    }

    /// The quantiser's step.
    pub fn step(self) -> Step {
        Step::new(self.0 as u8)
    }

    /// What a bit is worth, squared steps: [`LAMBDA`] amid two steps. The ranges of two steps overlap, so that no
    /// length is left out between them.
    pub fn lambda(self) -> f32 {
        LAMBDA * libm::exp2(1.5 * (self.0.fract() - 0.5)) as f32
    }
}

/// A search for the fineness at which a number, which falls or rises with it, has a value.
pub struct Bracket {
    target: f64,
    /// What the number changes by, per unit: a guess.
    slope: f64,
    next: Option<f64>,
    last: Option<(f64, f64)>,
    /// The nearest on either side: too fine, and too coarse.
    fine: Option<(f64, f64)>,
    coarse: Option<(f64, f64)>,
}

impl Bracket {
    /// Begins at `first`. `slope`: change of the number per unit of fineness, below zero.
    pub fn new(first: Fineness, target: f64, slope: f64) -> Bracket {
        let (next, last) = (Some(first.0), None);
        Bracket { target, slope, next, last, fine: None, coarse: None }
    }

    /// What to try next; `None`: no more is to be found.
    pub fn next(&self) -> Option<Fineness> {
        self.next.map(Fineness::new)
    }

    /// The number at a fineness.
    pub fn tell(&mut self, at: Fineness, value: f64) {
        let here = (at.0, value);
        if value >= self.target {
            self.fine = Some(here);
        } else {
            self.coarse = Some(here);
        }
        self.slope = self.slope_to(here);
        let ahead = |(x, value): (f64, f64)| x + (self.target - value) / self.slope;
        self.next = match (self.fine, self.coarse) {
            (Some(fine), Some(coarse)) if coarse.0 - fine.0 < 1e-3 => None,
            (Some((x, v)), Some((y, w))) => {
                let part = ((v - self.target) / (v - w)).clamp(0.1, 0.9);
                Some(x + part * (y - x))
            }
            (Some(fine), None) if fine.0 >= COARSEST => None,
            (None, Some(coarse)) if coarse.0 <= 0.0 => None,
            // Further than it seems, so that the next one lies beyond or near.
            (Some(fine), None) => Some((ahead(fine) + 0.05).min(COARSEST)),
            (None, Some(coarse)) => Some((ahead(coarse) - 0.05).max(0.0)),
            (None, None) => None,
        };
    }

    /// The slope between the last value and this one, if it is not far from what it was.
    fn slope_to(&mut self, (x, value): (f64, f64)) -> f64 {
        let slope = match self.last.replace((x, value)) {
            Some((last, before)) if (x - last).abs() > 1e-3 => (value - before) / (x - last),
            _ => self.slope,
        };
        slope.clamp(4.0 * self.slope, 0.25 * self.slope)
    }
}
