//! A report under way: its parts, one after the other.

use std::time::Instant;

use nvsprior::{Camera, Prior};
use nvsprior_basin::DemoFrame;

use super::pace::Pace;
use super::schema::{Missing, Report};

/// What a device is measured on.
pub struct Subject<'a> {
    pub prior: &'a Prior,
    pub cameras: &'a [Camera],
    /// Draws a run by a camera, a frame at a time.
    pub frames: &'a dyn Fn(Camera) -> Box<dyn Iterator<Item = DemoFrame> + 'a>,
    /// Packets are coded for so many bytes.
    pub budgets: &'a [usize],
}

/// A report under way.
pub struct Measuring {
    pub report: Report,
    pub since: Instant,
}

impl Measuring {
    /// Does a part, naming it; if it fails, notes why.
    pub fn part<T>(&mut self, what: &str, work: impl FnOnce() -> anyhow::Result<T>) -> Option<T> {
        tell!("{:4.0} s: {what}", self.since.elapsed().as_secs_f64());
        match work() {
            Ok(value) => Some(value),
            Err(error) => {
                let why = format!("{error:#}");
                tell!("        failed: {why}");
                self.report.failures.push(Missing { what: what.into(), why });
                None
            }
        }
    }

    /// So many seconds, or what is left of all.
    pub fn pace(&self, seconds: f64) -> Pace {
        let left = self.report.bounds.seconds - self.since.elapsed().as_secs_f64();
        Pace::of(seconds.min(left))
    }

    /// Notes what cannot be measured here.
    pub fn missing(&mut self, what: impl Into<String>, why: impl Into<String>) {
        let missing = Missing { what: what.into(), why: why.into() };
        if !self.report.not_measured.contains(&missing) {
            self.report.not_measured.push(missing);
        }
    }
}
