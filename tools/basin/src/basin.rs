//! The basin: a yellow structure of six piles of three oil barrels, joined by pipes, in an indoor pool.
//!
//! World axes: x and y level, z up, metres; the structure stands about the origin on the floor
//! z = 0 and fills 3.9 × 4.6 × 3.0 m.

use glam::{Mat3, Vec3};

use super::scene::Scene;
use super::solid::{Group, Material, Shape, Solid};
use super::water::Water;

/// Half sides of the structure's plan, metres.
pub const HALF_PLAN: [f32; 2] = [1.95, 2.3];
/// Height of the structure, metres.
pub const STRUCTURE_HEIGHT: f32 = 3.0;
/// Lower and upper corner of the water body.
pub const BASIN: (Vec3, Vec3) =
    (Vec3::new(-6.2, -6.6, 0.0), Vec3::new(6.2, 6.6, Water::BASIN.surface));

pub const BARREL_RADIUS: f32 = 0.29;
const BARREL_HEIGHT: f32 = 0.92;
const SLAB_HEIGHT: f32 = 0.12;
pub const PIPE_RADIUS: f32 = 0.055;
/// Of [`pipes`], the level one at half height and the brace between [`BRACED_PILES`].
pub const LEVEL_PIPE: usize = 13;
pub const BRACE: usize = 24;
/// Feet of the middle and the last pile of the side x > 0.
pub const BRACED_PILES: [Vec3; 2] = {
    let [x, y] = HALF_PLAN;
    [Vec3::new(x - BARREL_RADIUS, 0.0, 0.0), Vec3::new(x - BARREL_RADIUS, y - BARREL_RADIUS, 0.0)]
};

/// Structures of the row, and the distance from one to the next, along y.
pub const ROW: u8 = 3;
pub const ROW_STEP: f32 = 12.8;

/// The scene of the mapping run and of T1.
pub fn mapped() -> Scene {
    of_pipes(pipes())
}

/// The scene as mapped, without the pipes.
pub fn of_pipes(pipes: impl IntoIterator<Item = Solid>) -> Scene {
    let mut groups: Vec<Group> = pile_feet().enumerate().map(pile).collect();
    groups.extend(pipes.into_iter().map(|pipe| Group::new(vec![pipe])));
    Scene { groups, enclosure: pool(), water: Water::BASIN, weeks: 0.0 }
}

/// The scene of T2: a metallic object of 1.0 × 0.25 × 0.25 m stands beside the structure.
pub fn with_new_object() -> Scene {
    let half = Vec3::new(0.125, 0.125, 0.5);
    let centre = Vec3::new(HALF_PLAN[0] + 0.45, 0.35, half.z);
    mapped().with(vec![Solid::block(centre, half, 0.35, Material::Steel, 1)])
}

/// A row of such structures in one long pool. Each is painted in its own way.
pub fn row() -> Scene {
    let copy = |copy: u8| {
        let along = f32::from(copy) * ROW_STEP * Vec3::Y;
        let seed = 1024 * u32::from(copy);
        mapped().groups.into_iter().map(move |group| {
            let moved = |solid: Solid| Solid {
                centre: solid.centre + along,
                seed: solid.seed + seed,
                ..solid
            };
            Group::new(group.solids.into_iter().map(moved).collect())
        })
    };
    let (low, high) = BASIN;
    let end = high + f32::from(ROW - 1) * ROW_STEP * Vec3::Y;
    let groups = (0..ROW).flat_map(copy).collect();
    Scene { groups, enclosure: pool_within((low, end)), water: Water::BASIN, weeks: 0.0 }
}

fn pool() -> Group {
    pool_within(BASIN)
}

