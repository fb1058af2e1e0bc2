//! Colours of splats from their spherical harmonics, and the way back.

use glam::Vec3;

use nvsprior::prior::Splats;
use nvsprior_kernels::shared;

/// Coefficients of a degree.
pub fn count(degree: u32) -> usize {
    (degree as usize + 1).pow(2)
}

/// Values of the basis functions in a unit direction.
pub fn basis(direction: Vec3) -> [f32; 16] {
    shared::sh_basis(direction.to_array())
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

/// The derivative of `gradient · colour` by a splat's position, through the direction in which the
/// splat is seen. `own` are its coefficients; `offset` goes from the camera to it.
pub fn by_position(own: &[f32], gradient: Vec3, offset: Vec3) -> Vec3 {
    let direction = offset.normalize_or_zero();
    let slopes = shared::sh_basis_gradient(direction.to_array());
    let by_direction: Vec3 = std::iter::zip(own.chunks_exact(3), slopes)
        .map(|(c, slope)| Vec3::from(slope) * gradient.dot(Vec3::from_slice(c)))
        .sum();
    (by_direction - direction * direction.dot(by_direction)) * offset.length_recip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_by_position_agree_with_differences() {
        let wave = |i: usize| (i as f32 * 0.77 + 0.4).sin();
        for sh_degree in 0..=3 {
            let position = Vec3::new(0.4, -0.7, 1.9);
            let mut splats = Splats { sh_degree, ..Splats::default() };
            splats.sh = (0..splats.sh_stride()).map(|i| 0.1 * wave(i)).collect();
            splats.positions = vec![position.to_array()];
            let (gradient, centre) = (Vec3::new(0.3, -1.0, 0.8), Vec3::new(-0.2, 0.1, 0.3));
            let analytic = by_position(&splats.sh, gradient, position - centre);
            for axis in 0..3 {
                let mut value = |by: f32| {
                    splats.positions[0] = position.to_array();
                    splats.positions[0][axis] += by;
                    gradient.dot(colours(&splats, centre)[0])
                };
                let difference = (value(1e-2) - value(-1e-2)) / 2e-2;
                let error = (analytic[axis] - difference).abs();
                assert!(error < 2e-3, "degree {sh_degree}: {} {difference}", analytic[axis]);
            }
        }
    }
}
