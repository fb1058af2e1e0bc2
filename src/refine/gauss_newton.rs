//! Gauss–Newton with Levenberg–Marquardt damping (Marquardt 1963; the damping's update after
//! Nielsen 1999), from the pyramid's coarse levels to the full picture.

use crate::Pose;
use crate::render::{Jacobian, NormalEquations};
use crate::vulkan::Error;

use super::{Objective, Outcome, Stop};

/// Options of Gauss–Newton.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussNewtonOptions {
    /// A level is done where the next step is expected to lower the error by less than this share.
    pub coarse_tolerance: f64,
    /// The same at full resolution; 1e-3 is 0.004 dB.
    pub tolerance: f64,
    /// Most renders of a coarse level.
    pub coarse_renders: u32,
    /// Most renders at full resolution.
    pub renders: u32,
    /// First damping, relative to the diagonal of JᵀJ.
    pub damping: f64,
}

impl Default for GaussNewtonOptions {
    fn default() -> Self {
        GaussNewtonOptions {
            coarse_tolerance: 2e-3,
            tolerance: 2e-4,
            coarse_renders: 20,
            renders: 20,
            damping: 1e-3,
        }
    }
}

/// The search's place: a pose with its normal equations.
#[derive(Clone, Copy)]
struct Place {
    pose: Pose,
    equations: NormalEquations,
}

/// Minimises from level `coarsest` down to level 0.
pub(super) fn minimise(
    objective: &mut Objective,
    start: &Pose,
    coarsest: usize,
    jacobian: Jacobian,
    options: &GaussNewtonOptions,
) -> Result<Outcome, Error> {
    let coarsest = coarsest.min(objective.levels() - 1);
    let (pose, next) = if coarsest > HYPOTHESIS_LEVEL {
        let pose = best_hypothesis(objective, start, coarsest, jacobian, options)?;
        (pose, HYPOTHESIS_LEVEL - 1)
    } else {
        (*start, coarsest)
    };
    let pose = descend(objective, &pose, (1..=next).rev(), jacobian, options)?.pose;
    let (tolerance, renders) = (options.tolerance, options.renders);
    let search = Search { level: 0, jacobian, tolerance, renders, damping: options.damping };
    let (place, stop) = search.run(objective, &pose)?;
    Ok(Outcome { pose: place.pose, mse: place.equations.mse(), stop })
}

/// Level down to which several starts are followed, where the search begins above it.
const HYPOTHESIS_LEVEL: usize = 2;
/// Most rounds of phase correlation.
const TURNS: usize = 3;

/// Follows the start itself and the start turned by phase correlation down to
/// [`HYPOTHESIS_LEVEL`]; the better of the two there. A coarse level's wrong valley catches the one
/// or the other, rarely both, and coarse levels cost little.
fn best_hypothesis(
    objective: &mut Objective,
    start: &Pose,
    coarsest: usize,
    jacobian: Jacobian,
    options: &GaussNewtonOptions,
) -> Result<Pose, Error> {
    let levels = || (HYPOTHESIS_LEVEL..=coarsest).rev();
    let plain = descend(objective, start, levels(), jacobian, options)?;
    let mut turned = *start;
    let mut error = objective.evaluate(HYPOTHESIS_LEVEL, jacobian, start)?.square;
    for _ in 0..TURNS {
        let next = objective.turned(&turned)?;
        if next == turned {
            break;
        }
        let next_error = objective.evaluate(HYPOTHESIS_LEVEL, jacobian, &next)?.square;
        if !(next_error < error) {
            break;
        }
        (turned, error) = (next, next_error);
    }
    let level = HYPOTHESIS_LEVEL;
    let turned = descend(objective, &turned, level..=level, jacobian, options)?;
    let better = if turned.square < plain.square { turned } else { plain };
    Ok(better.pose)
}

/// A pose with its Σ r² at the level that found it.
struct Found {
    pose: Pose,
    square: f64,
}

/// Searches level after level; an infinite error where there is none.
fn descend(
    objective: &mut Objective,
    start: &Pose,
    levels: impl Iterator<Item = usize>,
    jacobian: Jacobian,
    options: &GaussNewtonOptions,
) -> Result<Found, Error> {
    let mut found = Found { pose: *start, square: f64::INFINITY };
    for level in levels {
        let (tolerance, renders) = (options.coarse_tolerance, options.coarse_renders);
        let search = Search { level, jacobian, tolerance, renders, damping: options.damping };
        let (place, _) = search.run(objective, &found.pose)?;
        found = Found { pose: place.pose, square: place.equations.square };
    }
    Ok(found)
}

/// One level's search.
struct Search {
    level: usize,
    jacobian: Jacobian,
    tolerance: f64,
    renders: u32,
    damping: f64,
}

impl Search {
    fn run(&self, objective: &mut Objective, start: &Pose) -> Result<(Place, Stop), Error> {
        let equations = objective.evaluate(self.level, self.jacobian, start)?;
        let mut place = Place { pose: *start, equations };
        let mut damping = self.damping;
        let mut growth = 2.0;
        for _ in 1..self.renders {
            let Some((step, expected)) = damped_step(&place.equations, damping) else {
                return Ok((place, Stop::NoDescent));
            };
            if !(expected > self.tolerance * place.equations.square) {
                return Ok((place, Stop::Progress));
            }
            let pose = place.pose.stepped(&step);
            let equations = objective.evaluate(self.level, self.jacobian, &pose)?;
            let ratio = (place.equations.square - equations.square) / expected;
            if ratio > 0.0 {
                place = Place { pose, equations };
                damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).max(1.0 / 3.0);
                growth = 2.0;
            } else {
                damping *= growth;
                growth *= 2.0;
            }
        }
        Ok((place, Stop::Iterations))
    }
}

