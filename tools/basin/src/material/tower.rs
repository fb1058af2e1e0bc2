//! The tower's paint: coated steel with what grows in the dark, and bare metal.

use glam::Vec3;

use super::super::noise::{fractal, hash, unit};
use super::super::solid::Material;
use super::texture::{Spot, grime, ramp, specks};

/// A worn coating under a film, with tubes of worms and small anemones.
pub fn coated(spot: &Spot) -> Vec3 {
    let p = spot.position;
    let seed = spot.solid.seed;
    let mut colour = Vec3::new(0.27, 0.26, 0.20) * (1.0 + 0.4 * grime(spot, 0.5));
    let flaked = ramp(fractal(p, 0.4, 5, spot.footprint, seed.wrapping_add(501)), 0.18, 0.3);
    colour = colour.lerp(Vec3::new(0.17, 0.085, 0.045), 0.8 * flaked);
    let film = fractal(p, 0.7, 5, spot.footprint, 502) + 0.25 * spot.normal.z;
    let brown =
        Vec3::new(0.11, 0.095, 0.06) * (1.0 + 0.5 * fractal(p, 0.05, 3, spot.footprint, 503));
    colour = colour.lerp(brown, 0.85 * ramp(film, -0.05, 0.2));
    colour *= 1.0 + 0.7 * fractal(p, 0.11, 5, spot.footprint, 509);
    let turf = ramp(fractal(p, 0.5, 4, spot.footprint, 504), 0.12, 0.3);
    for (pitch, share, number) in [(0.03, 0.5, 505), (0.07, 0.25, 511)] {
        let (tube, id) = specks(spot, pitch, share * (0.3 + turf), number);
        let white =
            Vec3::new(0.62, 0.58, 0.50).lerp(Vec3::new(0.55, 0.25, 0.10), ramp(unit(id), 0.1, 0.5));
        colour = colour.lerp(white, 0.8 * tube);
    }
    colour.clamp(Vec3::ZERO, Vec3::ONE)
}

/// An anemone, a sponge, a bush of hydroids or a shell.
pub fn fouling(spot: &Spot) -> Vec3 {
    let kind = unit(hash(spot.solid.seed));
    let grain = 1.0 + 0.5 * fractal(spot.position, 0.03, 2, spot.footprint, spot.solid.seed);
    let base = match (kind * 8.0) as u32 {
        0..2 => Vec3::new(0.56, 0.53, 0.48),
        2 | 3 => Vec3::new(0.50, 0.19, 0.06),
        4..7 => Vec3::new(0.16, 0.12, 0.08),
        _ => Vec3::new(0.06, 0.06, 0.065),
    };
    base * grain
}

/// Metal that was blasted clean, with the marks of the tool.
pub fn bare_steel(spot: &Spot) -> Vec3 {
    let along = spot.solid.to_local(spot.position) * Vec3::new(0.2, 0.2, 1.0);
    let brushed = fractal(along, 0.03, 3, spot.footprint, spot.solid.seed);
    let stain = ramp(grime(spot, 0.12), 0.15, 0.4);
    let metal = Vec3::new(0.52, 0.52, 0.50) * (1.0 + 0.2 * brushed);
    metal.lerp(Vec3::new(0.24, 0.15, 0.08), 0.6 * stain)
}

/// How much of the light a surface throws back as a mirror would, and how sharply (Blinn and Phong's lobe).
pub fn gloss(material: Material) -> Option<(f32, f32)> {
    match material {
        Material::BareSteel => Some((0.5, 40.0)),
        Material::Zinc | Material::Pipe => Some((0.08, 15.0)),
        Material::Coated => Some((0.03, 12.0)),
        _ => None,
    }
}
