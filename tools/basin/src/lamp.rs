//! A lamp that the vehicle carries: where it sits, how unevenly it shines, and what stands in its light.

use glam::{Mat3, Vec2, Vec3};
use nvsprior::Pose;
use rayon::prelude::*;

use super::medium;
use super::scene::Scene;
use super::solid::Ray;

/// A lamp in the axes of the rig's first camera (x right, y down, z forward), metres.
pub struct Lamp {
    place: Vec3,
    /// A point that its beam goes through.
    aim: Vec3,
    /// Radiant intensity in the middle of the beam, by channel.
    colour: Vec3,
    beam: Beam,
}

/// How a lamp's light spreads. Places in the beam are tangents: offset across it by distance along it.
struct Beam {
    width: f32,
    /// A spot beside the middle that is brighter, its width, and by how much.
    hot_spot: Vec2,
    hot_width: f32,
    hot_height: f32,
    /// Rings that the reflector throws: how many in a tangent of 1, and how high.
    rings: f32,
    ring_height: f32,
    /// The side that gets more light.
    lean: Vec2,
    /// Three chips shine as three lobes.
    lobes: f32,
}

/// Above the camera, to the left; it points a little to the right, and downwards.
pub const LEFT: Lamp = Lamp {
    place: Vec3::new(-0.46, -0.24, -0.06),
    aim: Vec3::new(-0.20, 0.14, 2.4),
    colour: Vec3::new(1.00, 0.97, 0.90),
    beam: Beam {
        width: 0.46,
        hot_spot: Vec2::new(0.10, -0.06),
        hot_width: 0.13,
        hot_height: 0.45,
        rings: 3.1,
        ring_height: 0.14,
        lean: Vec2::new(0.35, 0.35),
        lobes: 0.08,
    },
};

/// Below the camera, further to the right: another make, narrower and bluer.
pub const RIGHT: Lamp = Lamp {
    place: Vec3::new(0.58, 0.12, 0.04),
    aim: Vec3::new(0.42, -0.06, 2.4),
    colour: Vec3::new(0.74, 0.82, 0.88),
    beam: Beam {
        width: 0.38,
        hot_spot: Vec2::new(-0.05, 0.09),
        hot_width: 0.10,
        hot_height: 0.70,
        rings: 4.3,
        ring_height: 0.18,
        lean: Vec2::new(-0.40, 0.10),
        lobes: -0.12,
    },
};

impl Beam {
    /// Radiant intensity at a place, relative to that of an even beam's middle.
    fn share(&self, at: Vec2) -> f32 {
        let (square, r) = (at.length_squared(), at.length());
        let within = square / (self.width * self.width);
        let body = 0.85 * (-within).exp() + 0.15 / (1.0 + within).powi(2);
        let ring = 1.0 + self.ring_height * (std::f32::consts::TAU * self.rings * r).cos();
        let cos = at.x / r.max(1e-6);
        let lobes = 1.0 + self.lobes * (4.0 * cos.powi(3) - 3.0 * cos) * square / (square + 0.05);
        let hot = (at - self.hot_spot).length_squared() / (self.hot_width * self.hot_width);
        let lean = (1.0 + self.lean.dot(at) / (1.0 + r)).max(0.0);
        // The housing's rim.
        let rim = ((RIM - r) / 0.4).clamp(0.0, 1.0);
        (body * ring * lobes + self.hot_height * (-hot).exp()) * lean * rim
    }
}

/// Tangent beyond which a lamp's housing lets no light out: 62°.
const RIM: f32 = 1.9;

/// A lamp in the world.
pub struct PlacedLamp {
    lamp: &'static Lamp,
    origin: Vec3,
    /// From the world's axes to the beam's.
    to_beam: Mat3,
}

/// Light that comes to a point.
pub struct Incident {
    /// Irradiance of a surface that faces the lamp, by channel.
    pub light: Vec3,
    /// Unit, towards the lamp.
    pub direction: Vec3,
    pub distance: f32,
}

impl PlacedLamp {
    /// `vehicle`: the pose of the rig's first camera.
    pub fn new(lamp: &'static Lamp, vehicle: &Pose) -> PlacedLamp {
        let to_camera = vehicle.matrix().as_mat3();
        let z = (lamp.aim - lamp.place).normalize();
        let x = Vec3::Y.cross(z).normalize();
        let to_beam = Mat3::from_cols(x, z.cross(x), z).transpose() * to_camera;
        let origin = vehicle.centre().as_vec3() + to_camera.transpose() * lamp.place;
        PlacedLamp { lamp, origin, to_beam }
    }

    /// The light at a point that nothing hides: less by the square of the distance, and by what the water takes.
    pub fn at(&self, point: Vec3) -> Option<Incident> {
        let offset = point - self.origin;
        let distance = offset.length().max(NEAREST);
        let share = self.lamp.beam.share(self.place_in_beam(offset)?);
        let light = self.lamp.colour * (share / (distance * distance)) * medium::kept(distance);
        (share > 0.0).then(|| Incident { light, direction: -offset / distance, distance })
    }

