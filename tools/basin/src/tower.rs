//! The tower: the foot of a steel lattice tower on the floor of a fjord, in black water.
//!
//! World axes: x and y level, z up, metres; the tower stands about the origin on the sea floor z = 0. The vehicle
//! works at its face on the side x > 0.

use glam::{Mat3, Vec3};

use super::noise::Stream;
use super::scene::Scene;
use super::solid::{Group, Material, Shape, Solid};
use super::water::Water;

/// Heights at which the legs are joined.
const LEVELS: [f32; 4] = [0.7, 3.4, 6.1, 8.8];
/// Where the drawn part of the legs ends. No lamp shines as far.
const TOP: f32 = 11.0;
/// Half the distance between neighbouring legs: on the floor, and by how much less a metre higher.
const HALF_BASE: f32 = 1.5;
const BATTER: f32 = 0.036;
const LEG_RADIUS: f32 = 0.23;
const BEAM_RADIUS: f32 = 0.11;
const BRACE_RADIUS: f32 = 0.085;

/// Where the braces of the lowest bay cross, on the side x > 0.
pub const CROSSING: Vec3 = Vec3::new(HALF_BASE - BATTER * 2.05, 0.0, 2.05);

pub fn mapped() -> Scene {
    let members: Vec<Solid> = legs().chain(beams()).chain(braces()).collect();
    let mut groups: Vec<Group> = members.iter().flat_map(overgrown).collect();
    groups.extend(members.into_iter().map(|member| Group::new(vec![member])));
    groups.extend(LEVELS.into_iter().flat_map(nodes));
    groups.extend((0..3).flat_map(crossings));
    groups.extend(anodes());
    groups.push(riser());
    groups.extend(feet());
    Scene { groups, enclosure: sea_floor(), water: Water::BLACK, weeks: 0.0 }
}

fn sea_floor() -> Group {
    let half = Vec3::new(40.0, 40.0, 0.5);
    Group::new(vec![Solid::block(-half.z * Vec3::Z, half, 0.0, Material::Seabed, 3)])
}

/// The middle of a leg at a height. `leg`: 0 to 3, counterclockwise from x, y > 0.
fn on_leg(leg: usize, z: f32) -> Vec3 {
    let half = HALF_BASE - BATTER * z;
    let [x, y] = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]][leg % 4];
    Vec3::new(x * half, y * half, z)
}

fn legs() -> impl Iterator<Item = Solid> {
    (0..4).map(|leg| {
        let (foot, head) = (on_leg(leg, 0.0), on_leg(leg, TOP));
        Solid::cylinder(foot, head, LEG_RADIUS, Material::Coated, leg as u32)
    })
}

/// Level members between neighbouring legs.
fn beams() -> impl Iterator<Item = Solid> {
    LEVELS.into_iter().enumerate().flat_map(|(level, z)| {
        (0..4).map(move |leg| {
            let (from, to) = (on_leg(leg, z), on_leg(leg + 1, z));
            let seed = 16 + 4 * level as u32 + leg as u32;
            Solid::cylinder(from, to, BEAM_RADIUS, Material::Coated, seed)
        })
    })
}

/// The two ends of each brace: two cross in each face of a bay.
fn brace_ends() -> impl Iterator<Item = (Vec3, Vec3)> {
    LEVELS.windows(2).flat_map(|bay| {
        let (low, high) = (bay[0], bay[1]);
        (0..4).flat_map(move |leg| {
            let (a, b) = (leg, leg + 1);
            [(on_leg(a, low), on_leg(b, high)), (on_leg(b, low), on_leg(a, high))]
        })
    })
}

fn braces() -> impl Iterator<Item = Solid> {
    brace_ends().enumerate().map(|(i, (from, to))| {
        Solid::cylinder(from, to, BRACE_RADIUS, Material::Coated, 40 + i as u32)
    })
}

/// A part of a member, between two distances from its beginning, a little thicker than it.
fn sleeve((from, to): (Vec3, Vec3), [begin, end]: [f32; 2], radius: f32, metal: Material) -> Solid {
    let along = (to - from).normalize();
    let seed = (from.x * 31.0 + from.y * 17.0 + to.z * 7.0 + begin * 13.0) as i32 as u32;
    Solid::cylinder(from + along * begin, from + along * end, radius, metal, seed)
}

/// The four joints of a level: a thicker part of the leg, and welds that divers have cleaned to the metal.
fn nodes(z: f32) -> Vec<Group> {
    let joint = |leg: usize| {
        let at = on_leg(leg, z);
        let up = (at, on_leg(leg, z + 1.0));
        let can = sleeve(up, [-0.3, 0.3], LEG_RADIUS + 0.03, Material::Coated);
        let weld = |to: Vec3, radius: f32| {
            sleeve((at, to), [0.27, 0.36], radius + 0.005, Material::BareSteel)
        };
        let beams = [1, 3].map(|other| weld(on_leg(leg + other, z), BEAM_RADIUS));
        let of_joint = brace_ends().flat_map(|(a, b)| [(a, b), (b, a)]);
        let braces = of_joint.filter(|(a, _)| (*a - at).length() < 1e-3);
        let braces = braces.map(|(_, far)| weld(far, BRACE_RADIUS));
        Group::new([can].into_iter().chain(beams).chain(braces).collect())
    };
    (0..4).map(joint).collect()
}

/// Where the braces of a bay cross: bare metal along one of them, with a painted number plate beside it.
fn crossings(bay: usize) -> Vec<Group> {
    let of_bay = brace_ends().skip(8 * bay).take(8).step_by(2);
    let cleaned = |(from, to): (Vec3, Vec3)| {
        let half = (to - from).length() / 2.0;
        let part = |ends: [f32; 2], metal| {
            sleeve((from, to), ends.map(|end| half + end), BRACE_RADIUS + 0.006, metal)
        };
        let bare = part([-0.16, 0.2], Material::BareSteel);
        Group::new(vec![bare, part([0.42, 0.54], Material::Pipe)])
    };
    of_bay.map(cleaned).collect()
}

