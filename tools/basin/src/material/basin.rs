//! The basin's paint.

use glam::{IVec2, Vec2, Vec3};

use super::super::noise::{fractal, hash, hash_cell, unit};
use super::super::solid::Shape;
use super::texture::{Spot, band, grid, grime, joints};

pub fn floor(spot: &Spot) -> Vec3 {
    let p = spot.position.truncate();
    let pitch = Vec2::splat(0.6);
    let (tile, offset) = grid(p, pitch);
    let shade = unit(hash_cell(tile.extend(0), 11));
    let tint = unit(hash_cell(tile.extend(1), 11));
    let glaze = Vec3::new(0.22, 0.27, 0.29).lerp(Vec3::new(0.29, 0.28, 0.23), tint);
    let tiled = glaze * (0.75 + 0.4 * shade);
    let mut colour = tiled.lerp(Vec3::splat(0.12), joints(offset, pitch, 0.02, spot.footprint));
    let silt = (0.5 + 1.2 * grime(spot, 1.7)).clamp(0.0, 1.0);
    colour = colour.lerp(Vec3::new(0.17, 0.15, 0.10), 0.6 * silt);
    let lane = band((p.x.abs() - 2.9).abs(), 0.07, spot.footprint);
    colour = colour.lerp(Vec3::new(0.05, 0.07, 0.16), 0.8 * lane);
    survey_marks(p, spot.footprint, colour)
}

/// Painted discs, rings and squares, one in most cells of a 1.3 m grid.
fn survey_marks(p: Vec2, footprint: f32, under: Vec3) -> Vec3 {
    let pitch = Vec2::splat(1.3);
    let (cell, offset) = grid(p, pitch);
    let draw = |k: i32| unit(hash_cell(cell.extend(k), 23));
    let place = Vec2::new(draw(0) - 0.5, draw(1) - 0.5) * 0.7;
    let at = offset - place;
    let radius = 0.11 + 0.14 * draw(2);
    let paint = match (draw(3) * 4.0) as u32 {
        0 => Vec3::new(0.62, 0.60, 0.55),
        1 => Vec3::new(0.60, 0.16, 0.08),
        2 => Vec3::new(0.08, 0.09, 0.10),
        _ => Vec3::new(0.10, 0.28, 0.42),
    };
    let covered = match (draw(4) * 4.0) as u32 {
        0 => band(at.length(), radius, footprint),
        1 => band(at.length() - radius, 0.045, footprint),
        2 => band(at.x, radius, footprint) * band(at.y, radius * 0.6, footprint),
        _ => 0.0,
    };
    under.lerp(paint, 0.8 * covered)
}

pub fn wall(spot: &Spot) -> Vec3 {
    // Walls face along x or y: the other level axis runs along the wall.
    let along = if spot.normal.x.abs() > 0.5 { spot.position.y } else { spot.position.x };
    let p = Vec2::new(along, spot.position.z);
    let seed = spot.solid.seed;
    let pitch = Vec2::new(1.1, 0.9);
    let (panel, offset) = grid(p, pitch);
    let shade = unit(hash_cell(panel.extend(0), seed));
    let mut colour = Vec3::new(0.24, 0.29, 0.31) * (0.75 + 0.45 * shade);
    let joint = joints(offset, pitch, 0.03, spot.footprint);
    colour = colour.lerp(Vec3::splat(0.10), joint);
    // Streaks run down: noise squeezed along z.
    let squeezed = spot.position * Vec3::new(1.0, 1.0, 0.15);
    let streak = (0.2 + 1.3 * fractal(squeezed, 0.7, 3, spot.footprint, seed)).clamp(0.0, 1.0);
    colour = colour.lerp(Vec3::new(0.13, 0.10, 0.06), 0.55 * streak);
    let stripe = band(p.y - 1.2, 0.12, spot.footprint);
    colour = colour.lerp(Vec3::new(0.06, 0.09, 0.22), 0.75 * stripe);
    code_block(panel, offset, seed, spot.footprint, colour)
}

