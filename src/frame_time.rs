//! The most time that a frame may take, and when its search must end for that.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::Error;
use crate::tracking::{Clock, Costs};

/// Frames of which the longest coding counts.
const RECENT: usize = 8;

/// How long coding takes: the longest of the last frames. All who hold it share it.
#[derive(Clone, Debug)]
pub(crate) struct CodingTime {
    clock: Clock,
    recent: Arc<Mutex<Recent>>,
}

#[derive(Debug, Default)]
struct Recent {
    times: [Duration; RECENT],
    next: usize,
}

impl CodingTime {
    pub fn new(clock: &Clock) -> CodingTime {
        CodingTime { clock: clock.clone(), recent: Arc::default() }
    }

    /// The time by its clock.
    pub fn now(&self) -> Duration {
        self.clock.now()
    }

    /// Notes a coding that began at a time, and ends now.
    pub fn note(&self, begun: Duration) {
        let taken = self.now().saturating_sub(begun);
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        let next = recent.next;
        recent.times[next] = taken;
        recent.next = (next + 1) % RECENT;
    }

    /// The longest of the last ones.
    pub fn longest(&self) -> Duration {
        let recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        recent.times.into_iter().max().unwrap_or_default()
    }
}

/// The most time that frames of an encoder take.
#[derive(Debug)]
pub(crate) struct FrameTime {
    most: Duration,
    pub costs: Costs,
    pub coding: CodingTime,
}

impl FrameTime {
    /// Fails if `most` is less than one render and one coding take.
    pub fn new(most: Duration, costs: Costs, coding: CodingTime) -> Result<FrameTime, Error> {
        let least = costs.picture + coding.longest();
        if most < least {
            let [most, least] = [most, least].map(|time| time.as_secs_f64() * 1e3);
            return Err(Error::FrameTimeShort { most, least });
        }
        Ok(FrameTime { most, costs, coding })
    }

    /// When the search of a frame that begins now must have ended. What was found is then drawn and coded.
    pub fn deadline(&self) -> Duration {
        let after = self.costs.picture + self.coding.longest();
        self.coding.now() + self.most.saturating_sub(after)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    fn milliseconds(count: u64) -> Duration {
        Duration::from_millis(count)
    }

    /// How long coding takes, 20 ms so far, and what sets its clock, milliseconds.
    fn coding() -> (CodingTime, Arc<AtomicU64>) {
        let time = Arc::new(AtomicU64::new(20));
        let told = time.clone();
        let clock = Clock::new(move || milliseconds(told.load(Ordering::Relaxed)));
        let coding = CodingTime::new(&clock);
        coding.note(Duration::ZERO);
        (coding, time)
    }

    const COSTS: Costs = Costs {
        picture: Duration::from_millis(10),
        evaluation: Duration::from_millis(20),
        coarse: Duration::from_millis(5),
        look: Duration::from_millis(30),
    };

    #[test]
    fn one_render_and_one_coding_must_fit() {
        let (coding, _) = coding();
        let error = FrameTime::new(milliseconds(29), COSTS, coding.clone()).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("29.0 ms") && text.contains("30.0 ms"), "{text}");
        let least = FrameTime::new(milliseconds(30), COSTS, coding).unwrap();
        assert_eq!(least.deadline(), milliseconds(20), "the search has no time");
    }

    #[test]
    fn the_longest_coding_of_the_last_frames_is_left_for_the_next() {
        let (coding, time) = coding();
        let frames = FrameTime::new(milliseconds(100), COSTS, coding.clone()).unwrap();
        assert_eq!(frames.deadline(), milliseconds(20 + 100 - 10 - 20));
        time.store(1000, Ordering::Relaxed);
        coding.note(milliseconds(950));
        assert_eq!(frames.deadline(), milliseconds(1000 + 100 - 10 - 50));
        for _ in 0..RECENT {
            coding.note(milliseconds(995));
        }
        assert_eq!(frames.deadline(), milliseconds(1000 + 100 - 10 - 5));
        coding.note(milliseconds(0));
        assert_eq!(frames.deadline(), milliseconds(1000), "it takes longer than all of the time");
    }
}
