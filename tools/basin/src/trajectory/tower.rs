//! The vehicle's way at the tower: the courses of the mapping run, and an inspection run.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use nvsprior::Pose;

use super::super::tower::CROSSING;
use super::looking;

/// How the mapping run's pictures are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// Towards the tower along the line of sight: little parallax.
    Approach,
    /// About the tower in three rows.
    Arcs,
    /// The approach, then the arcs.
    Both,
}

/// Seconds between two pictures of the mapping run.
pub const MAPPING_STEP: f64 = 1.5;

/// Pictures of the approach, of each arc, and of all arcs.
const APPROACH: usize = 24;
const ARC: usize = 16;
const ARCS: usize = ARC * ROWS.len();
/// Of the arcs: height above the crossing of what they look at (m), distance from it (m), pitch (degrees).
const ROWS: [[f64; 3]; 3] = [[-0.2, 2.5, 12.0], [0.2, 3.2, -4.0], [0.5, 2.6, -22.0]];
/// How far an arc goes to either side, degrees.
const ARC_SIDE: f64 = 55.0;
/// Degrees to the side and downwards of the line of sight of the approach.
const SIGHT: [f64; 2] = [9.0, -6.0];

impl Course {
    /// Pictures of the mapping run.
    pub fn pictures(self) -> usize {
        match self {
            Course::Approach => APPROACH,
            Course::Arcs => ARCS,
            Course::Both => APPROACH + ARCS,
        }
    }

    /// Poses of the first camera.
    pub fn poses(self) -> Vec<Pose> {
        (0..self.pictures()).map(|i| self.pose(i as f64 * MAPPING_STEP)).collect()
    }

    /// Pose of the first camera, `time` seconds into the mapping run.
    pub fn pose(self, time: f64) -> Pose {
        // Halfway between two pictures, so that none is taken in the jump.
        let arcs_begin = (APPROACH as f64 - 0.5) * MAPPING_STEP;
        match self {
            Course::Approach => approach(time),
            Course::Arcs => arc(time),
            Course::Both if time < arcs_begin => approach(time),
            Course::Both => arc(time - APPROACH as f64 * MAPPING_STEP),
        }
    }
}

/// A pose that looks at a place from a distance. `around`: the side that it looks from, about +z from +x, and `pitch`,
/// degrees. `turn`: yaw and pitch beside the place, degrees.
fn facing(place: DVec3, distance: f64, [around, pitch]: [f64; 2], turn: [f64; 2]) -> Pose {
    let [around, pitch, yaw_off, pitch_off] =
        [around, pitch, turn[0], turn[1]].map(f64::to_radians);
    let level = DVec2::from_angle(around) * pitch.cos();
    let centre = place + level.extend(-pitch.sin()) * distance;
    looking(centre, around + PI + yaw_off, pitch + pitch_off)
}

/// A slow swing of height 1.
fn sway(time: f64, period: f64, offset: f64) -> f64 {
    (TAU * time / period + offset).sin()
}

/// From 4.5 to 1.6 m before the crossing, with the sway of a vehicle that holds its heading.
fn approach(time: f64) -> Pose {
    let share = time / ((APPROACH - 1) as f64 * MAPPING_STEP);
    let place = CROSSING.as_dvec3()
        + DVec3::new(0.0, 0.03 * sway(time, 17.0, 0.4), 0.02 * sway(time, 11.0, 1.3));
    let turn = [0.9 * sway(time, 13.0, 0.2), 0.6 * sway(time, 9.0, 2.1)];
    facing(place, 4.5 - 2.9 * share, SIGHT, turn)
}

/// Three rows about the face, forth and back.
fn arc(time: f64) -> Pose {
    let picture = time / MAPPING_STEP;
    // Between rows it jumps, halfway between two pictures.
    let row = (((picture + 0.5) / ARC as f64).max(0.0) as usize).min(ROWS.len() - 1);
    let share = (picture - (row * ARC) as f64) / (ARC - 1) as f64;
    let side = if row.is_multiple_of(2) { 1.0 } else { -1.0 };
    let [height, distance, pitch] = ROWS[row];
    let place = CROSSING.as_dvec3() + DVec3::Z * height;
    let turn = [1.2 * sway(time, 13.0, 0.0), 0.8 * sway(time, 9.0, 1.0)];
    facing(place, distance, [side * ARC_SIDE * (2.0 * share - 1.0), pitch], turn)
}

