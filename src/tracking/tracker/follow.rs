//! Following the camera from the frames before.

use crate::Picture;
use crate::vulkan::Error;

use super::super::schedule::Schedule;
use super::super::{FrameInfo, Hint, Outcome, PoseEstimate, Start, StartKind};
use super::afresh::disagrees;
use super::judgement::MOSTLY;
use super::state::Tracker;

/// If the error at a search's start is below this many times the error at its end, the start was close. The next search
/// then begins one level finer.
const CLOSE: f64 = 1.3;
/// If the ratio is above this, the next search begins one level coarser.
const FAR: f64 = 2.0;
/// If a frame's error is more than this many times that of the frame before, it is searched again from the coarsest
/// level: its start may have been too far off for a fine level.
const WORSE: f64 = 1.15;
/// Mean squared error of the frame before from which on sparse evaluations are taken. What they make of the pose adds
/// some 10⁻⁵ to the error at most; below this, that would be seen.
const ROUGH: f64 = 1e-3;
/// Going back along directions that the picture does not determine may multiply the error by this at most.
const SETTLED: f64 = 1.01;

impl Tracker {
    /// Finds the pose of a frame; `None` if there is neither a frame before, nor a hint, nor a key frame
    /// that looks like it.
    ///
    /// # Panics
    /// If the frame has not the camera's size.
    pub fn track(
        &mut self,
        frame: &Picture,
        info: &FrameInfo,
    ) -> Result<Option<PoseEstimate>, Error> {
        self.objective.set_frame(frame);
        self.starts.set_time(info.time);
        let found = self.search(frame, info)?;
        // A step that there was no room to end may have drawn over it.
        let shown = self.shown;
        Ok(found.map(|found| PoseEstimate {
            drawn: found.drawn.filter(|drawn| Some(*drawn) == shown),
            ..found
        }))
    }

    /// Gauss–Newton on the device.
    fn search(&mut self, frame: &Picture, info: &FrameInfo) -> Result<Option<PoseEstimate>, Error> {
        let hint = info.hint.map(|hint| self.brought_up(hint));
        let schedule = self.options.gauss_newton.warm;
        let mut warm = if self.masked { self.follow_masked()? } else { None };
        if warm.is_none()
            && (self.good || !self.spares_time())
            && let Some(found) = self.follow(frame, &schedule)?
        {
            let found = self.judged(found)?;
            warm = Some(self.with_masks(found, MOSTLY)?);
        }
        let doubt = self.objective.renderer().scene().pose_doubt();
        if let Some(found) = warm
            && (self.settles(&found)
                || found.goes_on()
                || (!found.agreement.is_conclusive && !self.lost(found.outcome.mse)))
        {
            let found = match hint {
                Some(hint) if disagrees(&hint, &found, doubt) => {
                    self.searched_from_hint(frame, found, &hint)?
                }
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

    /// Searches from the frames before, beginning at the level that was enough for the last one. If
    /// the error comes out worse, searches again from the coarsest level, or, if it began there, from
    /// the poses that phase correlation proposes. `None` if there are no frames before. The renders of the first search
    /// are not bounded, only its time.
    fn follow(
        &mut self,
        frame: &Picture,
        schedule: &Schedule,
    ) -> Result<Option<PoseEstimate>, Error> {
        let Some((pose, start)) = self.starts.near() else { return Ok(None) };
        let rough = self.error.is_some_and(|before| before > ROUGH);
        let schedule = &Schedule { sparse: if rough { schedule.sparse } else { 0 }, ..*schedule };
        let coarsest = schedule.first_level.max(schedule.far_level);
        let first = match start {
            // Until a frame was certain, no error tells whether a fine level was enough.
            StartKind::Predicted if self.good || !self.short => {
                self.level.clamp(schedule.first_level, coarsest)
            }
            // The motion between two frames is still unknown.
            _ => coarsest,
        };
        let at = |level| Schedule { first_level: level, follow_level: level, ..*schedule };
        let found = self.first_from(&pose, &at(first))?;
        self.bound_renders();
        let Some(found) = found else {
            return self.unsearched(&Start { pose, kind: start }).map(Some);
        };
        let mut found = PoseEstimate { start, ..found };
        if start == StartKind::Predicted {
            let ratio = found.first_mse / found.outcome.mse;
            self.level = match ratio {
                _ if ratio < CLOSE => first.saturating_sub(1),
                _ if ratio > FAR => first + 1,
                _ => first,
            };
        }
        let limit = self.error.map_or(f64::INFINITY, |before| WORSE * before);
        let worse = |found: &PoseEstimate| found.outcome.mse > limit;
        if worse(&found) && self.spares_time() {
            return Ok(Some(PoseEstimate { finished: false, ..found }));
        }
        if first < coarsest && worse(&found) {
            self.level = coarsest;
            let again = self.from(&[pose], &at(coarsest))?;
            found = found.or_retried(again.map(|again| PoseEstimate { start, ..again }));
        }
        if worse(&found) {
            // A new object may draw the search away from the scene.
            let cold = self.options.gauss_newton.cold;
            let proposed = self.search_cold(frame, &pose, &cold, schedule)?;
            found = found.or_retried(proposed.map(|found| PoseEstimate { start, ..found }));
        }
        Ok(Some(found))
    }

    /// Takes back the motion along directions that the picture does not determine, if that costs nothing. Noise caused
    /// that motion, and over many frames the pose would drift.
    fn settled(&mut self, found: PoseEstimate) -> Result<PoseEstimate, Error> {
        if found.observability.undetermined().next().is_none() || !found.finished {
            return Ok(found);
        }
        let (pose, begun) = (found.outcome.pose, found.begun);
        let motion = pose.after(&begun.inverse()).log();
        let pose = begun.stepped(&found.observability.determined(&motion));
        let Some((code, mse)) = self.draw_within(&pose)? else { return Ok(found) };
        if !(mse <= SETTLED * found.outcome.mse) {
            return Ok(PoseEstimate { drawn: None, ..found });
        }
        let outcome = Outcome { pose, mse, ..found.outcome };
        Ok(PoseEstimate { outcome, drawn: Some(code), ..found })
    }
}
