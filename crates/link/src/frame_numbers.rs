//! Which number a camera frame has, and how many per second the vehicle takes.
//!
//! Numbers count the camera's frames, those that never came here, too: so the topside knows when each was taken. A
//! vehicle that is too slow for its camera leaves out frames again and again. It then counts by the frames that it
//! takes: a topside cannot tell modem frames apart whose numbers leap by too much.

use std::collections::VecDeque;

/// Steps that are looked at.
const STEPS: usize = 15;
/// Of so many steps beyond a single frame on, the vehicle is too slow: a single frame may take long.
const GAPS: usize = 4;
/// A change by less is none.
const CHANGE: f64 = 0.1;
/// Greatest step: shares name their packet by its number modulo 256.
const MOST: f64 = 100.0;
/// Frames that come so much earlier than their rate says count from themselves on.
const EARLY: f64 = 2.0;

#[derive(Debug)]
pub(super) struct FrameNumbers {
    /// Camera frames per second; `None`: not known, each one counts.
    rate: Option<f64>,
    /// When the last frame was exposed, and its number.
    last: Option<(f64, u32)>,
    /// The last number, with the part of a frame that rounding took.
    exact: f64,
    /// The first number, or the one after the last.
    next: u32,
    /// Camera frames from one that came to the next.
    steps: VecDeque<f64>,
    /// Part of the camera's frames that is taken.
    part: f64,
}

impl FrameNumbers {
    pub fn new(rate: Option<f64>, first: u32) -> FrameNumbers {
        let steps = VecDeque::with_capacity(STEPS + 1);
        FrameNumbers { rate, last: None, exact: first.into(), next: first, steps, part: 1.0 }
    }

    /// The number after the last.
    pub fn next(&self) -> u32 {
        self.next
    }

    /// The number of a frame that came. Times must not fall.
    pub fn count(&mut self, exposed: f64) -> u32 {
        let number = match (self.last, self.rate) {
            (Some((before, last)), Some(rate)) => {
                let step = ((exposed - before).max(0.0) * rate).min(MOST);
                self.note(step);
                self.exact += step * self.part;
                let least = f64::from(last) + 1.0;
                if self.exact < least - EARLY {
                    self.exact = least;
                }
                (self.exact.round().max(least)) as u32
            }
            _ => self.next,
        };
        (self.last, self.next) = (Some((exposed, number)), number.wrapping_add(1));
        if number == u32::MAX {
            self.exact = -1.0;
        }
        number
    }

    fn note(&mut self, step: f64) {
        self.steps.push_back(step.round().max(1.0));
        if self.steps.len() > STEPS {
            self.steps.pop_front();
        }
    }

    /// Frames per second that are taken from here on, if they are others than before.
    pub fn changed_rate(&mut self) -> Option<f64> {
        let gaps = self.steps.iter().filter(|step| **step > 1.0).count();
        let (sum, longest) = self
            .steps
            .iter()
            .fold((0.0, 0.0), |(sum, longest): (f64, f64), step| (sum + step, longest.max(*step)));
        // The longest is left out: a search from nothing.
        let part = match gaps < GAPS {
            true => 1.0,
            false => (self.steps.len() - 1) as f64 / (sum - longest),
        };
        let is_other = (part < 1.0) != (self.part < 1.0) || (part / self.part - 1.0).abs() > CHANGE;
        is_other.then(|| self.part = part)?;
        Some(self.rate? * part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_the_cameras_frames() {
        let mut numbers = FrameNumbers::new(Some(15.0), 7);
        let times = [0.0, 1.0, 2.0, 3.1, 6.0, 6.2, 9.0, 30.0, 1e9];
        let counted: Vec<u32> = times.iter().map(|time| numbers.count(time / 15.0)).collect();
        assert_eq!(counted, [7, 8, 9, 10, 13, 14, 16, 37, 137], "no leap is too great");
        let mut each = FrameNumbers::new(None, 3);
        assert_eq!([0.0, 9.0, 5.0].map(|time| each.count(time)), [3, 4, 5]);
        // Uneven times do not add up.
        let mut numbers = FrameNumbers::new(Some(10.0), 0);
        let counted: Vec<u32> = (0..40).map(|k| numbers.count(f64::from(k) * 0.134)).collect();
        assert_eq!(counted.last(), Some(&52));
    }

    #[test]
    fn gaps_that_come_again_slow_it_down_until_they_end() {
        let mut numbers = FrameNumbers::new(Some(1.0), 0);
        let mut rates = |times: &mut dyn Iterator<Item = u32>| -> Vec<f64> {
            let changed = times.filter_map(|time| {
                numbers.count(time.into());
                numbers.changed_rate()
            });
            changed.collect()
        };
        assert_eq!(rates(&mut (0..20)), [0.0; 0]);
        assert_eq!(rates(&mut (60..61)), [0.0; 0], "a single frame took long");
        let slow = rates(&mut (16..55).map(|k| 4 * k));
        assert!(slow.last().is_some_and(|rate| (rate - 0.25).abs() < 0.025), "{slow:?}");
        assert_eq!(rates(&mut (217..240)).last(), Some(&1.0));
    }
}
