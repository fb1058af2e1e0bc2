//! What a frame may take: renders, and time by a clock.

use std::time::Duration;

use super::StepTime;

/// A search takes one evaluation and its picture at least.
pub const LEAST: u32 = 2;
/// So many renders of coarse levels count, in time, as one at full size, of four times as many pixels.
pub const COARSE: u32 = 4;

/// What the frame under way may still take. By default all that its search asks for.
#[derive(Debug, Default)]
pub struct Budget {
    time: Option<TimeLimit>,
    /// The number of renders, since the renderer was made, at which the search must have ended.
    end: Option<u64>,
    /// Whether the clock has kept a step from being taken whole.
    out_of_time: bool,
}

/// When a search must have ended.
#[derive(Clone, Debug)]
pub struct TimeLimit {
    pub end: Duration,
    /// How long steps take; their clock is that of `end`.
    pub steps: SearchSteps,
}

/// How long the steps of a search take.
#[derive(Clone, Debug)]
pub struct SearchSteps {
    /// A render of a coarse level.
    pub coarse: StepTime,
    /// A render of which the corners are taken.
    pub look: StepTime,
}

/// Renders that a search may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// Of any level.
    pub renders: u32,
    /// As their time goes, in renders of coarse levels.
    pub time: u32,
}

impl SearchSteps {
    /// How long a render at full size takes.
    pub fn full_render(&self) -> Duration {
        COARSE * self.coarse.longest()
    }
}

impl Room {
    /// Without bounds.
    pub const ALL: Room = Room { renders: u32::MAX, time: u32::MAX };

    /// Whether there is room for renders at full size and of coarse levels.
    pub fn holds(&self, full: u32, coarse: u32) -> bool {
        full + coarse <= self.renders && COARSE * full + coarse <= self.time
    }

    /// What is left after these.
    pub fn after(&self, full: u32, coarse: u32) -> Room {
        Room {
            renders: self.renders.saturating_sub(full + coarse),
            time: self.time.saturating_sub(COARSE * full + coarse),
        }
    }
}

impl TimeLimit {
    /// How often there is time for a step.
    fn times(&self, step: &StepTime) -> u32 {
        let left = self.end.saturating_sub(step.now()).as_nanos();
        match step.longest().as_nanos() {
            _ if left == 0 => 0,
            0 => u32::MAX,
            one => (left / one).min(u32::MAX.into()) as u32,
        }
    }
}

impl Budget {
    /// Begins a frame. Its renders are not bounded yet.
    pub fn begin(&mut self, time: Option<TimeLimit>) {
        *self = Budget { time, ..Budget::default() };
    }

    /// Bounds the renders from here on: `renders` so far, and `most` more. What was bounded stays so.
    pub fn bound(&mut self, renders: u64, most: u32) {
        self.end.get_or_insert(renders + u64::from(most));
    }

    /// Room beside the picture that is sent. `renders`: those so far.
    pub fn room(&self, renders: u64) -> Room {
        let time = self.time.as_ref().map_or(u32::MAX, |time| time.times(&time.steps.coarse));
        Room { renders: self.counted(renders), time }
    }

    /// As [`room`](Self::room) for a frame's first search: only its time is bounded, and its own picture is sent.
    pub fn first_room(&self) -> Room {
        let Room { time, .. } = self.room(0);
        Room { renders: u32::MAX, time: time.saturating_add(COARSE) }
    }

    /// Whether there is room for renders at full size beside the picture that is sent.
    pub fn holds(&mut self, renders: u64, full: u32) -> bool {
        let room = self.room(renders);
        let holds = room.holds(full, 0);
        self.out_of_time |= !holds && full <= room.renders;
        holds
    }

    /// Renders of which the corners are taken, beside the picture that is sent.
    pub fn looks(&mut self, renders: u64) -> u32 {
        let timed = self.time.as_ref().map_or(u32::MAX, |time| time.times(&time.steps.look));
        let counted = self.counted(renders);
        self.out_of_time |= timed == 0 && counted > 0;
        counted.min(timed)
    }

    /// Whether the clock allows a step of the host.
    pub fn has_time(&mut self) -> bool {
        let has_time = self.room(0).time > 0;
        self.out_of_time |= !has_time;
        has_time
    }

    /// Notes that a search did not arrive, or did not begin, in a room that time alone may have bounded.
    pub fn note_cut(&mut self, room: &Room) {
        self.out_of_time |= self.time.is_some() && room.time / COARSE < room.renders;
    }

    /// When a step begins, if its time counts.
    pub fn now(&self) -> Option<Duration> {
        self.time.as_ref().map(|time| time.steps.coarse.now())
    }

