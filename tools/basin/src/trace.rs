//! Drawing the scene: one ray per sample, four samples per pixel.

use glam::{Mat3, Vec2, Vec3};
use nvsprior::{Camera, Pose};
use rayon::prelude::*;

use super::light::Light;
use super::material::{Spot, albedo};
use super::scene::Scene;
use super::solid::Ray;
use super::water::LAMP_COUNT;

/// Samples per pixel: a 2 × 2 grid, each lit by a lamp of its own.
const SAMPLES: [(f32, f32); LAMP_COUNT] = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];

/// The rays of a camera's samples, in its own axes.
pub struct Rays {
    width: u32,
    height: u32,
    /// Focal length, pixels.
    focal: f32,
    /// (x/z, y/z) of each sample, pixel by pixel, row by row.
    through: Vec<[Vec2; LAMP_COUNT]>,
}

impl Rays {
    /// `through`: (x/z, y/z) of a picture point, pixels.
    pub fn new(
        width: u32,
        height: u32,
        focal: f32,
        through: impl Fn(f32, f32) -> Vec2 + Sync,
    ) -> Rays {
        let pixels = (0..width * height).into_par_iter().map(|i| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            SAMPLES.map(|(dx, dy)| through(x + dx, y + dy))
        });
        Rays { width, height, focal, through: pixels.collect() }
    }

    pub fn of_camera(camera: &Camera) -> Rays {
        let Camera { width, height, fx, fy, cx, cy } = *camera;
        Rays::new(width, height, fx, |x, y| Vec2::new((x - cx) / fx, (y - cy) / fy))
    }

    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Focal length, pixels.
    pub fn focal(&self) -> f32 {
        self.focal
    }

    /// (x/z, y/z) of each pixel's samples, row by row.
    pub fn samples(&self) -> &[[Vec2; LAMP_COUNT]] {
        &self.through
    }
}

/// A posed camera.
pub struct Eye {
    origin: Vec3,
    to_world: Mat3,
}

impl Eye {
    pub fn new(pose: &Pose) -> Eye {
        let to_world = pose.matrix().transpose().as_mat3();
        Eye { origin: pose.centre().as_vec3(), to_world }
    }

    /// The ray through a point of the plane before the camera.
    pub fn ray(&self, through: Vec2) -> Ray {
        Ray { origin: self.origin, direction: (self.to_world * through.extend(1.0)).normalize() }
    }
}

/// Radiance of every pixel, linear RGB, row-major, as seen through the water.
pub fn draw(scene: &Scene, rays: &Rays, pose: &Pose, light: &Light) -> Vec<Vec3> {
    let eye = Eye::new(pose);
    let pixel = |through: &[Vec2; LAMP_COUNT]| {
        let samples = through.iter().enumerate();
        let sample = |(lamp, through): (usize, &Vec2)| {
            sample(scene, &eye.ray(*through), rays.focal, light, lamp)
        };
        samples.map(sample).sum::<Vec3>() / SAMPLES.len() as f32
    };
    rays.through.par_iter().map(pixel).collect()
}

fn sample(scene: &Scene, ray: &Ray, focal: f32, light: &Light, lamp: usize) -> Vec3 {
    let Some((spot, range)) = seen(scene, ray, focal) else { return scene.water.veil };
    let reflected = albedo(&spot) * light.on(scene, spot.position, spot.normal, lamp);
    scene.water.through(reflected, range)
}

/// The point of a surface that a ray ends at, and its distance.
pub fn seen<'a>(scene: &'a Scene, ray: &Ray, focal: f32) -> Option<(Spot<'a>, f32)> {
    let hit = scene.hit(ray)?;
    // Samples are half a pixel apart. A slanting surface stretches them, up to a limit.
    let slant = hit.normal.dot(ray.direction).abs().max(0.3);
    let footprint = 0.5 * hit.t / (focal * slant);
    let (position, normal, weeks) = (hit.position, hit.normal, scene.weeks);
    Some((Spot { solid: hit.solid, position, normal, footprint, weeks }, hit.t))
}

#[cfg(test)]
mod tests {
    use super::super::{CAMERA, Course, Site};
    use super::*;

    #[test]
    fn rays_end_at_points_that_project_back_onto_their_pixels() {
        let mut open = 0;
        for (site, scene, pose) in Site::ALL.iter().flat_map(|site| {
            let scene = site.mapped();
            site.mapping_poses().into_iter().map(move |pose| (site, scene.clone(), pose))
        }) {
            let eye = Eye::new(&pose);
            for (x, y) in [(3.5, 4.5), (160.0, 90.0), (310.0, 20.0), (77.0, 171.0)] {
                let through = Vec2::new((x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy);
                let ray = eye.ray(through);
                let Some(hit) = scene.hit(&ray) else {
                    assert!(site.has_lamps(), "{site:?} has an end");
                    open += 1;
                    continue;
                };
                let p = (pose.rotation * hit.position.as_dvec3() + pose.translation).as_vec3();
                let (u, v) = (CAMERA.fx * p.x / p.z + CAMERA.cx, CAMERA.fy * p.y / p.z + CAMERA.cy);
                assert!((u - x).abs() < 0.01 && (v - y).abs() < 0.01, "({x}, {y}): ({u}, {v})");
                assert!((p.length() - hit.t).abs() < 1e-3 && hit.normal.dot(ray.direction) < 0.0);
            }
        }
        assert!(open < 2 * Course::Both.pictures(), "{open} rays meet nothing");
    }
}
