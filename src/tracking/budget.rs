//! What a frame may take: renders, and time by a clock.

use std::time::Duration;

use super::schedule_limit::Room;
use super::{Clock, Costs};

/// What the frame under way may still take. By default all that its search asks for.
#[derive(Debug, Default)]
pub struct Budget {
    clock: Clock,
    costs: Costs,
    /// When the search must have ended, by the clock.
    deadline: Option<Duration>,
    /// The number of renders, since the renderer was made, at which it must have ended.
    end: Option<u64>,
    /// Whether the clock has kept a step from being taken whole.
    out_of_time: bool,
}

impl Budget {
    /// One that goes by a clock.
    pub fn new(clock: Clock) -> Budget {
        Budget { clock, ..Budget::default() }
    }

    /// What steps take from here on.
    pub fn set_costs(&mut self, costs: Costs) {
        self.costs = costs;
    }

    /// Begins a frame, of which the search must end at `deadline`. Its renders are not bounded yet.
    pub fn begin(&mut self, deadline: Option<Duration>) {
        (self.deadline, self.out_of_time) = (deadline, false);
        self.unbound();
    }

    /// Renders are not bounded from here on.
    pub fn unbound(&mut self) {
        self.end = None;
    }

    /// Bounds the renders from here on: `renders` so far, and `most` more. What was bounded stays so.
    pub fn bound(&mut self, renders: u64, most: u32) {
        self.end.get_or_insert(renders + u64::from(most));
    }

    /// Renders that may still be taken beside the picture that is sent: evaluations, and a picture at their end.
    /// `renders`: those so far.
    pub fn renders(&mut self, renders: u64) -> u32 {
        let (counted, timed) = (self.counted(renders), self.searches(Duration::ZERO));
        self.least(counted, timed)
    }

    /// Room for a search.
    pub fn room(&self, renders: u64) -> Room {
        let (counted, timed) = (self.counted(renders), self.searches(Duration::ZERO));
        Room { counted, timed, per_coarse: self.per_coarse() }
    }

    /// Room for a frame's first search: only its time is bounded, and its own picture is sent.
    pub fn first_room(&self) -> Room {
        let timed = self.searches(self.costs.picture);
        Room { counted: u32::MAX, timed, per_coarse: self.per_coarse() }
    }

    /// Evaluations of a coarse level that take as long as one at full size.
    fn per_coarse(&self) -> u32 {
        const MOST: u32 = 8;
        times(Some(self.costs.evaluation), self.costs.coarse).clamp(1, MOST)
    }

    /// As [`renders`](Self::renders), for renders of which the corners are taken.
    pub fn looks(&mut self, renders: u64) -> u32 {
        let (counted, timed) = (self.counted(renders), times(self.left(), self.costs.look));
        self.least(counted, timed)
    }

    /// Whether the clock allows a step of the host.
    pub fn has_time(&mut self) -> bool {
        let has_time = self.deadline.is_none_or(|deadline| self.clock.now() < deadline);
        self.out_of_time |= !has_time;
        has_time
    }

    /// Notes that a search was cut short, or left out. If the clock allows less than the count does, it was the clock.
    pub fn note_cut(&mut self, renders: u64) {
        let (counted, timed) = (self.counted(renders), self.searches(Duration::ZERO));
        self.out_of_time |= timed < counted;
    }

    /// Notes whether it is the clock that allows nothing.
    fn least(&mut self, counted: u32, timed: u32) -> u32 {
        self.out_of_time |= timed == 0 && counted > 0;
        counted.min(timed)
    }

    fn counted(&self, renders: u64) -> u32 {
        // One is kept for the picture that is sent.
        let left = |end: u64| end.saturating_sub(renders + 1).min(u32::MAX.into()) as u32;
        self.end.map_or(u32::MAX, left)
    }

    /// Renders of a search for which there is time, its picture included; `more`: time beside what is left.
    fn searches(&self, more: Duration) -> u32 {
        let left = self.left().map(|left| (left + more).checked_sub(self.costs.picture));
        match left {
            None => u32::MAX,
            Some(None) => 0,
            Some(Some(Duration::ZERO)) if self.costs.picture.is_zero() => 0,
            Some(left) => times(left, self.costs.evaluation).saturating_add(1),
        }
    }

