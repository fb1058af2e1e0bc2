//! How a search goes through the pyramid: which levels, and how many evaluations.

use crate::search::{Placement, Program, STARTS};

use super::budget::Room;

/// How a search goes through the pyramid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Level at which each start is first evaluated. A frame that follows another begins here if that one was followed
    /// easily, else higher, up to `far_level`.
    pub first_level: usize,
    /// Level down to which each start is followed by itself. Below it only the best goes on.
    pub follow_level: usize,
    /// Levels to visit, one bit per level; level 0 is always visited.
    pub levels: u32,
    /// Levels of which an evaluation draws only some rows of tiles, one bit per level: see docs/decisions.md, 40. Final
    /// pictures are always whole.
    pub sparse: u32,
    /// Most renders of one start at one level while starts are compared; 1: starts are only scored.
    pub follow_renders: u32,
    /// Most renders of a coarse level.
    pub coarse_renders: u32,
    /// Most renders at full resolution.
    pub renders: u32,
    /// If the first step promises to lower the error by more than this share, the start is far off.
    /// The search then goes on at `far_level`, if that is above the first level.
    pub near: f32,
    /// See `near`.
    pub far_level: usize,
    /// If a coarse level's step is expected to lower the error by less than this share, it is taken
    /// without an evaluation and ends the level. The next level evaluates it.
    pub coarse_leap: f32,
    /// As `coarse_leap`, at full resolution: the final picture shows the outcome.
    pub leap: f32,
    /// A coarse level is done if the next step is expected to lower the error by less than this share.
    pub coarse_tolerance: f32,
    /// As `coarse_tolerance`, at full resolution; 1e-3 is 0.004 dB.
    pub tolerance: f32,
}

impl Schedule {
    /// The program that the device runs on a pyramid of `levels` levels, from the first eight of `starts`. `profile`:
    /// how the pose is coded, see [`Tracker::set_profile`](super::Tracker::set_profile).
    pub fn program(
        &self,
        levels: usize,
        starts: impl IntoIterator<Item = Placement>,
        damping: f32,
        profile: u32,
    ) -> Program {
        let last = levels - 1;
        let mut placements = [Placement::default(); STARTS];
        let mut count = 0;
        for (to, start) in placements.iter_mut().zip(starts) {
            *to = start;
            count += 1;
        }
        let first_level = self.first_level.min(last);
        Program {
            starts: placements,
            count,
            first_level: first_level as u32,
            follow_level: self.follow_level.min(first_level) as u32,
            levels: self.levels,
            sparse: self.sparse,
            follow_renders: self.follow_renders,
            coarse_renders: self.coarse_renders,
            renders: self.renders,
            near: self.near,
            far_level: self.far_level.min(last) as u32,
            coarse_leap: self.coarse_leap,
            leap: self.leap,
            coarse_tolerance: self.coarse_tolerance,
            tolerance: self.tolerance,
            damping,
            profile,
        }
    }

    /// This schedule for one start, or as much of it as there is room for, of a pyramid of `levels` levels. There must
    /// be room for two renders at full size.
    pub fn within(&self, room: &Room, levels: usize) -> Schedule {
        let (full, coarse) = self.most(levels);
        if room.holds(full, coarse) {
            return *self;
        }
        let first = self.first_level.min(levels - 1);
        let cut = Schedule { far_level: 0, follow_renders: 1, ..*self };
        let most = |coarse: fn(u32) -> u32| {
            (1..=self.renders).rev().find(|full| room.holds(full + 1, coarse(*full)))
        };
        // As many evaluations at coarse levels as at full size, and more if there is room.
        let Some(renders) = most(|full| full).filter(|_| first > 0) else {
            let renders = most(|_| 0).unwrap_or(1);
            return Schedule { first_level: 0, follow_level: 0, renders, ..cut };
        };
        let all = self.coarse(first) * self.coarse_renders;
        let left = (renders..=all).rev().find(|coarse| room.holds(renders + 1, *coarse));
        let left = left.unwrap_or(renders);
        let each = left / self.coarse(first);
        let cut = Schedule { follow_level: first, renders, ..cut };
        if each >= 2 {
            return Schedule { coarse_renders: each, ..cut };
        }
        // The coarsest level reaches farthest. A single evaluation there is of use if its step is taken.
        let coarse_renders = left.min(self.coarse_renders);
        let coarse_leap = if coarse_renders == 1 { f32::INFINITY } else { self.coarse_leap };
        Schedule { levels: 1, coarse_renders, coarse_leap, ..cut }
    }

