//! The paint of what has grown on the basin's structure.

use glam::Vec3;

use super::super::growth::{progress, thickness};
use super::super::noise::{fractal, hash, unit};
use super::super::solid::Material;
use super::texture::{Spot, ramp, specks};

/// A surface with what has grown on it. Without a week gone by, the surface itself.
pub fn grown(spot: &Spot, bare: Vec3) -> Vec3 {
    if spot.weeks <= 0.0 {
        return bare;
    }
    match spot.solid.material {
        Material::Barrel | Material::Pipe | Material::Concrete | Material::Chain => {
            overgrown(spot, bare)
        }
        Material::Floor | Material::Wall => filmed(spot, bare),
        _ => bare,
    }
}

/// All of it has a film of algae. Patches have weed, and thick weed has young barnacles.
fn overgrown(spot: &Spot, bare: Vec3) -> Vec3 {
    let thick = thickness(spot.position, spot.footprint, spot.weeks);
    let film = Vec3::new(0.16, 0.20, 0.06);
    let mut colour = bare.lerp(film, 0.45 * progress(spot.weeks));
    let blade = 0.7 + 0.5 * fractal(spot.position, 0.07, 2, spot.footprint, 411);
    colour = colour.lerp(Vec3::new(0.075, 0.14, 0.03) * blade, 0.85 * thick);
    let (barnacle, _) = specks(spot, 0.06, 0.7 * ramp(thick, 0.4, 1.0), 413);
    colour.lerp(Vec3::new(0.38, 0.35, 0.27), 0.8 * barnacle).clamp(Vec3::ZERO, Vec3::ONE)
}

/// A thin film in large patches.
fn filmed(spot: &Spot, bare: Vec3) -> Vec3 {
    let patch = fractal(spot.position, 2.4, 4, spot.footprint, 421);
    let covered = ramp(patch, 0.4 - 0.5 * progress(spot.weeks), 0.7);
    bare.lerp(Vec3::new(0.11, 0.15, 0.06), 0.7 * covered)
}

/// A barnacle, a mussel or a tuft of weed.
pub fn bump(spot: &Spot) -> Vec3 {
    let kind = unit(hash(spot.solid.seed));
    let grain = 1.0 + 0.4 * fractal(spot.position, 0.04, 2, spot.footprint, spot.solid.seed);
    let base = match (kind * 8.0) as u32 {
        0..3 => Vec3::new(0.33, 0.30, 0.22),
        3 | 4 => Vec3::new(0.055, 0.06, 0.065),
        _ => Vec3::new(0.10, 0.16, 0.04),
    };
    base * grain
}
