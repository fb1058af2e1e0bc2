//! How long a step of a frame takes on its device.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::Pose;
use crate::search::COMPACT;
use crate::vulkan::Error;

use super::budget::{COARSE, LEAST, Room, SearchSteps};
use super::gauss_newton;
use super::schedule::Schedule;
use super::{Clock, GaussNewtonOptions, Objective, Relocaliser};

/// Steps of which the longest counts.
const RECENT: usize = 8;
/// How often steps are timed at a pose. The shortest time counts: the driver compiles, and other programs disturb.
const ROUNDS: usize = 3;

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

    fn add(&self, taken: Duration) {
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

impl SearchSteps {
    /// Measures at some poses. The driver compiles then, and in no frame.
    pub fn measure(
        clock: &Clock,
        objective: &mut Objective,
        poses: &[Pose],
    ) -> Result<SearchSteps, Error> {
        let GaussNewtonOptions { cold, damping, .. } = GaussNewtonOptions::default();
        let once = Schedule { first_level: 0, follow_level: 0, renders: 1, leap: 0.0, ..cold };
        let mut relocaliser = Relocaliser::new(objective, &[]);
        objective.set_flat_frame();
        let search = |objective: &mut Objective, pose: &Pose, schedule: &Schedule| {
            gauss_newton::search(objective, &[*pose], schedule, damping, COMPACT, &Room::ALL)
        };
        let steps = SearchSteps { coarse: StepTime::new(clock), look: StepTime::new(clock) };
        for pose in poses {
            search(objective, pose, &cold)?;
            let mut shortest = [Duration::MAX; 2];
            for _ in 0..ROUNDS {
                let begun = clock.now();
                search(objective, pose, &once)?;
                let searched = clock.now();
                relocaliser.approach(objective, pose, 1)?;
                let taken = [
                    searched.saturating_sub(begun) / (COARSE * LEAST),
                    clock.now().saturating_sub(searched),
                ];
                shortest = std::array::from_fn(|i| shortest[i].min(taken[i]));
            }
            steps.coarse.add(shortest[0]);
            steps.look.add(shortest[1]);
        }
        Ok(steps)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn the_longest_of_the_last_steps_counts() {
        let time = Arc::new(AtomicU64::new(0));
        let told = time.clone();
        let clock = Clock::new(move || Duration::from_millis(told.load(Ordering::Relaxed)));
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
