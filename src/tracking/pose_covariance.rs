//! How far a pose may be off: its covariance, from the blocks of a picture.
//!
//! The normal equations take residuals for independent noise of single pixels. They are errors of the prior and of the
//! light, alike over whole areas. So the picture is cut into blocks. With `H = Σ H_b` and each block's gradient `g_b`
//! at the optimum, `H⁻¹ (Σ g_b g_bᵀ) H⁻¹` is the covariance, whatever the errors inside a block have in common (White,
//! "Maximum Likelihood Estimation of Misspecified Models", Econometrica 50, 1982; by blocks: Liang and Zeger,
//! Biometrika 73, 1986). It knows nothing of errors that all blocks have in common: a doubt multiplies it for them.

use crate::geometry::Twist;
use crate::render::{NormalEquations, TileSums};
use crate::shared::SUMS;

use super::Covariance;
use super::observability::{NUMERICAL, eigen};

/// Blocks along the picture's longer side.
const BLOCKS: usize = 5;
/// If the pose may be off along a direction by more than this, in lengths of the scene and radians, the direction is
/// open.
const OPEN: f64 = 0.3;
/// An axis is open if an open direction has more than this part along it.
const PART: f64 = 0.05;
/// Variance of a direction that no block reacts to.
const UNBOUND: f64 = 1e12;

type Sums = [f64; SUMS as usize];

/// The covariance of a pose as one picture tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseCovariance {
    /// Length of the scene, in the prior's unit: see [`Observability::length`](super::Observability::length).
    length: f64,
    /// Of `(ρ/length, θ)`.
    scaled: Covariance,
}

impl Default for PoseCovariance {
    /// Nothing is known.
    fn default() -> PoseCovariance {
        let mut scaled = [[0.0; 6]; 6];
        (0..6).for_each(|i| scaled[i][i] = UNBOUND);
        PoseCovariance { length: 1.0, scaled }
    }
}

impl PoseCovariance {
    /// Judges by the tiles' sums at a pose that is one step of Gauss–Newton from the optimum. `length`: the scene's;
    /// `mse`: the mean squared error over all residuals.
    pub(super) fn of(tiles: &TileSums, length: f64, mse: f64) -> PoseCovariance {
        if !(length > 0.0 && mse.is_finite()) {
            return PoseCovariance::default();
        }
        let mut blocks = [[0.0; SUMS as usize]; BLOCKS * BLOCKS];
        sum_blocks(tiles, &mut blocks);
        let blocks = blocks.map(|sums| Block::of(&sums, length));
        let mut all = Block::default();
        blocks.iter().for_each(|block| all.add(block));
        let spectrum = Spectrum::of(&all.curvature);
        let step = spectrum.inverse_times(&all.gradient).map(|v| -v);
        let mut scaled = spectrum.noise(mse);
        for block in &blocks {
            let gradient = block.gradient_after(&step);
            add_square(&mut scaled, &spectrum.inverse_times(&gradient), 1.0);
        }
        match scaled.as_flattened().iter().all(|value| value.is_finite()) {
            true => PoseCovariance { length, scaled },
            false => PoseCovariance::default(),
        }
    }

    /// The covariance that is stated, of ρ in the prior's unit and θ in radians. Along the axes of an open direction it
    /// is infinite. `doubt`: how many times further off the pose may be than the blocks tell.
    pub(super) fn stated(&self, doubt: f64) -> Covariance {
        let (values, directions) = eigen(self.scaled);
        let (mut scaled, mut open) = ([[0.0; 6]; 6], [false; 6]);
        for (value, direction) in values.iter().zip(&directions) {
            let variance = value.max(0.0) * doubt * doubt;
            if variance <= OPEN * OPEN {
                add_square(&mut scaled, direction, variance);
            } else {
                open.iter_mut().zip(direction).for_each(|(open, part)| *open |= part.abs() > PART);
            }
        }
        let unit = units(self.length);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| match (open[i] || open[j], i == j) {
                (true, true) => f64::INFINITY,
                (true, false) => 0.0,
                (false, _) => scaled[i][j] * unit[i] * unit[j],
            })
        })
    }
}

