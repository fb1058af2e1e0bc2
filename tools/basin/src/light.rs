//! The light that comes down through the water's surface.

use glam::{Vec2, Vec3};

use super::noise::value_noise;
use super::scene::Scene;
use super::solid::Ray;

/// The light at one moment.
#[derive(Clone, Copy)]
pub struct Light {
    /// Seconds since the run began; moves the caustics.
    pub time: f32,
    /// Height of the caustics relative to the direct light.
    pub caustics: f32,
}

impl Light {
    /// Irradiance of a surface point divided by π, linear RGB. `lamp` stands for all lamps: the
    /// mean over a pixel's samples is the light of all of them.
    pub fn on(&self, scene: &Scene, position: Vec3, normal: Vec3, lamp: usize) -> Vec3 {
        let outside = position + normal * 2e-3;
        let reach = 0.35;
        let open = scene.distance(outside + normal * reach, reach).max(0.0) / reach;
        let diffuse = (0.50 + 0.22 * normal.z) * (0.4 + 0.6 * open);
        let water = &scene.water;
        let direction = water.lamps[lamp].normalize();
        let facing = normal.dot(direction);
        let lit = facing > 0.0 && !scene.shadowed(&Ray { origin: outside, direction });
        let direct = if lit { 0.95 * facing * self.caustic(position, direction) } else { 0.0 };
        let depth = water.surface - position.z;
        (-water.downwelling * depth).exp() * (diffuse + direct) * water.light
    }

    /// Waves focus the direct light: bright ridges that drift, with a mean of about 1.
    fn caustic(&self, position: Vec3, direction: Vec3) -> f32 {
        if self.caustics == 0.0 {
            return 1.0;
        }
        let on_surface = position.truncate() - direction.truncate() * (position.z / direction.z);
        let ridge = |scale: f32, drift: Vec2, seed| {
            let p = (on_surface + drift * self.time) * scale;
            1.0 - value_noise(p.extend(0.25 * self.time), seed).abs()
        };
        let pattern = ridge(1.1, Vec2::new(0.10, 0.04), 5) * ridge(1.9, Vec2::new(-0.06, 0.09), 6);
        let mean = 0.43;
        1.0 + self.caustics * (pattern - mean) / mean
    }
}

#[cfg(test)]
mod tests {
    use super::super::basin;
    use super::*;

    #[test]
    fn the_structure_casts_shadows_and_caustics_average_out() {
        let scene = basin::mapped();
        let light = Light { time: 0.0, caustics: 0.0 };
        let open = light.on(&scene, Vec3::new(4.5, -4.0, 0.0), Vec3::Z, 0);
        let beneath = light.on(&scene, Vec3::new(1.3, 1.9, 0.0), Vec3::Z, 0);
        assert!(beneath.y < 0.7 * open.y, "{beneath} against {open}");
        let moving = Light { time: 3.0, caustics: 1.0 };
        let mean = (0..4000)
            .map(|i| Vec3::new((i % 63) as f32 * 0.31, (i / 63) as f32 * 0.29, 0.0))
            .map(|p| moving.caustic(p, Vec3::Z) / 4000.0)
            .sum::<f32>();
        assert!((mean - 1.0).abs() < 0.1, "{mean}");
    }
}
