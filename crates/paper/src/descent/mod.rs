//! The paper's searches: gradient methods, led by the host, with one evaluation per submission.
//!
//! A search starts as in the paper: at the previous frame's pose if the prior, rendered there, is nearer to the frame
//! than a threshold; else at the pose from outside. The pose that constant velocity predicts is a second candidate
//! beside the previous pose. A coarse level of the pyramid tells which of the two is better, at a fraction of a render.
//! The threshold is then applied to the better one at full resolution.

mod adam;
mod bfgs;
mod line_search;
mod vectors;

pub use adam::AdamOptions;
pub use bfgs::BfgsOptions;

use nvsprior::Pose;
use nvsprior::render::Jacobian;
use nvsprior::tracking::{Objective, Outcome, StartKind};
use nvsprior::vulkan::Error;

/// Level at which candidates are compared.
const NEAR_LEVEL: usize = 2;

/// Which method finds the pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Optimizer {
    /// BFGS at full resolution, the paper's choice.
    #[default]
    Bfgs,
    /// Adam at full resolution.
    Adam,
    /// Adam until it converges, then BFGS.
    AdamBfgs,
    /// The engine's own: Gauss–Newton over the pyramid, on the device.
    GaussNewton,
}

impl Optimizer {
    /// Name in reports and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Optimizer::Bfgs => "bfgs",
            Optimizer::Adam => "adam",
            Optimizer::AdamBfgs => "adam-bfgs",
            Optimizer::GaussNewton => "gauss-newton",
        }
    }
}

/// Options of a search.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DescentOptions {
    /// The method.
    pub optimizer: Optimizer,
    /// Options of BFGS.
    pub bfgs: BfgsOptions,
    /// Options of Adam.
    pub adam: AdamOptions,
}

/// Minimises the error from a start, by the method that the options name; [`Optimizer::GaussNewton`] is the engine's,
/// and here is BFGS. The frame is the objective's, whose renderer must plan [`Jacobian::Exact`].
///
/// # Errors
/// If the device fails.
pub fn minimise(
    objective: &mut Objective,
    start: &Pose,
    options: &DescentOptions,
) -> Result<Outcome, Error> {
    match options.optimizer {
        Optimizer::Adam => adam::minimise(objective, start, &options.adam),
        Optimizer::AdamBfgs => {
            let first = adam::minimise(objective, start, &options.adam)?;
            bfgs::minimise(objective, &first.pose, &options.bfgs)
        }
        Optimizer::Bfgs | Optimizer::GaussNewton => bfgs::minimise(objective, start, &options.bfgs),
    }
}

/// Poses of the frames before.
#[derive(Default)]
pub(crate) struct Poses {
    last: Option<Pose>,
    /// That of the frame before the last, if the last one's search started from it.
    before_last: Option<Pose>,
}

impl Poses {
    /// A frame's pose; `follows`: its search started from a frame before.
    pub fn add(&mut self, pose: Pose, follows: bool) {
        self.before_last = self.last.filter(|_| follows);
        self.last = Some(pose);
    }
}

/// Where a search starts.
pub(crate) struct Choice {
    pub pose: Pose,
    pub kind: StartKind,
}

/// Chooses the start of the next frame; `None` if there is neither a frame before nor a pose from outside. `threshold`:
/// mean squared error, values in [0, 1].
pub(crate) fn choose_start(
    poses: &Poses,
    objective: &mut Objective,
    external: Option<Pose>,
    threshold: f64,
) -> Result<Option<Choice>, Error> {
    let from_outside = |pose| Choice { pose, kind: StartKind::External };
    let Some(Choice { pose, kind }) = better_candidate(poses, objective)? else {
        return Ok(external.map(from_outside));
    };
    let mse = objective.evaluate(0, Jacobian::Exact, &pose)?.mse();
    Ok(Some(match external {
        _ if mse < threshold => Choice { pose, kind },
        Some(pose) => from_outside(pose),
        None => Choice { pose, kind: StartKind::BestOfBad },
    }))
}

/// The better of the previous pose and the predicted one, by a coarse level.
fn better_candidate(poses: &Poses, objective: &mut Objective) -> Result<Option<Choice>, Error> {
    let Some(last) = poses.last else { return Ok(None) };
    let stay = Choice { pose: last, kind: StartKind::Previous };
    let Some(before) = poses.before_last else { return Ok(Some(stay)) };
    let go_on = Choice { pose: last.predicted(&before), kind: StartKind::Predicted };
    let level = NEAR_LEVEL.min(objective.levels() - 1);
    let mut error =
        |pose| Ok::<f64, Error>(objective.evaluate(level, Jacobian::Exact, pose)?.mse());
    Ok(Some(if error(&go_on.pose)? < error(&stay.pose)? { go_on } else { stay }))
}