/// Pose of the first camera, `time` seconds into a dive of the inspection run, after `earlier` ones: back from the
/// tower and towards it again, along its face meanwhile, on no line of the mapping run's.
pub fn inspection_pose(earlier: u32, time: f64) -> Pose {
    let phase = 0.7 * f64::from(earlier);
    let distance = 3.0 - 1.1 * (TAU * time / 74.0 + 0.5 * phase).cos();
    let side = 1.0 + 12.0 * sway(time, 59.0, phase - 0.4);
    let along = 0.25 * sway(time, 83.0, phase);
    let up = 0.05 + 0.15 * sway(time, 47.0, phase + 0.6);
    let turn = [1.8 * sway(time, 23.0, phase + 2.0), 1.1 * sway(time, 15.0, phase)];
    let pitch = -5.0 + 5.0 * sway(time, 41.0, phase + 0.5);
    facing(CROSSING.as_dvec3() + DVec3::new(0.0, along, up), distance, [side, pitch], turn)
}

#[cfg(test)]
mod tests {
    use super::super::super::{Rig, RigCamera};
    use super::*;

    /// Most degrees between the directions in which two pictures show the crossing.
    fn parallax(poses: &[Pose]) -> f64 {
        let towards = |pose: &Pose| (CROSSING.as_dvec3() - pose.centre()).normalize();
        let pairs = poses.iter().flat_map(|a| poses.iter().map(move |b| (a, b)));
        pairs.map(|(a, b)| towards(a).angle_between(towards(b))).fold(0.0, f64::max).to_degrees()
    }

    #[test]
    fn the_approach_has_little_parallax_and_the_arcs_have_much() {
        let [approach, arcs] = [Course::Approach, Course::Arcs].map(Course::poses);
        assert!(parallax(&approach) < 4.0, "{}", parallax(&approach));
        assert!(parallax(&arcs) > 90.0, "{}", parallax(&arcs));
        let turned = approach.iter().map(|pose| pose.angle_to(&approach[0]).to_degrees());
        assert!(turned.fold(0.0, f64::max) < 5.0);
        let distance = |pose: &Pose| (CROSSING.as_dvec3() - pose.centre()).length();
        assert!((distance(&approach[0]) - 4.5).abs() < 0.1);
        assert!((distance(&approach[23]) - 1.6).abs() < 0.1);
        assert_eq!(Course::Both.poses(), [approach, arcs].concat());
    }

    #[test]
    fn the_course_is_steady_while_a_picture_is_taken() {
        for course in [Course::Approach, Course::Arcs, Course::Both] {
            for i in 0..course.pictures() {
                let at = |shift: f64| course.pose(i as f64 * MAPPING_STEP + shift);
                let moved = (at(0.1).centre() - at(-0.1).centre()).length();
                assert!(moved < 0.08, "{course:?}, picture {i}: {moved}");
            }
        }
    }

    #[test]
    fn the_second_camera_keeps_clear_of_the_tower() {
        let scene = super::super::super::tower::mapped();
        let rig = Rig { camera: RigCamera::Second, ..Rig::default() };
        let of_dive = |dive| (0..600).map(move |i| inspection_pose(dive, f64::from(i) / 3.0));
        let vehicles = Course::Both.poses().into_iter().chain((0..5).flat_map(of_dive));
        for vehicle in vehicles {
            let centre = rig.pose(&vehicle).centre().as_vec3();
            assert!(scene.distance(centre, 1.0) > 0.4, "{centre}");
        }
    }

    #[test]
    fn dives_keep_off_the_mapping_runs_line() {
        let line = Course::Approach.poses();
        let dive: Vec<Pose> = (0..200).map(|i| inspection_pose(0, f64::from(i) / 3.0)).collect();
        let off = dive.iter().map(|pose| {
            let away = |other: &Pose| (pose.centre() - other.centre()).length();
            line.iter().map(away).fold(f64::INFINITY, f64::min)
        });
        let mut off: Vec<f64> = off.collect();
        off.sort_by(f64::total_cmp);
        assert!(off[100] > 0.3, "{}", off[100]);
        let distances = dive.iter().map(|pose| (CROSSING.as_dvec3() - pose.centre()).length());
        assert!(distances.clone().fold(f64::INFINITY, f64::min) < 2.1);
        assert!(distances.fold(0.0, f64::max) > 3.9);
    }
}