    /// Time until the search must have ended; `None`: without end.
    fn left(&self) -> Option<Duration> {
        self.deadline.map(|deadline| deadline.saturating_sub(self.clock.now()))
    }

    /// Whether the clock has kept a step of the frame from being taken whole.
    pub fn out_of_time(&self) -> bool {
        self.out_of_time
    }
}

/// How often a step fits into a time.
fn times(left: Option<Duration>, step: Duration) -> u32 {
    let Some(left) = left else { return u32::MAX };
    match (left.as_nanos(), step.as_nanos()) {
        (0, _) => 0,
        (_, 0) => u32::MAX,
        (left, step) => (left / step).min(u32::MAX.into()) as u32,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    fn milliseconds(count: u64) -> Duration {
        Duration::from_millis(count)
    }

    /// A budget with a clock that the returned counter sets, milliseconds.
    fn budget() -> (Budget, Arc<AtomicU64>) {
        let time = Arc::new(AtomicU64::new(100));
        let told = time.clone();
        let clock = Clock::new(move || milliseconds(told.load(Ordering::Relaxed)));
        let mut budget = Budget::new(clock);
        budget.set_costs(Costs {
            picture: milliseconds(10),
            evaluation: milliseconds(20),
            coarse: milliseconds(5),
            look: milliseconds(30),
        });
        (budget, time)
    }

    #[test]
    fn without_bounds_all_is_allowed() {
        let (mut budget, _) = budget();
        budget.begin(None);
        assert_eq!((budget.renders(7), budget.looks(7)), (u32::MAX, u32::MAX));
        assert!(budget.has_time() && !budget.out_of_time());
    }

    #[test]
    fn a_render_is_kept_for_what_is_sent() {
        let (mut budget, _) = budget();
        budget.begin(None);
        budget.bound(50, 4);
        assert_eq!([50, 52, 53, 54, 60].map(|so_far| budget.renders(so_far)), [3, 1, 0, 0, 0]);
        budget.bound(52, 4);
        assert_eq!(budget.renders(50), 3, "the first bound holds");
        assert!(!budget.out_of_time(), "not by the clock");
        budget.begin(None);
        assert_eq!(budget.renders(60), u32::MAX);
    }

    #[test]
    fn time_is_counted_in_steps() {
        let (mut budget, time) = budget();
        budget.begin(Some(milliseconds(165)));
        assert_eq!((budget.renders(0), budget.looks(0)), (3, 2), "two evaluations, a picture");
        assert_eq!(budget.room(0), Room { counted: u32::MAX, timed: 3, per_coarse: 4 });
        assert_eq!(budget.first_room().timed, 4, "the picture that is sent is its own");
        assert!(budget.has_time() && !budget.out_of_time());
        time.store(140, Ordering::Relaxed);
        assert_eq!((budget.renders(0), budget.out_of_time()), (1, false), "a picture");
        assert_eq!((budget.looks(0), budget.out_of_time()), (0, true));
        time.store(200, Ordering::Relaxed);
        assert!(!budget.has_time());
        budget.begin(Some(milliseconds(300)));
        assert!(!budget.out_of_time(), "another frame");
        budget.bound(0, 4);
        assert_eq!(budget.renders(0), 3, "the count is the narrower bound");
        budget.note_cut(0);
        assert!(!budget.out_of_time());
        budget.begin(Some(milliseconds(205)));
        assert_eq!(
            (budget.renders(0), budget.first_room().timed, budget.out_of_time()),
            (0, 1, true)
        );
        budget.begin(Some(milliseconds(250)));
        budget.bound(0, 9);
        budget.note_cut(0);
        assert!(budget.out_of_time());
    }

    #[test]
    fn steps_that_take_no_time_have_room_until_the_end() {
        let (mut budget, time) = budget();
        budget.set_costs(Costs::default());
        budget.begin(Some(milliseconds(101)));
        assert_eq!(budget.renders(0), u32::MAX);
        time.store(101, Ordering::Relaxed);
        assert_eq!((budget.renders(0), budget.out_of_time()), (0, true));
    }
}
