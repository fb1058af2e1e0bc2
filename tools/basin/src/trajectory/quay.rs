//! The vehicle's way along the quay: the mapping run before the wall, and an inspection run.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use nvsprior::Pose;

use super::{lawnmower, looking};

/// Speed of the inspection run along the track, m/s.
const SPEED: f64 = 0.4;
/// The yaw that faces the wall.
const TO_WALL: f64 = PI;

/// Poses of the mapping run: rows before the wall, then one that looks down at its foot.
pub fn mapping_poses() -> Vec<Pose> {
    // Camera height (m), pitch below the horizon (degrees), distance (m), yaw to either side by turns (degrees),
    // pictures.
    let rows = [
        (0.9, 4.0, 2.6, 0.0, 17),
        (2.1, 6.0, 2.7, 14.0, 17),
        (3.3, 2.0, 2.6, 0.0, 17),
        (4.3, 12.0, 2.9, 12.0, 17),
        (2.8, 42.0, 2.4, 0.0, 12),
    ];
    let row = |(height, pitch, distance, turn, count)| {
        (0..count).map(move |i: u32| {
            let share = f64::from(i) / f64::from(count - 1);
            let place = DVec3::new(distance, -4.2 + 8.4 * share, height);
            let side = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
            let yaw = TO_WALL + side * f64::to_radians(turn);
            looking(place, yaw, -f64::to_radians(pitch))
        })
    };
    rows.into_iter().flat_map(row).collect()
}

/// The vehicle's pose `time` seconds into a dive of the inspection run, after `earlier` ones: a lawnmower track before
/// the wall, with the slow sway of a hovering vehicle.
pub fn inspection_pose(earlier: u32, time: f64) -> Pose {
    let earlier = f64::from(earlier);
    let (along, up) = lawnmower(1.2 + 0.4 * earlier + SPEED * time, 6.0, 0.7, 3);
    let sway = |period: f64, offset: f64| (TAU * time / period + offset + 0.8 * earlier).sin();
    let distance = 2.45 + 0.07 * sway(13.0, 0.7);
    let height = 1.25 + up + 0.05 * sway(9.0, 1.9);
    let yaw = TO_WALL + f64::to_radians(4.0) * sway(19.0, 0.4);
    let pitch = f64::to_radians(-7.0 + 1.5 * sway(6.0, 2.6));
    looking(DVec3::new(distance, along - 3.0, height), yaw, pitch)
}
