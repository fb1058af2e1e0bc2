//! How many of some modem frames arrive: Gilbert's model of a link that loses frames in bursts.

use std::ops::Deref;

use crate::modem::error::ModemError;
use crate::modem::limits::MAX_SHARES;

/// How a link loses modem frames: each one with the same chance, in bursts of a mean length (E. N. Gilbert, Bell System
/// Technical Journal 39, 1960; no frame arrives in the bad state, and all do in the good one).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Chance that a frame is lost, 0 up to but not 1.
    pub chance: f64,
    /// Mean number of frames that are lost in a row, 1 and more. Frames that are lost independently of each other have
    /// 1 / (1 − chance); less counts as that.
    pub burst: f64,
}

impl Loss {
    /// Nothing is lost.
    pub const NONE: Loss = Loss { chance: 0.0, burst: 1.0 };

    /// # Errors
    /// If the chance is not in 0..1, or the burst is not finite or below 1.
    pub fn check(&self) -> Result<(), ModemError> {
        let chance = (0.0..1.0).contains(&self.chance);
        let burst = self.burst.is_finite() && self.burst >= 1.0;
        if chance && burst { Ok(()) } else { Err(ModemError::Loss(self.chance, self.burst)) }
    }

    /// Chances that a frame is lost: after one that arrived, and after a lost one.
    pub fn steps(&self) -> [f64; 2] {
        let burst = self.burst.max(1.0 / (1.0 - self.chance));
        let again = 1.0 - 1.0 / burst;
        let begins = self.chance / (1.0 - self.chance) / burst;
        [begins.min(1.0), again]
    }

    /// The loss of every `apart`-th frame: the further apart frames are, the less they share a burst.
    pub fn spaced(&self, apart: f64) -> Loss {
        let [begins, again] = self.steps();
        let kept = (again - begins).max(0.0).powf(apart.max(1.0));
        let again = self.chance + (1.0 - self.chance) * kept;
        Loss { chance: self.chance, burst: 1.0 / (1.0 - again) }
    }

    /// Chances that exactly 0, 1, …, `count` of `count` frames in a row arrive.
    ///
    /// # Panics
    /// If the count is above [`MAX_SHARES`].
    pub fn arrivals(&self, count: usize) -> Arrivals {
        let [begins, again] = self.steps();
        // By number of frames that arrived, and whether the last one was lost.
        let mut chances = [[0.0; 2]; MAX_SHARES + 1];
        chances[0] = [1.0 - self.chance, self.chance];
        for sent in 0..count {
            for arrived in (0..=sent).rev() {
                let [good, bad] = chances[arrived];
                let lost = good * begins + bad * again;
                chances[arrived][0] = 0.0;
                chances[arrived][1] = lost;
                chances[arrived + 1][0] += good + bad - lost;
            }
        }
        Arrivals { count, chances: chances.map(|[good, bad]| good + bad) }
    }
}

/// Chances that exactly 0, 1, … frames arrive.
pub struct Arrivals {
    count: usize,
    chances: [f64; MAX_SHARES + 1],
}

impl Deref for Arrivals {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.chances[..=self.count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nvsprior::random::Random;

    #[test]
    fn independent_losses_are_binomial() {
        let loss = Loss { chance: 0.2, burst: 1.0 };
        let chances = loss.arrivals(4);
        let expected = [0.0016, 0.0256, 0.1536, 0.4096, 0.4096];
        for (chance, expected) in std::iter::zip(chances.iter(), expected) {
            assert!((chance - expected).abs() < 1e-12, "{chance} {expected}");
        }
    }

    #[test]
    fn bursts_are_as_long_and_as_many_as_said() {
        let loss = Loss { chance: 0.2, burst: 4.0 };
        let steps = loss.steps();
        let mut random = Random::new(5);
        let (mut lost, mut bursts, mut before) = (0, 0, false);
        let mut counts = [0.0; 9];
        let draws = 400_000;
        for _ in 0..draws / 8 {
            let mut arrived = 0;
            for _ in 0..8 {
                let now = f64::from(random.within(0.0, 1.0)) < steps[usize::from(before)];
                lost += u32::from(now);
                bursts += u32::from(now && !before);
                arrived += usize::from(!now);
                before = now;
            }
            counts[arrived] += 8.0 / f64::from(draws);
        }
        assert!((f64::from(lost) / f64::from(draws) - 0.2).abs() < 0.01);
        assert!((f64::from(lost) / f64::from(bursts) - 4.0).abs() < 0.1);
        for (drawn, chance) in std::iter::zip(counts, loss.arrivals(8).iter()) {
            assert!((drawn - chance).abs() < 0.01, "{drawn} {chance}");
        }
    }

    #[test]
    fn frames_far_apart_are_lost_independently() {
        let loss = Loss { chance: 0.2, burst: 4.0 };
        assert!((loss.spaced(1.0).burst - 4.0).abs() < 1e-12);
        assert!((loss.spaced(50.0).burst - 1.25).abs() < 1e-6);
        let [begins, again] = loss.steps();
        let two = loss.spaced(2.0).steps();
        assert!((two[1] - (again * again + (1.0 - again) * begins)).abs() < 1e-12);
    }

    #[test]
    fn what_no_link_does_is_refused() {
        for (chance, burst) in
            [(1.0, 1.0), (-0.1, 1.0), (f64::NAN, 1.0), (0.1, 0.5), (0.1, f64::INFINITY)]
        {
            assert!(Loss { chance, burst }.check().is_err(), "{chance} {burst}");
        }
    }
}
