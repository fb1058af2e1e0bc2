//! The pose of frame after frame: where to start, how to search, and when to start afresh.

use crate::render::Correction;
use crate::render::view::{anchor, placement};
use crate::search::{PoseCode, STARTS, quantised};
use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::gauss_newton::{self, Schedule};
use super::{
    Agreement, ColdStart, Evaluation, GaussNewtonOptions, Hint, Known, Objective, Observability,
    Optimizer, Outcome, RefineOptions, Relocaliser, StartKind, Starts, adam, bfgs,
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
/// If the picture cannot tell whether a pose is right, a frame whose error is above this many times that of
/// the frame before is looked for afresh.
const LOST: f64 = 1.6;
/// Going back along directions that the picture does not determine may add so much to the error.
const SETTLED: f64 = 1.01;
/// A pose that explains fewer of the frame's corners than this is most likely chance, and not worth a search.
/// One that explains more may still be wrong: the picture decides.
const EXPLAINED: u32 = 13;
/// Poses that key frames propose and that are looked at more closely.
const PROPOSED: usize = 4;
/// Light that differs by less is left as it is.
const LIGHT: f32 = 0.03;
/// A share of what the prior shows that is enough to look for no other pose; less is, if it is no less than
/// this share of the frame before's.
const SURE: f64 = 0.8;
const AS_BEFORE: f64 = 0.85;
/// A hint disagrees with the track beyond so many standard deviations.
const DISAGREES: f64 = 3.0;
/// Standard deviations of a hint that states none: share of the scene's depth, and radians.
const HINT_DEVIATION: [f64; 2] = [0.1, 0.1];

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
    /// How the frame agrees with the picture drawn.
    pub agreement: Agreement,
}

impl Found {
    /// The one of less error. The search draws: what was found before it is drawn no more.
    fn or_last(self, last: Found) -> Found {
        let better =
            if last.outcome.mse <= self.outcome.mse { last } else { Found { drawn: None, ..self } };
        Found { submissions: self.submissions + last.submissions, ..better }
    }

    /// The one that the frame agrees with, or the one of less error.
    fn or_judged(before: Option<Found>, last: Found) -> Found {
        let Some(before) = before else { return last };
        let rank = |f: &Found| (f.certain, -f.outcome.mse);
        let better =
            if rank(&last) >= rank(&before) { last } else { Found { drawn: None, ..before } };
        Found { submissions: before.submissions + last.submissions, ..better }
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
    relocaliser: Relocaliser,
    /// Whether a frame was certain since the start.
    good: bool,
    /// Frames since the last certain one.
    lost_frames: u32,
    /// Share of the last certain frame that agreed; infinite before the first.
    share: f64,
    /// The same of the frame under way.
    share_found: f64,
}

impl Tracker {
    /// `threshold`: mean squared error, values in [0, 1], below which a frame is never looked for
    /// afresh; `profile`: how poses are coded, [`crate::search::COMPACT`] or [`crate::search::PAPER`].
    pub fn new(
        mut objective: Objective,
        options: RefineOptions,
        threshold: f64,
        profile: u32,
    ) -> Tracker {
        let cold = ColdStart::new(&objective);
        let relocaliser = relocaliser(&mut objective, &options);
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
            relocaliser,
            good: false,
            lost_frames: 0,
            share: f64::INFINITY,
            share_found: f64::INFINITY,
        }
    }

    /// Goes on with another camera or device; poses carry over. Key frames are rendered anew.
    pub fn replace(&mut self, mut objective: Objective) {
        self.cold = ColdStart::new(&objective);
        self.relocaliser = relocaliser(&mut objective, &self.options);
        self.objective = objective;
    }

    /// Renders up to `most` of the prior's key frames that are not rendered yet, so that a lost frame need
    /// not; how many are left.
    pub fn prepare(&mut self, most: usize) -> Result<usize, Error> {
        self.relocaliser.learn(&mut self.objective, most)?;
        Ok(self.relocaliser.left())
    }

