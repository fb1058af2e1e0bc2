//! The vehicle's way in the basin: the mapping run around and over the structure, and the inspection runs.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3};
use nvsprior::Pose;

use super::super::basin::{self, BASIN, HALF_PLAN, ROW, ROW_STEP, STRUCTURE_HEIGHT};
use super::{lawnmower, looking};

/// Poses of the mapping run: rows around the structure, then passes over it.
pub fn mapping_poses() -> Vec<Pose> {
    // Camera height (m), pitch below the horizon (degrees), clearance (m), pictures.
    let rows = [(0.75, 2.0, 2.5, 24), (1.75, 10.0, 2.7, 24), (2.9, 24.0, 2.7, 24)];
    let around =
        rows.into_iter().enumerate().flat_map(|(row, (height, pitch, clearance, count))| {
            (0..count).map(move |i: u32| {
                let share = (f64::from(i) + row as f64 / 3.0) / f64::from(count);
                let loop_ = Loop { clearance };
                let (place, inward) = loop_.at(share * loop_.length());
                looking(place.extend(height), inward, -f64::to_radians(pitch))
            })
        });
    let passes = [-1.3, 1.3].into_iter().flat_map(|x| {
        (0..6).map(move |i| {
            let centre = DVec3::new(x, -2.75 + 1.1 * f64::from(i), 4.9);
            looking(centre, FRAC_PI_2, -f64::to_radians(75.0))
        })
    });
    around.chain(passes).collect()
}

/// Poses of the mapping run of the row: that of the basin at each structure in its turn.
pub fn row_mapping_poses() -> Vec<Pose> {
    let at = |copy: u8| {
        let along = f64::from(copy) * f64::from(ROW_STEP) * DVec3::Y;
        let moved = move |pose: Pose| Pose::from_centre(pose.rotation, pose.centre() + along);
        mapping_poses().into_iter().map(moved)
    };
    (0..ROW).flat_map(at).collect()
}

/// The pose `time` seconds into a dive along the side x > 0 of the row, after `earlier` ones: forth and back between
/// its ends. The camera looks at the row, a little ahead and a little back in turns.
pub fn row_pose(earlier: u32, time: f64) -> Pose {
    const SPEED: f64 = 0.4;
    let length = f64::from(ROW - 1) * f64::from(ROW_STEP);
    let (along, up) = lawnmower(1.0 + 0.4 * f64::from(earlier) + SPEED * time, length, 0.55, 4);
    let phase = 0.8 * f64::from(earlier);
    let sway = |period: f64, offset: f64| (TAU * time / period + phase + offset).sin();
    let clear = f64::from(HALF_PLAN[0]) + 2.6 + 0.06 * sway(17.0, 0.0);
    let place = DVec3::new(clear, along, 1.2 + up + 0.04 * sway(11.0, 1.0));
    let yaw = PI + f64::to_radians(15.0) * sway(23.0, 2.0);
    let pitch = f64::to_radians(-8.0 - 6.0 * up + 1.5 * sway(7.0, 0.5));
    looking(place, yaw, pitch)
}

/// What differs between the inspection runs.
pub struct Track {
    /// Where on the loop around the structure the legs begin, and their length, metres.
    from: f64,
    leg: f64,
    /// Metres per second.
    speed: f64,
    /// Where along the track the run begins, metres.
    begin: f64,
    /// Phase of the sway.
    phase: f64,
    /// Distance from the structure, metres.
    clearance: f64,
    /// Height of the lowest leg, metres.
    lowest: f64,
}

impl Track {
    pub const T1: Track = Track {
        from: -0.1,
        leg: 4.8,
        speed: 0.25,
        begin: 0.6,
        phase: 0.0,
        clearance: 2.6,
        lowest: 1.1,
    };
    pub const T2: Track =
        Track { begin: 1.6, phase: 2.1, clearance: 2.7, lowest: 0.95, ..Track::T1 };
    /// From the middle of the side x > 0 around the corner to the side y > 0.
    pub const T4: Track = Track {
        from: 1.2,
        leg: 8.4,
        speed: 0.35,
        begin: 0.7,
        phase: 0.9,
        clearance: 2.65,
        lowest: 1.2,
    };
    /// From the middle of the side x > 0 the other way, half a metre higher, around the corner to the side y < 0.
    pub const T5: Track =
        Track { from: -5.6, begin: 9.0, phase: 3.3, clearance: 2.75, lowest: 1.0, ..Track::T4 };

    /// The track of a dive after `earlier` others of its run.
    pub fn after(self, earlier: u32) -> Track {
        let earlier = f64::from(earlier);
        Track { begin: self.begin + 0.4 * earlier, phase: self.phase + 0.8 * earlier, ..self }
    }
}