/// Anodes that stand off from the beams and from some braces.
fn anodes() -> Vec<Group> {
    let on_beams = (0..4).map(|leg| (on_leg(leg, LEVELS[1]), on_leg(leg + 1, LEVELS[1])));
    let on_braces = brace_ends().step_by(3);
    let anode = |(from, to): (Vec3, Vec3)| {
        let along = (to - from).normalize();
        let level = ((from + to) / 2.0 * Vec3::new(1.0, 1.0, 0.0)).normalize();
        let middle = from + along * (0.32 * (to - from).length());
        let at = |shift: f32, off: f32| middle + along * shift + level * off;
        let pin = |shift| Solid::cylinder(at(shift, 0.0), at(shift, 0.2), 0.02, Material::Chain, 5);
        let bar = Solid::cylinder(at(-0.3, 0.2), at(0.3, 0.2), 0.055, Material::Zinc, 6);
        Group::new(vec![bar, pin(-0.22), pin(0.22)])
    };
    on_beams.chain(on_braces).map(anode).collect()
}

/// A pipe that goes up before the face x > 0, in clamps.
fn riser() -> Group {
    let at = |z: f32| Vec3::new(HALF_BASE + 0.24 - BATTER * z, -0.82, z);
    let mut solids = vec![Solid::cylinder(at(0.0), at(TOP), 0.1, Material::Coated, 91)];
    for (i, z) in LEVELS.into_iter().enumerate() {
        let seed = 92 + i as u32;
        let held = at(z) - Vec3::X * 0.24;
        solids.push(Solid::cylinder(held, at(z), 0.05, Material::Chain, seed));
        let clamp = [at(z - 0.09), at(z + 0.09)];
        solids.push(Solid::cylinder(clamp[0], clamp[1], 0.125, Material::Chain, seed));
    }
    Group::new(solids)
}

/// Plates under the legs, and stones about them.
fn feet() -> Vec<Group> {
    let mut draws = Stream::new(77);
    let mut stone = |around: Vec3| {
        let half = Vec3::new(draws.within(0.1, 0.3), draws.within(0.1, 0.25), 0.09);
        let away = Vec3::new(draws.within(-0.9, 0.9), draws.within(-0.9, 0.9), 0.02);
        let axes = Mat3::from_rotation_z(draws.within(0.0, 3.0));
        let seed = (draws.unit() * 1e6) as u32;
        let shape = Shape::Ellipsoid { half };
        Solid { shape, material: Material::Stone, centre: around + away, axes, seed }
    };
    let foot = |leg| {
        let at = on_leg(leg, 0.0);
        let plate = Solid::cylinder(at, at + Vec3::Z * 0.06, 0.6, Material::Coated, 96);
        Group::new([plate].into_iter().chain((0..7).map(|_| stone(at))).collect())
    };
    (0..4).map(foot).collect()
}

/// Length of a member's part whose growth is one group, metres.
const PART: f32 = 0.9;

/// What lives on a member, in groups along it: anemones, sponges, shells.
fn overgrown(member: &Solid) -> Vec<Group> {
    let Shape::Cylinder { radius, half_length } = member.shape else { return Vec::new() };
    let mut draws = Stream::new(member.seed ^ 0x70e5);
    let parts = (2.0 * half_length / PART) as u32;
    let mut part = |index: u32| {
        let begin = index as f32 * PART - half_length;
        let count = (PART * radius * 55.0 * draws.within(0.3, 1.4)) as u32;
        let bumps = (0..count).map(|i| {
            let (sin, cos) = draws.within(0.0, std::f32::consts::TAU).sin_cos();
            let outward = member.axes * Vec3::new(cos, sin, 0.0);
            let along = member.axes.z_axis * draws.within(begin, begin + PART);
            let size = draws.within(0.12, 0.21).powi(2);
            let x = member.axes.z_axis;
            Solid {
                shape: Shape::Ellipsoid { half: size * Vec3::new(1.0, 0.8, 0.7) },
                material: Material::Fouling,
                centre: member.centre + along + outward * radius,
                axes: Mat3::from_cols(x, outward.cross(x), outward),
                seed: member.seed.wrapping_mul(4096).wrapping_add(64 * index + i),
            }
        });
        Group::new(bumps.collect())
    };
    let all = (0..parts).map(&mut part);
    all.filter(|group| !group.solids.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::solid::Ray;
    use super::*;

    #[test]
    fn braces_cross_where_they_are_said_to() {
        let scene = mapped();
        let ray = Ray { origin: CROSSING + Vec3::X * 4.0, direction: -Vec3::X };
        let hit = scene.hit(&ray).unwrap();
        assert!((hit.t - 4.0 + BRACE_RADIUS).abs() < 0.02, "{}", hit.t);
        assert_eq!(hit.solid.material, Material::BareSteel);
    }

    #[test]
    fn joints_have_their_welds_and_the_water_about_the_tower_is_free() {
        let scene = mapped();
        let bare = scene.solids().filter(|solid| solid.material == Material::BareSteel);
        // Two beams at each of 16 joints, both ends of 24 braces, and a crossing in each of 12 faces.
        assert_eq!(bare.count(), 2 * 16 + 2 * 24 + 12);
        assert_eq!(scene.distance(CROSSING + Vec3::X * 2.0, 1.5), 1.5);
        assert!(scene.hit(&Ray { origin: CROSSING + Vec3::X * 4.0, direction: Vec3::Z }).is_none());
    }
}