/// Standard deviations of the components of a step; infinite along open axes.
pub(crate) fn deviations(covariance: &Covariance) -> Twist {
    std::array::from_fn(|i| covariance[i][i].sqrt())
}

/// What makes `(ρ, θ)` of `(ρ/length, θ)`.
fn units(length: f64) -> Twist {
    [length, length, length, 1.0, 1.0, 1.0]
}

/// The normal equations of a part of a picture, in `(ρ/length, θ)`.
#[derive(Clone, Copy, Default)]
struct Block {
    curvature: [Twist; 6],
    gradient: Twist,
}

impl Block {
    fn of(sums: &Sums, length: f64) -> Block {
        let NormalEquations { jtj, jtr, .. } = NormalEquations::from_sums(sums, 1);
        let unit = units(length);
        Block {
            curvature: std::array::from_fn(|i| {
                std::array::from_fn(|j| jtj[i][j] * unit[i] * unit[j])
            }),
            gradient: std::array::from_fn(|i| jtr[i] * unit[i]),
        }
    }

    fn add(&mut self, other: &Block) {
        for i in 0..6 {
            self.gradient[i] += other.gradient[i];
            (0..6).for_each(|j| self.curvature[i][j] += other.curvature[i][j]);
        }
    }

    fn gradient_after(&self, step: &Twist) -> Twist {
        std::array::from_fn(|i| self.gradient[i] + product(&self.curvature[i], step))
    }
}

/// The spectrum of the normal equations.
struct Spectrum {
    values: Twist,
    directions: [Twist; 6],
}

impl Spectrum {
    fn of(curvature: &[Twist; 6]) -> Spectrum {
        let (values, directions) = eigen(*curvature);
        Spectrum { values, directions }
    }

    /// Whether sums in f32 can tell a direction's eigenvalue from 0.
    fn reacts(&self, k: usize) -> bool {
        self.values[k] > NUMERICAL * self.values[5]
    }

    /// The inverse times a vector, along the directions that the picture reacts to.
    fn inverse_times(&self, vector: &Twist) -> Twist {
        let mut sum = [0.0; 6];
        for (k, direction) in self.directions.iter().enumerate().filter(|(k, _)| self.reacts(*k)) {
            let along = product(direction, vector) / self.values[k];
            sum.iter_mut().zip(direction).for_each(|(sum, part)| *sum += along * part);
        }
        sum
    }

    /// The covariance that independent noise of the residuals gives.
    fn noise(&self, mse: f64) -> Covariance {
        let mut covariance = [[0.0; 6]; 6];
        for (k, direction) in self.directions.iter().enumerate() {
            let variance = if self.reacts(k) { mse / self.values[k] } else { UNBOUND };
            add_square(&mut covariance, direction, variance);
        }
        covariance
    }
}

fn product(a: &Twist, b: &Twist) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds `factor · v vᵀ`.
fn add_square(covariance: &mut Covariance, v: &Twist, factor: f64) {
    for (row, a) in covariance.iter_mut().zip(v) {
        row.iter_mut().zip(v).for_each(|(sum, b)| *sum += factor * a * b);
    }
}

