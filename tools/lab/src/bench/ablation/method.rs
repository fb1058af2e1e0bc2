//! The methods that are compared, and what a search by one comes to.

use nvsprior::Pose;
use nvsprior_paper::Optimizer;

use super::super::context::Sample;

/// A loss with an optimiser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The mean squared error, by an optimiser.
    Mse(Optimizer),
    /// The matching loss: see [`super::matching`].
    Matching,
}

impl Method {
    pub const BFGS: Method = Method::Mse(Optimizer::Bfgs);
    pub const ADAM: Method = Method::Mse(Optimizer::Adam);
    pub const ADAM_BFGS: Method = Method::Mse(Optimizer::AdamBfgs);
    pub const GAUSS_NEWTON: Method = Method::Mse(Optimizer::GaussNewton);

    /// Adam comes before Adam→BFGS, which goes on from it.
    pub const ALL: [Method; 5] =
        [Method::BFGS, Method::GAUSS_NEWTON, Method::Matching, Method::ADAM, Method::ADAM_BFGS];

    pub fn name(self) -> &'static str {
        match self {
            Method::Mse(optimizer) => optimizer.name(),
            Method::Matching => "matching",
        }
    }

    pub fn loss(self) -> &'static str {
        match self {
            Method::Mse(_) => "mse",
            Method::Matching => "matching",
        }
    }

    /// Whether a search takes hundreds of renders.
    pub fn slow(self) -> bool {
        matches!(self, Method::ADAM | Method::ADAM_BFGS)
    }
}

/// What a search came to and what it took.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// As a packet holds it.
    pub pose: Pose,
    /// Evaluations of the loss, at any level.
    pub iterations: usize,
    /// Renders at full resolution, the final picture included.
    pub full_renders: u32,
    /// From the frame to pose and final picture.
    pub milliseconds: f64,
    /// Of a forward render just before.
    pub forward_ms: f64,
    pub stop: String,
}

impl Attempt {
    pub fn of(sample: &Sample) -> Attempt {
        Attempt {
            pose: sample.pose,
            iterations: sample.trace.len(),
            full_renders: sample.stats.full_renders,
            milliseconds: sample.frame_ms(),
            forward_ms: sample.forward_ms,
            stop: format!("{:?}", sample.stats.stop).to_lowercase(),
        }
    }

    pub fn in_forward_renders(&self) -> f64 {
        self.milliseconds / self.forward_ms
    }

    /// Adds up this search and `first`, which it went on from. The picture of `first` was not needed.
    pub fn after(self, first: &Attempt) -> Attempt {
        Attempt {
            iterations: first.iterations + self.iterations,
            full_renders: first.full_renders.saturating_sub(1) + self.full_renders,
            milliseconds: first.milliseconds + self.milliseconds,
            ..self
        }
    }
}
