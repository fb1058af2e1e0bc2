//! What all paint is made of: a point of a surface, and patterns there that leave out what is finer than a sample.

use glam::{IVec2, Vec2, Vec3};

use super::super::noise::{fractal, hash_cell, unit};
use super::super::solid::Solid;

/// A point of a surface, in the paint's coordinates.
pub struct Spot<'a> {
    pub solid: &'a Solid,
    pub position: Vec3,
    /// Outward unit normal, world axes.
    pub normal: Vec3,
    /// Width of a picture sample on the surface, metres. Finer detail is left out.
    pub footprint: f32,
    /// For how many weeks things have grown on it.
    pub weeks: f32,
}

/// Fractal noise in world axes, its coarsest octave `wavelength` metres.
pub fn grime(spot: &Spot, wavelength: f32) -> f32 {
    let octaves = 4;
    fractal(spot.position, wavelength, octaves, spot.footprint, spot.solid.seed.wrapping_mul(31))
}

/// How much of a sample lies in round specks: one at most in each cell of a grid in space, none of which leaves it.
/// `share`: of the cells that have one. Also gives a number of the speck.
pub fn specks(spot: &Spot, pitch: f32, share: f32, seed: u32) -> (f32, u32) {
    let cell = (spot.position / pitch).floor();
    let id = hash_cell(cell.as_ivec3(), seed);
    if unit(id) > share {
        return (0.0, id);
    }
    let draw = |k: u32| unit(hash_cell(cell.as_ivec3(), seed.wrapping_add(k)));
    let radius = pitch * (0.14 + 0.2 * draw(1));
    let place = Vec3::new(draw(2), draw(3), draw(4)) * (pitch - 2.0 * radius) + radius;
    let away = (spot.position - cell * pitch - place).length();
    (band(away, radius, spot.footprint), id)
}

/// A ramp from 0 at `from` to 1 at `to`.
pub fn ramp(value: f32, from: f32, to: f32) -> f32 {
    ((value - from) / (to - from)).clamp(0.0, 1.0)
}

/// How much of a sample of width `footprint` about `x` lies in `|x| < half_width`.
pub fn band(x: f32, half_width: f32, footprint: f32) -> f32 {
    let (low, high) = (x - footprint / 2.0, x + footprint / 2.0);
    ((high.min(half_width) - low.max(-half_width)) / footprint).clamp(0.0, 1.0)
}

/// A point of a grid: its cell, and the offset from the cell's centre in metres.
pub fn grid(p: Vec2, pitch: Vec2) -> (IVec2, Vec2) {
    let cell = (p / pitch).floor();
    (cell.as_ivec2(), p - (cell + 0.5) * pitch)
}

/// The share of joint in a sample of a tiled surface.
pub fn joints(offset: Vec2, pitch: Vec2, joint: f32, footprint: f32) -> f32 {
    let inside = (pitch - joint) / 2.0;
    1.0 - band(offset.x, inside.x, footprint) * band(offset.y, inside.y, footprint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn band_keeps_the_area_of_what_is_narrower_than_a_sample() {
        let (half, footprint, step) = (0.01, 0.08, 1e-4);
        let area: f32 = (-2000..2000).map(|i| band(i as f32 * step, half, footprint) * step).sum();
        assert!((area - 2.0 * half).abs() < 1e-4, "{area}");
    }
}
