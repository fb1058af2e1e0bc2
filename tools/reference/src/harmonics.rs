//! Real spherical harmonics, degrees 0–3, as polynomials of the unit direction. Signs and constants
//! as in Inria's trainer. Written as tables of monomials, from which the gradients follow
//! mechanically.

use glam::DVec3;

/// `coefficient · xᵃ yᵇ zᶜ`.
type Monomial = (f64, [u8; 3]);

const C0: f64 = 0.282_094_791_773_878_1;
const C1: f64 = 0.488_602_511_902_919_9;
const C2: [f64; 3] = [1.092_548_430_592_079_2, 0.315_391_565_252_52, 0.546_274_215_296_039_6];
const C3: [f64; 5] = [
    0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    1.445_305_721_320_277,
];

const BASIS: [&[Monomial]; 16] = [
    &[(C0, [0, 0, 0])],
    &[(-C1, [0, 1, 0])],
    &[(C1, [0, 0, 1])],
    &[(-C1, [1, 0, 0])],
    &[(C2[0], [1, 1, 0])],
    &[(-C2[0], [0, 1, 1])],
    &[(2.0 * C2[1], [0, 0, 2]), (-C2[1], [2, 0, 0]), (-C2[1], [0, 2, 0])],
    &[(-C2[0], [1, 0, 1])],
    &[(C2[2], [2, 0, 0]), (-C2[2], [0, 2, 0])],
    &[(-3.0 * C3[0], [2, 1, 0]), (C3[0], [0, 3, 0])],
    &[(C3[1], [1, 1, 1])],
    &[(-4.0 * C3[2], [0, 1, 2]), (C3[2], [2, 1, 0]), (C3[2], [0, 3, 0])],
    &[(2.0 * C3[3], [0, 0, 3]), (-3.0 * C3[3], [2, 0, 1]), (-3.0 * C3[3], [0, 2, 1])],
    &[(-4.0 * C3[2], [1, 0, 2]), (C3[2], [3, 0, 0]), (C3[2], [1, 2, 0])],
    &[(C3[4], [2, 0, 1]), (-C3[4], [0, 2, 1])],
    &[(-C3[0], [3, 0, 0]), (3.0 * C3[0], [1, 2, 0])],
];

/// `xⁿ` and its derivative.
fn power(x: f64, n: u8) -> (f64, f64) {
    match n {
        0 => (1.0, 0.0),
        n => (x.powi(n.into()), f64::from(n) * x.powi(i32::from(n) - 1)),
    }
}

/// Value of basis function `k` at `d`, and its gradient if `d` is not kept at unit length.
fn basis(k: usize, d: DVec3) -> (f64, DVec3) {
    let mut sum = (0.0, DVec3::ZERO);
    for (coefficient, [a, b, c]) in BASIS[k] {
        let ((x, dx), (y, dy), (z, dz)) = (power(d.x, *a), power(d.y, *b), power(d.z, *c));
        sum.0 += coefficient * x * y * z;
        sum.1 += *coefficient * DVec3::new(dx * y * z, x * dy * z, x * y * dz);
    }
    sum
}

/// R, G, B before the offset and the clamp, and their gradients, of RGB triples `sh` at `d`.
pub fn evaluate(sh: &[f32], d: DVec3) -> ([f64; 3], [DVec3; 3]) {
    let mut rgb = [0.0; 3];
    let mut gradients = [DVec3::ZERO; 3];
    for (k, triple) in sh.chunks_exact(3).enumerate() {
        let (value, gradient) = basis(k, d);
        for (channel, coefficient) in triple.iter().enumerate() {
            rgb[channel] += f64::from(*coefficient) * value;
            gradients[channel] += f64::from(*coefficient) * gradient;
        }
    }
    (rgb, gradients)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_orthonormal_on_the_sphere() {
        // Gauss–Legendre nodes of order 4 in z and 8 equal angles: exact for degree 6.
        let nodes = [
            (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
            (0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
        ];
        let nodes = nodes.into_iter().flat_map(|(z, w)| [(z, w), (-z, w)]);
        let mut gram = [[0.0; 16]; 16];
        for (z, weight) in nodes {
            for step in 0..8 {
                let angle = std::f64::consts::TAU * f64::from(step) / 8.0;
                let r = f64::sqrt(1.0 - z * z);
                let d = DVec3::new(r * angle.cos(), r * angle.sin(), z);
                let area = weight * std::f64::consts::TAU / 8.0;
                for (i, row) in gram.iter_mut().enumerate() {
                    for (j, sum) in row.iter_mut().enumerate() {
                        *sum += area * basis(i, d).0 * basis(j, d).0;
                    }
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((value - expected).abs() < 1e-9, "⟨{i}, {j}⟩ = {value}");
            }
        }
    }
}
