//! The paint of the surfaces: albedo at several scales, which never repeats.

mod basin;
mod growth;
mod quay;
mod texture;
mod tower;

use glam::Vec3;

use super::solid::Material;
pub use texture::Spot;
use texture::grime;
pub use tower::gloss;

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

#[cfg(test)]
mod tests {
    use super::super::noise::{hash, unit};
    use super::super::{Dive, Run};
    use super::*;

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
