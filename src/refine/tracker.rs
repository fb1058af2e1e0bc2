//! The pose of frame after frame: where to start, how to search, and when to start afresh.

use crate::render::view::{anchor, placement};
use crate::search::{PoseCode, STARTS, quantised};
use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::gauss_newton::{self, Schedule};
use super::{
    ColdStart, Evaluation, GaussNewtonOptions, Known, Objective, Observability, Optimizer, Outcome,
    RefineOptions, StartKind, Starts, adam, bfgs,
};

/// Hypotheses that a cold start follows. The first alone reached the optimum from each of 200 starts
/// off by up to 10° and 0.3 units; each further one costs a coarse render and more.
const HYPOTHESES: usize = 1;
/// A search whose start has an error below this many times that of its outcome was close: the next one
/// begins a level finer.
const CLOSE: f64 = 1.3;
/// Above this, the next one begins a level coarser.
const FAR: f64 = 2.0;
/// A frame that comes out at more than this many times the error of the frame before is searched for
/// again from the coarsest level: a start that is off by more than a fine level reaches looks like that.
const WORSE: f64 = 1.15;
/// A frame whose error is above this many times that of the frame before is looked for afresh.
const LOST: f64 = 1.6;
/// Going back along directions that the picture does not determine may add so much to the error.
const SETTLED: f64 = 1.01;

/// What was found for a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Pose and error.
    pub outcome: Outcome,
    /// Where the search started.
    pub start: StartKind,
    /// The pose as a packet holds it, where the search has drawn the picture there already, and the
    /// difference from the frame.
    pub drawn: Option<PoseCode>,
    /// Submissions to the device that the search took; 0 where the host led it.
    pub submissions: u32,
    /// Error at the start, at the level where the search began; not a number where the host led it.
    pub first_mse: f64,
    /// What of the pose the picture determines.
    pub observability: Observability,
    /// Where the search began.
    pub begun: Pose,
    /// Whether the picture confirms the pose.
    pub certain: bool,
}

impl Found {
    /// The one of less error. The search draws: what was found before it is drawn no more.
    fn or_last(self, last: Found) -> Found {
        let submissions = self.submissions + last.submissions;
        let better =
            if last.outcome.mse <= self.outcome.mse { last } else { Found { drawn: None, ..self } };
        Found { submissions, ..better }
    }
}

/// Finds poses of frames, in order.
pub struct Tracker {
    objective: Objective,
    options: RefineOptions,
    threshold: f64,
    profile: u32,
    cold: ColdStart,
    cold_starts: Vec<Pose>,
    starts: Starts,
    /// Error of the frame before.
    error: Option<f64>,
    /// Level of the pyramid at which the next frame's search begins, as far as its schedule lets it.
    level: usize,
}

impl Tracker {
    /// `threshold`: mean squared error, values in [0, 1], below which a frame is never looked for
    /// afresh; `profile`: how poses are coded, [`crate::search::COMPACT`] or [`crate::search::PAPER`].
    pub fn new(
        objective: Objective,
        options: RefineOptions,
        threshold: f64,
        profile: u32,
    ) -> Tracker {
        let cold = ColdStart::new(&objective);
        Tracker {
            objective,
            options,
            threshold,
            profile,
            cold,
            cold_starts: Vec::with_capacity(STARTS),
            starts: Starts::default(),
            error: None,
            level: 0,
        }
    }

    /// Goes on with another camera or device; poses carry over.
    pub fn replace(&mut self, objective: Objective) {
        self.cold = ColdStart::new(&objective);
        self.objective = objective;
    }

    /// Finds the pose of a frame; `None` where there is neither a frame before nor a hint, its pose as
    /// sensors or an estimator have it.
    ///
    /// # Panics
    /// Where the frame has not the camera's size.
    pub fn track(&mut self, frame: &Picture, known: &Known) -> Result<Option<Found>, Error> {
        self.objective.set_frame(frame);
        let external = known.hint.map(|hint| hint.pose).filter(Pose::is_finite);
        let found = if self.options.optimizer == Optimizer::GaussNewton {
            self.search(frame, external)
        } else {
            self.descend(external)
        };
        let certain = |found: &Found| found.start != StartKind::BestOfBad;
        Ok(found?.map(|found| Found { certain: certain(&found), ..found }))
    }

    /// Notes what was drawn for the frame, and what that determines of the pose where it is known, for
    /// the next one's start.
    pub fn keep(
        &mut self,
        pose: Pose,
        mse: f64,
        start: StartKind,
        observability: Option<&Observability>,
    ) {
        self.starts.push(pose, start, observability);
        self.error = Some(mse);
    }

    /// Forgets the frames before.
    pub fn reset(&mut self) {
        (self.starts, self.error, self.level) = (Starts::default(), None, 0);
    }

    /// Gauss–Newton on the device.
    fn search(&mut self, frame: &Picture, external: Option<Pose>) -> Result<Option<Found>, Error> {
        let GaussNewtonOptions { warm: schedule, cold, .. } = self.options.gauss_newton;
        let warm = self.follow(&schedule)?;
        if let Some(found) = warm
            && !self.lost(found.outcome.mse)
        {
            return self.settled(found).map(Some);
        }
        let Some(start) = external.or(self.starts.last()) else {
            return Ok(None);
        };
        let kind = if external.is_some() { StartKind::External } else { StartKind::BestOfBad };
        let searched = self.search_cold(frame, &start, &cold, &schedule);
        let mut cold = Found { start: kind, ..searched? };
        if external.is_none() && !self.lost(cold.outcome.mse) {
            // The frame before led there after all, by a longer way.
            cold.start = StartKind::Previous;
        }
        let found = match warm {
            Some(warm) => Found { start: StartKind::BestOfBad, ..warm }.or_last(cold),
            None => cold,
        };
        self.settled(found).map(Some)
    }

