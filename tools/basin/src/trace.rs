//! Drawing the scene: one ray per sample, four samples per pixel.

use glam::{Mat3, Vec3};
use nvsprior::{Camera, Pose};
use rayon::prelude::*;

use super::material::{Spot, albedo};
use super::scene::Scene;
use super::solid::Ray;
use super::water::{LAMP_COUNT, Light};

/// Samples per pixel: a 2 × 2 grid, each lit by a lamp of its own.
const SAMPLES: [(f32, f32); LAMP_COUNT] = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];

/// Rays of a posed camera.
pub struct Eye {
    camera: Camera,
    origin: Vec3,
    to_world: Mat3,
}

impl Eye {
    pub fn new(camera: &Camera, pose: &Pose) -> Eye {
        let to_world = pose.matrix().transpose().as_mat3();
        Eye { camera: *camera, origin: pose.centre().as_vec3(), to_world }
    }

    /// The ray through a picture point, pixels.
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        let through = Vec3::new((x - cx) / fx, (y - cy) / fy, 1.0);
        Ray { origin: self.origin, direction: (self.to_world * through).normalize() }
    }
}

/// Radiance of every pixel, linear RGB, row-major, as seen through the water.
pub fn draw(scene: &Scene, camera: &Camera, pose: &Pose, light: &Light) -> Vec<Vec3> {
    let eye = Eye::new(camera, pose);
    let width = camera.width as usize;
    let mut radiance = vec![Vec3::ZERO; camera.pixels()];
    radiance.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let sum: Vec3 = SAMPLES
                .iter()
                .enumerate()
                .map(|(lamp, (dx, dy))| {
                    sample(scene, &eye, light, lamp, x as f32 + dx, y as f32 + dy)
                })
                .sum();
            *pixel = sum / SAMPLES.len() as f32;
        }
    });
    radiance
}

fn sample(scene: &Scene, eye: &Eye, light: &Light, lamp: usize, x: f32, y: f32) -> Vec3 {
    let ray = eye.ray(x, y);
    let Some(hit) = scene.hit(&ray) else { return scene.water.veil };
    // Samples are half a pixel apart. A slanting surface stretches them, up to a limit.
    let slant = hit.normal.dot(ray.direction).abs().max(0.3);
    let footprint = 0.5 * hit.t / (eye.camera.fx * slant);
    let (position, normal, weeks) = (hit.position, hit.normal, scene.weeks);
    let spot = Spot { solid: hit.solid, position, normal, footprint, weeks };
    let reflected = albedo(&spot) * light.on(scene, hit.position, hit.normal, lamp);
    scene.water.through(reflected, hit.t)
}

#[cfg(test)]
mod tests {
    use super::super::{CAMERA, Site};
    use super::*;

    #[test]
    fn rays_end_at_points_that_project_back_onto_their_pixels() {
        for (scene, pose) in Site::ALL.iter().flat_map(|site| {
            let scene = site.mapped();
            site.mapping_poses().into_iter().map(move |pose| (scene.clone(), pose))
        }) {
            let eye = Eye::new(&CAMERA, &pose);
            for (x, y) in [(3.5, 4.5), (160.0, 90.0), (310.0, 20.0), (77.0, 171.0)] {
                let ray = eye.ray(x, y);
                let hit = scene.hit(&ray).unwrap();
                let p = (pose.rotation * hit.position.as_dvec3() + pose.translation).as_vec3();
                let (u, v) = (CAMERA.fx * p.x / p.z + CAMERA.cx, CAMERA.fy * p.y / p.z + CAMERA.cy);
                assert!((u - x).abs() < 0.01 && (v - y).abs() < 0.01, "({x}, {y}): ({u}, {v})");
                assert!((p.length() - hit.t).abs() < 1e-3 && hit.normal.dot(ray.direction) < 0.0);
            }
        }
    }
}
