//! Adam (Kingma & Ba 2015) as in the paper: learning rate 1e-3, halved after three epochs without improvement. τ is
//! relative to the current pose; its translation is measured in the prior's own length.

use nvsprior::Pose;
use nvsprior::render::Jacobian;
use nvsprior::vulkan::Error;

use super::vectors::{length, moved_in, norm_max};
use nvsprior::tracking::{Objective, Outcome, Stop};

/// Options of Adam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamOptions {
    /// First learning rate (paper: 1e-3).
    pub rate: f64,
    /// Epochs without improvement after which the rate is halved (paper: 3).
    pub patience: u32,
    /// Stop if the gradient's largest component is below this.
    pub gradient_tolerance: f64,
    /// Stop if the step's largest component is below this.
    pub parameter_tolerance: f64,
    /// Most epochs.
    pub epochs: u32,
}

impl Default for AdamOptions {
    fn default() -> Self {
        AdamOptions {
            rate: 1e-3,
            patience: 3,
            gradient_tolerance: 1e-5,
            parameter_tolerance: 1e-6,
            epochs: 1000,
        }
    }
}

const BETA1: f64 = 0.9;
const BETA2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

pub(super) fn minimise(
    objective: &mut Objective,
    start: &Pose,
    options: &AdamOptions,
) -> Result<Outcome, Error> {
    let length = length(objective);
    let mut pose = *start;
    let mut best = Outcome { pose, mse: f64::INFINITY, stop: Stop::Iterations };
    let (mut mean, mut variance) = ([0.0; 6], [0.0; 6]);
    let (mut rate, mut since_best) = (options.rate, 0);
    for epoch in 1..=options.epochs {
        let equations = objective.evaluate(0, Jacobian::Exact, &pose)?;
        let gradient = moved_in(length, &equations.gradient());
        if equations.mse() < best.mse || epoch == 1 {
            best = Outcome { pose, mse: equations.mse(), ..best };
            since_best = 0;
        } else {
            since_best += 1;
        }
        // PyTorch's ReduceLROnPlateau: more than `patience` epochs in a row.
        if since_best > options.patience {
            rate *= 0.5;
            since_best = 0;
        }
        if norm_max(&gradient) <= options.gradient_tolerance {
            return Ok(Outcome { stop: Stop::Gradient, ..best });
        }
        let step: [f64; 6] = std::array::from_fn(|i| {
            mean[i] = BETA1 * mean[i] + (1.0 - BETA1) * gradient[i];
            variance[i] = BETA2 * variance[i] + (1.0 - BETA2) * gradient[i] * gradient[i];
            let m = mean[i] / (1.0 - BETA1.powi(epoch as i32));
            let v = variance[i] / (1.0 - BETA2.powi(epoch as i32));
            -rate * m / (v.sqrt() + EPSILON)
        });
        if !(norm_max(&step) > options.parameter_tolerance) {
            return Ok(Outcome { stop: Stop::Progress, ..best });
        }
        pose = pose.stepped(&moved_in(length, &step));
    }
    Ok(best)
}
