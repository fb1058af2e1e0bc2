//! What grows on the basin's structure: where, how thick, and the bumps that it makes.
//!
//! All of it follows from the place and the weeks since the mapping run. What has grown stays: more weeks only add.

use glam::{Mat3, Vec3};

use super::noise::{Stream, fractal, value_noise};
use super::solid::{Material, Shape, Solid};

/// How far growth has come: 0 on the day of the mapping run, half after eight weeks, never 1.
pub fn progress(weeks: f32) -> f32 {
    weeks / (weeks + 8.0)
}

/// How thick a place is grown over, from 0 (bare) to 1. Detail finer than `footprint`, metres, is left out.
pub fn thickness(place: Vec3, footprint: f32, weeks: f32) -> f32 {
    if weeks <= 0.0 {
        return 0.0;
    }
    // Growth likes some sides of the structure better than others, and the light above.
    let liking = 0.24 * value_noise(place / 2.1, 402) + 0.07 * (place.z - 1.5);
    let patches = fractal(place, 0.8, 5, footprint, 401);
    let bare_below = 0.5 - 0.8 * progress(weeks);
    ((patches + liking - bare_below) / 0.3).clamp(0.0, 1.0)
}

/// Barnacles, mussels and tufts on the side of a cylinder. Those of fewer weeks lie inside those of more.
pub fn bumps(on: &Solid, weeks: f32) -> Vec<Solid> {
    let Shape::Cylinder { radius, half_length } = on.shape else { return Vec::new() };
    let mut draws = Stream::new(on.seed ^ 0x6709);
    let area = 4.0 * std::f32::consts::PI * radius * half_length;
    let places = (area * PLACES_PER_AREA) as u32;
    let bump = |seed| {
        let (sin, cos) = draws.within(0.0, std::f32::consts::TAU).sin_cos();
        let outward = on.axes * Vec3::new(cos, sin, 0.0);
        let along = on.axes.z_axis * draws.within(-half_length, half_length);
        let centre = on.centre + along + outward * radius;
        let full_size = draws.within(0.16, 0.25).powi(2);
        let size = full_size * (0.3 + 0.9 * progress(weeks)) * thickness(centre, COARSE, weeks);
        (size > SMALLEST).then(|| {
            let x = on.axes.z_axis;
            Solid {
                shape: Shape::Ellipsoid { half: Vec3::new(size, 0.85 * size, 0.6 * size) },
                material: Material::Growth,
                centre,
                axes: Mat3::from_cols(x, outward.cross(x), outward),
                seed: on.seed.wrapping_mul(1024).wrapping_add(seed),
            }
        })
    };
    (0..places).filter_map(bump).collect()
}

/// Where a bump may grow, per square metre.
const PLACES_PER_AREA: f32 = 45.0;
/// The detail of patches that decides about bumps, metres.
const COARSE: f32 = 0.05;
/// Smaller bumps do not show, metres.
const SMALLEST: f32 = 0.008;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_only_adds() {
        let ages = [0.0, 1.0, 4.0, 12.0, 26.0, 200.0];
        let mut covered = ages.map(|_| 0.0);
        for i in 0..4000_u16 {
            let turn = f32::from(i) * 2.4;
            let place = Vec3::new(2.0 * turn.cos(), 2.0 * turn.sin(), f32::from(i) * 3.0 / 4000.0);
            let thick = ages.map(|weeks| thickness(place, 0.01, weeks));
            assert!(thick.is_sorted() && thick[5] <= 1.0, "{thick:?} at {place}");
            for (sum, thick) in std::iter::zip(&mut covered, thick) {
                *sum += thick / 4000.0;
            }
        }
        assert_eq!(covered[0], 0.0);
        let [_, _, week_4, _, week_26, _] = covered;
        assert!((0.05..0.25).contains(&week_4), "{covered:?}");
        assert!((0.3..0.5).contains(&week_26), "{covered:?}");
    }
}
