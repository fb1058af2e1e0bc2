//! The vehicle's safety line: thin, yellow, always in view, swaying as the vehicle moves.

use glam::Vec3;
use nvsprior::Pose;

use super::solid::{Material, Solid};

const SEGMENTS: usize = 12;
/// Half the thickness of the line, metres.
const RADIUS: f32 = 0.005;
/// Where the line leaves the vehicle, bends and goes out of view, camera axes, metres.
const CONTROL: [Vec3; 3] =
    [Vec3::new(0.62, -0.62, 1.0), Vec3::new(0.30, 0.15, 1.15), Vec3::new(0.42, 0.75, 1.25)];

/// The line as seen from a pose, `time` seconds into the run: a quadratic Bézier curve in camera
/// axes, as a chain of cylinders in the world.
pub fn solids(pose: &Pose, time: f64) -> Vec<Solid> {
    let to_world = pose.inverse();
    let time = time as f32;
    let sway = Vec3::new(0.16 * (0.55 * time).sin(), 0.0, 0.08 * (0.37 * time).cos());
    let [start, bend, end] = [CONTROL[0], CONTROL[1] + sway, CONTROL[2] + 0.5 * sway];
    let joint = |i: usize| {
        let s = i as f32 / SEGMENTS as f32;
        let in_camera = start.lerp(bend, s).lerp(bend.lerp(end, s), s);
        (to_world.rotation * in_camera.as_dvec3() + to_world.translation).as_vec3()
    };
    (0..SEGMENTS)
        .map(|i| Solid::cylinder(joint(i), joint(i + 1), RADIUS, Material::SafetyLine, 0))
        .collect()
}
