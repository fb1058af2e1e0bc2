//! Marine snow in the light of the lamps: bright near them, blurred where it is out of focus, drawn out while the
//! vehicle moves.

use glam::{Vec2, Vec3};
use nvsprior::{Camera, Pose};

use super::medium;
use super::night::{Drawn, Moment};
use super::noise::Stream;
use super::rig::Rig;
use super::scene::Scene;
use super::sensor::pixels_about;

/// Where flakes are drawn, metres before the camera.
const NEAR: f32 = 0.12;
const FAR: f32 = 2.6;
/// How far beside the picture they are drawn, too: what is blurred reaches into it.
const MARGIN: f32 = 1.1;
/// Where the lens is focused, and its opening, metres.
const FOCUS: f32 = 2.2;
const OPENING: f32 = 0.004;
/// Radius of a point in focus, pixels of a picture 320 wide.
const SHARPEST: f32 = 0.6;
/// Share of the light that a flake throws back.
const BRIGHT: f32 = 0.6;

/// Adds flakes to an exposure. `density`: in a cubic metre. `moments`: poses of the rig's first camera.
pub fn fall(
    drawn: &mut Drawn,
    scene: &Scene,
    camera: &Camera,
    rig: &Rig,
    moments: &[Pose; 4],
    density: f32,
    draws: &mut Stream,
) {
    let lit =
        moments.each_ref().map(|vehicle| (Moment::new(scene, rig, vehicle), rig.pose(vehicle)));
    let first = &lit[0].1;
    let (wide, high) = (MARGIN * camera.cx, MARGIN * camera.cy);
    let volume = 4.0 * wide * high / (camera.fx * camera.fy) * (FAR.powi(3) - NEAR.powi(3)) / 3.0;
    for _ in 0..(density * volume) as u32 {
        // As many in each cubic metre.
        let depth = draws.within(NEAR.powi(3), FAR.powi(3)).cbrt();
        let at = Vec2::new(draws.within(-wide, wide), draws.within(-high, high));
        let in_camera = (at / camera.fx).extend(1.0) * depth;
        let radius = 1.5e-3 * draws.within(0.35, 1.0).powi(3);
        let place = first.rotation.inverse() * (in_camera.as_dvec3() - first.translation);
        for (moment, pose) in &lit {
            let seen = (pose.rotation * place + pose.translation).as_vec3();
            if seen.z > NEAR / 2.0 {
                let glow = glow(moment, place.as_vec3(), seen) / lit.len() as f32;
                Flake { seen, radius, glow }.add(drawn, camera);
            }
        }
    }
}

/// Radiance of a flake as it comes to the camera. Flakes throw light back evenly.
fn glow(moment: &Moment, place: Vec3, seen: Vec3) -> Vec3 {
    let light = moment.lamps.iter().filter_map(|lamp| lamp.at(place));
    let light: Vec3 = light.map(|incident| incident.light).sum();
    light * (BRIGHT / std::f32::consts::PI) * medium::kept(seen.length())
}

/// A flake at one moment of the exposure.
struct Flake {
    /// In the camera's axes, metres.
    seen: Vec3,
    radius: f32,
    glow: Vec3,
}

impl Flake {
    /// Spreads its light over the disc that the lens makes of it.
    fn add(&self, drawn: &mut Drawn, camera: &Camera) {
        let Flake { seen, radius, glow } = self;
        let at = seen.truncate() / seen.z * camera.fx + Vec2::new(camera.cx, camera.cy);
        let own = radius * camera.fx / seen.z;
        let blur = camera.fx * OPENING / 2.0 * (1.0 / seen.z - 1.0 / FOCUS).abs();
        let sharpest = SHARPEST * camera.width as f32 / 320.0;
        let disc = (own * own + blur * blur + sharpest * sharpest).sqrt();
        // Its light stays what it is, however wide the disc.
        let spread = *glow * (own / disc).powi(2);
        let range = seen.length();
        let columns = pixels_about(at.x, disc + 1.0, camera.width);
        for y in pixels_about(at.y, disc + 1.0, camera.height) {
            for x in columns.clone() {
                let away = (Vec2::new(x as f32, y as f32) + 0.5 - at).length();
                let index = (y * camera.width + x) as usize;
                if range < drawn.range[index] {
                    drawn.radiance[index] += spread * (disc + 0.5 - away).clamp(0.0, 1.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Course, Lamps, tower};
    use super::*;

    const CAMERA: Camera = super::super::CAMERA;

    #[test]
    fn flakes_are_brighter_near_the_lamps() {
        let (scene, vehicle) = (tower::mapped(), Course::Approach.pose(0.0));
        let rig = Rig { lamps: Lamps::Left, ..Rig::default() };
        let moment = Moment::new(&scene, &rig, &vehicle);
        let glow = |x: f32, z: f32| {
            let seen = Vec3::new(x, 0.0, z);
            let place = vehicle.rotation.inverse() * (seen.as_dvec3() - vehicle.translation);
            glow(&moment, place.as_vec3(), seen).y
        };
        assert!(glow(-0.3, 0.6) > 2.0 * glow(0.3, 0.6));
        assert!(glow(-0.3, 0.7) > 4.0 * glow(-0.2, 2.0));
    }

    #[test]
    fn flakes_out_of_focus_are_wide_discs_of_as_much_light() {
        let spread = |z: f32| {
            let count = CAMERA.pixels();
            let mut drawn = Drawn { radiance: vec![Vec3::ZERO; count], range: vec![9.0; count] };
            Flake { seen: Vec3::new(0.0, 0.0, z), radius: 1e-3 * z, glow: Vec3::ONE }
                .add(&mut drawn, &CAMERA);
            let lit = drawn.radiance.iter().filter(|v| v.y > 0.0).count();
            (lit, drawn.radiance.iter().map(|v| v.y).sum::<f32>())
        };
        let ((near, of_near), (far, of_far)) = (spread(0.15), spread(FOCUS));
        assert!(near > 3 * far, "{near} and {far} pixels");
        assert!((0.5..2.0).contains(&(of_near / of_far)), "{of_near} and {of_far}");
    }

    #[test]
    fn flakes_behind_a_surface_do_not_show() {
        let count = CAMERA.pixels();
        let mut drawn = Drawn { radiance: vec![Vec3::ZERO; count], range: vec![1.0; count] };
        let seen = Vec3::new(0.0, 0.0, 1.2);
        Flake { seen, radius: 1e-3, glow: Vec3::ONE }.add(&mut drawn, &CAMERA);
        assert!(drawn.radiance.iter().all(|v| *v == Vec3::ZERO));
    }
}
