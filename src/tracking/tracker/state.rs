//! What tracking carries from frame to frame, and the steps that all searches take.

use std::sync::Arc;

use crate::Pose;
use crate::image::Mask;
use crate::render::Correction;
use crate::render::levels::{anchor, placement};
use crate::search::{PoseCode, STARTS, quantised};
use crate::vulkan::Error;

use super::super::budget::{Budget, LEAST, Room, TimeLimit};
use super::super::cold::ColdStart;
use super::super::gauss_newton;
use super::super::schedule::Schedule;
use super::super::{
    Comparison, Evaluation, Objective, PoseEstimate, RefineOptions, Relocaliser, Start, StartKind,
    Starts,
};

/// If the picture cannot tell whether a pose is right, a frame is searched afresh if its error is above this many times
/// that of the frame before.
const LOST: f64 = 1.6;
/// If this share of what the prior shows agrees, no other pose is looked for. Less is enough if it is at least this
/// share of the frame before's, and that was certain: what covers a part of the picture stays for some frames.
pub(super) const SURE: f64 = 0.8;
const AS_BEFORE: f64 = 0.85;
/// So many corners are explained by no wrong pose.
const MANY: u32 = 100;

/// The finest level at which blurred frames are searched: half the size.
const FINEST_BLURRED: usize = 1;

/// Finds poses of frames, in order.
pub struct Tracker {
    pub(super) objective: Objective,
    pub(super) options: RefineOptions,
    pub(super) threshold: f64,
    pub(super) profile: u32,
    pub(super) cold: ColdStart,
    pub(super) cold_starts: Vec<Pose>,
    pub(super) starts: Starts,
    /// Error of the frame before.
    pub(super) error: Option<f64>,
    /// Level of the pyramid at which the next frame's search begins, if its schedule allows it.
    pub(super) level: usize,
    pub(super) relocaliser: Relocaliser,
    pub(super) comparison: Comparison,
    /// Whether a frame was certain since the start.
    pub(super) good: bool,
    /// Frames since the last certain one.
    pub(super) frames_since_certain: u32,
    /// Share of the last certain frame that agreed; infinite before the first.
    pub(super) share: f64,
    /// Whether a part of the last certain frame was masked.
    pub(super) masked: bool,
    /// Whether the last certain frame was blurred.
    pub(super) blurred: bool,
    /// What the frame under way may take.
    pub(super) budget: Budget,
    /// A search of the frame before that its budget ended.
    pub(super) unfinished: Option<Unfinished>,
    /// Whether the last frame's time was short.
    pub(super) short: bool,
    /// The pose of the picture drawn last.
    pub(super) shown: Option<PoseCode>,
    /// Whether the last frame agreed where the frame before led.
    pub(super) agreed: bool,
    /// Whether the last frame with little room rendered key frames with all of it: the next one searches.
    pub(super) searches_next: bool,
}

