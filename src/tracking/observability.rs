//! Which directions of a pose a picture determines: the spectrum of the normal equations.
//!
//! The scene's own length makes translations and turns comparable. It is the depth at which moving
//! sideways and turning shift the picture by the same amount: `L² = tr Hθθ / tr Hρρ` with `H =
//! JᵀJ`. In `(ρ/L, θ)` nothing depends on the prior's unit. An eigenvector of `H` there is a
//! direction of motion. `√(MSE / eigenvalue)` is how far the picture's noise lets the pose wander
//! along it. This is the Cramér–Rao bound for independent residuals. Neighbouring residuals are not
//! independent, so the true deviation is more: see [`PoseCovariance`](super::PoseCovariance).

use crate::geometry::Twist;
use crate::render::NormalEquations;

/// If the pose may wander along a direction by this much, in depths of the scene and radians, the
/// picture does not determine that direction.
const LOOSE: f64 = 0.1;
/// If a direction's eigenvalue is below this share of the largest, the picture does not determine it: sums in f32
/// cannot tell it from 0.
pub(super) const NUMERICAL: f64 = 1e-6;

/// Which directions of a pose the last picture determines, and how well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observability {
    /// The scene's length `L`, in the prior's unit; 0 if the picture does not react to translations.
    pub length: f64,
    /// Standard deviations along [`directions`](Self::directions), least determined first, in lengths of the scene and
    /// radians. Infinite if the picture does not react at all.
    pub deviations: [f64; 6],
    /// Orthonormal directions `(ρ/L, θ)` in camera axes.
    pub directions: [Twist; 6],
    /// Largest eigenvalue divided by the least; infinite if the least is 0.
    pub condition: f64,
    loose: [bool; 6],
}

impl Default for Observability {
    /// Nothing is determined.
    fn default() -> Observability {
        Observability {
            length: 0.0,
            deviations: [f64::INFINITY; 6],
            directions: identity(),
            condition: f64::INFINITY,
            loose: [true; 6],
        }
    }
}

impl Observability {
    /// Judges by the normal equations at a pose.
    pub fn of(equations: &NormalEquations) -> Observability {
        let h = &equations.jtj;
        let trace = |from: usize| (from..from + 3).map(|i| h[i][i]).sum::<f64>();
        let length = (trace(3) / trace(0)).sqrt();
        if !(length.is_finite() && length > 0.0) {
            return Observability::default();
        }
        let unit = [length, length, length, 1.0, 1.0, 1.0];
        let scaled = std::array::from_fn(|i| std::array::from_fn(|j| h[i][j] * unit[i] * unit[j]));
        let (values, directions) = eigen(scaled);
        let largest = values[5];
        let mse = equations.mse();
        let deviations = values.map(|v| if v > 0.0 { (mse / v).sqrt() } else { f64::INFINITY });
        let condition = if values[0] > 0.0 { largest / values[0] } else { f64::INFINITY };
        let loose =
            std::array::from_fn(|k| !(values[k] > NUMERICAL * largest) || !(deviations[k] < LOOSE));
        Observability { length, deviations, directions, condition, loose }
    }

    /// Directions that the picture does not determine, `(ρ/L, θ)`.
    pub fn undetermined(&self) -> impl Iterator<Item = &Twist> {
        self.directions.iter().zip(self.loose).filter(|(_, loose)| *loose).map(|(d, _)| d)
    }

    /// Removes from a motion, `(ρ, θ)`, the directions that the picture does not determine.
    pub fn determined(&self, motion: &Twist) -> Twist {
        if !(self.length > 0.0) {
            return [0.0; 6];
        }
        let unit = [self.length, self.length, self.length, 1.0, 1.0, 1.0];
        let scaled: Twist = std::array::from_fn(|i| motion[i] / unit[i]);
        let mut rest = scaled;
        for direction in self.undetermined() {
            let along: f64 = scaled.iter().zip(direction).map(|(a, b)| a * b).sum();
            rest.iter_mut().zip(direction).for_each(|(r, d)| *r -= along * d);
        }
        std::array::from_fn(|i| rest[i] * unit[i])
    }
}

fn identity() -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))))
}

/// Eigenvalues of a symmetric matrix, ascending, and their eigenvectors, by Jacobi's rotations (Golub & Van Loan,
/// Matrix Computations, §8.5). Exact to rounding even if the eigenvalues lie far apart.
pub(super) fn eigen(mut a: [[f64; 6]; 6]) -> ([f64; 6], [[f64; 6]; 6]) {
    // Rows are the vectors.
    let mut v = identity();
    for _ in 0..SWEEPS {
        for p in 0..5 {
            for q in p + 1..6 {
                rotate(&mut a, &mut v, p, q);
            }
        }
    }
    let mut order = [0, 1, 2, 3, 4, 5];
    order.sort_by(|i: &usize, j: &usize| a[*i][*i].total_cmp(&a[*j][*j]));
    (order.map(|i| a[i][i]), order.map(|i| v[i]))
}

