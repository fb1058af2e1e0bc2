//! The tower as its vehicle's lamps show it: what surfaces reflect, and what the water scatters back on the way.
//!
//! Light is followed from lamp to surface or water, and on to the camera: one turn at most. J. Jaffe, "Computer
//! modeling and the design of optimal underwater imaging systems", IEEE Journal of Oceanic Engineering 15, 1990, calls
//! these the direct component and the backscatter.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use nvsprior::Pose;
use rayon::prelude::*;

use super::lamp::{PlacedLamp, ShadowMap};
use super::material::{Spot, albedo, gloss};
use super::medium;
use super::rig::Rig;
use super::scene::Scene;
use super::solid::Ray;
use super::trace::{Eye, Rays, seen};

/// Nothing farther than this is drawn, metres: of a lamp's light one part in 10,000 of that at 1 m comes back.
pub const SIGHT: f32 = 10.0;
/// Where the march through the water begins, metres.
const NEAR: f32 = 0.08;
/// Steps of the march. Each is as much longer than the last as the distance.
const STEPS: usize = 28;

/// What a camera gets during one exposure.
pub struct Drawn {
    /// Linear RGB, row by row.
    pub radiance: Vec<Vec3>,
    /// To the nearest surface of each pixel, along the ray.
    pub range: Vec<f32>,
}

/// The scene at one moment.
pub struct Moment<'a> {
    scene: &'a Scene,
    eye: Eye,
    pub lamps: Vec<PlacedLamp>,
}

impl<'a> Moment<'a> {
    /// `vehicle`: the pose of the rig's first camera.
    pub fn new(scene: &'a Scene, rig: &Rig, vehicle: &Pose) -> Moment<'a> {
        let lamps = rig.lit().iter().map(|lamp| PlacedLamp::new(lamp, vehicle)).collect();
        Moment { scene, eye: Eye::new(&rig.pose(vehicle)), lamps }
    }

    /// Radiance of the surface that a ray ends at, as it comes to the camera, and its distance.
    fn surface(&self, ray: &Ray, focal: f32) -> (Vec3, f32) {
        let Some((spot, range)) = seen(self.scene, ray, focal).filter(|(_, range)| *range < SIGHT)
        else {
            return (Vec3::ZERO, SIGHT);
        };
        let colour = albedo(&spot);
        let lit = self.lamps.iter().map(|lamp| self.reflected(lamp, &spot, colour, ray));
        (lit.sum::<Vec3>() * medium::kept(range), range)
    }

    /// What a surface sends back along a ray of one lamp's light.
    fn reflected(&self, lamp: &PlacedLamp, spot: &Spot, colour: Vec3, ray: &Ray) -> Vec3 {
        let outside = spot.position + spot.normal * 2e-3;
        let Some(incident) = lamp.at(outside) else { return Vec3::ZERO };
        let facing = spot.normal.dot(incident.direction);
        if facing <= 0.0 || !lamp.reaches(self.scene, outside, &incident) {
            return Vec3::ZERO;
        }
        let mirrored = gloss(spot.solid.material).map_or(0.0, |(share, sharp)| {
            let half = (incident.direction - ray.direction).normalize();
            // The lobe's integral over the half space is about 1.
            share * (sharp + 8.0) / (8.0 * PI) * spot.normal.dot(half).max(0.0).powf(sharp)
        });
        incident.light * facing * (colour / PI + mirrored)
    }
}

/// The steps of a march: where each begins and ends, and what comes back to the camera from its middle.
struct March {
    steps: Vec<Slice>,
}

struct Slice {
    begin: f32,
    length: f32,
    middle: f32,
    kept: Vec3,
}

impl March {
    fn new() -> March {
        let edge = |i: usize| NEAR * (SIGHT / NEAR).powf(i as f32 / STEPS as f32);
        let step = |i| {
            let (begin, end) = (edge(i), edge(i + 1));
            let middle = (begin * end).sqrt();
            Slice { begin, length: end - begin, middle, kept: medium::kept(middle) }
        };
        March { steps: (0..STEPS).map(step).collect() }
    }

    /// Radiance that the water before a pixel's surfaces scatters towards the camera. `ranges`: where its samples end.
    fn backscatter(&self, ray: &Ray, ranges: &[f32], lit: &[(&PlacedLamp, ShadowMap)]) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for step in &self.steps {
            let share = |range: &f32| ((range - step.begin) / step.length).clamp(0.0, 1.0);
            let free = ranges.iter().map(share).sum::<f32>() / ranges.len() as f32;
            if free == 0.0 {
                break;
            }
            let point = ray.at(step.middle);
            for (lamp, shadows) in lit {
                let Some(incident) = lamp.at(point) else { continue };
                // The light comes from the lamp, and turns towards the camera.
                let turn = incident.direction.dot(ray.direction);
                let shown = free * step.length * shadows.lit(lamp, point);
                sum += shown * incident.light * medium::scattered(turn) * step.kept;
            }
        }
        sum
    }
}

/// Draws one exposure: each of a pixel's samples at a moment of its own, the water at the middle one. `moments` and
/// `middle`: poses of the rig's first camera.
pub fn draw(scene: &Scene, rays: &Rays, rig: &Rig, moments: &[Pose; 4], middle: &Pose) -> Drawn {
    let near = scene.near(middle.centre().as_vec3(), SIGHT);
    let moments = moments.each_ref().map(|pose| Moment::new(&near, rig, pose));
    let middle = Moment::new(&near, rig, middle);
    // Shadows in the water have no sharp edges: they need half the picture's detail.
    let side = (rays.size().0 / 2) as usize;
    let shadows = middle.lamps.iter().map(|lamp| (lamp, ShadowMap::new(&near, lamp, side)));
    let (lit, march): (Vec<_>, _) = (shadows.collect(), March::new());
    let pixel = |through: &[Vec2; 4]| {
        let sample = |i: usize| moments[i].surface(&moments[i].eye.ray(through[i]), rays.focal());
        let samples: [(Vec3, f32); 4] = std::array::from_fn(sample);
        let ranges = samples.map(|(_, range)| range);
        let ray = middle.eye.ray(through.iter().sum::<Vec2>() / 4.0);
        let surface = samples.iter().map(|(radiance, _)| radiance).sum::<Vec3>() / 4.0;
        let radiance = surface + march.backscatter(&ray, &ranges, &lit);
        (radiance, ranges.into_iter().fold(SIGHT, f32::min))
    };
    let (radiance, range) = rays.samples().par_iter().map(pixel).unzip();
    Drawn { radiance, range }
}
