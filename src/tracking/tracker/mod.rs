//! Tracks the pose from frame to frame: where to start, how to search, and when to search afresh.

mod afresh;
mod judgement;

use std::sync::Arc;

use crate::image::Mask;
use crate::render::Correction;
use crate::render::levels::{anchor, placement};
use crate::search::{PoseCode, STARTS, quantised};
use crate::vulkan::Error;
use crate::{Picture, Pose};

use self::afresh::disagrees;
use self::judgement::MOSTLY;
#[cfg(feature = "paper")]
use super::descent;
use super::gauss_newton::{self, Schedule};
use super::{
    ColdStart, Comparison, Evaluation, Found, Hint, Known, Objective, Optimizer, Outcome,
    RefineOptions, Relocaliser, StartKind, Starts,
};

/// If the error at a search's start is below this many times the error at its end, the start was close. The next search
/// then begins one level finer.
const CLOSE: f64 = 1.3;
/// If the ratio is above this, the next search begins one level coarser.
const FAR: f64 = 2.0;
/// If a frame's error is more than this many times that of the frame before, it is searched again from the coarsest
/// level: its start may have been too far off for a fine level.
const WORSE: f64 = 1.15;
/// If the picture cannot tell whether a pose is right, a frame is searched afresh if its error is above this many times
/// that of the frame before.
const LOST: f64 = 1.6;
/// Going back along directions that the picture does not determine may multiply the error by this at most.
const SETTLED: f64 = 1.01;
/// If this share of what the prior shows agrees, no other pose is looked for. Less is enough if it is at least this
/// share of the frame before's.
const SURE: f64 = 0.8;
const AS_BEFORE: f64 = 0.85;
/// So many corners are explained by no wrong pose.
const MANY: u32 = 100;

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
    /// Level of the pyramid at which the next frame's search begins, if its schedule allows it.
    level: usize,
    relocaliser: Relocaliser,
    comparison: Comparison,
    /// Whether a frame was certain since the start.
    good: bool,
    /// Frames since the last certain one.
    lost_frames: u32,
    /// Share of the last certain frame that agreed; infinite before the first.
    share: f64,
    /// Whether a part of the last certain frame was masked.
    masked: bool,
    /// Whether the last certain frame was blurred.
    blurred: bool,
}

impl Tracker {
    /// `threshold`: mean squared error, values in [0, 1]; see `EncoderOptions::threshold`.
    /// `profile`: how poses are coded, see [`Tracker::set_profile`].
    pub fn new(
        mut objective: Objective,
        options: RefineOptions,
        threshold: f64,
        profile: u32,
    ) -> Tracker {
        let cold = ColdStart::new(&objective);
        let relocaliser = relocaliser(&mut objective, &options);
        Tracker {
            options,
            threshold,
            profile,
            cold,
            cold_starts: Vec::with_capacity(STARTS),
            starts: Starts::default(),
            error: None,
            level: 0,
            comparison: comparison(&objective),
            objective,
            relocaliser,
            good: false,
            lost_frames: 0,
            share: f64::INFINITY,
            masked: false,
            blurred: false,
        }
    }

    /// Sets how poses are coded from here on: [`crate::search::COMPACT`], [`crate::search::PAPER`]
    /// or [`crate::search::SHORT`].
    pub fn set_profile(&mut self, profile: u32) {
        self.profile = profile;
    }

    /// Sets which pixels of frames count from here on; `None`: all do. The others of a frame must all have one colour.
    ///
    /// # Panics
    /// If it has not the camera's size.
    pub fn set_mask(&mut self, mask: Option<Arc<Mask>>) {
        self.cold.set_mask(&self.objective, mask.as_deref());
        self.relocaliser.set_mask(mask.as_deref());
        self.comparison.set_mask(mask.clone());
        self.objective.set_mask(mask);
    }

    /// Goes on with another camera or device. Poses carry over. Key frames are rendered again. All pixels count again.
    pub fn replace(&mut self, mut objective: Objective) {
        self.cold = ColdStart::new(&objective);
        self.relocaliser = relocaliser(&mut objective, &self.options);
        self.comparison = comparison(&objective);
        self.objective = objective;
    }

    /// Renders up to `most` of the prior's key frames that are not rendered yet, so that a lost frame need not. Returns
    /// how many are left.
    pub fn prepare(&mut self, most: usize) -> Result<usize, Error> {
        self.relocaliser.learn(&mut self.objective, most)?;
        Ok(self.relocaliser.left())
    }

    /// Finds the pose of a frame; `None` if there is neither a frame before, nor a hint, nor a key frame
    /// that looks like it.
    ///
    /// # Panics
    /// If the frame has not the camera's size.
    pub fn track(&mut self, frame: &Picture, known: &Known) -> Result<Option<Found>, Error> {
        self.objective.set_frame(frame);
        self.starts.set_time(known.time);
        match self.options.optimizer {
            Optimizer::GaussNewton => self.search(frame, known),
            #[cfg(feature = "paper")]
            _ => self.descend(known.hint.map(|hint| hint.pose)),
        }
    }

