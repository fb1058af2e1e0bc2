//! Where a frame's refinement starts: at the pose that constant velocity predicts, or at the previous frame's.

use crate::Pose;
use crate::geometry::Twist;

use super::Observability;

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
    pub(super) fn motion_of(&self, seconds: f64) -> Option<Twist> {
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
    pub(super) fn predicted(&self, last: &Pose, before: &Pose) -> Pose {
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
}
