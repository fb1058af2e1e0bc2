//! BFGS as in the paper: pytorch-minimize's, strong Wolfe line search, identity as the first inverse Hessian, rescaled
//! before its first update. τ is relative to the current pose. So a step along `d` is `Exp(t d) T`, and its slope is
//! the gradient's product with `d`, for every t. Translations are measured in the prior's own length, so that the first
//! inverse Hessian does not depend on the prior's unit.

use nvsprior::Pose;
use nvsprior::render::Jacobian;
use nvsprior::vulkan::Error;

use super::line_search::{Point, strong_wolfe};
use super::vectors::{dot, length, minus, moved_in, norm_max, scaled};
use nvsprior::tracking::{Objective, Outcome, Stop};

/// Options of BFGS.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BfgsOptions {
    /// Stop if the gradient's largest component is below this (paper: 1e-5).
    pub gradient_tolerance: f64,
    /// Stop if the step's largest component is below this (paper: 1e-6).
    pub parameter_tolerance: f64,
    /// Stop if the error changes by less than this: pytorch-minimize's own default. With the paper's 1e-6 here, too,
    /// the search would end early (docs/decisions.md, 3).
    pub change_tolerance: f64,
    /// Most iterations; pytorch-minimize's default is 200 a parameter.
    pub iterations: u32,
}

impl Default for BfgsOptions {
    fn default() -> Self {
        BfgsOptions {
            gradient_tolerance: 1e-5,
            parameter_tolerance: 1e-6,
            change_tolerance: 1e-9,
            iterations: 1200,
        }
    }
}

/// A slope above minus this is no descent.
const SLOPE_TOLERANCE: f64 = 1e-9;
/// A curvature `yᵀs` below this does not update the inverse Hessian.
const CURVATURE_MIN: f64 = 1e-10;

/// What the line search carries along.
#[derive(Clone, Copy)]
struct Evaluated {
    pose: Pose,
    gradient: [f64; 6],
}

pub(super) fn minimise(
    objective: &mut Objective,
    start: &Pose,
    options: &BfgsOptions,
) -> Result<Outcome, Error> {
    let length = length(objective);
    let mut evaluate = |pose: &Pose| {
        let equations = objective.evaluate(0, Jacobian::Exact, pose)?;
        Ok::<_, Error>((equations.mse(), moved_in(length, &equations.gradient())))
    };
    let (mut f, gradient) = evaluate(start)?;
    let mut place = Evaluated { pose: *start, gradient };
    let mut hessian = InverseHessian::new();
    let mut t = (1.0 / gradient.iter().map(|g| g.abs()).sum::<f64>()).min(1.0);
    let outcome = |place: Evaluated, mse, stop| Ok(Outcome { pose: place.pose, mse, stop });
    for _ in 0..options.iterations {
        let direction = hessian.direction(&place.gradient);
        let slope = dot(&place.gradient, &direction);
        if !(slope <= -SLOPE_TOLERANCE) {
            return outcome(place, f, Stop::NoDescent);
        }
        let from = Point { t: 0.0, f, slope, payload: place };
        let found = strong_wolfe(from, t, norm_max(&direction), |t| {
            let pose = place.pose.stepped(&moved_in(length, &scaled(&direction, t)));
            let (f, gradient) = evaluate(&pose)?;
            Ok(Point {
                t,
                f,
                slope: dot(&gradient, &direction),
                payload: Evaluated { pose, gradient },
            })
        })?;
        let step = scaled(&direction, found.t);
        hessian.update(&step, &minus(&found.payload.gradient, &place.gradient));
        let moved = norm_max(&step) > options.parameter_tolerance;
        let changed = (f - found.f).abs() > options.change_tolerance;
        (place, f, t) = (found.payload, found.f, 1.0);
        if !(moved && changed) {
            return outcome(place, f, Stop::Progress);
        }
        if norm_max(&place.gradient) <= options.gradient_tolerance {
            return outcome(place, f, Stop::Gradient);
        }
    }
    outcome(place, f, Stop::Iterations)
}

/// The approximation of the inverse Hessian.
struct InverseHessian {
    h: [[f64; 6]; 6],
    updated: bool,
}

impl InverseHessian {
    fn new() -> InverseHessian {
        let h = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
        InverseHessian { h, updated: false }
    }

    fn times(&self, v: &[f64; 6]) -> [f64; 6] {
        std::array::from_fn(|i| dot(&self.h[i], v))
    }

    fn direction(&self, gradient: &[f64; 6]) -> [f64; 6] {
        scaled(&self.times(gradient), -1.0)
    }

    /// `H ← (I − ρ s yᵀ) H (I − ρ y sᵀ) + ρ s sᵀ` (Nocedal & Wright, eq. 6.17).
    fn update(&mut self, s: &[f64; 6], y: &[f64; 6]) {
        let curvature = dot(s, y);
        if !(curvature > CURVATURE_MIN) {
            return;
        }
        if !self.updated {
            let first = curvature / dot(y, y);
            self.h.iter_mut().flatten().for_each(|v| *v *= first);
            self.updated = true;
        }
        let rho = 1.0 / curvature;
        let hy = self.times(y);
        let yhy = dot(y, &hy);
        for i in 0..6 {
            for j in 0..6 {
                self.h[i][j] +=
                    rho * (1.0 + rho * yhy) * s[i] * s[j] - rho * (hy[i] * s[j] + s[i] * hy[j]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_update_meets_the_secant_equation() {
        let mut hessian = InverseHessian::new();
        let pairs = [
            ([0.1, 0.2, -0.1, 0.3, 0.0, 0.05], [0.4, 0.3, -0.2, 0.5, 0.1, 0.2]),
            ([-0.2, 0.1, 0.1, 0.0, 0.3, 0.1], [-0.1, 0.3, 0.2, 0.1, 0.9, 0.3]),
        ];
        for (s, y) in pairs {
            hessian.update(&s, &y);
            let hy = hessian.times(&y);
            assert!((0..6).all(|i| (hy[i] - s[i]).abs() < 1e-12));
        }
    }

    #[test]
    fn negative_curvature_changes_nothing() {
        let mut hessian = InverseHessian::new();
        hessian.update(&[1.0; 6], &[-1.0; 6]);
        assert_eq!(hessian.direction(&[1.0; 6]), [-1.0; 6]);
    }
}
