//! The vehicle's way: the mapping run around and over the structure, and two inspection runs.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DMat3, DQuat, DVec2, DVec3};
use nvsprior::Pose;

use super::Run;
use super::scene::{BASIN, HALF_PLAN, STRUCTURE_HEIGHT, Scene};

/// Frames per second of the inspection runs.
pub const FRAME_RATE: f64 = 3.0;
/// Speed of the inspection runs along the track, m/s.
const SPEED: f64 = 0.25;

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

/// The vehicle's pose `time` seconds into an inspection run: a lawnmower track along the side
/// x > 0, with the slow sway of a hovering vehicle.
pub fn inspection_pose(run: Run, time: f64) -> Pose {
    // Where along the track the run begins (m), the sway's phase, clearance (m), lowest leg (m).
    let (begin, phase, clearance, lowest) = match run {
        Run::T1 => (0.6, 0.0, 2.6, 1.1),
        Run::T2 => (1.6, 2.1, 2.7, 0.95),
    };
    let (along, up) = lawnmower(begin + SPEED * time, 4.8, 0.55, 4);
    let sway = |period: f64, offset: f64| (TAU * time / period + phase + offset).sin();
    let loop_ = Loop { clearance: clearance + 0.06 * sway(17.0, 0.0) };
    let (place, inward) = loop_.at(along - 0.1);
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
    let scene = Scene::mapped();
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

/// Distance along the leg, and height above the first leg, after `distance` metres of a lawnmower
/// track of `rows` legs. The track goes up and down again without end.
fn lawnmower(distance: f64, leg: f64, step: f64, rows: u32) -> (f64, f64) {
    let total = f64::from(rows) * leg + f64::from(rows - 1) * step;
    let folded = distance.rem_euclid(2.0 * total);
    let d = if folded > total { 2.0 * total - folded } else { folded };
    let row = (d / (leg + step)).floor();
    let rest = d - row * (leg + step);
    let forth = rest.min(leg);
    let along = if row.rem_euclid(2.0) == 0.0 { forth } else { leg - forth };
    (along, row * step + (rest - leg).max(0.0))
}

/// The pose of a camera that stands at `centre` and looks along yaw (about +z from +x) and pitch
/// (above the horizon), radians, without roll.
fn looking(centre: DVec3, yaw: f64, pitch: f64) -> Pose {
    let level = DVec2::from_angle(yaw);
    let forward = (level * pitch.cos()).extend(pitch.sin());
    let right = DVec3::new(level.y, -level.x, 0.0);
    let to_world = DMat3::from_cols(right, forward.cross(right), forward);
    Pose::from_centre(DQuat::from_mat3(&to_world.transpose()), centre)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_keep_clear_of_solids_and_face_the_structure() {
        let scene = Scene::with_new_object();
        let times = || (0..600).map(|i| f64::from(i) / FRAME_RATE);
        let inspected = [Run::T1, Run::T2].map(|r| times().map(move |t| inspection_pose(r, t)));
        for pose in mapping_poses().into_iter().chain(inspected.into_iter().flatten()) {
            let centre = pose.centre();
            assert!(scene.distance(centre.as_vec3(), 1.0) > 0.4, "{centre}");
            let middle = pose.rotation * DVec3::Z * 1.5 + pose.translation;
            assert!(middle.z > 1.0, "{centre} looks away: {middle}");
        }
    }

    #[test]
    fn the_vehicle_moves_slowly_and_without_jumps() {
        for run in [Run::T1, Run::T2] {
            for i in 0..900 {
                let time = f64::from(i) / FRAME_RATE;
                let (a, b) =
                    (inspection_pose(run, time), inspection_pose(run, time + 1.0 / FRAME_RATE));
                let moved = (a.centre() - b.centre()).length();
                assert!(moved < 0.15 && a.angle_to(&b) < 0.06, "{run:?} at {time}: {moved}");
            }
        }
    }

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

    #[test]
    fn looking_follows_the_opencv_axes() {
        let pose = looking(DVec3::new(1.0, 2.0, 3.0), 0.4, -0.2);
        let ahead = DVec3::new(1.0, 2.0, 3.0) + DVec3::new(0.4f64.cos(), 0.4f64.sin(), 0.0) * 5.0;
        let seen = pose.rotation * ahead + pose.translation;
        assert!(seen.x.abs() < 1e-9 && seen.y < 0.0 && seen.z > 4.0, "{seen}");
    }
}
