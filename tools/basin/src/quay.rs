//! The quay: a corrugated wall of sheet piles with what hangs on it and stands before it, in a harbour.
//!
//! World axes: x away from the wall into the water, y along the wall, z up, metres; the wall's outermost face is at
//! x = 0, the seabed at z = 0.

use glam::{EulerRot, Mat3, Vec3};

use super::chain::links;
use super::noise::Stream;
use super::scene::Scene;
use super::solid::{Group, Material, Shape, Solid};
use super::water::Water;

/// Depth of the water, metres.
pub const DEPTH: f32 = Water::HARBOUR.surface;
/// Half the length of the wall. No camera sees its ends.
const HALF_LENGTH: f32 = 14.4;
/// Length of a corrugation of the wall, and its depth.
const PITCH: f32 = 1.2;
const CORRUGATION: f32 = 0.36;
/// How far the water reaches from the wall.
const REACH: f32 = 12.0;

pub fn mapped() -> Scene {
    let mut groups: Vec<Group> = corrugations().map(sheet_piles).collect();
    groups.push(waling());
    groups.extend([-3.9, 3.3].map(fender));
    groups.push(ladder(-1.35));
    groups.extend([(-2.55, 0), (2.05, 1)].map(|(y, i)| dolphin(y, i)));
    groups.push(chain(Vec3::new(0.02, -0.4, 4.3), Vec3::new(0.75, 1.55, 0.05)));
    groups.extend(stones());
    Scene { groups, enclosure: harbour(), water: Water::HARBOUR, weeks: 0.0 }
}

/// The scene of T3, another day: someone has lost a crab pot, whose buoy stands above it.
pub fn later() -> Scene {
    let mut scene = mapped().with(crab_pot(Vec3::new(1.0, 0.15, 0.0)));
    scene.water = Water::HARBOUR_LATER;
    scene
}

/// Seabed and water surface, and the ground behind the wall.
fn harbour() -> Group {
    let slab = |low: Vec3, high: Vec3, material| {
        Solid::block((low + high) / 2.0, (high - low) / 2.0, 0.0, material, 0)
    };
    let (near, far) = (-1.0, REACH);
    let (left, right) = (-HALF_LENGTH, HALF_LENGTH);
    Group::new(vec![
        slab(Vec3::new(near, left, -0.5), Vec3::new(far, right, 0.0), Material::Seabed),
        slab(
            Vec3::new(near, left, DEPTH),
            Vec3::new(far, right, DEPTH + 0.5),
            Material::WaterSurface,
        ),
    ])
}

/// Where the corrugations begin, along y.
fn corrugations() -> impl Iterator<Item = f32> {
    let count = (2.0 * HALF_LENGTH / PITCH).round() as usize;
    (0..count).map(|i| i as f32 * PITCH - HALF_LENGTH)
}

/// A pan that stands out, one that stands back, and the flanks between them.
fn sheet_piles(begin: f32) -> Group {
    const HALF_SHEET: f32 = 0.03;
    const PAN: f32 = 0.42;
    let flank_width = PITCH / 2.0 - PAN;
    let seed = (begin * 10.0).round() as i32 as u32;
    let sheet = |x: f32, y: f32, half_y: f32, yaw: f32, part: u32| {
        let half = Vec3::new(HALF_SHEET, half_y, DEPTH / 2.0);
        let centre = Vec3::new(x - HALF_SHEET, y, DEPTH / 2.0);
        Solid::block(centre, half, yaw, Material::SheetPile, seed.wrapping_add(part))
    };
    let slope = (CORRUGATION / flank_width).atan();
    let half_flank = CORRUGATION.hypot(flank_width) / 2.0 + 0.02;
    let (out, back) = (begin + PAN / 2.0, begin + PITCH / 2.0 + PAN / 2.0);
    let flank = |y: f32, yaw, part| sheet(-CORRUGATION / 2.0, y, half_flank, yaw, part);
    // Neighbouring piles lock into each other at the middle of the pans.
    let lock = |x: f32, y: f32, part| {
        let (foot, head) = (Vec3::new(x, y, 0.0), Vec3::new(x, y, DEPTH));
        Solid::cylinder(foot, head, 0.028, Material::SheetPile, seed.wrapping_add(part))
    };
    let mut solids = vec![
        sheet(0.0, out, PAN / 2.0, 0.0, 0),
        flank(begin + PAN + flank_width / 2.0, slope, 1),
        sheet(-CORRUGATION, back, PAN / 2.0, 0.0, 2),
        flank(begin + PITCH - flank_width / 2.0, -slope, 3),
        lock(0.0, out, 4),
        lock(-CORRUGATION, back, 5),
    ];
    // An anode on every third pan that stands back.
    if seed.is_multiple_of(36) {
        let centre = Vec3::new(0.08 - CORRUGATION, back + 0.12, 2.0);
        solids.push(Solid::block(centre, Vec3::new(0.05, 0.06, 0.4), 0.0, Material::Zinc, seed));
    }
    Group::new(solids)
}