    /// Searches from the frames before, at a level that did for the last of them, the finest at
    /// first; again from the coarsest where that comes out worse. `None` where there are none.
    fn follow(&mut self, schedule: &Schedule) -> Result<Option<Found>, Error> {
        let Some((pose, start)) = self.starts.near() else { return Ok(None) };
        let coarsest = schedule.first_level.max(schedule.far_level);
        let first = match start {
            StartKind::Predicted => self.level.clamp(schedule.first_level, coarsest),
            // The motion between two frames is still unknown.
            _ => coarsest,
        };
        let at = |level| Schedule { first_level: level, follow_level: level, ..*schedule };
        let mut found = Found { start, ..self.from(&[pose], &at(first))? };
        if start == StartKind::Predicted {
            let ratio = found.first_mse / found.outcome.mse;
            self.level = match ratio {
                _ if ratio < CLOSE => first.saturating_sub(1),
                _ if ratio > FAR => first + 1,
                _ => first,
            };
        }
        let worse = self.error.is_some_and(|before| found.outcome.mse > WORSE * before);
        if worse && first < coarsest {
            self.level = coarsest;
            found = found.or_last(Found { start, ..self.from(&[pose], &at(coarsest))? });
        }
        Ok(Some(found))
    }

    /// Searches from the poses that phase correlation proposes for a start. It may be wrong of a picture
    /// that is small, flat, or of another scene, and a coarse level's valley may lie elsewhere: the outcome
    /// is never worse than the start.
    fn search_cold(
        &mut self,
        frame: &Picture,
        start: &Pose,
        cold: &Schedule,
        warm: &Schedule,
    ) -> Result<Found, Error> {
        let (_, begun) = self.draw(start)?;
        let mut from = std::mem::take(&mut self.cold_starts);
        let proposed = self.cold.starts(&mut self.objective, frame, start, HYPOTHESES)?;
        from.clear();
        from.extend_from_slice(proposed);
        let searched = self.from(&from, cold);
        self.cold_starts = from;
        let mut found = searched?;
        if !(found.first_mse <= self.cold.error()) {
            found = found.or_last(self.from(&[*start], cold)?);
        }
        if !(found.outcome.mse <= begun) {
            let near = Schedule { first_level: 0, follow_level: 0, far_level: 0, ..*warm };
            found = found.or_last(self.from(&[*start], &near)?);
        }
        Ok(Found { begun: *start, ..found })
    }

    /// Takes back what the search moved along directions that the picture does not determine, as long as
    /// that costs nothing: noise moved it, and over many frames it would wander off.
    fn settled(&mut self, found: Found) -> Result<Found, Error> {
        if found.observability.undetermined().next().is_none() {
            return Ok(found);
        }
        let (pose, begun) = (found.outcome.pose, found.begun);
        let motion = pose.after(&begun.inverse()).log();
        let pose = begun.stepped(&found.observability.determined(&motion));
        let (code, mse) = self.draw(&pose)?;
        if !(mse <= SETTLED * found.outcome.mse) {
            return Ok(Found { drawn: None, ..found });
        }
        let outcome = Outcome { pose, mse, ..found.outcome };
        Ok(Found { outcome, drawn: Some(code), ..found })
    }

    /// Draws a pose as a packet about it will have it drawn; its code, and the mean squared error.
    fn draw(&mut self, pose: &Pose) -> Result<(PoseCode, f64), Error> {
        let renderer = self.objective.renderer();
        let scene = renderer.scene();
        let code = quantised(&placement(scene, pose), &anchor(scene), self.profile);
        renderer.draw_coded(&code)?;
        Ok((code, gauss_newton::mse(renderer.difference())))
    }

    fn lost(&self, mse: f64) -> bool {
        mse >= self.threshold && self.error.is_none_or(|before| mse > LOST * before)
    }

    /// Searches from some poses.
    fn from(&mut self, poses: &[Pose], schedule: &Schedule) -> Result<Found, Error> {
        let damping = self.options.gauss_newton.damping;
        let tracked =
            gauss_newton::track(&mut self.objective, poses, schedule, damping, self.profile)?;
        Ok(Found {
            outcome: tracked.outcome,
            start: StartKind::External,
            drawn: Some(tracked.code),
            submissions: tracked.submissions,
            first_mse: tracked.first_mse,
            observability: tracked.observability,
            begun: poses[0],
            certain: true,
        })
    }

    /// The gradient methods, led by the host.
    fn descend(&mut self, external: Option<Pose>) -> Result<Option<Found>, Error> {
        let (objective, options) = (&mut self.objective, &self.options);
        let jacobian = options.jacobian();
        let Some(start) = self.starts.choose(objective, jacobian, external, self.threshold)? else {
            return Ok(None);
        };
        let outcome = match options.optimizer {
            Optimizer::Adam => adam::minimise(objective, &start.pose, &options.adam)?,
            Optimizer::AdamBfgs => {
                let first = adam::minimise(objective, &start.pose, &options.adam)?;
                bfgs::minimise(objective, &first.pose, &options.bfgs)?
            }
            _ => bfgs::minimise(objective, &start.pose, &options.bfgs)?,
        };
        Ok(Some(Found {
            outcome,
            start: start.kind,
            drawn: None,
            submissions: 0,
            first_mse: f64::NAN,
            observability: *self.objective.observability(),
            begun: start.pose,
            certain: true,
        }))
    }

    /// The objective, to draw with.
    pub fn objective(&mut self) -> &mut Objective {
        &mut self.objective
    }

    /// Evaluations of the last frame, in order.
    pub fn trace(&self) -> &[Evaluation] {
        self.objective.trace()
    }
}