/// Floor, water surface and four walls, as blocks around the water body.
fn pool_within((low, high): (Vec3, Vec3)) -> Group {
    let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
    let slab = |axis: usize, side: f32, material, seed| {
        let mut c = centre;
        let mut h = half + 0.5;
        h[axis] = 0.5;
        c[axis] += side * (half[axis] + 0.5);
        Solid { shape: Shape::Block { half: h }, material, centre: c, axes: Mat3::IDENTITY, seed }
    };
    Group::new(vec![
        slab(2, -1.0, Material::Floor, 0),
        slab(2, 1.0, Material::WaterSurface, 0),
        slab(0, -1.0, Material::Wall, 1),
        slab(0, 1.0, Material::Wall, 2),
        slab(1, -1.0, Material::Wall, 3),
        slab(1, 1.0, Material::Wall, 4),
    ])
}

/// Centres of the six piles on the floor: two columns along x, three rows along y.
fn pile_feet() -> impl Iterator<Item = Vec3> {
    let half = HALF_PLAN.map(|h| h - BARREL_RADIUS);
    [-1.0, 0.0, 1.0]
        .into_iter()
        .flat_map(move |y| [-1.0, 1.0].map(|x| Vec3::new(x * half[0], y * half[1], 0.0)))
}

/// A foot, three barrels and a cap.
fn pile((index, foot): (usize, Vec3)) -> Group {
    let seed = 16 * index as u32;
    let part = |low: f32, high: f32, radius, material, part: u32| {
        Solid::cylinder(foot + Vec3::Z * low, foot + Vec3::Z * high, radius, material, seed + part)
    };
    let barrel = |i: u32| {
        let low = SLAB_HEIGHT + i as f32 * BARREL_HEIGHT;
        part(low, low + BARREL_HEIGHT, BARREL_RADIUS, Material::Barrel, i)
    };
    let cap = STRUCTURE_HEIGHT - SLAB_HEIGHT;
    Group::new(vec![
        part(0.0, SLAB_HEIGHT, BARREL_RADIUS * 0.98, Material::Concrete, 3),
        barrel(0),
        barrel(1),
        barrel(2),
        part(cap, STRUCTURE_HEIGHT, BARREL_RADIUS * 0.9, Material::Concrete, 4),
    ])
}

/// Level pipes between neighbouring piles at three heights, and braces across the long sides.
pub fn pipes() -> impl Iterator<Item = Solid> {
    let feet: Vec<Vec3> = pile_feet().collect();
    let across = [(0, 1), (2, 3), (4, 5)];
    let along = [(0, 2), (2, 4), (1, 3), (3, 5)];
    let level = [0.55, 1.5, 2.62]
        .into_iter()
        .flat_map(move |z| across.into_iter().chain(along).map(move |pair| (pair, z, z)));
    let braces = [((0, 2), 0.4, 2.4), ((2, 4), 2.4, 0.4), ((1, 3), 2.4, 0.4), ((3, 5), 0.4, 2.4)];
    level.chain(braces).enumerate().map(move |(i, ((a, b), z_a, z_b))| {
        let (from, to) = (feet[a] + Vec3::Z * z_a, feet[b] + Vec3::Z * z_b);
        Solid::cylinder(from, to, PIPE_RADIUS, Material::Pipe, 256 + i as u32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pipes_that_change_are_where_they_are_said_to_be() {
        let pipes: Vec<Solid> = pipes().collect();
        let [a, b] = BRACED_PILES;
        for (pipe, height) in [(LEVEL_PIPE, 1.5), (BRACE, 1.4)] {
            let middle = (a + b) / 2.0 + Vec3::Z * height;
            assert!((pipes[pipe].centre - middle).length() < 1e-5, "{}", pipes[pipe].centre);
        }
    }

    #[test]
    fn the_structure_has_the_size_it_claims() {
        let scene = mapped();
        let (low, high) = scene
            .groups
            .iter()
            .flat_map(|g| &g.solids)
            .map(Solid::bounds)
            .reduce(|(a, b), (low, high)| (a.min(low), b.max(high)))
            .unwrap();
        assert!((high - low - Vec3::new(3.9, 4.6, 3.0)).abs().max_element() < 1e-4);
    }
}