/// The beam along the wall's head, and its bolts.
fn waling() -> Group {
    let centre = Vec3::new(0.07, 0.0, 4.55);
    let half = Vec3::new(0.07, HALF_LENGTH, 0.14);
    let mut solids = vec![Solid::block(centre, half, 0.0, Material::SheetPile, 7)];
    solids.extend(corrugations().filter(|y| y.abs() < 8.0).map(|begin| {
        let head = centre + Vec3::new(half.x, begin + 0.21, 0.0);
        Solid::cylinder(head, head + Vec3::X * 0.05, 0.06, Material::SheetPile, 8)
    }));
    Group::new(solids)
}

/// A drum of rubber that hangs before the wall on two chains.
fn fender(y: f32) -> Group {
    let (low, high) = (Vec3::new(0.42, y, 3.0), Vec3::new(0.42, y, 4.25));
    let mut solids = vec![
        Solid::cylinder(low, high, 0.34, Material::Rubber, 1),
        Solid::cylinder(low - Vec3::Z * 0.06, high + Vec3::Z * 0.06, 0.2, Material::Chain, 2),
    ];
    for side in [-0.12, 0.12] {
        let eye = high + Vec3::new(0.0, side, 0.05);
        solids.extend(links(|s| eye.lerp(Vec3::new(0.14, y + 3.0 * side, 4.6), s), 6));
    }
    Group::new(solids)
}

fn ladder(y: f32) -> Group {
    const HALF_WIDTH: f32 = 0.22;
    let at = |side: f32, z: f32| Vec3::new(0.2, y + side * HALF_WIDTH, z);
    let bar = |from, to, radius, seed| Solid::cylinder(from, to, radius, Material::Ladder, seed);
    let mut solids: Vec<Solid> =
        [-1.0, 1.0].map(|side| bar(at(side, 1.3), at(side, DEPTH), 0.03, 1)).into();
    solids.extend((0..14).map(|i| {
        let z = 1.45 + 0.29 * i as f32;
        bar(at(-1.0, z), at(1.0, z), 0.018, 2 + i)
    }));
    solids.extend([1.6, 3.4].map(|z| {
        let wall = Vec3::new(0.0, y - HALF_WIDTH, z);
        bar(wall, at(-1.0, z), 0.02, 20)
    }));
    Group::new(solids)
}

/// A timber pile before the wall, with a band of iron.
fn dolphin(y: f32, index: u32) -> Group {
    let foot = Vec3::new(0.62, y, 0.0);
    let head = Vec3::new(0.5, y + 0.1, DEPTH);
    let at = |share: f32| foot.lerp(head, share);
    Group::new(vec![
        Solid::cylinder(foot, head, 0.17, Material::Timber, 3 + index),
        Solid::cylinder(at(0.6), at(0.62), 0.178, Material::Chain, 5),
    ])
}

/// A chain that hangs from one point to another.
fn chain(from: Vec3, to: Vec3) -> Group {
    let sag = |s: f32| Vec3::new(0.3, 0.0, -1.1) * (4.0 * s * (1.0 - s));
    Group::new(links(|s| (from.lerp(to, s) + sag(s)).max(Vec3::new(0.04, f32::MIN, 0.04)), 44))
}

