//! Schedules that take no more renders than a frame has left.

use super::Stop;
use super::schedule::Schedule;

/// A search takes one evaluation and its picture at least.
pub const LEAST: u32 = 2;

/// Renders that a search may take, its picture included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// By their number.
    pub counted: u32,
    /// By their time, of which `per_coarse` evaluations of a coarse level take as much as one at full size.
    pub timed: u32,
    pub per_coarse: u32,
}

impl Room {
    /// Without bounds.
    pub const ALL: Room = Room { counted: u32::MAX, timed: u32::MAX, per_coarse: 1 };

    /// Whether a search has room at all.
    pub fn is_enough(&self) -> bool {
        self.counted.min(self.timed) >= LEAST
    }

    /// What is left after a search with so many evaluations by level, and its picture.
    pub fn after(&self, by_level: &[u32]) -> Room {
        let (full, coarse) = (by_level[0] + 1, by_level[1..].iter().sum::<u32>());
        Room {
            counted: self.counted.saturating_sub(full + coarse),
            timed: self.timed.saturating_sub(full + coarse.div_ceil(self.per_coarse)),
            ..*self
        }
    }
}

/// What was left out of a schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Nothing.
    None,
    /// Evaluations, or coarse levels below the coarsest. What is left on each coarse level.
    Evaluations { coarse: u32 },
    /// All coarse levels, which reach farther.
    Levels,
}

impl Cut {
    /// Whether a search, which took so many evaluations by level, has arrived: it ended each level before it had to.
    pub fn allows(self, stop: Stop, by_level: &[u32]) -> bool {
        match self {
            Cut::None => true,
            Cut::Evaluations { coarse } => {
                stop != Stop::Iterations && by_level[1..].iter().all(|taken| *taken < coarse)
            }
            Cut::Levels => false,
        }
    }
}

impl Schedule {
    /// This schedule, or one that takes no more than there is room for, by count and by time; and what was left out.
    pub fn within_room(&self, room: &Room, levels: usize) -> (Schedule, Cut) {
        let (timed, by_time) = self.within(room.timed, room.per_coarse, levels);
        let (counted, by_count) = timed.within(room.counted, 1, levels);
        (counted, if by_count == Cut::None { by_time } else { by_count })
    }

    /// This schedule, or one that takes at most `room` renders, its picture included, of which `per_coarse` of a coarse
    /// level count as one; and what was left out. From one start, of a pyramid of `levels`. `room` is [`LEAST`] or
    /// more.
    fn within(&self, room: u32, per_coarse: u32, levels: usize) -> (Schedule, Cut) {
        if self.most(per_coarse, levels) <= room {
            return (*self, Cut::None);
        }
        let evaluations = room.saturating_sub(1).max(1);
        let coarse = self.coarse(self.first_level.min(levels - 1));
        let cut =
            Schedule { far_level: 0, follow_level: self.first_level, follow_renders: 1, ..*self };
        if evaluations < 2 || coarse == 0 {
            let renders = evaluations.min(self.renders);
            let evaluations = Cut::Evaluations { coarse: 1 };
            let left_out = if coarse == 0 { evaluations } else { Cut::Levels };
            return (Schedule { first_level: 0, follow_level: 0, renders, ..cut }, left_out);
        }
        let renders = (evaluations / 2).min(self.renders);
        let left = (evaluations - renders).saturating_mul(per_coarse);
        let each = left / coarse;
        if each >= 2 {
            let coarse_renders = each.min(self.coarse_renders);
            let left_out = Cut::Evaluations { coarse: coarse_renders };
            return (Schedule { renders, coarse_renders, ..cut }, left_out);
        }
        // The coarsest level reaches farthest. A single evaluation there is of use if its step is taken.
        let coarse_renders = left.min(self.coarse_renders);
        let coarse_leap = if coarse_renders == 1 { f32::INFINITY } else { self.coarse_leap };
        let left_out = Cut::Evaluations { coarse: coarse_renders };
        (Schedule { renders, coarse_renders, coarse_leap, levels: 1, ..cut }, left_out)
    }

    /// Most renders of a search from one start, its picture included.
    fn most(&self, per_coarse: u32, levels: usize) -> u32 {
        let [first, far] = [self.first_level, self.far_level].map(|level| level.min(levels - 1));
        let follow = self.follow_level.min(first);
        let followed = self.coarse(first) - self.coarse(follow);
        let mut coarse = followed * self.follow_renders + self.coarse(follow) * self.coarse_renders;
        let mut full = self.renders + 1;
        if far > first {
            // The first evaluation then goes on there.
            coarse += self.coarse(far) * self.coarse_renders;
            full += 1;
        }
        full + coarse.div_ceil(per_coarse)
    }

