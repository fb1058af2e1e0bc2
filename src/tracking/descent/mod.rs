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

use crate::Pose;
use crate::render::Jacobian;
use crate::vulkan::Error;

use super::{Objective, Optimizer, Outcome, RefineOptions, Start, StartKind, Starts};

/// Level at which candidates are compared.
const NEAR_LEVEL: usize = 2;

/// Minimises the error from a start, by the method that the options name.
pub(super) fn minimise(
    objective: &mut Objective,
    start: &Pose,
    options: &RefineOptions,
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

/// Chooses the start of the next frame; `None` if there is neither a frame before nor a pose from outside. `threshold`:
/// mean squared error, values in [0, 1].
pub(super) fn choose_start(
    starts: &Starts,
    objective: &mut Objective,
    external: Option<Pose>,
    threshold: f64,
) -> Result<Option<Start>, Error> {
    let from_outside = |pose| Start { pose, kind: StartKind::External };
    let Some((pose, kind)) = better_candidate(starts, objective)? else {
        return Ok(external.map(from_outside));
    };
    let mse = objective.evaluate(0, Jacobian::Exact, &pose)?.mse();
    Ok(Some(match external {
        _ if mse < threshold => Start { pose, kind },
        Some(pose) => from_outside(pose),
        None => Start { pose, kind: StartKind::BestOfBad },
    }))
}

/// The better of the previous pose and the predicted one, by a coarse level.
fn better_candidate(
    starts: &Starts,
    objective: &mut Objective,
) -> Result<Option<(Pose, StartKind)>, Error> {
    let Some(last) = starts.last() else { return Ok(None) };
    let Some(before) = starts.before_last() else { return Ok(Some((last, StartKind::Previous))) };
    let predicted = starts.predicted(&last, &before);
    let level = NEAR_LEVEL.min(objective.levels() - 1);
    let stay = objective.evaluate(level, Jacobian::Exact, &last)?.mse();
    let go_on = objective.evaluate(level, Jacobian::Exact, &predicted)?.mse();
    let predicted_is_better = go_on < stay;
    Ok(Some(if predicted_is_better {
        (predicted, StartKind::Predicted)
    } else {
        (last, StartKind::Previous)
    }))
}