/// A painted block of 4 × 4 squares, black or white at random, on every third panel or so.
fn code_block(panel: IVec2, offset: Vec2, seed: u32, footprint: f32, under: Vec3) -> Vec3 {
    let pitch = Vec2::splat(0.13);
    if unit(hash_cell(panel.extend(1), seed)) > 0.3 || offset.abs().max_element() > 2.0 * pitch.x {
        return under;
    }
    let (square, within) = grid(offset, pitch);
    let id = hash_cell(panel.extend(2), seed);
    let white = hash_cell(square.extend(0), id) & 1 == 1;
    let paint = Vec3::splat(if white { 0.45 } else { 0.07 });
    under.lerp(paint, 1.0 - joints(within, pitch, 0.0, footprint))
}

pub fn barrel(spot: &Spot) -> Vec3 {
    let local = spot.solid.to_local(spot.position);
    let seed = spot.solid.seed;
    let tint = unit(hash(seed ^ 0x51));
    let paint = Vec3::new(0.72, 0.47, 0.035).lerp(Vec3::new(0.64, 0.50, 0.07), tint);
    let mut colour = paint * (1.0 + 0.18 * grime(spot, 0.5));
    let Shape::Cylinder { radius, half_length } = spot.solid.shape else { return colour };
    let around = local.y.atan2(local.x) * radius;
    if local.z.abs() < half_length * 0.98 {
        colour = stencil(Vec2::new(around, local.z), seed, spot.footprint, colour);
    }
    // Rust gathers on the two rolling hoops and at the rims.
    let third = half_length / 3.0;
    let hoop = band(local.z.abs() - third, 0.018, spot.footprint);
    let rim = band(local.z.abs() - half_length, 0.025, spot.footprint);
    let patches = fractal(spot.position, 0.35, 4, spot.footprint, seed ^ 0x77);
    let worn = (2.6 * (patches - 0.22) + 0.45 * hoop + 0.6 * rim).clamp(0.0, 1.0);
    colour.lerp(Vec3::new(0.16, 0.065, 0.025), 0.8 * worn)
}

/// A white label and two black marks, placed around the barrel by its seed.
fn stencil(p: Vec2, seed: u32, footprint: f32, under: Vec3) -> Vec3 {
    let mut colour = under;
    for mark in 0..3 {
        let draw = |k: u32| unit(hash(seed.wrapping_mul(64) + mark * 8 + k));
        let centre = Vec2::new(1.7 * (draw(0) - 0.5), 0.5 * (draw(1) - 0.5));
        let half = Vec2::new(0.05 + 0.09 * draw(2), 0.03 + 0.06 * draw(3));
        let at = p - centre;
        let covered = band(at.x, half.x, footprint) * band(at.y, half.y, footprint);
        let paint = if mark == 0 { Vec3::splat(0.66) } else { Vec3::splat(0.05) };
        colour = colour.lerp(paint, 0.85 * covered);
    }
    colour
}

pub fn pipe(spot: &Spot) -> Vec3 {
    let along = spot.solid.to_local(spot.position).z;
    let seed = spot.solid.seed;
    let zinc = Vec3::new(0.42, 0.44, 0.45) * (1.0 + 0.3 * grime(spot, 0.4));
    let rust = (3.0 * (fractal(spot.position, 0.5, 3, spot.footprint, seed) - 0.2)).clamp(0.0, 1.0);
    let mut colour = zinc.lerp(Vec3::new(0.22, 0.10, 0.05), 0.7 * rust);
    for tape in 0..3 {
        let draw = |k: u32| unit(hash(seed.wrapping_mul(64) + tape * 8 + k));
        let covered = band(along - 3.0 * (draw(0) - 0.5), 0.04 + 0.05 * draw(1), spot.footprint);
        let paint = if draw(2) < 0.5 { Vec3::new(0.5, 0.08, 0.05) } else { Vec3::splat(0.62) };
        colour = colour.lerp(paint, 0.85 * covered);
    }
    colour
}

pub fn steel(spot: &Spot) -> Vec3 {
    let local = spot.solid.to_local(spot.position);
    let metal = Vec3::new(0.48, 0.49, 0.50) * (1.0 + 0.3 * grime(spot, 0.25));
    let stripe = band((local.z + 0.25).abs() - 0.12, 0.05, spot.footprint);
    metal.lerp(Vec3::new(0.65, 0.20, 0.04), 0.8 * stripe)
}