/// The step of `(JᵀJ + λ diag JᵀJ) δ = −Jᵀr` and the decrease of Σ r² that the quadratic model expects
/// of it. Directions that the picture does not determine at all get no step. `None` where there is
/// nothing to step along.
fn damped_step(equations: &NormalEquations, damping: f64) -> Option<([f64; 6], f64)> {
    let largest = (0..6).map(|i| equations.jtj[i][i]).fold(0.0, f64::max);
    if !(largest > 0.0) {
        return None;
    }
    // Scaled to a unit diagonal, the system does not know the prior's unit of length.
    let scale: [f64; 6] = std::array::from_fn(|i| {
        let d = equations.jtj[i][i];
        if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }
    });
    let matrix: [[f64; 6]; 6] = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let damped = if i == j { damping } else { 0.0 };
            let unit = if i == j && scale[i] == 0.0 { 1.0 } else { 0.0 };
            equations.jtj[i][j] * scale[i] * scale[j] + damped + unit
        })
    });
    let right: [f64; 6] = std::array::from_fn(|i| -equations.jtr[i] * scale[i]);
    let solution = solve(&matrix, &right)?;
    let step: [f64; 6] = std::array::from_fn(|i| solution[i] * scale[i]);
    // 2 δᵀ(−Jᵀr) − δᵀ JᵀJ δ, with JᵀJ δ taken from the system: all terms positive.
    let expected: f64 = (0..6).map(|i| solution[i] * (right[i] + damping * solution[i])).sum();
    (step.iter().all(|v| v.is_finite()) && expected.is_finite()).then_some((step, expected))
}

/// Solves a symmetric positive definite system by Cholesky's factorisation; `None` where it is not.
fn solve(a: &[[f64; 6]; 6], b: &[f64; 6]) -> Option<[f64; 6]> {
    let mut l = [[0.0; 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            if i == j {
                let d = a[i][i] - sum;
                if !(d > 0.0) {
                    return None;
                }
                l[i][i] = d.sqrt();
            } else {
                l[i][j] = (a[i][j] - sum) / l[j][j];
            }
        }
    }
    let mut x = *b;
    for i in 0..6 {
        let sum: f64 = (0..i).map(|k| l[i][k] * x[k]).sum();
        x[i] = (x[i] - sum) / l[i][i];
    }
    for i in (0..6).rev() {
        let sum: f64 = (i + 1..6).map(|k| l[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / l[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn equations(scale: [f64; 6]) -> NormalEquations {
        // JᵀJ of three rows of a known J, in units scaled per parameter.
        let rows = [
            [1.0, 0.2, -0.3, 0.5, 0.1, 0.0],
            [0.0, 1.5, 0.4, -0.2, 0.3, 0.1],
            [0.3, -0.1, 0.8, 0.2, -0.6, 0.9],
            [0.1, 0.4, 0.2, 1.1, 0.0, -0.5],
            [-0.2, 0.3, 0.1, 0.4, 0.9, 0.2],
            [0.6, -0.4, 0.1, 0.0, 0.2, 1.3],
        ];
        let residual = [0.3, -0.2, 0.5, 0.1, -0.4, 0.2];
        let j = |r: usize, c: usize| rows[r][c] * scale[c];
        let at = |a: usize, b: usize| (0..6).map(|r| j(r, a) * j(r, b)).sum();
        NormalEquations {
            jtj: std::array::from_fn(|a| std::array::from_fn(|b| at(a, b))),
            jtr: std::array::from_fn(|a| (0..6).map(|r| j(r, a) * residual[r]).sum()),
            square: residual.iter().map(|r| r * r).sum(),
            residuals: 6,
        }
    }

    #[test]
    fn an_undamped_step_solves_a_linear_problem() {
        let e = equations([1.0; 6]);
        let (step, expected) = damped_step(&e, 0.0).unwrap();
        for row in 0..6 {
            let sum: f64 = (0..6).map(|c| e.jtj[row][c] * step[c]).sum();
            assert!((sum + e.jtr[row]).abs() < 1e-10);
        }
        assert!((expected - e.square).abs() < 1e-9, "six rows, six unknowns: no residual is left");
    }

    #[test]
    fn a_step_does_not_depend_on_units() {
        let units = [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0];
        let (a, ea) = damped_step(&equations([1.0; 6]), 0.1).unwrap();
        let (b, eb) = damped_step(&equations(units), 0.1).unwrap();
        assert!((ea - eb).abs() < 1e-9);
        assert!((0..6).all(|i| (a[i] - b[i] * units[i]).abs() < 1e-9));
    }

    #[test]
    fn what_the_picture_does_not_determine_gets_no_step() {
        let e = equations([1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
        let (step, _) = damped_step(&e, 1e-3).unwrap();
        assert_eq!((step[1], step[4]), (0.0, 0.0));
        assert!(damped_step(&equations([0.0; 6]), 1e-3).is_none());
    }
}
