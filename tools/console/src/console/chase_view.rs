//! The chase view: the prior from behind and above the vehicle, with the vehicle in it.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};
use nvsprior::render::{Plan, Renderer, Scene};
use nvsprior::{Camera, Engine, Picture, Pose};

use super::projection::{self, Pixel};

const WIDTH: u32 = 480;
const HEIGHT: u32 = 270;
/// Focal length as a part of the width: 77 degrees across.
const FOCAL: f32 = 0.63;
/// How far behind and above the vehicle it is seen from, and how far before it the eye looks: in view units.
const BEHIND: f64 = 1.6;
const ABOVE: f64 = 0.9;
const AHEAD: f64 = 1.5;
/// What a view unit is, in spreads of the prior.
const UNIT: f64 = 0.35;

pub struct ChaseView {
    camera: Camera,
    renderer: Renderer,
    up: DVec3,
    /// Length that the view is measured by, the prior's unit.
    pub unit: f64,
    pub picture: Picture,
    pose: Pose,
}

impl ChaseView {
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        up: DVec3,
        spread: f64,
    ) -> anyhow::Result<ChaseView> {
        let focal = FOCAL * WIDTH as f32;
        let (cx, cy) = (WIDTH as f32 / 2.0, HEIGHT as f32 / 2.0);
        let camera = Camera { width: WIDTH, height: HEIGHT, fx: focal, fy: focal, cx, cy };
        Ok(ChaseView {
            renderer: engine.renderer(scene, &camera, Plan::picture())?,
            camera,
            up,
            unit: UNIT * spread,
            picture: Picture::new(WIDTH, HEIGHT),
            pose: Pose::IDENTITY,
        })
    }

    /// Draws it for a vehicle's pose.
    pub fn draw(&mut self, vehicle: &Pose) -> anyhow::Result<()> {
        self.pose = behind(vehicle, self.up, self.unit);
        let pose = self.pose.relative_to(self.renderer.scene().origin());
        self.renderer.picture(&pose, &mut self.picture)?;
        Ok(())
    }

    /// A line of the scene, in pixels.
    pub fn lines(&self, points: impl IntoIterator<Item = DVec3>) -> Vec<Vec<Pixel>> {
        projection::lines(&self.camera, &self.pose, points, 0.05 * self.unit)
    }

    /// The vehicle as a pyramid. Its top is the camera; its base lies in front of the camera.
    pub fn vehicle(&self, camera: &Camera, pose: &Pose) -> Vec<Vec<Pixel>> {
        let [a, b, c, d] = projection::corners(camera, pose, 0.5 * self.unit);
        let centre = pose.centre();
        let edges: [&[DVec3]; 3] = [&[a, b, c, d, a], &[a, centre, b], &[c, centre, d]];
        edges.iter().flat_map(|edge| self.lines(edge.iter().copied())).collect()
    }
}

/// A pose behind and above a vehicle, upright, that looks at what lies before it.
fn behind(vehicle: &Pose, up: DVec3, unit: f64) -> Pose {
    let centre = vehicle.centre();
    let ahead = vehicle.rotation.inverse() * DVec3::Z;
    let flat = ahead - up * ahead.dot(up);
    // A vehicle that looks straight down has its upper edge ahead.
    let flat = if flat.length() > 0.1 { flat } else { vehicle.rotation.inverse() * -DVec3::Y };
    let flat =
        (flat - up * flat.dot(up)).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let eye = centre - flat * (BEHIND * unit) + up * (ABOVE * unit);
    let forward = (centre + flat * (AHEAD * unit) - eye).normalize();
    let right = forward.cross(up).normalize();
    let down = forward.cross(right);
    let rows = DMat3::from_cols(right, down, forward).transpose();
    Pose::from_centre(DQuat::from_mat3(&rows), eye)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vehicle_is_in_the_middle_and_the_eye_is_upright() {
        let up = -DVec3::Y;
        let camera = Camera { width: 200, height: 100, fx: 100.0, fy: 100.0, cx: 100.0, cy: 50.0 };
        for turn in [DQuat::IDENTITY, DQuat::from_rotation_y(2.0), DQuat::from_rotation_x(1.5)] {
            let vehicle = Pose::from_centre(turn.inverse(), DVec3::new(3.0, -1.0, 2.0));
            let pose = behind(&vehicle, up, 2.0);
            let see = |point| projection::project(&camera, &pose, point, 0.1).unwrap();
            let seen = see(vehicle.centre());
            assert!((seen[0] - 100.0).abs() < 0.5 && (40.0..90.0).contains(&seen[1]), "{seen:?}");
            let above = see(vehicle.centre() + up * 0.5);
            assert!((above[0] - 100.0).abs() < 0.5 && above[1] < seen[1], "{above:?}");
            assert!(pose.centre().dot(up) > vehicle.centre().dot(up));
        }
    }

    #[test]
    fn straight_up_and_down_are_poses_too() {
        for turn in [
            DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2),
            DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2),
        ] {
            assert!(behind(&Pose::from_centre(turn, DVec3::ZERO), -DVec3::Y, 1.0).is_finite());
        }
    }
}
