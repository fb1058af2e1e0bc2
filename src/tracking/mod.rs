//! iNVS, inverse novel view synthesis: the pose at which the prior looks most like a frame.
//!
//! There is one [`Objective`]: the mean squared error over pixels and channels (the paper's eq. mse, averaged over
//! channels too). Four optimisers minimise it. Poses move by left perturbations `T' = Exp(τ) T`; all optimisers work on
//! τ. Gauss–Newton runs on the device ([`crate::search`]). The host leads BFGS and Adam, the paper's choices, with one
//! evaluation per submission.

mod adam;
mod agreement;
mod bfgs;
mod cold;
mod found;
mod gauss_newton;
mod hypotheses;
mod known;
mod line_search;
mod objective;
mod observability;
mod phase_correlation;
mod pyramid;
mod relocaliser;
mod starts;
mod tracker;

pub use adam::AdamOptions;
pub use agreement::{Agreement, Comparison};
pub use bfgs::BfgsOptions;
pub use found::Found;
pub use gauss_newton::{GaussNewtonOptions, Schedule};
pub use hypotheses::{Hypotheses, Proposal};
pub use known::{Covariance, Hint, Known};
pub use objective::{Evaluation, Objective};
pub use observability::Observability;
pub use pyramid::Pyramid;
pub use relocaliser::{Candidate, Relocaliser};
pub use starts::{Start, StartKind, Starts};
pub use tracker::Tracker;

use cold::ColdStart;

use crate::Pose;
use crate::render::{Jacobian, SortPrecision};

/// Which optimiser refines the pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Optimizer {
    /// Gauss–Newton with Levenberg–Marquardt damping, over the pyramid.
    #[default]
    GaussNewton,
    /// BFGS at full resolution, the paper's choice.
    Bfgs,
    /// Adam at full resolution.
    Adam,
    /// Adam until it converges, then BFGS.
    AdamBfgs,
}

impl Optimizer {
    /// Name in reports and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Optimizer::GaussNewton => "gauss-newton",
            Optimizer::Bfgs => "bfgs",
            Optimizer::Adam => "adam",
            Optimizer::AdamBfgs => "adam-bfgs",
        }
    }
}

/// Options of the refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineOptions {
    /// The optimiser.
    pub optimizer: Optimizer,
    /// Jacobian of Gauss–Newton; the gradient methods always use the exact one.
    pub jacobian: Jacobian,
    /// How finely Gauss–Newton's evaluations tell depths apart. Final pictures are always exact.
    pub sort_precision: SortPrecision,
    /// Options of Gauss–Newton.
    pub gauss_newton: GaussNewtonOptions,
    /// Options of BFGS.
    pub bfgs: BfgsOptions,
    /// Options of Adam.
    pub adam: AdamOptions,
    /// Renders, of any level, that one frame may take to search afresh. A search that has begun is finished, even if it
    /// takes more. If the frame finds no pose, the next frame searches again.
    pub lost_renders: u32,
    /// Whether a fresh search may also mask what does not agree.
    pub masks: bool,
}

impl Default for RefineOptions {
    fn default() -> Self {
        RefineOptions {
            optimizer: Optimizer::default(),
            jacobian: Jacobian::Flow,
            sort_precision: SortPrecision::default(),
            gauss_newton: GaussNewtonOptions::default(),
            bfgs: BfgsOptions::default(),
            adam: AdamOptions::default(),
            lost_renders: 96,
            masks: true,
        }
    }
}

impl RefineOptions {
    /// The Jacobian that a refinement with these options asks a renderer for.
    pub fn jacobian(&self) -> Jacobian {
        match self.optimizer {
            Optimizer::GaussNewton => self.jacobian,
            _ => Jacobian::Exact,
        }
    }
}

/// Why an optimiser stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stop {
    /// The gradient is below its tolerance.
    Gradient,
    /// The step or the decrease that it brought is below its tolerance.
    Progress,
    /// No step along the direction decreased the error.
    NoDescent,
    /// The number of iterations is used up.
    #[default]
    Iterations,
}

/// What an optimiser found: never worse than its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The best pose seen at full resolution.
    pub pose: Pose,
    /// Its mean squared error at full resolution.
    pub mse: f64,
    /// Why the search ended.
    pub stop: Stop,
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn scaled(a: &[f64; 6], factor: f64) -> [f64; 6] {
    a.map(|v| v * factor)
}

/// Turns a step whose translation is in units of `length` into one in the prior's unit. Also turns a gradient with
/// respect to the second into one with respect to the first.
fn moved_in(length: f64, step: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| if i < 3 { step[i] * length } else { step[i] })
}

fn minus(a: &[f64; 6], b: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Largest absolute component; a NaN counts as infinite.
fn norm_max(a: &[f64; 6]) -> f64 {
    a.iter().fold(0.0, |m: f64, v| if v.is_nan() { f64::INFINITY } else { m.max(v.abs()) })
}
