//! The quay's paint: what grows on steel, timber and stone, and how much of it at which depth.

use glam::{Vec2, Vec3};

use super::super::noise::{fractal, hash_cell, unit};
use super::super::quay::DEPTH;
use super::texture::{Spot, band, grime, ramp, specks};

/// What has grown on a surface since it was put there.
fn grown(spot: &Spot, bare: Vec3) -> Vec3 {
    let p = spot.position;
    let height = p.z / DEPTH;
    let mut colour = bare;
    // A film of silt below, weed above.
    let film = fractal(p, 0.9, 5, spot.footprint, 301);
    colour = colour.lerp(Vec3::new(0.13, 0.125, 0.07), 0.75 * ramp(film - height, -0.75, 0.15));
    let weed = fractal(p * Vec3::new(1.0, 1.0, 0.4), 0.5, 5, spot.footprint, 302);
    let blade = 0.7 + 0.5 * fractal(p * Vec3::new(1.0, 1.0, 0.2), 0.06, 2, spot.footprint, 303);
    let weedy = ramp(weed + 1.6 * (height - 0.72), -0.05, 0.18);
    colour = colour.lerp(Vec3::new(0.10, 0.19, 0.035) * blade, 0.85 * weedy);
    // Mussels in beds, each with a pale edge.
    let bed = fractal(p, 0.75, 4, spot.footprint, 304) - 1.5 * (height - 0.5).abs();
    let (mussel, id) = specks(spot, 0.075, 0.95, 305);
    let shell = Vec3::new(0.035, 0.04, 0.055).lerp(Vec3::new(0.17, 0.17, 0.16), 0.5 * unit(id));
    let rough = Vec3::splat(0.05).lerp(shell, mussel);
    colour = colour.lerp(rough, 0.9 * ramp(bed, -0.12, 0.04));
    // Barnacles, in clouds.
    let cloud = ramp(fractal(p, 0.6, 3, spot.footprint, 306) + 0.8 * height, 0.32, 0.6);
    for (pitch, seed) in [(0.055, 307), (0.12, 311)] {
        let (barnacle, _) = specks(spot, pitch, 0.75 * cloud, seed);
        colour = colour.lerp(Vec3::new(0.50, 0.48, 0.42), 0.85 * barnacle);
    }
    // Sponges and anemones, here and there.
    let (sponge, id) = specks(spot, 0.33, 0.16, 315);
    let kind = if id & 1 == 0 { Vec3::new(0.55, 0.20, 0.03) } else { Vec3::new(0.60, 0.52, 0.36) };
    let lobes = 0.8 + 0.4 * fractal(p, 0.05, 2, spot.footprint, 316);
    colour.lerp(kind * lobes, 0.9 * sponge)
}

pub fn sheet_pile(spot: &Spot) -> Vec3 {
    let p = spot.position;
    let seed = spot.solid.seed;
    let rust = fractal(p, 0.45, 5, spot.footprint, seed.wrapping_add(51));
    let steel = Vec3::new(0.17, 0.10, 0.055).lerp(Vec3::new(0.09, 0.085, 0.08), 0.5 + 0.6 * rust);
    // Rust water runs down from the waling.
    let run = fractal(p * Vec3::new(1.0, 1.0, 0.08), 0.16, 3, spot.footprint, seed);
    let bare = steel.lerp(Vec3::new(0.30, 0.13, 0.04), 0.6 * ramp(run + 0.12 * p.z, 0.45, 0.8));
    grown(spot, bare).clamp(Vec3::ZERO, Vec3::ONE)
}

pub fn seabed(spot: &Spot) -> Vec3 {
    let p = spot.position.truncate();
    let bend = 0.35 * grime(spot, 1.6);
    let phase = (p.x * 0.8 + p.y * 0.25 + bend) * std::f32::consts::TAU / 0.17;
    // Ripples narrower than two samples show as their mean.
    let kept = (0.17 / (2.0 * spot.footprint) - 1.0).clamp(0.0, 1.0);
    let sand = Vec3::new(0.25, 0.22, 0.15) * (1.0 + 0.14 * kept * phase.sin());
    let mut colour = sand.lerp(Vec3::new(0.10, 0.10, 0.065), ramp(grime(spot, 1.1), 0.0, 0.5));
    for (pitch, share, seed) in [(0.06, 0.3, 71), (0.14, 0.35, 75)] {
        let (shell, id) = specks(spot, pitch, share, seed);
        let bright = 0.08 + 0.45 * unit(id.wrapping_mul(2_654_435_761));
        colour = colour.lerp(Vec3::new(1.0, 0.94, 0.82) * bright, 0.85 * shell);
    }
    colour
}

