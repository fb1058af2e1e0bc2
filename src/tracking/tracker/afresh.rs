//! Looking for a frame that the frames before do not lead to.

use crate::vulkan::Error;
use crate::{Picture, Pose};

use super::super::PoseEstimate;
use super::super::budget::LEAST;
use super::super::deviations;
use super::super::schedule::Schedule;
use super::super::{GaussNewtonOptions, Hint, Start, StartKind};
use super::judgement::PARTLY;
use super::state::{SURE, Tracker, Unfinished};

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
/// Renders that are left to search with when key frames are rendered.
const SEARCH: u32 = 32;
/// Frames in a row that go on with one search.
const MOST_FRAMES: u32 = 6;
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
    /// by the key frames. Ends if a pose is certain or the frame has no room left.
    pub(super) fn look_afresh(
        &mut self,
        frame: &Picture,
        warm: Option<PoseEstimate>,
        hint: Option<&Hint>,
    ) -> Result<Option<PoseEstimate>, Error> {
        let last = self.starts.last();
        let warm = warm.map(|warm| PoseEstimate { start: StartKind::BestOfBad, ..warm });
        let rough = hint.map(|h| Start { pose: h.pose, kind: StartKind::External });
        let last = last.filter(|_| !self.spares_time());
        let rough = rough.or(last.map(|pose| Start { pose, kind: StartKind::Previous }));
        let mut best = match rough {
            Some(start) => self.search_roughly(frame, &start, warm)?,
            None => warm,
        };
        self.bound_renders();
        if !self.is_settled(&best) {
            best = self.go_on(best)?;
        }
        if self.is_settled(&best) {
            return Ok(best);
        }
        if self.options.lost_renders > 0 && self.room_to_look() > 0 {
            best = self.search_by_corners(frame, best, hint)?;
        }
        if best.is_none() {
            best = self.search_anywhere()?;
        }
        Ok(best.map(|best| {
            let certain = best.certain && !self.is_guess(&best);
            let start = if certain { best.start } else { StartKind::BestOfBad };
            PoseEstimate { start, certain, ..best }
        }))
    }

    /// Searches from the key frame that looks most like the frame, or any. If there is no room for that, draws the pose
    /// to which the frames before lead, or else that key frame.
    fn search_anywhere(&mut self) -> Result<Option<PoseEstimate>, Error> {
        let Some(pose) = self.relocaliser.likeliest() else { return Ok(None) };
        let start = Start { pose, kind: StartKind::KeyFrame };
        let found = self.search_plainly(&pose, start.kind)?;
        if found.is_some() {
            return Ok(found);
        }
        let near = self.starts.near().map(|(pose, kind)| Start { pose, kind });
        self.unsearched(&near.unwrap_or(start)).map(Some)
    }

    /// Whether a pose, found by following uncertain ones alone, is not settled, and there was no room to look for
    /// others.
    fn is_guess(&mut self, best: &PoseEstimate) -> bool {
        let follows = best.start == StartKind::BestOfBad && !self.good;
        follows && !self.settles(best) && !self.has_room(1)
    }

    fn is_settled(&self, best: &Option<PoseEstimate>) -> bool {
        best.is_some_and(|best| self.settles(&best))
    }

    /// Searches from a rough start, and judges the outcome. If there is no room for that, and nothing else was found,
    /// draws the start. The first renders of a frame that follows none are not bounded.
    fn search_roughly(
        &mut self,
        frame: &Picture,
        start: &Start,
        warm: Option<PoseEstimate>,
    ) -> Result<Option<PoseEstimate>, Error> {
        let GaussNewtonOptions { warm: schedule, cold, .. } = self.options.gauss_newton;
        let found = self.search_cold(frame, &start.pose, &cold, &schedule)?;
        self.bound_renders();
        let Some(found) = found else {
            return if warm.is_some() { Ok(warm) } else { self.unsearched(start).map(Some) };
        };
        let found = self.judged(PoseEstimate { start: start.kind, ..found })?;
        let found = self.with_masks(found, PARTLY)?;
        Ok(Some(PoseEstimate::or_judged(warm, found)))
    }

    /// Goes on with a search that the budget of the frame before ended.
    fn go_on(&mut self, best: Option<PoseEstimate>) -> Result<Option<PoseEstimate>, Error> {
        let Some(unfinished) = self.unfinished.take() else { return Ok(best) };
        let Unfinished { start: Start { pose, kind }, frames } = unfinished;
        let Some(found) = self.search_plainly(&pose, kind)? else {
            self.unfinished = Some(unfinished);
            return Ok(best);
        };
        if !found.finished && frames < MOST_FRAMES {
            let start = Start { pose: found.outcome.pose, kind };
            self.unfinished = Some(Unfinished { start, frames: frames + 1 });
        }
        Ok(Some(PoseEstimate::or_judged(best, found)))
    }

    /// Searches by the corners that the prior shows at the hint, at the last good pose, and by the key frames.
    fn search_by_corners(
        &mut self,
        frame: &Picture,
        mut best: Option<PoseEstimate>,
        hint: Option<&Hint>,
    ) -> Result<Option<PoseEstimate>, Error> {
        let last = self.starts.last();
        self.relocaliser.set_frame(frame);
        // The order alternates, so that neither can use up the renders every time.
        let key_frames_first = self.frames_since_certain % 2 == 1;
        for turn in [0, 1, 2] {
            if self.is_settled(&best) {
                break;
            }
            let found = match (turn, key_frames_first) {
                (0, _) => self.near_one(hint.map(|hint| hint.pose), StartKind::External)?,
                (1, false) | (2, true) => self.near_one(last, StartKind::Previous)?,
                _ => self.by_key_frames()?,
            };
            if let Some(found) = found {
                best = Some(PoseEstimate::or_judged(best, found));
            }
        }
        Ok(best)
    }

    fn near_one(
        &mut self,
        pose: Option<Pose>,
        kind: StartKind,
    ) -> Result<Option<PoseEstimate>, Error> {
        pose.map_or(Ok(None), |pose| self.near(&pose, kind))
    }

    /// Searches by the corners that the prior shows at a pose; `None` if too few match, or there is no room. If the
    /// search ends where most corners are not explained any more, the pose is not certain, unless nearly all of the
    /// picture agrees.
    fn near(&mut self, pose: &Pose, kind: StartKind) -> Result<Option<PoseEstimate>, Error> {
        let room = self.room_to_look() as usize;
        let (begun, renders) = (self.budget.now(), self.objective.renderer().all_renders());
        let candidate = self.relocaliser.approach(&mut self.objective, pose, room)?;
        self.budget.note_looks(begun, self.objective.renderer().all_renders() - renders);
        let Some(candidate) = candidate.filter(|c| c.features >= EXPLAINED) else {
            return Ok(None);
        };
        let Some(found) = self.search_candidate(&candidate.pose, kind)? else {
            self.leave(&candidate.pose, kind);
            return Ok(None);
        };
        if !found.finished {
            self.leave(&found.outcome.pose, kind);
        }
        let explained = 2 * self.relocaliser.explained(&found.outcome.pose) >= candidate.features;
        let certain = found.certain && (explained || found.agreement.share >= SURE);
        Ok(Some(PoseEstimate { features: candidate.features, certain, ..found }))
    }

    /// Leaves a search to the next frame. The first one of a frame is the likeliest.
    fn leave(&mut self, pose: &Pose, kind: StartKind) {
        let start = Start { pose: *pose, kind };
        self.unfinished.get_or_insert(Unfinished { start, frames: 0 });
    }

    /// Renders some of the key frames that are not rendered yet. Leaves renders to search with.
    fn learn_some(&mut self) -> Result<(), Error> {
        let (room, left) = (self.room_to_look(), self.relocaliser.left() as u32);
        if left == 0 {
            return Ok(());
        }
        // If there are too few for both, frames take turns.
        let takes_turns = room < 2 * SEARCH;
        let most = match takes_turns {
            false => room - SEARCH,
            true if self.searches_next => 0,
            true => room,
        };
        self.searches_next = takes_turns && most > 0;
        for _ in 0..most.min(left) {
            if self.room_to_look() == 0 {
                break;
            }
            self.relocaliser.learn(&mut self.objective, 1)?;
        }
        Ok(())
    }

    /// Searches by the prior's key frames. First renders some of those not rendered yet.
    fn by_key_frames(&mut self) -> Result<Option<PoseEstimate>, Error> {
        self.learn_some()?;
        if self.room_to_look() == 0 {
            return Ok(None);
        }
        let mut proposed = [None; PROPOSED + LIKELY];
        let budget = &mut self.budget;
        let candidates = self.relocaliser.propose(|| budget.has_time());
        for (to, from) in proposed[..PROPOSED].iter_mut().zip(candidates) {
            *to = Some(from.pose);
        }
        // Other ones in each frame.
        let first = self.frames_since_certain as usize * LIKELY;
        for (rank, to) in proposed[PROPOSED..].iter_mut().enumerate() {
            *to = self.relocaliser.likely(first + rank);
        }
        let best = self.near_any(None, &proposed)?;
        if self.is_settled(&best) || self.room_to_look() == 0 {
            return Ok(best);
        }
        let max = COMPARISONS * self.options.lost_renders as usize;
        let mut compared = [None; COMPARED];
        let (turn, budget) = (self.frames_since_certain as usize, &mut self.budget);
        let candidates = self.relocaliser.compare_some(max, turn, || budget.has_time());
        for (to, from) in compared.iter_mut().zip(candidates) {
            *to = Some(from.pose);
        }
        self.near_any(best, &compared)
    }

    /// Searches by the corners that the prior shows at each of some poses, until one settles the frame.
    fn near_any(
        &mut self,
        mut best: Option<PoseEstimate>,
        poses: &[Option<Pose>],
    ) -> Result<Option<PoseEstimate>, Error> {
        for pose in poses.iter().flatten() {
            if self.is_settled(&best) || self.room_to_look() == 0 {
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
    /// the start, unless the frame's budget ends. `None` if there is no room.
    pub(super) fn search_cold(
        &mut self,
        frame: &Picture,
        start: &Pose,
        cold: &Schedule,
        warm: &Schedule,
    ) -> Result<Option<PoseEstimate>, Error> {
        if !self.has_room(2 + LEAST) {
            return Ok(None);
        }
        let (_, begun) = self.draw(start)?;
        let mut from = std::mem::take(&mut self.cold_starts);
        let proposed = self.cold.starts(&mut self.objective, frame, start, HYPOTHESES)?;
        from.clear();
        from.extend_from_slice(proposed);
        let searched = self.from(&from, cold);
        self.cold_starts = from;
        let Some(mut found) = searched? else { return Ok(None) };
        if !(found.first_mse <= self.cold.error())
            && let Some(again) = self.from(&[*start], cold)?
        {
            found = found.or_last(again);
        }
        let near = Schedule { first_level: 0, follow_level: 0, far_level: 0, ..*warm };
        if !(found.outcome.mse <= begun)
            && let Some(again) = self.from(&[*start], &near)?
        {
            found = found.or_last(again);
        }
        Ok(Some(PoseEstimate { begun: *start, ..found }))
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
