//! How many of some modem frames arrive: Gilbert's model of a link that loses frames in bursts.

use super::super::ModemError;

/// How a link loses modem frames: each one with the same chance, in bursts of a mean length (E. N. Gilbert, Bell System
/// Technical Journal 39, 1960; no frame arrives in the bad state, and all do in the good one).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Share of the frames that is lost, 0 up to but not 1.
    pub share: f64,
    /// Mean number of frames that are lost in a row, 1 and more. Frames that are lost independently of each other have
    /// 1 / (1 − share); less counts as that.
    pub burst: f64,
}

impl Loss {
    /// Nothing is lost.
    pub const NONE: Loss = Loss { share: 0.0, burst: 1.0 };

    /// # Errors
    /// If the share is not in 0..1, or the burst is not finite or below 1.
    pub fn check(&self) -> Result<(), ModemError> {
        let share = (0.0..1.0).contains(&self.share);
        let burst = self.burst.is_finite() && self.burst >= 1.0;
        if share && burst { Ok(()) } else { Err(ModemError::Loss(self.share, self.burst)) }
    }

    /// Chances that a frame is lost: after one that arrived, and after a lost one.
    pub fn steps(&self) -> [f64; 2] {
        let burst = self.burst.max(1.0 / (1.0 - self.share));
        let again = 1.0 - 1.0 / burst;
        let begins = self.share / (1.0 - self.share) / burst;
        [begins.min(1.0), again]
    }

    /// The loss of every `apart`-th frame: the further apart frames are, the less they share a burst.
    pub(super) fn spaced(&self, apart: f64) -> Loss {
        let [begins, again] = self.steps();
        let kept = (again - begins).max(0.0).powf(apart.max(1.0));
        let again = self.share + (1.0 - self.share) * kept;
        Loss { share: self.share, burst: 1.0 / (1.0 - again) }
    }

    /// Chances that exactly 0, 1, …, `count` of `count` frames in a row arrive.
    pub(super) fn arrivals(&self, count: usize) -> Vec<f64> {
        let [begins, again] = self.steps();
        // By number of frames that arrived, and whether the last one was lost.
        let mut chances = vec![[0.0; 2]; count + 1];
        chances[0] = [1.0 - self.share, self.share];
        for sent in 0..count {
            for arrived in (0..=sent).rev() {
                let [good, bad] = chances[arrived];
                let lost = good * begins + bad * again;
                chances[arrived][0] = 0.0;
                chances[arrived][1] = lost;
                chances[arrived + 1][0] += good + bad - lost;
            }
        }
        chances.iter().map(|[good, bad]| good + bad).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn independent_losses_are_binomial() {
        let loss = Loss { share: 0.2, burst: 1.0 };
        let chances = loss.arrivals(4);
        let expected = [0.0016, 0.0256, 0.1536, 0.4096, 0.4096];
        for (chance, expected) in std::iter::zip(chances, expected) {
            assert!((chance - expected).abs() < 1e-12, "{chance} {expected}");
        }
    }

    #[test]
    fn bursts_are_as_long_and_as_many_as_said() {
        let loss = Loss { share: 0.2, burst: 4.0 };
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
        for (drawn, chance) in std::iter::zip(counts, loss.arrivals(8)) {
            assert!((drawn - chance).abs() < 0.01, "{drawn} {chance}");
        }
    }

    #[test]
    fn frames_far_apart_are_lost_independently() {
        let loss = Loss { share: 0.2, burst: 4.0 };
        assert!((loss.spaced(1.0).burst - 4.0).abs() < 1e-12);
        assert!((loss.spaced(50.0).burst - 1.25).abs() < 1e-6);
        let [begins, again] = loss.steps();
        let two = loss.spaced(2.0).steps();
        assert!((two[1] - (again * again + (1.0 - again) * begins)).abs() < 1e-12);
    }

    #[test]
    fn what_no_link_does_is_refused() {
        for (share, burst) in
            [(1.0, 1.0), (-0.1, 1.0), (f64::NAN, 1.0), (0.1, 0.5), (0.1, f64::INFINITY)]
        {
            assert!(Loss { share, burst }.check().is_err(), "{share} {burst}");
        }
    }
}