    /// Notes what was found for a frame, for the next one's start. It keeps the pose as found, not as the packet holds
    /// it, which may be coarser. Once a frame was certain, uncertain frames are not used as starts.
    pub fn keep(&mut self, found: &Found) {
        if found.certain || !self.good {
            self.starts.push(found.outcome.pose, found.start, Some(&found.observability));
            self.error = Some(found.outcome.mse);
        }
        self.good |= found.certain;
        if found.certain {
            self.share = found.agreement.share;
            self.masked = found.masked;
        }
        self.lost_frames = if found.certain { 0 } else { self.lost_frames.saturating_add(1) };
    }

    /// Forgets the frames before.
    pub fn reset(&mut self) {
        (self.starts, self.error, self.level) = (Starts::default(), None, 0);
        (self.good, self.lost_frames) = (false, 0);
        (self.share, self.masked, self.blurred) = (f64::INFINITY, false, false);
        self.objective.set_correction(&Correction::NONE);
    }

    /// Gauss–Newton on the device.
    fn search(&mut self, frame: &Picture, known: &Known) -> Result<Option<Found>, Error> {
        let hint = known.hint.map(|hint| self.brought_up(hint));
        let schedule = self.options.gauss_newton.warm;
        let mut warm = if self.masked { self.follow_masked()? } else { None };
        if warm.is_none()
            && let Some(found) = self.follow(frame, &schedule)?
        {
            let found = self.judged(found)?;
            warm = Some(self.with_masks(found, MOSTLY)?);
        }
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

    /// Moves a hint on by the camera's motion since it was taken, if that motion is known.
    fn brought_up(&self, hint: Hint) -> Hint {
        match self.starts.motion_of(hint.age) {
            Some(motion) => Hint { pose: hint.pose.stepped(&motion), age: 0.0, ..hint },
            None => hint,
        }
    }

    /// Whether no other pose need be looked for: nearly all agrees, or nearly as much as in the frame before, or very
    /// many corners were explained. At a wrong pose a part of the scene may agree, such as a far wall.
    fn settles(&self, found: &Found) -> bool {
        let nearly_all = found.agreement.share >= SURE.min(AS_BEFORE * self.share);
        found.certain && (nearly_all || found.features >= MANY)
    }

    /// Searches from the frames before, beginning at the level that was enough for the last one. If
    /// the error comes out worse, searches again from the coarsest level, or, if it began there, from
    /// the poses that phase correlation proposes. `None` if there are no frames before.
    fn follow(&mut self, frame: &Picture, schedule: &Schedule) -> Result<Option<Found>, Error> {
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
        let limit = self.error.map_or(f64::INFINITY, |before| WORSE * before);
        let worse = |found: &Found| found.outcome.mse > limit;
        if first < coarsest && worse(&found) {
            self.level = coarsest;
            found = found.or_last(Found { start, ..self.from(&[pose], &at(coarsest))? });
        }
        if worse(&found) {
            // A new object may draw the search away from the scene.
            let cold = self.options.gauss_newton.cold;
            let proposed = self.search_cold(frame, &pose, &cold, schedule)?;
            found = found.or_last(Found { start, ..proposed });
        }
        Ok(Some(found))
    }

    /// Takes back the motion along directions that the picture does not determine, if that costs nothing. Noise caused
    /// that motion, and over many frames the pose would drift.
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

    /// Draws a pose as its packet will hold it. Returns the pose's code and the mean squared error.
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
        let schedule = self.at_sharpness(schedule);
        gauss_newton::search(&mut self.objective, poses, &schedule, damping, self.profile)
    }

    /// The gradient methods, led by the host.
    #[cfg(feature = "paper")]
    fn descend(&mut self, external: Option<Pose>) -> Result<Option<Found>, Error> {
        let (objective, options) = (&mut self.objective, &self.options);
        let begin = descent::choose_start(&self.starts, objective, external, self.threshold)?;
        let Some(start) = begin else { return Ok(None) };
        let outcome = descent::minimise(objective, &start.pose, options)?;
        let observability = *self.objective.observability();
        let (code, mse) = self.draw(&outcome.pose)?;
        let agreement = self.agreement();
        Ok(Some(Found {
            drawn: Some(code),
            observability,
            certain: agreement.confirms(),
            agreement,
            ..Found::from_start(&start, Outcome { mse, ..outcome })
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

/// For pictures of an objective's size.
fn comparison(objective: &Objective) -> Comparison {
    let camera = objective.camera(0);
    Comparison::new(camera.width as usize, camera.height as usize)
}

/// A relocaliser with the prior's key frames. The gradient methods get none, as the paper has none.
fn relocaliser(objective: &mut Objective, options: &RefineOptions) -> Relocaliser {
    let scene = objective.renderer().scene().clone();
    let searches = options.optimizer == Optimizer::GaussNewton;
    let key_frames = if searches { scene.key_frames().poses() } else { &[] };
    Relocaliser::new(objective, key_frames)
}