/// More sweeps than Jacobi's rotations take for a 6×6 matrix, as they converge quadratically.
const SWEEPS: usize = 12;

/// Makes `a[p][q]` zero.
fn rotate(a: &mut [[f64; 6]; 6], v: &mut [[f64; 6]; 6], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let tau = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = tau.signum() / (tau.abs() + tau.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for row in a.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    for rows in [a, v] {
        let (above, below) = rows.split_at_mut(q);
        for (x, y) in above[p].iter_mut().zip(&mut below[0]) {
            (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equations of `directions` with these eigenvalues, in a prior whose unit makes lengths `unit`
    /// times larger, and an MSE of 0.01.
    fn equations(values: [f64; 6], unit: f64) -> NormalEquations {
        let directions = turned();
        let scale = [unit, unit, unit, 1.0, 1.0, 1.0];
        let at = |i: usize, j: usize| -> f64 {
            let sum: f64 = (0..6).map(|k| values[k] * directions[k][i] * directions[k][j]).sum();
            sum / (scale[i] * scale[j])
        };
        let jtj = std::array::from_fn(|i| std::array::from_fn(|j| at(i, j)));
        NormalEquations { jtj, jtr: [0.0; 6], square: 3.0, residuals: 300 }
    }

    /// An orthonormal basis that mixes translations among themselves and turns among themselves.
    fn turned() -> [[f64; 6]; 6] {
        let (s, c) = 0.7_f64.sin_cos();
        let mut rows = identity();
        for at in [0, 3] {
            rows[at] = std::array::from_fn(|k| if k == at { c } else { 0.0 });
            rows[at][at + 1] = s;
            rows[at + 1] = std::array::from_fn(|k| if k == at + 1 { c } else { 0.0 });
            rows[at + 1][at] = -s;
        }
        rows
    }

    #[test]
    fn eigenvectors_diagonalise() {
        let values = [3.0, 1e-9, 40.0, 1e6, 7.0, 0.5];
        let e = equations(values, 1.0);
        let (found, vectors) = eigen(e.jtj);
        for (value, vector) in found.iter().zip(vectors) {
            for (row, x) in e.jtj.iter().zip(vector) {
                let product: f64 = row.iter().zip(vector).map(|(a, b)| a * b).sum();
                assert!((product - value * x).abs() < 1e-9, "{product} {value} {x}");
            }
        }
        assert!(found.windows(2).all(|w| w[0] <= w[1]));
    }

    #[test]
    fn the_unit_of_the_prior_does_not_matter() {
        let values = [300.0, 1e-2, 500.0, 200.0, 400.0, 600.0];
        let one = Observability::of(&equations(values, 1.0));
        for unit in [1e-3, 1e3] {
            let other = Observability::of(&equations(values, unit));
            assert!((other.length / one.length / unit - 1.0).abs() < 1e-9);
            assert!((other.condition / one.condition - 1.0).abs() < 1e-6);
            assert_eq!(other.undetermined().count(), one.undetermined().count());
        }
    }

    #[test]
    fn motions_keep_what_the_picture_determines() {
        let loose = Observability::of(&equations([300.0, 0.0, 500.0, 200.0, 400.0, 600.0], 1.0));
        assert_eq!(loose.undetermined().count(), 1);
        assert_eq!(loose.condition, f64::INFINITY);
        let directions = turned();
        let moved = loose.determined(&directions[1].map(|v| 3.0 * v));
        assert!(moved.iter().all(|v| v.abs() < 1e-9), "{moved:?}");
        for k in [0, 2, 3, 4, 5] {
            let moved = loose.determined(&directions[k]);
            assert!(moved.iter().zip(directions[k]).all(|(a, b)| (a - b).abs() < 1e-9));
        }
    }

    #[test]
    fn what_shows_nothing_determines_nothing() {
        let broken = NormalEquations { jtr: [f64::NAN; 6], ..equations([f64::NAN; 6], 1.0) };
        for equations in [equations([0.0; 6], 1.0), broken] {
            let none = Observability::of(&equations);
            assert_eq!(none.undetermined().count(), 6);
            assert_eq!(none.determined(&[1.0; 6]), [0.0; 6]);
        }
    }
}