    /// Finds the pose of a frame; `None` if there is neither a frame before, nor a hint, nor a key frame
    /// that looks like it.
    ///
    /// # Panics
    /// Where the frame has not the camera's size.
    pub fn track(&mut self, frame: &Picture, known: &Known) -> Result<Option<Found>, Error> {
        self.objective.set_frame(frame);
        self.starts.set_time(known.time);
        let found = if self.options.optimizer == Optimizer::GaussNewton {
            self.search(frame, known)?
        } else {
            self.descend(known.hint.map(|hint| hint.pose))?
        };
        self.share_found = found.map_or(f64::INFINITY, |found| found.agreement.share);
        Ok(found)
    }

    /// Notes what was drawn for the frame, whether it is certain, and what it determines of the pose if that
    /// is known, for the next one's start. After a certain frame, those that are not lead nowhere.
    pub fn keep(
        &mut self,
        pose: Pose,
        mse: f64,
        start: StartKind,
        certain: bool,
        observability: Option<&Observability>,
    ) {
        if certain || !self.good {
            self.starts.push(pose, start, observability);
            self.error = Some(mse);
        }
        self.good |= certain;
        if certain {
            self.share = self.share_found;
        }
        self.lost_frames = if certain { 0 } else { self.lost_frames.saturating_add(1) };
    }

    /// Forgets the frames before.
    pub fn reset(&mut self) {
        (self.starts, self.error, self.level) = (Starts::default(), None, 0);
        (self.good, self.lost_frames) = (false, 0);
        (self.share, self.share_found) = (f64::INFINITY, f64::INFINITY);
        self.objective.set_correction(&Correction::NONE);
    }

    /// Gauss–Newton on the device.
    fn search(&mut self, frame: &Picture, known: &Known) -> Result<Option<Found>, Error> {
        let hint = known.hint.map(|hint| self.brought_up(hint));
        let schedule = self.options.gauss_newton.warm;
        let warm = match self.follow(&schedule)? {
            Some(found) => Some(self.judged(found)?),
            None => None,
        };
        if let Some(found) = warm
            && (self.settles(&found) || (!found.agreement.tells && !self.lost(found.outcome.mse)))
        {
            let found = match hint {
                Some(hint) if disagrees(&hint, &found) => self.heard(frame, found, &hint)?,
                _ => found,
            };
            return self.settled(found).map(Some);
        }
        let found = self.look_afresh(frame, warm, hint.as_ref())?;
        found.map(|found| self.settled(found)).transpose()
    }

    /// A hint where the camera has moved on since it was taken, as far as its motion is known.
    fn brought_up(&self, hint: Hint) -> Hint {
        match self.starts.motion_of(hint.age) {
            Some(motion) => Hint { pose: hint.pose.stepped(&motion), age: 0.0, ..hint },
            None => hint,
        }
    }

    /// Looks where a hint says that the camera stands, though the track is certain: the better one by the
    /// picture alone.
    fn heard(&mut self, frame: &Picture, found: Found, hint: &Hint) -> Result<Found, Error> {
        self.relocaliser.set_frame(frame);
        Ok(match self.near(&hint.pose, StartKind::External)? {
            Some(heard) => Found::or_judged(Some(found), heard),
            None => Found { drawn: None, ..found },
        })
    }

