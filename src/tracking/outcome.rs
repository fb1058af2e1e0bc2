//! What an optimiser found.

use crate::Pose;

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