    /// Most renders of a search from one start: at full size, its picture included, and at coarse levels.
    fn most(&self, levels: usize) -> (u32, u32) {
        let [first, far] = [self.first_level, self.far_level].map(|level| level.min(levels - 1));
        let follow = self.follow_level.min(first);
        let followed = self.coarse(first) - self.coarse(follow);
        let coarse = followed * self.follow_renders + self.coarse(follow) * self.coarse_renders;
        if far <= first {
            return (self.renders + 1, coarse);
        }
        // The first evaluation then goes on there.
        (self.renders + 2, coarse + self.coarse(far) * self.coarse_renders)
    }

    /// Coarse levels that a search visits from `first` on.
    fn coarse(&self, first: usize) -> u32 {
        (1..=first).filter(|level| *level == first || self.levels >> level & 1 == 1).count() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::super::GaussNewtonOptions;
    use super::super::budget::{LEAST, Room};
    use super::*;

    const LEVELS: usize = 4;

    #[test]
    fn what_fits_stays() {
        let GaussNewtonOptions { warm, cold, .. } = GaussNewtonOptions::default();
        assert_eq!((warm.most(LEVELS), cold.most(LEVELS)), ((6 + 2, 16), (8 + 1, 24)));
        for schedule in [warm, cold] {
            let (full, coarse) = schedule.most(LEVELS);
            let counted = |renders| Room { renders, ..Room::ALL };
            let timed = |time| Room { time, ..Room::ALL };
            for (fits, short) in [
                (counted(full + coarse), counted(full + coarse - 1)),
                (timed(4 * full + coarse), timed(4 * full + coarse - 1)),
            ] {
                assert_eq!(schedule.within(&fits, LEVELS), schedule);
                assert_ne!(schedule.within(&short, LEVELS), schedule);
            }
        }
        let at_once = Schedule { first_level: 0, follow_level: 0, renders: 1, ..cold };
        assert_eq!(at_once.within(&Room { renders: LEAST, ..Room::ALL }, LEVELS), at_once);
    }

    #[test]
    fn no_cut_schedule_takes_more_than_there_is_room_for() {
        let GaussNewtonOptions { warm, cold, .. } = GaussNewtonOptions::default();
        let third = Schedule { levels: 0b0101, ..cold };
        for schedule in [warm, cold, third] {
            for (levels, renders) in (1..=LEVELS).flat_map(|l| (LEAST..40).map(move |n| (l, n))) {
                for time in (4 * LEAST)..80 {
                    let room = Room { renders, time };
                    let cut = schedule.within(&room, levels);
                    let (full, coarse) = cut.most(levels);
                    assert!(room.holds(full, coarse), "{cut:?} of {levels} levels in {room:?}");
                    assert!(cut.renders > 0 && cut.coarse_renders > 0);
                }
            }
        }
    }

    #[test]
    fn little_room_is_spent_at_both_ends_of_the_pyramid() {
        let cold = GaussNewtonOptions::default().cold;
        let cut = |renders| cold.within(&Room { renders, ..Room::ALL }, LEVELS);
        assert_eq!((cut(2).first_level, cut(2).renders), (0, 1));
        let least = cut(3);
        assert_eq!((least.first_level, least.levels), (2, 1));
        assert_eq!((least.coarse_renders, least.renders, least.coarse_leap), (1, 1, f32::INFINITY));
        let more = cut(6);
        assert_eq!((more.levels, more.coarse_renders, more.renders), (1, 3, 2));
        assert_eq!(more.coarse_leap, cold.coarse_leap);
        let half = cut(21);
        assert_eq!((half.levels, half.coarse_renders, half.renders), (cold.levels, 6, 8));
        let timed = cold.within(&Room { time: 32, ..Room::ALL }, LEVELS);
        assert_eq!((timed.levels, timed.coarse_renders, timed.renders), (cold.levels, 4, 5));
    }
}