    /// Looks for a frame that the frames before do not lead to: from the hint, from the last good pose, and
    /// by the key frames, until a pose is certain or the frame's renders are used up.
    fn look_afresh(
        &mut self,
        frame: &Picture,
        warm: Option<Found>,
        hint: Option<&Hint>,
    ) -> Result<Option<Found>, Error> {
        let last = self.starts.last();
        let mut best = warm.map(|warm| Found { start: StartKind::BestOfBad, ..warm });
        let end = self.renders() + u64::from(self.options.lost_renders);
        let GaussNewtonOptions { warm: schedule, cold, .. } = self.options.gauss_newton;
        let rough = hint.map(|h| (h.pose, StartKind::External));
        let rough = rough.or(last.map(|pose| (pose, StartKind::Previous)));
        if let Some((pose, kind)) = rough {
            let found = self.search_cold(frame, &pose, &cold, &schedule)?;
            let found = self.judged(Found { start: kind, ..found })?;
            best = Some(Found::or_judged(best, found));
        }
        if best.is_some_and(|best| self.settles(&best)) {
            return Ok(best);
        }
        self.relocaliser.set_frame(frame);
        // Which comes first changes: neither is kept from its turn by the other.
        let key_frames_first = self.lost_frames % 2 == 1;
        for turn in [0, 1, 2] {
            if best.is_some_and(|best| self.settles(&best)) || self.renders() >= end {
                break;
            }
            let found = match (turn, key_frames_first) {
                (0, _) => self.near_one(hint.map(|hint| hint.pose), StartKind::External)?,
                (1, false) | (2, true) => self.near_one(last, StartKind::Previous)?,
                _ => self.by_key_frames(end)?,
            };
            if let Some(found) = found {
                best = Some(Found::or_judged(best, found));
            }
        }
        if best.is_none()
            && let Some(pose) = self.relocaliser.likeliest()
        {
            let schedule = Schedule { renders: 1, leap: 0.0, ..schedule };
            let found = self.from(&[pose], &schedule)?;
            best = Some(self.judged(found)?);
        }
        Ok(best.map(|best| {
            let start = if best.certain { best.start } else { StartKind::BestOfBad };
            Found { start, ..best }
        }))
    }

    fn near_one(&mut self, pose: Option<Pose>, kind: StartKind) -> Result<Option<Found>, Error> {
        pose.map_or(Ok(None), |pose| self.near(&pose, kind))
    }

    /// Renders of all levels so far.
    fn renders(&mut self) -> u64 {
        self.objective.renderer().renders().iter().map(|count| u64::from(*count)).sum()
    }

    /// Searches by the corners that the prior shows at a pose; `None` if they say nothing.
    fn near(&mut self, pose: &Pose, kind: StartKind) -> Result<Option<Found>, Error> {
        let candidate = self.relocaliser.approach(&mut self.objective, pose)?;
        let Some(candidate) = candidate.filter(|c| c.features >= EXPLAINED) else {
            return Ok(None);
        };
        self.lit_by(&candidate.pose)?;
        let cold = self.options.gauss_newton.cold;
        let found = self.from(&[candidate.pose], &cold)?;
        self.judged(Found { start: kind, ..found }).map(Some)
    }

    /// Searches by the prior's key frames; those not rendered yet are rendered first, as far as the frame's
    /// renders go.
    fn by_key_frames(&mut self, end: u64) -> Result<Option<Found>, Error> {
        let room = end.saturating_sub(self.renders()) as usize;
        self.relocaliser.learn(&mut self.objective, room)?;
        let mut proposed = [None; PROPOSED];
        for (to, from) in proposed.iter_mut().zip(self.relocaliser.propose()) {
            *to = Some(from.pose);
        }
        let mut best: Option<Found> = None;
        for pose in proposed.into_iter().flatten() {
            if let Some(found) = self.near(&pose, StartKind::KeyFrame)? {
                best = Some(Found::or_judged(best, found));
            }
            if best.is_some_and(|best| self.settles(&best)) || self.renders() >= end {
                break;
            }
        }
        Ok(best)
    }

    /// Whether no other pose need be looked for: nearly all agrees, or nearly as much as in the frame before.
    /// At a wrong pose a part of the scene may agree, such as a far wall behind what is near.
    fn settles(&self, found: &Found) -> bool {
        found.certain && found.agreement.share >= SURE.min(AS_BEFORE * self.share)
    }