pub fn stone(spot: &Spot) -> Vec3 {
    let seed = spot.solid.seed;
    let tint = unit(hash_cell(glam::IVec3::splat(seed as i32), 81));
    let rock = Vec3::new(0.20, 0.19, 0.18).lerp(Vec3::new(0.27, 0.22, 0.17), tint);
    let grain = 1.0 + 0.5 * fractal(spot.position, 0.12, 4, spot.footprint, seed);
    let vein = fractal(spot.position * Vec3::new(1.0, 0.4, 1.6), 0.3, 4, spot.footprint, 83).abs();
    let veined = (rock * grain).lerp(Vec3::splat(0.42), 0.6 * ramp(0.06 - vein, 0.0, 0.06));
    // Silt lies on top, weed in patches.
    let silted = veined.lerp(Vec3::new(0.16, 0.15, 0.10), 0.7 * ramp(spot.normal.z, 0.55, 0.95));
    let weed = ramp(grime(spot, 0.35), 0.18, 0.35);
    silted.lerp(Vec3::new(0.12, 0.15, 0.035), 0.8 * weed)
}

pub fn rubber(spot: &Spot) -> Vec3 {
    let z = spot.solid.to_local(spot.position).z;
    let worn = Vec3::splat(0.045) * (1.0 + 0.8 * grime(spot, 0.2));
    let groove = band((z.rem_euclid(0.25) - 0.125).abs(), 0.012, spot.footprint);
    let grooved = worn.lerp(Vec3::splat(0.015), 0.8 * groove);
    let (barnacle, _) = specks(spot, 0.09, 0.4, 91);
    let scraped = ramp(fractal(spot.position, 0.4, 3, spot.footprint, 95), 0.2, 0.4);
    let paint = Vec3::new(0.10, 0.17, 0.30);
    grooved.lerp(paint, 0.6 * scraped).lerp(Vec3::new(0.45, 0.44, 0.38), 0.8 * barnacle)
}

pub fn chain(spot: &Spot) -> Vec3 {
    let seed = spot.solid.seed.wrapping_add(101);
    let rust = fractal(spot.position, 0.15, 4, spot.footprint, seed);
    Vec3::new(0.10, 0.06, 0.04).lerp(Vec3::new(0.32, 0.15, 0.06), ramp(rust, -0.2, 0.4))
}

pub fn timber(spot: &Spot) -> Vec3 {
    let local = spot.solid.to_local(spot.position);
    let seed = spot.solid.seed.wrapping_add(111);
    let long = local * Vec3::new(1.0, 1.0, 0.06);
    let grain = fractal(long, 0.06, 3, spot.footprint, seed);
    let wood = Vec3::new(0.19, 0.13, 0.075) * (1.0 + 0.6 * grain);
    let crack = fractal(long, 0.11, 2, spot.footprint, seed + 7).abs();
    let cracked = wood.lerp(Vec3::splat(0.02), 0.8 * ramp(0.05 - crack, 0.0, 0.05));
    grown(spot, cracked).clamp(Vec3::ZERO, Vec3::ONE)
}

pub fn ladder(spot: &Spot) -> Vec3 {
    let zinc = Vec3::new(0.40, 0.41, 0.40) * (1.0 + 0.3 * grime(spot, 0.2));
    let foul = ramp(fractal(spot.position, 0.3, 4, spot.footprint, 121), 0.0, 0.35);
    zinc.lerp(Vec3::new(0.11, 0.10, 0.05), 0.85 * foul)
}

pub fn zinc(spot: &Spot) -> Vec3 {
    let crust = ramp(fractal(spot.position, 0.12, 4, spot.footprint, 131), -0.1, 0.4);
    Vec3::new(0.30, 0.31, 0.33).lerp(Vec3::new(0.62, 0.62, 0.58), crust)
}

pub fn pot(spot: &Spot) -> Vec3 {
    let at = Vec2::new(spot.position.x + spot.position.y, spot.position.z);
    let twist = band((at.y.rem_euclid(0.06) - 0.03).abs(), 0.012, spot.footprint);
    Vec3::new(0.05, 0.24, 0.20).lerp(Vec3::new(0.5, 0.45, 0.1), 0.7 * twist)
}

pub fn buoy(spot: &Spot) -> Vec3 {
    let z = spot.solid.to_local(spot.position).z;
    let stripe = band(z, 0.05, spot.footprint);
    Vec3::new(0.68, 0.10, 0.035).lerp(Vec3::splat(0.68), stripe)
}