/// Stones that protect the wall's foot, and some that lie further out.
fn stones() -> Vec<Group> {
    let mut draws = Stream::new(41);
    let mut stone = |near: f32, far: f32, y: f32, size: f32| {
        let half = Vec3::new(
            size * draws.within(0.8, 1.2),
            size * draws.within(0.8, 1.3),
            size * draws.within(0.5, 0.8),
        );
        let centre = Vec3::new(draws.within(near, far), y, half.z * draws.within(0.1, 0.6));
        let turn = Mat3::from_euler(
            EulerRot::ZYX,
            draws.within(0.0, 3.0),
            draws.within(-0.4, 0.4),
            draws.within(-0.4, 0.4),
        );
        let seed = (draws.unit() * 1e6) as u32;
        Solid {
            shape: Shape::Ellipsoid { half },
            material: Material::Stone,
            centre,
            axes: turn,
            seed,
        }
    };
    let mut groups = Vec::new();
    for i in 0..24 {
        let y = -7.2 + 0.6 * i as f32;
        groups.push(Group::new(vec![
            stone(0.0, 0.25, y, 0.30),
            stone(0.25, 0.7, y + 0.25, 0.22),
            stone(0.7, 1.5, y + 0.1, 0.13),
            stone(1.4, 4.5, y, 0.10),
        ]));
    }
    groups
}

/// A pot of bars and netting with its line and a buoy.
fn crab_pot(foot: Vec3) -> Vec<Solid> {
    let half = Vec3::new(0.24, 0.32, 0.17);
    let middle = foot + Vec3::Z * (half.z + 0.28);
    let turn = Mat3::from_rotation_z(0.5);
    let corner = |x: f32, y: f32, z: f32| middle + turn * (half * Vec3::new(x, y, z));
    let bar = |from, to| Solid::cylinder(from, to, 0.016, Material::Pot, 1);
    let signs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
    let mut solids = Vec::new();
    for (a, b) in signs {
        solids.push(bar(corner(-1.0, a, b), corner(1.0, a, b)));
        solids.push(bar(corner(a, -1.0, b), corner(a, 1.0, b)));
        solids.push(bar(corner(a, b, -1.0), corner(a, b, 1.0)));
    }
    for i in 1..5 {
        let along = 0.4 * i as f32 - 1.0;
        solids.extend([-1.0, 1.0].map(|x| bar(corner(x, along, -1.0), corner(x, along, 1.0))));
        solids.push(bar(corner(-1.0, along, 1.0), corner(1.0, along, 1.0)));
    }
    let head = middle + Vec3::Z * half.z;
    let buoy = head + Vec3::new(0.1, 0.2, 1.15);
    solids.push(Solid::cylinder(head, buoy, 0.008, Material::Pot, 2));
    solids.push(Solid {
        shape: Shape::Ellipsoid { half: Vec3::new(0.13, 0.13, 0.19) },
        material: Material::Buoy,
        centre: buoy,
        axes: Mat3::IDENTITY,
        seed: 0,
    });
    solids
}

#[cfg(test)]
mod tests {
    use super::super::solid::Ray;
    use super::*;

    #[test]
    fn the_wall_is_closed_and_as_deep_as_it_claims() {
        let scene = mapped();
        let mut depths: Vec<f32> = (0..240)
            .map(|i| {
                let origin = Vec3::new(3.0, -6.0 + 0.05 * i as f32, 0.9);
                let hit = scene.hit(&Ray { origin, direction: -Vec3::X }).unwrap();
                assert!(hit.t < 3.0 + CORRUGATION + 1e-4, "a gap at y = {}", origin.y);
                hit.t
            })
            .collect();
        depths.sort_by(f32::total_cmp);
        assert!((depths[239] - 3.0 - CORRUGATION).abs() < 1e-4, "{}", depths[239]);
    }

    #[test]
    fn what_is_new_stands_clear_of_what_was_there() {
        let scene = mapped();
        for solid in crab_pot(Vec3::new(1.0, 0.15, 0.0)) {
            assert!(scene.distance(solid.centre, 1.0) > 0.03, "{}", solid.centre);
        }
    }
}
