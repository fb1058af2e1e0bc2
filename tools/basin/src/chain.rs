//! Chains, as rows of cylinders.

use glam::Vec3;

use super::solid::{Material, Solid};

/// Links along a curve from 0 to 1: thick and thin by turns, as they show their broad and narrow side.
pub fn links(curve: impl Fn(f32) -> Vec3, count: u32) -> Vec<Solid> {
    let at = |i: u32| curve(i as f32 / count as f32);
    let radius = |i: u32| if i.is_multiple_of(2) { 0.036 } else { 0.016 };
    let link = |i| Solid::cylinder(at(i), at(i + 1), radius(i), Material::Chain, i);
    (0..count).map(link).collect()
}