    /// Tangents of a direction from the lamp.
    fn place_in_beam(&self, offset: Vec3) -> Option<Vec2> {
        let local = self.to_beam * offset;
        (local.z > 0.0).then(|| local.truncate() / local.z)
    }

    /// Whether the light reaches a surface's point, which lies at `distance` metres.
    pub fn reaches(&self, scene: &Scene, point: Vec3, incident: &Incident) -> bool {
        let ray = Ray { origin: point, direction: incident.direction };
        !scene.shadowed_within(&ray, incident.distance)
    }
}

/// No point is nearer to a lamp than its glass, metres.
const NEAREST: f32 = 0.06;

/// How far a lamp's light goes in each direction before it meets a surface, for its shadows in the water.
pub struct ShadowMap {
    side: usize,
    /// Metres, in a square of tangents from −[`RIM`] to [`RIM`].
    reach: Vec<f32>,
}

impl ShadowMap {
    pub fn new(scene: &Scene, lamp: &PlacedLamp, side: usize) -> ShadowMap {
        let to_world = lamp.to_beam.transpose();
        let reach = (0..side * side).into_par_iter().map(|i| {
            let cell = Vec2::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5);
            let tangents = (cell * 2.0 / side as f32 - 1.0) * RIM;
            let direction = (to_world * tangents.extend(1.0)).normalize();
            let ray = Ray { origin: lamp.origin, direction };
            scene.hit(&ray).map_or(f32::INFINITY, |hit| hit.t)
        });
        ShadowMap { side, reach: reach.collect() }
    }

    /// The share of a lamp's light that comes to a point of the water: the mean of four neighbouring directions.
    pub fn lit(&self, lamp: &PlacedLamp, point: Vec3) -> f32 {
        let offset = point - lamp.origin;
        let Some(tangents) = lamp.place_in_beam(offset) else { return 0.0 };
        let last = self.side as f32 - 2.0;
        let at = (tangents / RIM + 1.0) * (self.side as f32 / 2.0) - 0.5;
        let low = at.floor().clamp(Vec2::ZERO, Vec2::splat(last));
        let part = (at - low).clamp(Vec2::ZERO, Vec2::ONE);
        let first = low.y as usize * self.side + low.x as usize;
        let distance = offset.length();
        let free = |i: usize| f32::from(u8::from(self.reach[i] > distance));
        let row = |i: usize| free(i) + (free(i + 1) - free(i)) * part.x;
        let (above, below) = (row(first), row(first + self.side));
        above + (below - above) * part.y
    }
}

#[cfg(test)]
mod tests {
    use super::super::tower;
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn beams_are_uneven_and_end_at_the_rim() {
        for lamp in [LEFT, RIGHT] {
            let at = |x, y| lamp.beam.share(Vec2::new(x, y));
            let sides = at(0.3, 0.0) / at(-0.3, 0.0);
            assert!(!(0.87..1.15).contains(&sides), "{sides}");
            let hot = lamp.beam.hot_spot;
            assert!(at(hot.x, hot.y) > 1.2 * at(-hot.x, -hot.y));
            // Rings bend the fall of the light to and fro.
            let fall = (0..50).map(|i| at(0.0, 0.02 * i as f32).ln()).collect::<Vec<f32>>();
            let bends = fall.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect::<Vec<f32>>();
            let turns = bends.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
            assert!(turns >= 4, "no rings: {fall:?}");
            assert_eq!(at(RIM, 0.1), 0.0);
        }
    }

    #[test]
    fn light_falls_faster_than_by_the_square_of_the_distance() {
        let lamp = PlacedLamp::new(&LEFT, &Pose::from_centre(DQuat::IDENTITY, DVec3::ZERO));
        let along = (LEFT.aim - LEFT.place).normalize();
        let at = |metres: f32| lamp.at(LEFT.place + metres * along).unwrap().light;
        let ratio = at(4.0) / at(2.0);
        assert!(ratio.max_element() < 0.2 && ratio.x < 0.7 * ratio.y, "{ratio}");
        assert!(lamp.at(LEFT.place - along).is_none());
    }

    #[test]
    fn the_shadow_map_agrees_with_rays() {
        let scene = tower::mapped();
        let vehicle = super::super::Site::Tower.mapping_poses()[12];
        let lamp = PlacedLamp::new(&RIGHT, &vehicle);
        let map = ShadowMap::new(&scene, &lamp, 256);
        let to_world = vehicle.matrix().as_mat3().transpose();
        let (mut same, mut dark) = (0, 0);
        for i in 0..1000 {
            let (x, y, z) = ((i % 10) as f32 - 4.5, (i / 10 % 10) as f32 - 4.5, i / 100);
            let depth = 1.0 + 0.5 * z as f32;
            let in_camera = Vec3::new(0.06 * x * depth, 0.04 * y * depth, depth);
            let point = vehicle.centre().as_vec3() + to_world * in_camera;
            let Some(incident) = lamp.at(point) else { continue };
            let lit = lamp.reaches(&scene, point, &incident);
            same += usize::from((map.lit(&lamp, point) > 0.5) == lit);
            dark += usize::from(!lit);
        }
        assert!(same > 950 && dark > 50, "{same} alike, {dark} dark");
    }
}
