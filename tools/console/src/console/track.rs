//! Where the vehicle was, and where it will be if it goes on as it does.

use std::collections::VecDeque;

use glam::DVec3;
use nvsprior::Pose;

/// Places that are kept of all of the dive.
const PLACES: usize = 600;
/// Seconds of the past by which the motion is told.
const MOTION: f64 = 2.0;
/// Fewest seconds between the poses by which it is told.
const LEAST: f64 = 0.2;

/// A pose that the vehicle was certain of.
#[derive(Clone, Copy, Debug)]
struct Sighting {
    /// When its frame was exposed, UTC, seconds.
    time: f64,
    pose: Pose,
}

#[derive(Debug, Default)]
pub struct Track {
    /// Those of late, in order of time.
    recent: VecDeque<Sighting>,
    /// Where the camera was, all through the dive.
    places: Vec<DVec3>,
    /// One of so many sightings is kept as a place.
    stride: usize,
    seen: usize,
}

impl Track {
    /// Takes a pose that the vehicle was certain of. One that is older than the last is left out: its packet was late.
    pub fn add(&mut self, time: f64, pose: Pose) {
        if self.recent.back().is_some_and(|last| time <= last.time) {
            // A clock that was set back begins anew.
            if self.recent.back().is_some_and(|last| time < last.time - MOTION) {
                self.recent.clear();
            }
            return;
        }
        self.recent.push_back(Sighting { time, pose });
        while self.recent.front().is_some_and(|first| first.time < time - MOTION) {
            self.recent.pop_front();
        }
        self.stride = self.stride.max(1);
        if self.seen.is_multiple_of(self.stride) {
            self.places.push(pose.centre());
        }
        self.seen += 1;
        if self.places.len() > PLACES {
            // Every other one stays, and from here on half as many are taken.
            self.places = self.places.iter().copied().step_by(2).collect();
            self.stride *= 2;
        }
    }

    /// Where the camera was, from the start of the dive on, to the newest place.
    pub fn places(&self) -> impl Iterator<Item = DVec3> {
        let newest = self.recent.back().map(|last| last.pose.centre());
        self.places.iter().copied().chain(newest)
    }

    /// The poses at some times after the newest one, seconds: the motion of the last seconds goes on. `None`: too
    /// little is known, or the vehicle was not certain since.
    pub fn predicted(&self, now: f64, after: impl Iterator<Item = f64>) -> Option<Vec<Pose>> {
        let (first, last) = (self.recent.front()?, self.recent.back()?);
        let seconds = last.time - first.time;
        if !(seconds >= LEAST) || now - last.time > MOTION {
            return None;
        }
        Some(after.map(|time| first.pose.between(&last.pose, 1.0 + time / seconds)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// One unit a second along x.
    fn at(time: f64) -> Pose {
        Pose::from_centre(DQuat::IDENTITY, DVec3::new(time, 0.0, 0.0))
    }

    #[test]
    fn the_motion_goes_on() {
        let mut track = Track::default();
        assert!(track.predicted(0.0, [1.0].into_iter()).is_none());
        for k in 0..30 {
            track.add(f64::from(k) * 0.2, at(f64::from(k) * 0.2));
        }
        let predicted = track.predicted(6.0, [0.0, 1.5].into_iter()).unwrap();
        assert!((predicted[0].centre().x - 5.8).abs() < 1e-9);
        assert!((predicted[1].centre().x - 7.3).abs() < 1e-9);
        assert!(track.predicted(9.0, [1.0].into_iter()).is_none(), "nothing certain came since");
    }

    #[test]
    fn late_packets_do_not_turn_it_round_and_a_clock_set_back_begins_anew() {
        let mut track = Track::default();
        for time in [10.0, 11.0, 10.5, 12.0] {
            track.add(time, at(time));
        }
        assert_eq!(track.places().last().unwrap().x, 12.0);
        assert_eq!(track.seen, 3);
        for time in [2.0, 2.5, 3.0] {
            track.add(time, at(time));
        }
        assert_eq!(track.recent.len(), 2);
    }

    #[test]
    fn memory_is_flat_and_the_whole_dive_is_kept() {
        let mut track = Track::default();
        for k in 0..100_000 {
            track.add(f64::from(k), at(f64::from(k)));
        }
        let places: Vec<_> = track.places().map(|place| place.x).collect();
        assert!((PLACES / 2..=PLACES + 1).contains(&places.len()));
        assert_eq!((places[0], places[places.len() - 1]), (0.0, 99_999.0));
        assert!(places.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(track.recent.len() < 4);
    }
}
