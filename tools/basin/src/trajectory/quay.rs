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

/// Seconds of the survey's course.
pub const SURVEY: f64 = 60.0;

/// Places of the survey, at even times: along the wall, height, distance from the wall (metres), yaw beside the wall's
/// normal, and pitch (degrees). Two rows that look ahead, a third from further up, then down across all of them.
const COURSE: [[f64; 5]; 14] = [
    [-3.2, 1.20, 2.5, 12.0, -9.0],
    [-1.6, 1.15, 2.4, 13.0, -8.0],
    [0.0, 1.20, 2.4, 12.0, -9.0],
    [1.6, 1.20, 2.4, 10.0, -8.0],
    [3.0, 1.50, 2.5, 0.0, -9.0],
    [2.9, 2.20, 2.5, -10.0, -10.0],
    [1.4, 2.35, 2.45, -13.0, -10.0],
    [-0.2, 2.30, 2.4, -12.0, -11.0],
    [-1.8, 2.35, 2.45, -10.0, -10.0],
    [-3.0, 2.80, 2.6, 0.0, -13.0],
    [-2.5, 3.40, 2.7, 9.0, -18.0],
    [-1.0, 3.10, 2.7, 8.0, -19.0],
    [0.5, 2.10, 2.6, 3.0, -13.0],
    [1.5, 1.20, 2.5, -3.0, -9.0],
];

/// Which of the two videos of the quay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filmed {
    /// The whole course.
    Survey,
    /// A later dive: a part of the course, faster, nearer to the wall, with another sway.
    Dive,
}

impl Filmed {
    /// The camera's pose `time` seconds into the video. After the course it goes back the way it came.
    pub fn pose(self, time: f64) -> Pose {
        let (on_course_at, nearer, higher, ahead) = match self {
            Filmed::Survey => (time, 0.0, 0.0, 0.0),
            Filmed::Dive => (8.0 + 1.3 * time, 0.12, 0.09, 2.4),
        };
        let folded = on_course_at.rem_euclid(2.0 * SURVEY);
        let at = if folded > SURVEY { 2.0 * SURVEY - folded } else { folded };
        let [along, height, distance, turn, pitch] = on_course(at / SURVEY);
        let sway = |period: f64, offset: f64| (TAU * time / period + offset + ahead).sin();
        let distance = distance - nearer + 0.04 * sway(11.0, 0.3);
        let height = height + higher + 0.03 * sway(7.0, 1.1);
        let yaw = TO_WALL + f64::to_radians(turn + 1.5 * sway(9.0, 0.4));
        let pitch = f64::to_radians(pitch + 0.8 * sway(5.0, 2.6));
        looking(DVec3::new(distance, along, height), yaw, pitch)
    }
}

/// A share of the course, on a Catmull-Rom spline through its places.
fn on_course(share: f64) -> [f64; 5] {
    let last = COURSE.len() - 1;
    let along = share.clamp(0.0, 1.0) * last as f64;
    let from = (along as usize).min(last - 1);
    let f = along - from as f64;
    let place = |i: usize| COURSE[i.min(last)];
    let [before, a, b, after] = [from.saturating_sub(1), from, from + 1, from + 2].map(place);
    std::array::from_fn(|k| {
        let (slope_a, slope_b) = (0.5 * (b[k] - before[k]), 0.5 * (after[k] - a[k]));
        let (f2, f3) = (f * f, f * f * f);
        a[k] * (2.0 * f3 - 3.0 * f2 + 1.0)
            + slope_a * (f3 - 2.0 * f2 + f)
            + b[k] * (3.0 * f2 - 2.0 * f3)
            + slope_b * (f3 - f2)
    })
}