    /// Corrects the frame's light to that of the prior at a pose, if the two agree there.
    fn lit_by(&mut self, pose: &Pose) -> Result<(), Error> {
        self.draw(pose)?;
        if let Some(correction) = self.agreement().correction {
            self.objective.set_correction(&correction);
        }
        Ok(())
    }

    /// How the frame agrees with the picture drawn last.
    fn agreement(&mut self) -> Agreement {
        let camera = self.objective.camera(0);
        let (frame, render) = self.objective.pictures();
        Agreement::of(frame, render, camera.width as usize, camera.height as usize)
    }

    /// Draws what was found, unless that is drawn, and judges it. If the frame agrees in another light than
    /// was searched in, the search goes on in that light.
    fn judged(&mut self, mut found: Found) -> Result<Found, Error> {
        if found.drawn.is_none() {
            let (code, mse) = self.draw(&found.outcome.pose)?;
            found.drawn = Some(code);
            found.outcome.mse = mse;
        }
        found.agreement = self.agreement();
        if let Some(correction) = found.agreement.correction
            && differs(&correction, self.objective.correction())
        {
            self.objective.set_correction(&correction);
            let near =
                Schedule { first_level: 1, follow_level: 1, ..self.options.gauss_newton.cold };
            let again = self.from(&[found.outcome.pose], &near)?;
            let (start, submissions) = (found.start, found.submissions + again.submissions);
            let begun = found.begun;
            found = Found { start, submissions, begun, agreement: self.agreement(), ..again };
        }
        found.certain = found.agreement.confirms();
        Ok(found)
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
        Ok((code, self.objective.error()))
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
            certain: false,
            agreement: Agreement::default(),
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
        let observability = *self.objective.observability();
        let (code, mse) = self.draw(&outcome.pose)?;
        let agreement = self.agreement();
        Ok(Some(Found {
            outcome: Outcome { mse, ..outcome },
            start: start.kind,
            drawn: Some(code),
            submissions: 0,
            first_mse: f64::NAN,
            observability,
            begun: start.pose,
            certain: agreement.confirms(),
            agreement,
        }))
    }

    /// Frames since the last certain one.
    pub fn lost_frames(&self) -> u32 {
        self.lost_frames
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

/// For an objective, with the prior's key frames; the gradient methods search as the paper does, without.
fn relocaliser(objective: &mut Objective, options: &RefineOptions) -> Relocaliser {
    let scene = objective.renderer().scene().clone();
    let searches = options.optimizer == Optimizer::GaussNewton;
    let key_frames = if searches { scene.key_frames().poses() } else { &[] };
    Relocaliser::new(objective, key_frames)
}

/// Whether a hint lies further from what was found than its covariance lets expect.
fn disagrees(hint: &Hint, found: &Found) -> bool {
    let off = found.outcome.pose.after(&hint.pose.inverse()).log();
    let depth = found.observability.length;
    let [moved, turned] = HINT_DEVIATION;
    let usual = std::array::from_fn(|i| if i < 3 { moved * depth } else { turned });
    let stated = hint.deviation().unwrap_or(usual);
    // The found pose is not exact either.
    let own = found.observability.pose_deviation();
    let squares = (0..6).map(|i| {
        let own = if own[i].is_finite() { own[i] } else { return 0.0 };
        let spread = stated[i] * stated[i] + own * own + (1e-3 * usual[i]).powi(2);
        if spread > 0.0 { off[i] * off[i] / spread } else { 0.0 }
    });
    squares.fold(0.0, f64::max) > DISAGREES * DISAGREES
}

/// Whether two corrections differ by more than a search would notice.
fn differs(a: &Correction, b: &Correction) -> bool {
    let apart = |channel: usize| {
        let ends = [0.2, 0.8].map(|v| (a.of(channel, v) - b.of(channel, v)).abs());
        ends[0].max(ends[1])
    };
    // Of the frame's own values, which the factor makes larger.
    (0..3).any(|c| apart(c) > LIGHT * a.factor[c].max(1.0))
}
