//! The paint of the surfaces: albedo at several scales, which never repeats.

mod basin;
mod growth;
mod quay;
mod tower;

use glam::{IVec2, Vec2, Vec3};

use super::noise::{fractal, hash_cell, unit};
use super::solid::{Material, Solid};

pub use tower::gloss;

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

/// Albedo in linear RGB.
pub fn albedo(spot: &Spot) -> Vec3 {
    growth::grown(spot, bare(spot))
}

/// Albedo of the surface itself.
fn bare(spot: &Spot) -> Vec3 {
    match spot.solid.material {
        Material::Floor => basin::floor(spot),
        Material::Wall => basin::wall(spot),
        Material::WaterSurface => Vec3::new(0.20, 0.34, 0.38) * (1.0 + 0.2 * grime(spot, 1.8)),
        Material::Barrel => basin::barrel(spot),
        Material::Pipe => basin::pipe(spot),
        Material::Concrete => Vec3::new(0.34, 0.33, 0.30) * (1.0 + 0.35 * grime(spot, 0.3)),
        Material::Steel => basin::steel(spot),
        Material::SheetPile => quay::sheet_pile(spot),
        Material::Seabed => quay::seabed(spot),
        Material::Stone => quay::stone(spot),
        Material::Rubber => quay::rubber(spot),
        Material::Chain => quay::chain(spot),
        Material::Timber => quay::timber(spot),
        Material::Ladder => quay::ladder(spot),
        Material::Zinc => quay::zinc(spot),
        Material::Pot => quay::pot(spot),
        Material::Buoy => quay::buoy(spot),
        Material::Growth => growth::bump(spot),
        Material::Coated => tower::coated(spot),
        Material::Fouling => tower::fouling(spot),
        Material::BareSteel => tower::bare_steel(spot),
        Material::SafetyLine => Vec3::new(0.85, 0.65, 0.05),
    }
}

/// Fractal noise in world axes, its coarsest octave `wavelength` metres.
fn grime(spot: &Spot, wavelength: f32) -> f32 {
    let octaves = 4;
    fractal(spot.position, wavelength, octaves, spot.footprint, spot.solid.seed.wrapping_mul(31))
}

/// How much of a sample lies in round specks: one at most in each cell of a grid in space, none of which leaves it.
/// `share`: of the cells that have one. Also gives a number of the speck.
fn specks(spot: &Spot, pitch: f32, share: f32, seed: u32) -> (f32, u32) {
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
fn ramp(value: f32, from: f32, to: f32) -> f32 {
    ((value - from) / (to - from)).clamp(0.0, 1.0)
}

/// How much of a sample of width `footprint` about `x` lies in `|x| < half_width`.
fn band(x: f32, half_width: f32, footprint: f32) -> f32 {
    let (low, high) = (x - footprint / 2.0, x + footprint / 2.0);
    ((high.min(half_width) - low.max(-half_width)) / footprint).clamp(0.0, 1.0)
}

/// A point of a grid: its cell, and the offset from the cell's centre in metres.
fn grid(p: Vec2, pitch: Vec2) -> (IVec2, Vec2) {
    let cell = (p / pitch).floor();
    (cell.as_ivec2(), p - (cell + 0.5) * pitch)
}

/// The share of joint in a sample of a tiled surface.
fn joints(offset: Vec2, pitch: Vec2, joint: f32, footprint: f32) -> f32 {
    let inside = (pitch - joint) / 2.0;
    1.0 - band(offset.x, inside.x, footprint) * band(offset.y, inside.y, footprint)
}

#[cfg(test)]
mod tests {
    use super::super::noise::hash;
    use super::super::{Dive, Run};
    use super::*;

    #[test]
    fn band_keeps_the_area_of_what_is_narrower_than_a_sample() {
        let (half, footprint, step) = (0.01, 0.08, 1e-4);
        let area: f32 = (-2000..2000).map(|i| band(i as f32 * step, half, footprint) * step).sum();
        assert!((area - 2.0 * half).abs() < 1e-4, "{area}");
    }

    #[test]
    fn albedo_stays_physical() {
        let scenes = Run::ALL.map(|run| Dive::of(run).scene());
        let solids =
            scenes.iter().flat_map(|scene| scene.solids().map(|solid| (solid, scene.weeks)));
        for (solid, weeks) in solids {
            for i in 0..500 {
                let draw = |k: u32| unit(hash(i * 4 + k)) - 0.5;
                let (low, high) = solid.bounds();
                let offset = Vec3::new(draw(0), draw(1), draw(2)) * (high - low);
                let position = solid.centre + offset;
                let spot = Spot { solid, position, normal: Vec3::X, footprint: 0.01, weeks };
                let a = albedo(&spot);
                assert!(a.min_element() >= 0.0 && a.max_element() <= 1.0, "{a} at {position}");
            }
        }
    }
}
