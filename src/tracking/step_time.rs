//! How long a step of a frame takes on its device.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::Clock;

/// Steps of which the longest counts.
const RECENT: usize = 8;

/// How long a step takes: the longest of the last ones, by a clock. All who hold it share it.
#[derive(Clone, Debug)]
pub struct StepTime {
    clock: Clock,
    recent: Arc<Mutex<Recent>>,
}

#[derive(Debug, Default)]
struct Recent {
    times: [Duration; RECENT],
    next: usize,
}

impl StepTime {
    /// None is known yet: they take no time.
    pub fn new(clock: &Clock) -> StepTime {
        StepTime { clock: clock.clone(), recent: Arc::default() }
    }

    /// The time by its clock.
    pub fn now(&self) -> Duration {
        self.clock.now()
    }

    /// Notes that so many steps began at a time, and end now. None change nothing.
    pub fn note(&self, begun: Duration, steps: u32) {
        if steps > 0 {
            self.add(self.now().saturating_sub(begun) / steps);
        }
    }

    /// Notes how long a step took.
    pub fn add(&self, taken: Duration) {
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::super::counted;
    use super::*;

    #[test]
    fn the_longest_of_the_last_steps_counts() {
        let (clock, time) = counted();
        let steps = StepTime::new(&clock);
        assert_eq!(steps.longest(), Duration::ZERO);
        let take = |milliseconds: u64, count: u32| {
            let begun = steps.now();
            time.fetch_add(milliseconds, Ordering::Relaxed);
            steps.note(begun, count);
            steps.longest().as_millis()
        };
        assert_eq!((take(40, 4), take(0, 0), take(9, 3), take(30, 2)), (10, 10, 10, 15));
        assert_eq!([(); RECENT].map(|()| take(5, 1))[RECENT - 1], 5);
    }
}
