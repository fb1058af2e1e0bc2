//! Spherical harmonics of a scene that is turned.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use nvsprior_kernels::shared;

/// Coefficients up to degree 3.
const ALL: usize = 16;

/// Nodes and weights of Gauss's rule on [-1, 1], exact for polynomials of degree 7.
const GAUSS: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];

/// Directions around the axis, for each node: exact for products of two functions of degree 3.
const AROUND: usize = 7;

/// How a rotation of the world changes coefficients up to degree 3.
///
/// A function of the direction stays the same if it is turned with the world: `f'(R d) = f(d)`. Since the functions are
/// orthonormal, coefficient `m` of `f'` is the integral of `f' Y_m` over all directions. A rule that is exact for
/// products of two functions of degree 3 gives it. The functions are those of the renderer, in f32.
pub struct ShRotation {
    matrix: [[f64; ALL]; ALL],
}

impl ShRotation {
    /// Of a unit quaternion.
    pub fn new(rotation: DQuat) -> ShRotation {
        let mut matrix = [[0.0; ALL]; ALL];
        for (z, weight) in GAUSS {
            for step in 0..AROUND {
                // To the same bits with every C library: the prior's identity depends on it.
                let (sin, cos) = libm::sincos(TAU * step as f64 / AROUND as f64);
                let r = (1.0 - z * z).sqrt();
                let before = DVec3::new(r * cos, r * sin, z);
                let basis = |d: DVec3| shared::sh_basis(d.as_vec3().into()).map(f64::from);
                let (before, after) = (basis(before), basis(rotation * before));
                for (row, after) in matrix.iter_mut().zip(after) {
                    for (entry, before) in row.iter_mut().zip(before) {
                        *entry += weight * TAU / AROUND as f64 * after * before;
                    }
                }
            }
        }
        ShRotation { matrix }
    }

    /// The coefficients of the turned scene.
    pub fn turn(&self, sh: &[[f64; 3]; ALL]) -> [[f64; 3]; ALL] {
        // Functions of different degrees do not mix.
        let degree = |index: usize| index.isqrt();
        std::array::from_fn(|m| {
            std::array::from_fn(|channel| {
                let same = (0..ALL).filter(|k| degree(*k) == degree(m));
                same.map(|k| self.matrix[m][k] * sh[k][channel]).sum()
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_scene_shows_the_same_from_turned_directions() {
        let rotation = DQuat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize();
        let turned = ShRotation::new(rotation);
        let sh: [[f64; 3]; ALL] =
            std::array::from_fn(|k| std::array::from_fn(|c| ((7 * k + 3 * c) as f64).sin()));
        let colour = |sh: &[[f64; 3]; ALL], d: DVec3| -> f64 {
            let basis = shared::sh_basis(d.as_vec3().into());
            basis.iter().zip(sh).map(|(b, rgb)| f64::from(*b) * rgb[1]).sum()
        };
        for step in 0..50 {
            let at = f64::from(step);
            let d = DVec3::new(at.sin(), (1.7 * at).cos(), (0.3 * at).sin()).normalize();
            let (before, after) = (colour(&sh, d), colour(&turned.turn(&sh), rotation * d));
            assert!((before - after).abs() < 2e-6, "{before} {after}");
            assert!((before - colour(&sh, rotation * d)).abs() > 1e-4);
        }
    }
}
