//! When a frame was exposed, by the topside's clock: the first user bytes that travel with its packet.
//!
//! A topside that knows only when packets came cannot tell how old a picture is: a delay that all of them have does not
//! show. So the vehicle tells the time of exposure. Its own clock may be wrong. Each report tells the topside's time as
//! it was sent, and the vehicle counts from the report that was fastest of late. The age is then never told too small,
//! and too large by no more than that report took.
//!
//! | bits | content, little endian |
//! |---|---|
//! | 0–12 | time in steps of 80 ms, modulo 655.36 s; 8191 by the vehicle's own time: it knows none |
//! | 13–14 | from which age on a picture is old: [`AgeLimit`] |
//! | 15 | whether the time is counted from a report; else it is the vehicle's own UTC |

use std::collections::VecDeque;

use super::age_limit::AgeLimit;

/// Bytes that travel with each packet.
pub const EXPOSURE_LEN: usize = 2;
/// Steps of a stamp, and of the time of a packet, which is cut to fewer.
const STEP: f64 = 0.02;
const STEPS: u16 = 1 << 15;
const CUT: u16 = 4;
const LIMIT_AT: u32 = 13;
/// Told if the vehicle knows no time.
const NO_TIME: u16 = (1 << LIMIT_AT) - 1;
/// Seconds after which stamps begin anew.
pub const PERIOD: f64 = STEP * STEPS as f64;
/// Reports that count: the clocks drift.
const REPORTS: usize = 16;
/// Greatest age that is believed by each clock, seconds. A vehicle's own clock may be days off.
const OLDEST: f64 = 600.0;
const OLDEST_BY_VEHICLE: f64 = 60.0;

/// Whose clock a time is by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockSource {
    /// The topside's, as its reports told it.
    Reports,
    /// The vehicle's own UTC.
    Vehicle,
}

/// A time modulo [`PERIOD`], as steps.
pub fn stamp(seconds: f64) -> u16 {
    (seconds.rem_euclid(PERIOD) / STEP) as u16 % STEPS
}

/// A time as it travels; `None`: the vehicle knows none.
pub fn written(time: Option<(f64, ClockSource)>, limit: AgeLimit) -> [u8; EXPOSURE_LEN] {
    let word = match time {
        Some((seconds, ClockSource::Reports)) => (stamp(seconds) / CUT) | STEPS,
        // The last step of a period is told as the one before.
        Some((seconds, ClockSource::Vehicle)) => (stamp(seconds) / CUT).min(NO_TIME - 1),
        None => NO_TIME,
    };
    (word | (limit.bits() << LIMIT_AT)).to_le_bytes()
}

/// How old a frame is at `now`, the topside's UTC in seconds, by the user bytes of its packet. `None`: they tell no
/// time, or one that cannot be, as the vehicle's clock is wrong.
pub fn age(user: &[u8], now: f64) -> Option<(f64, ClockSource)> {
    let word = word(user)?;
    let source = if word >= STEPS { ClockSource::Reports } else { ClockSource::Vehicle };
    if source == ClockSource::Vehicle && word % (1 << LIMIT_AT) == NO_TIME {
        return None;
    }
    let age = (now - f64::from(word % (1 << LIMIT_AT)) * STEP * f64::from(CUT)).rem_euclid(PERIOD);
    // Times are cut to their steps.
    let age = if age > PERIOD - 2.0 * STEP { 0.0 } else { age };
    let oldest = if source == ClockSource::Vehicle { OLDEST_BY_VEHICLE } else { OLDEST };
    (age <= oldest).then_some((age, source))
}

/// Whether the user bytes of a packet tell a time by the vehicle's own clock.
pub fn is_by_vehicle(user: &[u8]) -> bool {
    word(user).is_some_and(|word| word < STEPS && word % (1 << LIMIT_AT) != NO_TIME)
}

/// From which age on a picture is old, by the user bytes of its packet; seconds.
pub fn limit(user: &[u8]) -> f64 {
    let told = word(user).map(|word| AgeLimit::from_bits(word >> LIMIT_AT));
    told.unwrap_or(AgeLimit::UNTOLD).seconds()
}