    /// Coarse levels that a search visits from `first` on.
    fn coarse(&self, first: usize) -> u32 {
        (1..=first).filter(|level| *level == first || self.levels >> level & 1 == 1).count() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::super::GaussNewtonOptions;
    use super::*;

    const LEVELS: usize = 4;

    #[test]
    fn what_fits_stays() {
        let GaussNewtonOptions { warm, cold, .. } = GaussNewtonOptions::default();
        assert_eq!((warm.most(1, LEVELS), cold.most(1, LEVELS)), (6 + 1 + 16 + 1, 12 + 12 + 8 + 1));
        for schedule in [warm, cold] {
            let most = schedule.most(1, LEVELS);
            assert_eq!(schedule.within(most, 1, LEVELS), (schedule, Cut::None));
            assert!(matches!(schedule.within(most - 1, 1, LEVELS).1, Cut::Evaluations { .. }));
        }
        assert_eq!(cold.within(u32::MAX, 1, LEVELS), (cold, Cut::None));
        let at_once = Schedule { first_level: 0, follow_level: 0, renders: 1, ..cold };
        assert_eq!(at_once.within(LEAST, 1, LEVELS), (at_once, Cut::None));
    }

    #[test]
    fn no_cut_schedule_takes_more_than_there_is_room_for() {
        let GaussNewtonOptions { warm, cold, .. } = GaussNewtonOptions::default();
        let third = Schedule { levels: 0b0101, ..cold };
        for schedule in [warm, cold, third] {
            for levels in 1..=LEVELS {
                for room in LEAST..40 {
                    for per_coarse in [1, 4] {
                        let (cut, _) = schedule.within(room, per_coarse, levels);
                        let most = cut.most(per_coarse, levels);
                        assert!(most <= room, "{cut:?} of {levels} levels in {room}");
                        assert!(cut.renders > 0 && cut.coarse_renders > 0);
                    }
                }
            }
        }
    }

    #[test]
    fn only_a_search_that_was_not_cut_short_has_arrived() {
        let stops = [Stop::Progress, Stop::NoDescent, Stop::Iterations];
        let arrived = |cut: Cut, by_level| stops.map(|stop| cut.allows(stop, by_level));
        let coarse = Cut::Evaluations { coarse: 3 };
        assert_eq!(arrived(Cut::None, &[8, 12, 12, 0]), [true; 3]);
        assert_eq!(arrived(coarse, &[3, 2, 2, 0]), [true, true, false]);
        assert_eq!(arrived(coarse, &[1, 2, 3, 0]), [false; 3]);
        assert_eq!(arrived(Cut::Levels, &[1, 0, 0, 0]), [false; 3]);
    }

    #[test]
    fn little_room_is_spent_at_both_ends_of_the_pyramid() {
        let cold = GaussNewtonOptions::default().cold;
        let cut = |room| cold.within(room, 1, LEVELS).0;
        assert_eq!((cut(2).first_level, cut(2).renders), (0, 1));
        assert_eq!(cold.within(2, 1, LEVELS).1, Cut::Levels);
        let least = cut(3);
        assert_eq!((least.first_level, least.levels), (2, 1));
        assert_eq!((least.coarse_renders, least.renders, least.coarse_leap), (1, 1, f32::INFINITY));
        let more = cut(5);
        assert_eq!((more.levels, more.coarse_renders, more.renders), (1, 2, 2));
        assert_eq!(more.coarse_leap, cold.coarse_leap);
        let half = cut(21);
        assert_eq!((half.levels, half.coarse_renders, half.renders), (cold.levels, 6, 8));
    }

    #[test]
    fn what_was_taken_is_left_out_of_what_follows() {
        let cold = GaussNewtonOptions::default().cold;
        let room = Room { counted: 40, timed: 15, per_coarse: 4 };
        assert_eq!(cold.within_room(&room, LEVELS), (cold, Cut::None));
        let left = room.after(&[2, 3, 4, 0]);
        assert_eq!((left.counted, left.timed), (30, 10));
        assert!(left.is_enough() && Room::ALL.is_enough());
        assert!(cold.within_room(&left, LEVELS).1 != Cut::None);
        assert!(!room.after(&[13, 0, 0, 0]).is_enough());
    }
}