/// Adds the tiles' sums up to blocks.
fn sum_blocks(tiles: &TileSums, blocks: &mut [Sums; BLOCKS * BLOCKS]) {
    let [columns, rows] = tiles.picture();
    let side = columns.max(rows).div_ceil(BLOCKS).max(1);
    for (column, row, sums) in tiles.iter() {
        let block = &mut blocks[row / side * BLOCKS + column / side];
        block.iter_mut().zip(sums).for_each(|(sum, value)| *sum += f64::from(*value));
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::random::Random;
    use crate::shared::{Params, TILE};

    const PICTURE: [usize; 2] = [40, 20];

    /// The 28 sums of one residual with its derivative.
    fn add_residual(sums: &mut [f32], derivative: &Twist, residual: f64) {
        let row: Vec<f64> = derivative.iter().copied().chain([residual]).collect();
        let curvature = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
        let all = curvature.chain((0..7).map(|i| (i, 6)));
        sums.iter_mut().zip(all).for_each(|(sum, (i, j))| *sum += (row[i] * row[j]) as f32);
    }

    /// Sums of tiles that react to all directions but those left out, and whose residuals have a part in common in
    /// squares of `side` tiles.
    fn tiles(random: &mut Random, side: usize, open: &[usize]) -> Vec<f32> {
        let mut normal = || random.even() + random.even() + random.even();
        let [columns, rows] = PICTURE;
        let common: Vec<f64> = (0..columns * rows).map(|_| normal()).collect();
        let mut sums = vec![0.0; columns * rows * SUMS as usize];
        for (tile, sums) in sums.chunks_exact_mut(SUMS as usize).enumerate() {
            let (x, y) = (tile % columns, tile / columns);
            let shared = common[y / side * columns + x / side];
            // Near tiles react alike, so that what they have in common does not cancel.
            let lean = |i: usize| ((x * (i + 3) + y * (7 - i)) as f64 / 20.0).cos();
            for _ in 0..4 {
                let part = |i: usize| lean(i) + 0.3 * normal();
                let mut derivative: Twist = [0, 1, 2, 3, 4, 5].map(part);
                open.iter().for_each(|i| derivative[*i] = 0.0);
                add_residual(sums, &derivative, 0.02 * shared + 0.004 * normal());
            }
        }
        sums
    }

    /// How far the optimum is from the pose of the sums. All residuals have mean 0, so that is the error.
    fn error(sums: &[f32]) -> Twist {
        let mut all = Block::default();
        for sums in sums.chunks_exact(SUMS as usize) {
            let sums: Vec<f64> = sums.iter().map(|v| f64::from(*v)).collect();
            all.add(&Block::of(sums[..].try_into().unwrap(), 1.0));
        }
        Spectrum::of(&all.curvature).inverse_times(&all.gradient)
    }

    fn judged(sums: &[f32]) -> PoseCovariance {
        let [tiles_x, rows] = PICTURE.map(|side| side as u32);
        let params = Params { tiles_x, height: rows * TILE, ..Params::zeroed() };
        let tiles = TileSums { sums, params };
        PoseCovariance::of(&tiles, 1.0, 4e-4)
    }

    #[test]
    fn errors_that_blocks_have_in_common_are_counted() {
        for side in [1, 4] {
            let mut random = Random::new(7);
            let (mut squares, mut stated) = ([0.0; 6], [0.0; 6]);
            for _ in 0..60 {
                let sums = tiles(&mut random, side, &[]);
                let (error, covariance) = (error(&sums), judged(&sums).stated(1.0));
                for i in 0..6 {
                    squares[i] += error[i] * error[i] / 60.0;
                    stated[i] += covariance[i][i] / 60.0;
                }
            }
            for (square, stated) in squares.iter().zip(stated) {
                let ratio = (stated / square).sqrt();
                assert!((0.6..1.7).contains(&ratio), "side {side}: {ratio}");
            }
        }
    }

    #[test]
    fn a_direction_that_nothing_reacts_to_is_open() {
        let sums = tiles(&mut Random::new(3), 4, &[0]);
        let covariance = judged(&sums).stated(2.0);
        assert_eq!(covariance[0][0], f64::INFINITY);
        assert!((1..6).all(|i| covariance[i][i].is_finite() && covariance[0][i] == 0.0));
        let none = judged(&vec![0.0; 40 * 20 * SUMS as usize]).stated(1.0);
        assert!((0..6).all(|i| none[i][i] == f64::INFINITY));
        let broken = judged(&vec![f32::NAN; 40 * 20 * SUMS as usize]).stated(1.0);
        assert!((0..6).all(|i| broken[i][i] == f64::INFINITY), "{broken:?}");
    }

    #[test]
    fn the_unit_of_the_prior_changes_lengths_alone() {
        let sums = tiles(&mut Random::new(5), 4, &[]);
        let one = judged(&sums);
        let other = PoseCovariance { length: 1e3, ..one };
        let (one, other) = (one.stated(1.0), other.stated(1.0));
        assert!((other[0][0] / one[0][0] / 1e6 - 1.0).abs() < 1e-9);
        assert!((other[0][4] / one[0][4] / 1e3 - 1.0).abs() < 1e-9);
        assert_eq!(other[5][5], one[5][5]);
    }
}