/// A search that the next frame goes on with.
#[derive(Clone, Copy)]
pub(super) struct Unfinished {
    pub start: Start,
    /// Frames that have searched from there.
    pub frames: u32,
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
        let relocaliser = relocaliser(&mut objective);
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
            frames_since_certain: 0,
            share: f64::INFINITY,
            masked: false,
            blurred: false,
            budget: Budget::default(),
            unfinished: None,
            short: false,
            shown: None,
            agreed: false,
            searches_next: false,
        }
    }

    /// Sets when the search of the next frame must end; `None`: whenever it does.
    pub(crate) fn set_time_limit(&mut self, limit: Option<TimeLimit>) {
        self.budget.begin(limit);
    }

    /// Whether the clock ended the last frame's search.
    pub fn out_of_time(&self) -> bool {
        self.budget.out_of_time()
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
        self.relocaliser = relocaliser(&mut objective);
        self.comparison = comparison(&objective);
        self.objective = objective;
    }

    /// Renders up to `max` of the prior's key frames that are not rendered yet, so that a lost frame need not. Returns
    /// how many are left.
    pub fn prepare(&mut self, max: usize) -> Result<usize, Error> {
        self.relocaliser.learn(&mut self.objective, max)?;
        Ok(self.relocaliser.left())
    }

    /// Notes what was found for a frame, for the next one's start. It keeps the pose as found, not as the packet holds
    /// it, which may be coarser. Once a frame was certain, uncertain frames are not used as starts.
    pub fn keep(&mut self, found: &PoseEstimate) {
        let follows = matches!(found.start, StartKind::Previous | StartKind::Predicted);
        let goes_on = follows && found.goes_on();
        if found.certain || !self.good || goes_on {
            self.starts.push(found.outcome.pose, found.start, Some(&found.observability));
        }
        if found.certain || !self.good {
            self.error = Some(found.outcome.mse);
        }
        (self.agreed, self.short) = (found.certain || goes_on, self.out_of_time());
        self.good |= found.certain;
        if found.certain {
            self.share = found.agreement.share;
            self.masked = found.masked;
            self.unfinished = None;
        }
        self.frames_since_certain =
            if found.certain { 0 } else { self.frames_since_certain.saturating_add(1) };
    }

    /// Forgets the frames before.
    pub fn reset(&mut self) {
        (self.starts, self.error, self.level) = (Starts::default(), None, 0);
        (self.good, self.frames_since_certain) = (false, 0);
        (self.unfinished, self.agreed, self.short) = (None, false, false);
        (self.share, self.masked, self.blurred) = (f64::INFINITY, false, false);
        self.objective.set_correction(&Correction::NONE);
    }

    /// Whether no other pose need be looked for: nearly all agrees, or nearly as much as in the frame before, or very
    /// many corners were explained. At a wrong pose a part of the scene may agree, such as a far wall.
    pub(super) fn settles(&self, found: &PoseEstimate) -> bool {
        // Of a lost vehicle nothing is known. The frame at which silt came had a small share, too.
        let before = if self.frames_since_certain == 0 { self.share } else { f64::INFINITY };
        let nearly_all = found.agreement.share >= SURE.min(AS_BEFORE * before);
        found.certain && (nearly_all || found.features >= MANY)
    }

    /// Draws a pose as its packet will hold it. Returns the pose's code and the mean squared error.
    pub(super) fn draw(&mut self, pose: &Pose) -> Result<(PoseCode, f64), Error> {
        let renderer = self.objective.renderer();
        let scene = renderer.scene();
        let code = quantised(&placement(scene, pose), &anchor(scene), self.profile);
        let begun = self.budget.now();
        renderer.draw_coded_as_planned(&code)?;
        // A frame that there was no time to search for tells how long renders take now, too.
        self.budget.note_renders(begun, 1, 0);
        self.shown = Some(code);
        Ok((code, self.objective.error()))
    }

    /// As [`draw`](Self::draw), if the frame has room for it beside the picture that is sent.
    pub(super) fn draw_within(&mut self, pose: &Pose) -> Result<Option<(PoseCode, f64)>, Error> {
        if !self.has_room(1) {
            return Ok(None);
        }
        self.draw(pose).map(Some)
    }

    pub(super) fn lost(&self, mse: f64) -> bool {
        mse >= self.threshold && self.error.is_none_or(|before| mse > LOST * before)
    }

    /// Searches from poses, as far as the frame has room; `None` if it has none for an evaluation and its picture.
    pub(super) fn from(
        &mut self,
        poses: &[Pose],
        schedule: &Schedule,
    ) -> Result<Option<PoseEstimate>, Error> {
        let room = self.budget.room(self.objective.renderer().all_renders());
        self.search_within(poses, schedule, room)
    }

    /// As [`from`](Self::from), for a frame's first search, of which only the time is bounded.
    pub(super) fn first_from(
        &mut self,
        pose: &Pose,
        schedule: &Schedule,
    ) -> Result<Option<PoseEstimate>, Error> {
        let room = self.budget.first_room();
        self.search_within(&[*pose], schedule, room)
    }

    fn search_within(
        &mut self,
        poses: &[Pose],
        schedule: &Schedule,
        room: Room,
    ) -> Result<Option<PoseEstimate>, Error> {
        if !room.holds(LEAST, 0) {
            self.budget.note_cut(&room);
            return Ok(None);
        }
        let (begun, before) = (self.budget.now(), self.renders());
        let damping = self.options.gauss_newton.damping;
        let schedule = self.at_sharpness(schedule);
        let (objective, profile) = (&mut self.objective, self.profile);
        let found = gauss_newton::search(objective, poses, &schedule, damping, profile, &room)?;
        self.shown = found.drawn;
        let after = self.renders();
        self.budget.note_renders(begun, after.0 - before.0, after.1 - before.1);
        if !found.finished {
            self.budget.note_cut(&room);
        }
        Ok(Some(found))
    }

    /// Whether the frame's time is spent on looking elsewhere than where the frame before leads: every other frame of a
    /// lost camera, as both together may not fit.
    pub(super) fn spares_time(&self) -> bool {
        let lost = self.frames_since_certain > 0;
        let turn = self.frames_since_certain.is_multiple_of(2)
            || (!self.good && self.unfinished.is_some());
        self.short && lost && turn && !self.agreed
    }

    /// Renders so far: at full size and of coarse levels.
    fn renders(&mut self) -> (u32, u32) {
        let by_level = self.objective.renderer().renders();
        (by_level[0], by_level[1..].iter().sum())
    }

    /// Whether the frame has room for renders at full size beside that of the picture that is sent.
    pub(super) fn has_room(&mut self, renders: u32) -> bool {
        self.budget.holds(self.objective.renderer().all_renders(), renders)
    }

    /// Renders of which the corners are taken that the frame has room for, beside that of the picture that is sent.
    pub(super) fn room_to_look(&mut self) -> u32 {
        self.budget.looks(self.objective.renderer().all_renders())
    }

    /// Bounds the renders that the frame takes from here on.
    pub(super) fn bound_renders(&mut self) {
        if self.options.lost_renders > 0 {
            let renders = self.objective.renderer().all_renders();
            self.budget.bound(renders, self.options.lost_renders);
        }
    }

    /// A schedule for the frame's sharpness. Detail that a blurred frame lacks would pull the camera away from the
    /// scene. So the finest level only measures the error.
    pub(super) fn at_sharpness(&self, schedule: &Schedule) -> Schedule {
        let Schedule { first_level, follow_level, .. } = *schedule;
        if !self.blurred {
            return *schedule;
        }
        let levels = schedule.levels & !1 | 1 << FINEST_BLURRED;
        let [first_level, follow_level] =
            [first_level, follow_level].map(|l| l.max(FINEST_BLURRED));
        // Most of the error is the lack of detail, so even steps that matter lower it by little.
        let coarse_tolerance = 0.1 * schedule.tolerance;
        let (coarse_leap, leap) = (0.0, 0.0);
        let to_the_end = Schedule { coarse_tolerance, coarse_leap, leap, renders: 1, ..*schedule };
        Schedule { first_level, follow_level, levels, ..to_the_end }
    }

    /// Frames since the last certain one.
    pub fn frames_since_certain(&self) -> u32 {
        self.frames_since_certain
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

/// A relocaliser with the prior's key frames.
fn relocaliser(objective: &mut Objective) -> Relocaliser {
    let scene = objective.renderer().scene().clone();
    Relocaliser::new(objective, scene.key_frames().poses())
}