    /// Notes that so many renders at full size and of coarse levels have been taken since then.
    pub fn note_renders(&self, begun: Option<Duration>, full: u32, coarse: u32) {
        if let (Some(time), Some(begun)) = (&self.time, begun) {
            time.steps.coarse.note(begun, COARSE * full + coarse);
        }
    }

    /// Notes that so many renders, of which the corners were taken, have been taken since then.
    pub fn note_looks(&self, begun: Option<Duration>, renders: u64) {
        if let (Some(time), Some(begun)) = (&self.time, begun) {
            time.steps.look.note(begun, renders as u32);
        }
    }

    fn counted(&self, renders: u64) -> u32 {
        // One is kept for the picture that is sent.
        let left = |end: u64| end.saturating_sub(renders + 1).min(u32::MAX.into()) as u32;
        self.end.map_or(u32::MAX, left)
    }

    /// Whether the clock has kept a step of the frame from being taken whole.
    pub fn out_of_time(&self) -> bool {
        self.out_of_time
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::super::counted;
    use super::*;

    fn milliseconds(count: u64) -> Duration {
        Duration::from_millis(count)
    }

    /// Steps by a clock that the counter sets, milliseconds; it is at 100.
    fn steps() -> (SearchSteps, Arc<AtomicU64>) {
        let (clock, time) = counted();
        time.store(100, Ordering::Relaxed);
        (SearchSteps { coarse: StepTime::new(&clock), look: StepTime::new(&clock) }, time)
    }

    #[test]
    fn without_bounds_all_is_allowed() {
        let mut budget = Budget::default();
        assert_eq!((budget.room(7), budget.first_room()), (Room::ALL, Room::ALL));
        assert!(budget.holds(7, 100) && budget.has_time() && budget.now().is_none());
        assert!(!budget.out_of_time());
    }

    #[test]
    fn a_render_is_kept_for_what_is_sent() {
        let mut budget = Budget::default();
        budget.bound(50, 4);
        assert_eq!([50, 52, 53, 54, 60].map(|so_far| budget.room(so_far).renders), [3, 1, 0, 0, 0]);
        assert!(budget.holds(50, 3) && !budget.holds(50, 4));
        budget.bound(52, 4);
        assert_eq!((budget.room(50).renders, budget.looks(50)), (3, 3), "the first bound holds");
        budget.note_cut(&budget.room(50));
        assert!(!budget.out_of_time(), "not by the clock");
        budget.begin(None);
        assert_eq!(budget.room(60), Room::ALL);
    }

    #[test]
    fn time_is_counted_in_steps() {
        let (steps, time) = steps();
        steps.coarse.note(milliseconds(95), 1);
        steps.look.note(milliseconds(70), 1);
        let mut budget = Budget::default();
        budget.begin(Some(TimeLimit { end: milliseconds(165), steps: steps.clone() }));
        let times = (budget.room(0).time, budget.first_room().time, budget.looks(0));
        assert_eq!((times, steps.full_render()), ((13, 17, 2), milliseconds(20)));
        assert!(budget.holds(0, 3) && budget.has_time() && !budget.out_of_time());
        assert!(!budget.holds(0, 4) && budget.out_of_time());
        let begun = budget.now();
        time.store(300, Ordering::Relaxed);
        assert!(!budget.has_time());
        budget.note_renders(begun, 4, 4);
        budget.note_looks(begun, 2);
        let longest = [&steps.coarse, &steps.look].map(StepTime::longest);
        assert_eq!(longest, [10, 100].map(milliseconds), "what they take now");
        budget.begin(Some(TimeLimit { end: milliseconds(500), steps }));
        budget.bound(0, 4);
        assert!(!budget.holds(0, 4));
        budget.note_cut(&budget.room(0));
        assert!(!budget.out_of_time(), "the count is less");
        budget.note_cut(&Room { renders: 9, time: 35 });
        assert!(budget.out_of_time());
    }

    #[test]
    fn renders_that_take_no_time_have_room_until_the_end() {
        let (steps, time) = steps();
        let mut budget = Budget::default();
        budget.begin(Some(TimeLimit { end: milliseconds(101), steps }));
        assert_eq!(budget.room(0), Room::ALL);
        time.store(101, Ordering::Relaxed);
        assert_eq!((budget.holds(0, 1), budget.looks(0), budget.out_of_time()), (false, 0, true));
    }

    #[test]
    fn four_coarse_renders_take_as_long_as_a_full_one() {
        let room = Room { renders: 9, time: 20 };
        assert!(room.holds(4, 4) && !room.holds(4, 5) && !room.holds(2, 8));
        assert_eq!(room.after(2, 3), Room { renders: 4, time: 9 });
        assert_eq!(room.after(6, 0), Room { renders: 3, time: 0 });
    }
}
