//! The time that a part of the report has.

use std::time::{Duration, Instant};

/// Ends a part's repeats when its time is over. A repeat that has begun is never ended.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    end: Instant,
    seconds: f64,
}

impl Pace {
    /// So many seconds from now on.
    pub fn of(seconds: f64) -> Pace {
        let seconds = seconds.max(0.0);
        let allowed = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::ZERO);
        Pace { end: Instant::now() + allowed, seconds }
    }

    /// Whether another repeat may begin.
    pub fn goes_on(&self) -> bool {
        Instant::now() < self.end
    }

    /// When that is over.
    pub fn end(&self) -> Instant {
        self.end
    }

    /// Whether it has so many seconds. A time that is no number is too long.
    pub fn affords(&self, seconds: f64) -> bool {
        seconds <= self.seconds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_affords_what_fits_into_its_time() {
        let pace = Pace::of(10.0);
        assert!(pace.goes_on() && !Pace::of(0.0).goes_on() && !Pace::of(-1.0).goes_on());
        assert!(pace.affords(9.0) && !pace.affords(11.0) && !pace.affords(f64::NAN));
    }
}
