//! Where a frame's refinement starts.
//!
//! As in the paper: the previous frame's pose if the prior, rendered there, is nearer to the frame than a threshold;
//! else the pose from outside. The pose that constant velocity predicts is a second candidate beside the previous pose.
//! A coarse level of the pyramid tells which of the two is better, at a fraction of a render. The threshold is then
//! applied to the better one at full resolution.

use crate::Pose;
use crate::geometry::Step;
use crate::render::Jacobian;
use crate::vulkan::Error;

use super::{Objective, Observability};

/// Where a start came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StartKind {
    /// The previous frame's pose.
    Previous,
    /// Constant velocity from the two frames before.
    Predicted,
    /// Supplied from outside.
    #[default]
    External,
    /// No candidate passed the threshold and nothing came from outside: the best candidate, which is unsure.
    BestOfBad,
    /// Found by the prior's key frames.
    KeyFrame,
}

impl StartKind {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            StartKind::Previous => "previous",
            StartKind::Predicted => "predicted",
            StartKind::External => "external",
            StartKind::BestOfBad => "uncertain",
            StartKind::KeyFrame => "key frame",
        }
    }
}

/// A start for the refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// The pose.
    pub pose: Pose,
    /// Where it came from.
    pub kind: StartKind,
}

/// How long the last motion is assumed to go on at most, as a multiple of its own time.
const LONGEST: f64 = 4.0;

/// Poses of the frames before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Starts {
    last: Option<Pose>,
    before_last: Option<Pose>,
    /// When the last frame was taken, if that was stated.
    last_time: Option<f64>,
    before_last_time: Option<f64>,
    /// When the next frame was taken, if that is stated.
    time: Option<f64>,
    /// Observability of the frame before, if it is known.
    observability: Option<Observability>,
}

/// Level at which candidates are compared.
const NEAR_LEVEL: usize = 2;

impl Starts {
    /// Notes the pose found for a frame. If it did not start from the frames before, it says
    /// nothing about the velocity. Directions that the picture did not determine say nothing
    /// either.
    pub fn push(&mut self, pose: Pose, start: StartKind, observability: Option<&Observability>) {
        self.observability = observability.copied();
        self.before_last_time = std::mem::replace(&mut self.last_time, self.time);
        let before = self.last.replace(pose);
        let follows = matches!(start, StartKind::Previous | StartKind::Predicted);
        self.before_last = before.filter(|_| follows);
    }

    /// Sets when the next frame was taken, seconds on any clock. `None`: frames follow each other at equal times.
    pub fn set_time(&mut self, time: Option<f64>) {
        self.time = time;
    }

    /// How many times the last motion leads to the next frame.
    fn motions(&self) -> f64 {
        let (Some(time), Some(last), Some(before)) =
            (self.time, self.last_time, self.before_last_time)
        else {
            return 1.0;
        };
        let motions = (time - last) / (last - before);
        if motions.is_finite() { motions.clamp(0.0, LONGEST) } else { 1.0 }
    }

    /// The motion in `seconds` at the last velocity; `None` if the time of the last motion is not known.
    pub(super) fn motion_of(&self, seconds: f64) -> Option<Step> {
        let (last, before) = (self.last?, self.before_last?);
        let share = seconds / (self.last_time? - self.before_last_time?);
        let motion = last.after(&before.inverse()).log();
        (share.is_finite() && share.abs() <= LONGEST).then(|| motion.map(|v| v * share))
    }

    /// The pose of the frame before.
    pub(super) fn last(&self) -> Option<Pose> {
        self.last
    }

    /// Where the search for the next frame starts: at the pose that constant velocity predicts, or else at the previous
    /// one. (Scoring both would cost an evaluation, and the coarse levels reach several frames' motion.)
    pub(super) fn near(&self) -> Option<(Pose, StartKind)> {
        let last = self.last?;
        Some(match &self.before_last {
            Some(before) => (self.predicted(&last, before), StartKind::Predicted),
            None => (last, StartKind::Previous),
        })
    }

    /// The pose that constant velocity predicts. In directions that the picture does not determine the camera is
    /// assumed to stay: nothing would ever end a drift that noise began there.
    fn predicted(&self, last: &Pose, before: &Pose) -> Pose {
        let motions = self.motions();
        match &self.observability {
            Some(observed) if observed.undetermined().next().is_some() => {
                let motion = last.after(&before.inverse()).log().map(|v| v * motions);
                last.stepped(&observed.determined(&motion))
            }
            _ if motions != 1.0 => {
                last.stepped(&last.after(&before.inverse()).log().map(|v| v * motions))
            }
            _ => last.predicted(before),
        }
    }

    /// Chooses the start of the next frame; `None` if there is neither a frame before nor a pose
    /// from outside. `threshold`: mean squared error, values in [0, 1].
    pub fn choose(
        &self,
        objective: &mut Objective,
        jacobian: Jacobian,
        external: Option<Pose>,
        threshold: f64,
    ) -> Result<Option<Start>, Error> {
        let from_outside = |pose| Start { pose, kind: StartKind::External };
        let Some((pose, kind)) = self.better_candidate(objective, jacobian)? else {
            return Ok(external.map(from_outside));
        };
        let mse = objective.evaluate(0, jacobian, &pose)?.mse();
        Ok(Some(match external {
            _ if mse < threshold => Start { pose, kind },
            Some(pose) => from_outside(pose),
            None => Start { pose, kind: StartKind::BestOfBad },
        }))
    }

    /// The better of the previous pose and the predicted one, by a coarse level.
    fn better_candidate(
        &self,
        objective: &mut Objective,
        jacobian: Jacobian,
    ) -> Result<Option<(Pose, StartKind)>, Error> {
        let Some(last) = self.last else { return Ok(None) };
        let Some(before) = self.before_last else {
            return Ok(Some((last, StartKind::Previous)));
        };
        let predicted = self.predicted(&last, &before);
        let level = NEAR_LEVEL.min(objective.levels() - 1);
        let stay = objective.evaluate(level, jacobian, &last)?.mse();
        let go_on = objective.evaluate(level, jacobian, &predicted)?.mse();
        let predicted_is_better = go_on < stay;
        Ok(Some(if predicted_is_better {
            (predicted, StartKind::Predicted)
        } else {
            (last, StartKind::Previous)
        }))
    }
}
