//! Times that do not go back, whatever the caller's clock does.

use crate::modem::ModemError;

/// Turns a caller's times into times that never go back. After its clock is set back, time goes on from where it was.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timeline {
    last: Option<f64>,
    /// The clock was set back by so many seconds in all.
    set_back: f64,
}

/// A time that is earlier by less comes of another thread, and not of a clock that was set back; seconds.
const SLACK: f64 = 1.0;

impl Timeline {
    /// The time of a call.
    ///
    /// # Errors
    /// If it is not finite.
    pub fn at(&mut self, now: f64) -> Result<f64, ModemError> {
        let time = self.of(now)?;
        let Some(last) = self.last.filter(|last| time < *last) else {
            self.last = Some(time);
            return Ok(time);
        };
        if last - time > SLACK {
            self.set_back += last - time;
        }
        Ok(last)
    }

    /// Another time of the caller's clock, as it is now.
    ///
    /// # Errors
    /// If it is not finite.
    pub fn of(&self, time: f64) -> Result<f64, ModemError> {
        if time.is_finite() { Ok(time + self.set_back) } else { Err(ModemError::Time(time)) }
    }

    /// The time of the last call.
    pub fn last(&self) -> f64 {
        self.last.unwrap_or(0.0)
    }

    /// A time as the caller's clock tells it.
    pub fn told(&self, time: f64) -> f64 {
        time - self.set_back
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_do_not_go_back() {
        let mut line = Timeline::default();
        let times = [-5.0, 3.0, 2.5, 3.25, 1.0, 2.0, -7.0, -6.5];
        let made: Vec<f64> = times.iter().map(|now| line.at(*now).unwrap()).collect();
        assert_eq!(made, [-5.0, 3.0, 3.0, 3.25, 3.25, 4.25, 4.25, 4.75]);
        assert_eq!((line.told(made[7]), line.of(-6.5)), (-6.5, Ok(4.75)));
        assert!(line.at(f64::NAN).is_err() && line.at(f64::INFINITY).is_err());
    }
}