fn word(user: &[u8]) -> Option<u16> {
    user.first_chunk().map(|bytes| u16::from_le_bytes(*bytes))
}

/// The topside's clock, as the vehicle knows it.
#[derive(Debug)]
pub struct TopsideClock {
    /// Of the last reports: topside's time less vehicle's, modulo [`PERIOD`].
    differences: VecDeque<f64>,
}

impl Default for TopsideClock {
    fn default() -> TopsideClock {
        TopsideClock { differences: VecDeque::with_capacity(REPORTS + 1) }
    }
}

impl TopsideClock {
    /// A report that came at `now`, the vehicle's time, tells when it was sent.
    pub fn reported(&mut self, now: f64, sent: u16) {
        self.differences.push_back((f64::from(sent) * STEP - now).rem_euclid(PERIOD));
        if self.differences.len() > REPORTS {
            self.differences.pop_front();
        }
    }

    /// The topside's time at `now`, the vehicle's. It is early by as long as the fastest report was on its way. `None`:
    /// none has come.
    pub fn at(&self, now: f64) -> Option<f64> {
        let first = *self.differences.front()?;
        let beyond = |difference: &f64| (difference - first + PERIOD / 2.0).rem_euclid(PERIOD);
        let fastest = self.differences.iter().map(beyond).fold(f64::MIN, f64::max);
        Some((now + first + fastest - PERIOD / 2.0).rem_euclid(PERIOD))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(exposed: f64, now: f64) -> Option<f64> {
        let time = Some((exposed, ClockSource::Vehicle));
        age(&written(time, AgeLimit::UNTOLD), now).map(|(age, _)| age)
    }

    #[test]
    fn ages_are_told_across_the_period() {
        for (exposed, now) in
            [(5.0, 7.5), (PERIOD - 1.0, PERIOD + 1.5), (1.7e9 + 0.37, 1.7e9 + 2.87)]
        {
            let told = of(exposed, now).unwrap();
            assert!((told - 2.5).abs() <= STEP * f64::from(CUT), "{told}");
        }
        assert_eq!(of(10.0, 10.0 - 1e-3), Some(0.0), "a stamp of now is not of the past period");
        assert_eq!(of(60.0, 30.0), None, "a vehicle's clock that is ahead is not believed");
        assert_eq!(of(60.0, 130.0), None, "nor one that is behind");
        assert_eq!((age(&[1], 0.0), age(&[], 0.0)), (None, None));
        for bits in 0..4 {
            let told = AgeLimit::from_bits(bits);
            assert_eq!(age(&written(None, told), 2.0), None);
            let bytes = written(Some((1.0, ClockSource::Reports)), told);
            assert_eq!(age(&bytes, 2.0).unwrap().1, ClockSource::Reports);
            assert_eq!((limit(&bytes), limit(&[1])), (told.seconds(), AgeLimit::UNTOLD.seconds()));
        }
    }

    /// The vehicle's clock is off by an hour. Reports take 0.4 s and more.
    #[test]
    fn the_fastest_report_counts_and_ages_are_never_too_small() {
        let mut clock = TopsideClock::default();
        assert_eq!(clock.at(0.0), None);
        let vehicle = |topside: f64| topside + 3600.0;
        for (sent, delay) in [(100.0, 1.5), (101.0, 0.4), (102.0, 2.0)] {
            clock.reported(vehicle(sent + delay), stamp(sent));
        }
        let (exposed, now) = (650.0, 657.0);
        let told = clock.at(vehicle(exposed)).unwrap();
        let time = Some((told, ClockSource::Reports));
        let (age, _) = age(&written(time, AgeLimit::UNTOLD), now).unwrap();
        assert!((7.0..=7.0 + 0.4 + STEP + STEP * f64::from(CUT)).contains(&age), "{age}");
        for sent in 0..REPORTS {
            clock.reported(vehicle(sent as f64 + 1.0), stamp(sent as f64));
        }
        let told = clock.at(vehicle(exposed)).unwrap();
        assert!((told - (exposed - 1.0)).abs() < 2.0 * STEP, "what is long past does not count");
    }
}