/// The vehicle's pose `time` seconds into an inspection run: a lawnmower track along the structure's sides, with the
/// slow sway of a hovering vehicle.
pub fn inspection_pose(track: &Track, time: f64) -> Pose {
    let Track { from, leg, speed, begin, phase, clearance, lowest } = *track;
    let (along, up) = lawnmower(begin + speed * time, leg, 0.55, 4);
    let sway = |period: f64, offset: f64| (TAU * time / period + phase + offset).sin();
    let loop_ = Loop { clearance: clearance + 0.06 * sway(17.0, 0.0) };
    let (place, inward) = loop_.at(along + from);
    let height = lowest + up + 0.04 * sway(11.0, 1.0);
    let yaw = inward + f64::to_radians(5.0) * sway(23.0, 2.0);
    let pitch = f64::to_radians(-8.0 - 6.0 * up + 1.5 * sway(7.0, 0.5));
    looking(place.extend(height), yaw, pitch)
}

/// Distances of [`random_poses`] from the nearest surface and from the point looked at, metres.
const CLEARANCE: f32 = 0.5;
const SIGHT: std::ops::RangeInclusive<f64> = 1.0..=5.0;

/// The endless sequence of a seed: level poses anywhere in the free water that look at the structure.
///
/// `even`: numbers in [−1, 1).
pub fn random_poses(mut even: impl Iterator<Item = f64>) -> impl Iterator<Item = Pose> {
    let scene = basin::mapped();
    let half =
        DVec3::new(HALF_PLAN[0].into(), HALF_PLAN[1].into(), f64::from(STRUCTURE_HEIGHT) / 2.0);
    let (low, high) = (BASIN.0.as_dvec3(), BASIN.1.as_dvec3());
    let mut draw =
        move || DVec3::from_array(std::array::from_fn(|_| even.next().unwrap_or_default()));
    std::iter::repeat_with(move || {
        let centre = (low + high) / 2.0 + draw() * (high - low) / 2.0;
        let target = DVec3::Z * half.z + draw() * half;
        (centre, target - centre)
    })
    .filter(move |(centre, sight)| {
        SIGHT.contains(&sight.length()) && scene.distance(centre.as_vec3(), 1.0) > CLEARANCE
    })
    .map(|(centre, sight)| {
        looking(centre, sight.y.atan2(sight.x), (sight.z / sight.length()).asin())
    })
}

/// The closed track at a clearance around the structure's plan: straight along the sides, arcs
/// about the corners. It starts at the side x > 0, at y = −(half side), and runs towards +y.
struct Loop {
    clearance: f64,
}

impl Loop {
    fn sides() -> [f64; 4] {
        let [x, y] = HALF_PLAN.map(|h| 2.0 * f64::from(h));
        [y, x, y, x]
    }

    fn length(&self) -> f64 {
        Loop::sides().iter().sum::<f64>() + TAU * self.clearance
    }

    /// Place at an arc length from the start (any sign), and the yaw that faces the structure.
    fn at(&self, along: f64) -> (DVec2, f64) {
        let mut rest = along.rem_euclid(self.length());
        let arc = FRAC_PI_2 * self.clearance;
        let half = DVec2::from(HALF_PLAN.map(f64::from));
        let starts = [[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]].map(DVec2::from);
        let mut outward = 0.0;
        for (start, side) in std::iter::zip(starts, Loop::sides()) {
            let heading = outward + FRAC_PI_2;
            if rest < side {
                let foot = start * half + DVec2::from_angle(heading) * rest;
                return (foot + DVec2::from_angle(outward) * self.clearance, outward + TAU / 2.0);
            }
            rest -= side;
            if rest < arc {
                let corner = start * half + DVec2::from_angle(heading) * side;
                let turned = outward + rest / self.clearance;
                let place = corner + DVec2::from_angle(turned) * self.clearance;
                return (place, turned + TAU / 2.0);
            }
            rest -= arc;
            outward += FRAC_PI_2;
        }
        // Rounding may leave a hair of the last arc: that is the start.
        self.at(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loop_closes_and_keeps_its_clearance() {
        let track = Loop { clearance: 2.0 };
        let (start, end) = (track.at(0.0).0, track.at(track.length() - 1e-9).0);
        assert!((start - end).length() < 1e-6);
        for i in 0..100 {
            let (place, _) = track.at(track.length() * f64::from(i) / 100.0);
            let beyond = place.abs() - DVec2::from(HALF_PLAN.map(f64::from));
            assert!((beyond.max(DVec2::ZERO).length() - 2.0).abs() < 1e-6, "{place}");
        }
    }
}
