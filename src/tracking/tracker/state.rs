//! What tracking carries from frame to frame, and the steps that all searches take.

use std::sync::Arc;

use crate::Pose;
use crate::image::Mask;
use crate::render::Correction;
use crate::render::levels::{anchor, placement};
use crate::search::{PoseCode, STARTS, quantised};
use crate::vulkan::Error;

use super::super::cold::ColdStart;
use super::super::gauss_newton::{self, Schedule};
use super::super::{
    Comparison, Evaluation, Objective, Optimizer, PoseEstimate, RefineOptions, Relocaliser, Starts,
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
            frames_since_certain: 0,
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

    /// Renders up to `max` of the prior's key frames that are not rendered yet, so that a lost frame need not. Returns
    /// how many are left.
    pub fn prepare(&mut self, max: usize) -> Result<usize, Error> {
        self.relocaliser.learn(&mut self.objective, max)?;
        Ok(self.relocaliser.left())
    }

    /// Notes what was found for a frame, for the next one's start. It keeps the pose as found, not as the packet holds
    /// it, which may be coarser. Once a frame was certain, uncertain frames are not used as starts.
    pub fn keep(&mut self, found: &PoseEstimate) {
        if found.certain || !self.good {
            self.starts.push(found.outcome.pose, found.start, Some(&found.observability));
            self.error = Some(found.outcome.mse);
        }
        self.good |= found.certain;
        if found.certain {
            self.share = found.agreement.share;
            self.masked = found.masked;
        }
        self.frames_since_certain =
            if found.certain { 0 } else { self.frames_since_certain.saturating_add(1) };
    }

    /// Forgets the frames before.
    pub fn reset(&mut self) {
        (self.starts, self.error, self.level) = (Starts::default(), None, 0);
        (self.good, self.frames_since_certain) = (false, 0);
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
        renderer.draw_coded_as_planned(&code)?;
        Ok((code, self.objective.error()))
    }

    pub(super) fn lost(&self, mse: f64) -> bool {
        mse >= self.threshold && self.error.is_none_or(|before| mse > LOST * before)
    }

    pub(super) fn from(
        &mut self,
        poses: &[Pose],
        schedule: &Schedule,
    ) -> Result<PoseEstimate, Error> {
        let damping = self.options.gauss_newton.damping;
        let schedule = self.at_sharpness(schedule);
        gauss_newton::search(&mut self.objective, poses, &schedule, damping, self.profile)
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

/// A relocaliser with the prior's key frames. The gradient methods get none, as the paper has none.
fn relocaliser(objective: &mut Objective, options: &RefineOptions) -> Relocaliser {
    let scene = objective.renderer().scene().clone();
    let searches = options.optimizer == Optimizer::GaussNewton;
    let key_frames = if searches { scene.key_frames().poses() } else { &[] };
    Relocaliser::new(objective, key_frames)
}
