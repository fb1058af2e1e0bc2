//! The basin some weeks after the mapping run: what has grown, what is gone, what has come, and the light of that day.

use glam::Vec3;

use super::basin::{self, BRACE, BRACED_PILES, LEVEL_PIPE};
use super::chain::links;
use super::growth;
use super::scene::Scene;
use super::solid::{Group, Material, Solid};
use super::water::Water;

/// From which week on a brace is gone, and a chain hangs between the piles that it held.
pub const BRACE_GONE: f32 = 2.0;
/// From which week on a level pipe has come off at one end, and leans on the floor.
pub const PIPE_FALLEN: f32 = 13.0;

/// The scene of T4 and T5. After no weeks, the scene as mapped.
pub fn basin_after(weeks: f32) -> Scene {
    let mut pipes: Vec<Solid> = basin::pipes().collect();
    if weeks >= PIPE_FALLEN {
        pipes[LEVEL_PIPE] = fallen(&pipes[LEVEL_PIPE]);
    }
    if weeks >= BRACE_GONE {
        pipes.remove(BRACE);
    }
    let mut scene = basin::of_pipes(pipes);
    let grown = scene.groups.iter().flat_map(|group| &group.solids);
    let bumps: Vec<_> = grown.map(|solid| growth::bumps(solid, weeks)).collect();
    scene.groups.extend(bumps.into_iter().filter(|bumps| !bumps.is_empty()).map(Group::new));
    if weeks >= BRACE_GONE {
        scene.groups.extend(chain().map(Group::new));
    }
    scene.water = Water::basin_after(weeks);
    scene.weeks = weeks;
    scene
}

/// The same pipe, its end at the middle pile still in place.
fn fallen(pipe: &Solid) -> Solid {
    let [middle, _] = BRACED_PILES;
    let held = middle + Vec3::Z * pipe.centre.z;
    let on_floor = Vec3::new(middle.x + 0.35, middle.y + 1.36, 0.06);
    Solid::cylinder(held, on_floor, basin::PIPE_RADIUS, pipe.material, pipe.seed)
}

/// Straps about two piles, a chain that sags between them, and its free end.
fn chain() -> [Vec<Solid>; 4] {
    let radius = basin::BARREL_RADIUS;
    let top = 2.8;
    let strap = |pile: Vec3| {
        let at = |z: f32| pile + Vec3::Z * z;
        vec![Solid::cylinder(at(top), at(top + 0.06), radius + 0.01, Material::Chain, 99)]
    };
    let [from, to] = BRACED_PILES;
    let before = Vec3::new(radius + 0.05, 0.0, top);
    let sag = |s: f32| Vec3::new(0.12, 0.0, -1.35) * (4.0 * s * (1.0 - s));
    let sagging = links(|s| (from + before).lerp(to + before, s) + sag(s), 40);
    let corner = to + Vec3::new(0.71, 0.71, 0.0) * (radius + 0.07) + Vec3::Z * top;
    let swing = |s: f32| Vec3::new(0.05, 0.03, 0.0) * (9.0 * s).sin() * s;
    let free = links(|s| corner - Vec3::Z * (2.3 * s) + swing(s), 28);
    [strap(from), strap(to), sagging, free]
}

#[cfg(test)]
mod tests {
    use super::super::solid::Shape;
    use super::*;

    /// Half axes of a solid that is a bump.
    fn half(solid: &Solid) -> Option<Vec3> {
        match solid.shape {
            Shape::Ellipsoid { half } => Some(half),
            _ => None,
        }
    }

    #[test]
    fn what_grew_by_week_4_is_inside_what_grew_by_week_26() {
        let [young, old] = [4.0, 26.0].map(basin_after);
        let bumps = |scene: &Scene| {
            let bumps = scene.solids().filter_map(|s| Some((s.seed, s.centre, half(s)?)));
            bumps.collect::<Vec<_>>()
        };
        let (young, old) = (bumps(&young), bumps(&old));
        // The pipe that fell has moved with what grew on it.
        let fallen = (256 + LEVEL_PIPE as u32) * 1024..(257 + LEVEL_PIPE as u32) * 1024;
        for (seed, centre, half) in young.iter().filter(|(seed, ..)| !fallen.contains(seed)) {
            let later = old.iter().find(|later| later.0 == *seed && later.1 == *centre).unwrap();
            assert!(later.2.cmpge(*half).all(), "a bump of {half} shrank to {}", later.2);
        }
        assert!(young.len() > 100 && old.len() > 2 * young.len(), "{} {}", young.len(), old.len());
    }

    #[test]
    fn without_a_week_gone_by_nothing_has_changed() {
        let (mapped, aged) = (basin::mapped(), basin_after(0.0));
        let solids = |scene: &Scene| {
            scene.solids().map(|s| (s.seed, s.centre, s.material)).collect::<Vec<_>>()
        };
        assert_eq!(solids(&aged), solids(&mapped));
    }

    #[test]
    fn the_brace_goes_and_the_chain_comes_clear_of_the_structure() {
        let mapped = basin::mapped();
        let brace = basin::pipes().nth(BRACE).unwrap();
        assert!(mapped.distance(brace.centre, 1.0) < 0.0);
        for weeks in [4.0, 26.0] {
            let scene = basin_after(weeks);
            assert!(scene.solids().all(|solid| solid.seed != brace.seed), "{weeks}");
            assert!(scene.solids().filter(|s| s.material == Material::Chain).count() > 60);
        }
        let [_, _, sagging, free] = chain();
        for link in sagging.iter().chain(&free) {
            assert!(mapped.distance(link.centre, 1.0) > 0.03, "{}", link.centre);
        }
    }

    #[test]
    fn the_fallen_pipe_is_as_long_as_it_was_and_rests_on_the_floor() {
        let pipe = basin::pipes().nth(LEVEL_PIPE).unwrap();
        let fallen = fallen(&pipe);
        let half = |solid: &Solid| match solid.shape {
            Shape::Cylinder { half_length, .. } => half_length,
            _ => 0.0,
        };
        let (before, after) = (half(&pipe), half(&fallen));
        assert!((before - after).abs() < 0.01, "{before} and {after}");
        assert!(fallen.bounds().0.z < 0.03 && fallen.bounds().0.z > -0.03);
    }
}
