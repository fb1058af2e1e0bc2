//! Looking for a frame that the frames before do not lead to.

use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::super::gauss_newton::Schedule;
use super::super::{GaussNewtonOptions, Hint, StartKind};
use super::super::{PoseEstimate, deviations};
use super::judgement::PARTLY;
use super::state::{SURE, Tracker};

/// Hypotheses that a cold start follows. One is enough: it reached the optimum from each of 200 starts off by up to 10°
/// and 0.3 units. Each further one costs a coarse render and more.
const HYPOTHESES: usize = 1;
/// If a pose explains fewer of the frame's corners than this, it is most likely chance and not worth a search. If it
/// explains more, it may still be wrong: the picture decides.
const EXPLAINED: u32 = 13;
/// Poses that key frames propose and that are looked at more closely.
const PROPOSED: usize = 4;
/// Key frames that are tried one by one if none of the proposed poses is right.
const LIKELY: usize = 6;
/// Key frames that are compared with the frame one by one, per render that the frame may take. Comparing this many
/// takes less time than a render.
const COMPARISONS: usize = 4;
/// Poses that come of that and are looked at more closely.
const COMPARED: usize = 8;
/// A hint disagrees with the track beyond this many standard deviations.
const DISAGREES: f64 = 3.0;
/// Standard deviations of a hint that states none: as a share of the scene's depth, and in radians.
const HINT_DEVIATION: [f64; 2] = [0.1, 0.1];

impl Tracker {
    /// Searches from a hint's pose too, although the track is certain. The picture alone decides between the two.
    pub(super) fn searched_from_hint(
        &mut self,
        frame: &Picture,
        found: PoseEstimate,
        hint: &Hint,
    ) -> Result<PoseEstimate, Error> {
        self.relocaliser.set_frame(frame);
        Ok(match self.near(&hint.pose, StartKind::External)? {
            Some(hinted) => PoseEstimate::or_judged(Some(found), hinted),
            None => PoseEstimate { drawn: None, ..found },
        })
    }

