//! Real spherical harmonics of degree 0 and 1, signs as in Inria's trainer.

use glam::Vec3;

use crate::prior::Splats;

const C0: f32 = 0.282_094_8;
const C1: f32 = 0.488_602_52;

/// Coefficients of a degree.
pub fn count(degree: u32) -> usize {
    (degree as usize + 1).pow(2)
}

/// Values of the first four basis functions in a unit direction.
pub fn basis(direction: Vec3) -> [f32; 4] {
    [C0, -C1 * direction.y, C1 * direction.z, -C1 * direction.x]
}

/// Every splat's colour as seen from a point: the series plus 0.5, at least zero.
pub fn colours(splats: &Splats, centre: Vec3) -> Vec<Vec3> {
    let terms = 3 * count(splats.sh_degree);
    std::iter::zip(splats.sh.chunks_exact(terms), &splats.positions)
        .map(|(own, position)| {
            let basis = basis((Vec3::from(*position) - centre).normalize_or_zero());
            let triples = own.chunks_exact(3).map(Vec3::from_slice);
            let sum =
                std::iter::zip(triples, basis).fold(Vec3::splat(0.5), |sum, (c, b)| sum + c * b);
            sum.max(Vec3::ZERO)
        })
        .collect()
}

/// The derivative by a splat's position of `gradient · colour`, through the direction in which the
/// splat is seen; `own` are its coefficients and `offset` goes from the camera to it.
pub fn by_position(own: &[f32], gradient: Vec3, offset: Vec3) -> Vec3 {
    let Some(terms) = own.get(3..12) else { return Vec3::ZERO };
    let [y, z, x] = std::array::from_fn(|k| gradient.dot(Vec3::from_slice(&terms[3 * k..])));
    let by_direction = C1 * Vec3::new(-x, -y, z);
    let direction = offset.normalize_or_zero();
    (by_direction - direction * direction.dot(by_direction)) * offset.length_recip()
}
