//! The vehicle's ways.

pub mod basin;
pub mod quay;
pub mod tower;

use glam::{DMat3, DQuat, DVec2, DVec3};
use nvsprior::Pose;

/// Frames per second of the inspection runs.
pub const FRAME_RATE: f64 = 3.0;

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
    use super::super::{Dive, Run, Site};
    use super::*;

    /// The five dives of each run.
    fn dives() -> impl Iterator<Item = Dive> {
        let of = |run| (1..=5).map(move |number| Dive { number, ..Dive::of(run) });
        Run::ALL.into_iter().flat_map(of)
    }

    #[test]
    fn cameras_keep_clear_of_solids_and_face_them() {
        let times = || (0..600).map(|i| f64::from(i) / FRAME_RATE);
        let mapped = Site::ALL.map(|site| (site, site.mapped(), site.mapping_poses()));
        let inspected = dives().map(|dive| {
            let poses = times().map(|time| dive.pose(time)).collect();
            (dive.run.site(), dive.scene(), poses)
        });
        let survey = times().map(|time| quay::Filmed::Survey.pose(time)).collect();
        let surveyed = std::iter::once((Site::Quay, Site::Quay.mapped(), survey));
        for (site, scene, poses) in mapped.into_iter().chain(inspected).chain(surveyed) {
            for pose in poses {
                let centre = pose.centre();
                assert!(scene.distance(centre.as_vec3(), 1.0) > 0.4, "{centre}");
                let aim = match site {
                    Site::Basin => DVec3::Z * 1.5,
                    Site::Quay => DVec3::new(0.0, centre.y, 1.5),
                    Site::Tower => super::super::tower::CROSSING.as_dvec3(),
                    Site::Row => {
                        let step = f64::from(super::super::basin::ROW_STEP);
                        DVec3::new(0.0, step * (centre.y / step).round(), 1.5)
                    }
                };
                let aim = pose.rotation * aim + pose.translation;
                assert!(aim.z > 1.0, "{centre} looks away: {aim}");
            }
        }
    }

    #[test]
    fn the_vehicle_moves_slowly_and_without_jumps() {
        for dive in dives() {
            for i in 0..900 {
                let time = f64::from(i) / FRAME_RATE;
                let (a, b) = (dive.pose(time), dive.pose(time + 1.0 / FRAME_RATE));
                let moved = (a.centre() - b.centre()).length();
                assert!(moved < 0.18 && a.angle_to(&b) < 0.06, "{dive:?} at {time}: {moved}");
            }
        }
    }

    #[test]
    fn the_survey_moves_steadily_and_comes_to_places_again() {
        let poses: Vec<Pose> =
            (0..=600).map(|i| quay::Filmed::Survey.pose(0.1 * f64::from(i))).collect();
        for pair in poses.windows(2) {
            let moved = (pair[0].centre() - pair[1].centre()).length();
            assert!(moved < 0.06 && pair[0].angle_to(&pair[1]) < 0.02, "{moved}");
        }
        let near = |a: &Pose, b: &Pose| (a.centre() - b.centre()).length() < 0.5;
        let again = poses[400..].iter().filter(|a| poses[..300].iter().any(|b| near(a, b)));
        assert!(again.count() > 20);
    }

    #[test]
    fn looking_follows_the_opencv_axes() {
        let pose = looking(DVec3::new(1.0, 2.0, 3.0), 0.4, -0.2);
        let ahead = DVec3::new(1.0, 2.0, 3.0) + DVec3::new(0.4f64.cos(), 0.4f64.sin(), 0.0) * 5.0;
        let seen = pose.rotation * ahead + pose.translation;
        assert!(seen.x.abs() < 1e-9 && seen.y < 0.0 && seen.z > 4.0, "{seen}");
    }
}
