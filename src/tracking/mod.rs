//! iNVS, inverse novel view synthesis: the pose at which the prior looks most like a frame.
//!
//! There is one [`Objective`]: the mean squared error over pixels and channels (the paper's eq. mse, averaged over
//! channels too). Gauss–Newton minimises it on the device ([`crate::search`]). Poses move by left perturbations
//! `T' = Exp(τ) T`. [`Objective::evaluate`] is for searches that a host leads, with one evaluation per submission.

mod agreement;
mod budget;
mod clock;
mod cold;
mod frame_info;
mod gauss_newton;
mod hypotheses;
mod measured_steps;
mod objective;
mod observability;
mod options;
mod outcome;
mod phase_correlation;
mod pose_covariance;
mod pose_estimate;
mod pyramid;
mod relocaliser;
mod schedule;
mod starts;
mod step_time;
mod tracker;

pub use agreement::{Agreement, Comparison};
pub(crate) use budget::{SearchSteps, TimeLimit};
pub use clock::Clock;
#[cfg(test)]
pub(crate) use clock::counted;
pub use frame_info::{Covariance, FrameInfo, Hint};
pub use gauss_newton::GaussNewtonOptions;
pub use hypotheses::{Hypotheses, Proposal};
pub(crate) use measured_steps::measured_steps;
pub use objective::{Evaluation, Objective};
pub use observability::Observability;
pub use options::RefineOptions;
pub use outcome::{Outcome, Stop};
pub use pose_covariance::PoseCovariance;
pub(crate) use pose_covariance::deviations;
pub use pose_estimate::PoseEstimate;
pub use pyramid::Pyramid;
pub use relocaliser::{Alike, Candidate, Places, Relocaliser};
pub use schedule::Schedule;
pub use starts::{Start, StartKind, Starts};
pub(crate) use step_time::StepTime;
pub use tracker::Tracker;
