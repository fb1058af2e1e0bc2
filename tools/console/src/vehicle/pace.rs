//! How many frames per second the vehicle takes.

use std::collections::VecDeque;

/// Frames that are looked at.
const FRAMES: usize = 16;
/// Gaps between them from which on the vehicle is too slow: a single frame may take long.
const GAPS: usize = 4;
/// A change by less is none.
const STEP: f64 = 0.1;

/// Tells from the numbers of the frames that were taken for which part of the camera's there is time, and numbers them
/// by it: a topside cannot tell modem frames apart whose numbers leap by too much.
pub struct Pace {
    /// The camera's numbers.
    taken: VecDeque<usize>,
    part: f64,
    /// The last frame as it is sent.
    number: usize,
}

impl Pace {
    /// All of the frames.
    pub fn full() -> Pace {
        Pace { taken: VecDeque::with_capacity(FRAMES + 1), part: 1.0, number: 0 }
    }

    /// The number that a frame is sent with.
    pub fn number(&mut self, camera: usize) -> usize {
        let steps = self.taken.back().map_or(camera as f64, |last| (camera - last) as f64);
        let least = usize::from(!self.taken.is_empty());
        self.number += ((steps * self.part).round() as usize).max(least);
        self.number
    }

    /// Notes the number of a frame that is taken. Returns the part that is taken from now on, if it is another.
    pub fn take(&mut self, number: usize) -> Option<f64> {
        self.taken.push_back(number);
        if self.taken.len() > FRAMES {
            self.taken.pop_front();
        }
        let pairs = self.taken.iter().zip(self.taken.iter().skip(1));
        let steps = pairs.map(|(before, after)| *after - *before);
        let (gaps, longest) = steps.fold((0, 0), |(gaps, longest), step| {
            (gaps + usize::from(step > 1), longest.max(step))
        });
        // The longest is left out: a search from nothing.
        let part = match gaps < GAPS {
            true => 1.0,
            false => (self.taken.len() - 2) as f64 / (number - self.taken[0] - longest) as f64,
        };
        let is_other = (part < 1.0) != (self.part < 1.0) || (part / self.part - 1.0).abs() > STEP;
        is_other.then(|| self.part = part)?;
        Some(part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_that_come_again_slow_it_down_until_they_end() {
        let mut pace = Pace::full();
        assert!((0..20).all(|number| pace.take(number).is_none()));
        assert_eq!(pace.take(60), None, "a single frame took long");
        let parts: Vec<f64> = (61..100).filter_map(|k| pace.take(60 + 4 * (k - 60))).collect();
        assert!(parts.last().is_some_and(|part| (part - 0.25).abs() < 0.025), "{parts:?}");
        let number = pace.number(217);
        assert_eq!(pace.taken.back(), Some(&216));
        let parts: Vec<f64> = (217..240).filter_map(|number| pace.take(number)).collect();
        assert_eq!(parts.last(), Some(&1.0));
        assert_eq!(pace.number(243), number + 4);
    }
}
