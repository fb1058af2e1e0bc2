//! The most time that a frame may take, and when its search must end for that.

use std::time::Duration;

use crate::Error;
use crate::tracking::{SearchSteps, StepTime, TimeLimit};

/// The most time that frames of an encoder take.
#[derive(Debug)]
pub(crate) struct FrameTime {
    most: Duration,
    search: SearchSteps,
    pub coding: StepTime,
}

impl FrameTime {
    /// `search` and `coding`: how long their steps take, by one clock. Fails if `most` is less than a render and a
    /// coding.
    pub fn new(most: Duration, search: SearchSteps, coding: StepTime) -> Result<FrameTime, Error> {
        let least = search.full_render() + coding.longest();
        if most < least {
            let [most, least] = [most, least].map(|time| time.as_secs_f64() * 1e3);
            return Err(Error::FrameTimeShort { most, least });
        }
        Ok(FrameTime { most, search, coding })
    }

    /// Ends the search of a frame that begins now. What was found is then drawn and coded.
    pub fn limit(&self) -> TimeLimit {
        let after = self.search.full_render() + self.coding.longest();
        let end = self.coding.now() + self.most.saturating_sub(after);
        TimeLimit { end, steps: self.search.clone() }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;
    use crate::tracking::counted;

    #[test]
    fn what_follows_the_search_must_fit() {
        let (clock, time) = counted();
        let [look, coarse, coding] = [50, 10, 20].map(|milliseconds| {
            let step = StepTime::new(&clock);
            let begun = step.now();
            time.fetch_add(milliseconds, Ordering::Relaxed);
            step.note(begun, 1);
            step
        });
        let frame_time = |milliseconds| {
            let search = SearchSteps { coarse: coarse.clone(), look: look.clone() };
            FrameTime::new(Duration::from_millis(milliseconds), search, coding.clone())
        };
        let text = frame_time(59).unwrap_err().to_string();
        assert!(text.contains("59.0 ms") && text.contains("60.0 ms"), "{text}");
        let end = |milliseconds| frame_time(milliseconds).unwrap().limit().end.as_millis();
        assert_eq!((end(60), end(100)), (80, 120), "at 60 ms the search has no time");
        let frames = frame_time(100).unwrap();
        coding.note(Duration::from_millis(50), 1);
        assert_eq!(frames.limit().end.as_millis(), 80 + 100 - 40 - 30, "a longer coding");
        coding.note(Duration::ZERO, 1);
        assert_eq!(frames.limit().end.as_millis(), 80, "it takes longer than all of the time");
    }
}
