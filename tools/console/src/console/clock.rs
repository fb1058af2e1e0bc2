//! The topside's time: UTC that does not go back. Of a recording that is played, it is that of the dive.

use std::time::{Duration, Instant};

use crate::journal::utc;

#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Instant,
    /// UTC at the start, seconds.
    utc: f64,
    speed: f64,
}

impl Clock {
    /// The system's UTC as it is now; later changes of the system's clock do not count.
    pub fn system() -> Clock {
        Clock { start: Instant::now(), utc: utc(), speed: 1.0 }
    }

    /// Begins at a time of a recording, and goes so many times as fast.
    pub fn of_recording(utc: f64, speed: f64) -> Clock {
        Clock { start: Instant::now(), utc, speed }
    }

    /// UTC, seconds.
    pub fn now(&self) -> f64 {
        self.utc + self.start.elapsed().as_secs_f64() * self.speed
    }

    /// How long it takes until a time.
    pub fn until(&self, utc: f64) -> Duration {
        Duration::try_from_secs_f64((utc - self.now()) / self.speed).unwrap_or_default()
    }

    pub fn speed(&self) -> f64 {
        self.speed
    }
}