    /// Searches afresh for a frame that the frames before do not lead to: from the hint, from the last good pose, and
    /// by the key frames. Ends if a pose is certain or the frame has no renders left.
    pub(super) fn look_afresh(
        &mut self,
        frame: &Picture,
        warm: Option<PoseEstimate>,
        hint: Option<&Hint>,
    ) -> Result<Option<PoseEstimate>, Error> {
        let last = self.starts.last();
        let mut best = warm.map(|warm| PoseEstimate { start: StartKind::BestOfBad, ..warm });
        let end = self.renders() + u64::from(self.options.lost_renders);
        let GaussNewtonOptions { warm: schedule, cold, .. } = self.options.gauss_newton;
        let rough = hint.map(|h| (h.pose, StartKind::External));
        let rough = rough.or(last.map(|pose| (pose, StartKind::Previous)));
        if let Some((pose, kind)) = rough {
            let found = self.search_cold(frame, &pose, &cold, &schedule)?;
            let found = self.judged(PoseEstimate { start: kind, ..found })?;
            let found = self.with_masks(found, PARTLY)?;
            best = Some(PoseEstimate::or_judged(best, found));
        }
        if best.is_some_and(|best| self.settles(&best)) {
            return Ok(best);
        }
        self.relocaliser.set_frame(frame);
        // The order alternates, so that neither can use up the renders every time.
        let key_frames_first = self.frames_since_certain % 2 == 1;
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
                best = Some(PoseEstimate::or_judged(best, found));
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
            PoseEstimate { start, ..best }
        }))
    }

    fn near_one(
        &mut self,
        pose: Option<Pose>,
        kind: StartKind,
    ) -> Result<Option<PoseEstimate>, Error> {
        pose.map_or(Ok(None), |pose| self.near(&pose, kind))
    }

    /// Searches by the corners that the prior shows at a pose; `None` if too few match. If the search ends where most
    /// corners are not explained any more, the pose is not certain, unless nearly all of the picture agrees.
    fn near(&mut self, pose: &Pose, kind: StartKind) -> Result<Option<PoseEstimate>, Error> {
        let candidate = self.relocaliser.approach(&mut self.objective, pose)?;
        let Some(candidate) = candidate.filter(|c| c.features >= EXPLAINED) else {
            return Ok(None);
        };
        let found = self.search_candidate(&candidate.pose, kind)?;
        let explained = 2 * self.relocaliser.explained(&found.outcome.pose) >= candidate.features;
        let certain = found.certain && (explained || found.agreement.share >= SURE);
        Ok(Some(PoseEstimate { features: candidate.features, certain, ..found }))
    }

    /// Searches by the prior's key frames. First renders those not rendered yet, as many as the frame's renders allow.
    fn by_key_frames(&mut self, end: u64) -> Result<Option<PoseEstimate>, Error> {
        let room = end.saturating_sub(self.renders()) as usize;
        self.relocaliser.learn(&mut self.objective, room)?;
        let mut proposed = [None; PROPOSED + LIKELY];
        for (to, from) in proposed[..PROPOSED].iter_mut().zip(self.relocaliser.propose()) {
            *to = Some(from.pose);
        }
        // Other ones in each frame.
        let first = self.frames_since_certain as usize * LIKELY;
        for (rank, to) in proposed[PROPOSED..].iter_mut().enumerate() {
            *to = self.relocaliser.likely(first + rank);
        }
        let best = self.near_any(None, &proposed, end)?;
        if best.is_some_and(|best| self.settles(&best)) || self.renders() >= end {
            return Ok(best);
        }
        let max = COMPARISONS * self.options.lost_renders as usize;
        let mut compared = [None; COMPARED];
        let candidates = self.relocaliser.compare_some(max, self.frames_since_certain as usize);
        for (to, from) in compared.iter_mut().zip(candidates) {
            *to = Some(from.pose);
        }
        self.near_any(best, &compared, end)
    }

    /// Searches by the corners that the prior shows at each of some poses, until one settles the frame.
    fn near_any(
        &mut self,
        mut best: Option<PoseEstimate>,
        poses: &[Option<Pose>],
        end: u64,
    ) -> Result<Option<PoseEstimate>, Error> {
        for pose in poses.iter().flatten() {
            if best.is_some_and(|best| self.settles(&best)) || self.renders() >= end {
                break;
            }
            if let Some(found) = self.near(pose, StartKind::KeyFrame)? {
                best = Some(PoseEstimate::or_judged(best, found));
            }
        }
        Ok(best)
    }

    /// Searches from the poses that phase correlation proposes for a start. They may be wrong if a picture is small,
    /// flat, or of another scene, and the minimum of a coarse level may lie elsewhere. The outcome is never worse than
    /// the start.
    pub(super) fn search_cold(
        &mut self,
        frame: &Picture,
        start: &Pose,
        cold: &Schedule,
        warm: &Schedule,
    ) -> Result<PoseEstimate, Error> {
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
        Ok(PoseEstimate { begun: *start, ..found })
    }

    /// Renders of all levels so far.
    fn renders(&mut self) -> u64 {
        self.objective.renderer().renders().iter().map(|count| u64::from(*count)).sum()
    }
}

/// Whether a hint lies farther from the pose found than its covariance makes likely.
pub(super) fn disagrees(hint: &Hint, found: &PoseEstimate, prior_doubt: f64) -> bool {
    let off = found.outcome.pose.after(&hint.pose.inverse()).log();
    let depth = found.observability.length;
    let [moved, turned] = HINT_DEVIATION;
    let usual = std::array::from_fn(|i| if i < 3 { moved * depth } else { turned });
    let stated = hint.deviation().unwrap_or(usual);
    // The found pose is not exact either.
    let own = deviations(&found.stated_covariance(prior_doubt));
    let squares = (0..6).map(|i| {
        let own = if own[i].is_finite() { own[i] } else { return 0.0 };
        let spread = stated[i] * stated[i] + own * own + (1e-3 * usual[i]).powi(2);
        if spread > 0.0 { off[i] * off[i] / spread } else { 0.0 }
    });
    squares.fold(0.0, f64::max) > DISAGREES * DISAGREES
}
