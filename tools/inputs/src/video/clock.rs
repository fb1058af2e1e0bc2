//! Times of frames as they should be: each lies after the one before.

use super::decoder::Way;

/// Seconds from one frame to the next if nothing says it.
pub const STEP: f64 = 1.0 / 25.0;
/// A frame must come so long after the one before, seconds: shorter steps are roundings of none.
const SHORTEST: f64 = 5e-5;
/// A step that is as long is a gap, seconds.
const GAP: f64 = 1.0;

/// Mends times. A frame whose time is missing or not later than that of the one before comes one step after it, and all
/// that follow are moved by as much. A step is the last one that was shorter than a second; before there is one, that
/// of the rate that the file states. Decoders give a frame without a time, or with one that lies back, the last one's.
pub struct Clock {
    untimed: bool,
    step: f64,
    /// What is added to the decoder's times.
    shift: f64,
    /// The last frame's time: the decoder's, and the mended one.
    last: Option<(f64, f64)>,
    /// Frames whose times were mended.
    pub mended: usize,
}

impl Clock {
    pub fn new(way: &Way) -> Clock {
        let step = way.rate.map_or(STEP, |rate| 1.0 / rate);
        Clock { untimed: way.untimed, step, shift: 0.0, last: None, mended: 0 }
    }

    /// The time of the next frame, of what its decoder says.
    pub fn time(&mut self, said: f64) -> f64 {
        let on = self.last.map(|(before, _)| said - before);
        if self.untimed || on.is_some_and(|on| !(on >= SHORTEST)) {
            self.shift = self.last.map_or(0.0, |(_, time)| time + self.step) - said;
            self.mended += 1;
        } else if let Some(on) = on.filter(|on| *on < GAP) {
            self.step = on;
        }
        let time = said + self.shift;
        self.last = Some((said, time));
        time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mended(rate: Option<f64>, untimed: bool, times: &[f64]) -> (Vec<f64>, usize) {
        let mut clock = Clock::new(&Way { rate, untimed, ..Way::default() });
        let times = times.iter().map(|time| (1e6 * clock.time(*time)).round() / 1e6);
        (times.collect(), clock.mended)
    }

    #[test]
    fn good_times_stay() {
        for times in [[0.0, 0.1, 0.25, 7300.0, 7300.1], [5.0, 5.001, 5.002, 5.003, 65.0]] {
            assert_eq!(mended(Some(30.0), false, &times), (times.to_vec(), 0));
        }
    }

    #[test]
    fn times_that_go_back_or_stand_still_go_on() {
        let expected = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        // As a file has them, and as a decoder gives them.
        for times in [[0.0, 0.1, 0.2, 0.1, 0.2, 0.3], [0.0, 0.1, 0.2, 0.2, 0.2, 0.3]] {
            let (found, count) = mended(None, false, &times);
            assert_eq!(found, expected);
            assert!((1..=2).contains(&count), "{count}");
        }
        assert_eq!(mended(Some(10.0), false, &[0.0; 6]), (expected.to_vec(), 5));
        assert_eq!(mended(None, false, &[0.0; 3]), (vec![0.0, 0.04, 0.08], 2));
        // A gap is no step.
        assert_eq!(mended(None, false, &[0.0, 0.1, 9.0, 9.0]).0, [0.0, 0.1, 9.0, 9.1]);
    }

    #[test]
    fn frames_without_times_follow_at_the_stated_rate() {
        assert_eq!(mended(Some(10.0), true, &[0.0, 0.3, 9.0]), (vec![0.0, 0.1, 0.2], 3));
    }
}
