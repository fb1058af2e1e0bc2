//! Judges how a frame agrees with the render at a pose, and searches again with the right light and without what the
//! prior does not know.

use crate::Pose;
use crate::render::Correction;
use crate::vulkan::Error;

use super::super::PoseEstimate;
use super::super::budget::LEAST;
use super::super::schedule::Schedule;
use super::super::{Agreement, Outcome, Start, StartKind};
use super::state::Tracker;

/// If the light differs by less than this, it is not corrected again.
const LIGHT: f32 = 0.03;
/// How often the masks are made again, at most. They are made again as long as that raises the score by more than
/// [`BETTER`].
const MASKINGS: u32 = 6;
/// In a frame that follows another, what does not agree is masked only if it makes a larger share of the squared error
/// than this.
pub(super) const MOSTLY: f64 = 0.85;
/// As [`MOSTLY`], in a lost frame.
pub(super) const PARTLY: f64 = 0.6;
/// If a frame has less of the render's fine detail than this, it is blurred. Sharp frames have 0.8 and more; frames
/// blurred by a Gaussian of 2 pixels have 0.2 and less.
const BLURRED: f64 = 0.4;
/// A search counts as better than another if its score is higher by more.
const BETTER: f64 = 0.01;
/// If less agrees at a proposed pose, masks would leave only what agrees by chance.
const HINTED: f64 = 0.15;

impl Tracker {
    /// Draws what was found, unless it is drawn, and judges it. If the frame agrees in another light or at another
    /// sharpness than the search assumed, the search goes on with these.
    pub(super) fn judged(&mut self, mut found: PoseEstimate) -> Result<PoseEstimate, Error> {
        if found.drawn.is_none() {
            let Some((code, mse)) = self.draw_within(&found.outcome.pose)? else {
                return Ok(PoseEstimate { certain: false, finished: false, ..found });
            };
            found.drawn = Some(code);
            found.outcome.mse = mse;
        }
        found.agreement = self.agreement();
        if self.take_light(&found.agreement) | self.take_sharpness(&found.agreement) {
            found = match self.from(&[found.outcome.pose], &self.nearby(1))? {
                Some(again) => found.gone_on(again, self.agreement()),
                None => PoseEstimate { finished: false, ..found },
            };
        }
        found.certain = found.agreement.confirms() && found.finished;
        Ok(found)
    }

    /// Draws a start that there is no room to search from.
    pub(super) fn unsearched(&mut self, start: &Start) -> Result<PoseEstimate, Error> {
        let drawn = self.draw(&start.pose)?;
        Ok(PoseEstimate::unsearched(start, drawn, self.agreement()))
    }

    /// Goes on from what was found and judged last: masks what does not agree, and corrects the light from place to
    /// place. If nearly all agrees then, in one light, a plain search finishes. Changes nothing if the pose found is
    /// not certain, or if what does not agree makes no more than the share `max` of the squared error. What the frame
    /// has no room to search to the end is left out.
    pub(super) fn with_masks(
        &mut self,
        found: PoseEstimate,
        max: f64,
    ) -> Result<PoseEstimate, Error> {
        let uneven = found.certain && self.is_uneven(&found.agreement, max);
        if !uneven || !self.has_room(LEAST) {
            return Ok(found);
        }
        let mut best = found;
        for _ in 0..MASKINGS {
            let before = best.agreement.score;
            let again = self.masked_from(&best.outcome.pose)?;
            let Some(again) = again.filter(|again| again.finished) else { break };
            if again.agreement.score > before {
                best = best.gone_on(again, again.agreement);
            }
            if !(best.agreement.score > before + BETTER) {
                break;
            }
        }
        let pose = best.outcome.pose;
        let plain = self.from(&[pose], &self.nearby(0))?;
        let Some(plain) = plain.filter(|plain| plain.finished) else {
            return Ok(PoseEstimate { drawn: None, ..best });
        };
        let agreement = self.agreement();
        if agreement.score > best.agreement.score + BETTER || !self.is_uneven(&agreement, max) {
            return Ok(best.gone_on(plain, agreement));
        }
        Ok(PoseEstimate { drawn: None, ..best })
    }

    /// Searches from a pose that corners propose. If less agrees at the end of the search, the search went wrong, and
    /// the corners' pose is kept. `None` if the frame has no room for that.
    pub(super) fn search_candidate(
        &mut self,
        pose: &Pose,
        kind: StartKind,
    ) -> Result<Option<PoseEstimate>, Error> {
        if self.draw_within(pose)?.is_none() {
            return Ok(None);
        }
        let agreement = self.agreement();
        self.take_light(&agreement);
        let Some(found) = self.search_corners(pose, kind, &agreement)? else { return Ok(None) };
        if !agreement.confirms() || found.agreement.score + BETTER >= agreement.score {
            return Ok(Some(found));
        }
        let schedule = Schedule { renders: 1, leap: 0.0, ..self.nearby(0) };
        let Some(stayed) = self.from(&[*pose], &schedule)? else { return Ok(Some(found)) };
        let agreement = self.agreement();
        let masked = self.is_uneven(&agreement, PARTLY);
        Ok(Some(PoseEstimate { masked, ..found.gone_on(stayed, agreement) }))
    }

    /// Searches from a pose that corners propose. First masks what does not agree there: it would lead a plain search
    /// astray.
    fn search_corners(
        &mut self,
        pose: &Pose,
        kind: StartKind,
        agreement: &Agreement,
    ) -> Result<Option<PoseEstimate>, Error> {
        let mut best = None;
        if agreement.share > HINTED
            && self.is_uneven(agreement, MOSTLY)
            && let Some(found) = self.masked_from(pose)?
        {
            let found = self.with_masks(PoseEstimate { start: kind, ..found }, PARTLY)?;
            if found.certain {
                return Ok(Some(found));
            }
            best = Some(found);
        }
        let found = self.search_plainly(pose, kind)?;
        Ok(found.map(|found| PoseEstimate::or_judged(best, found)).or(best))
    }

    /// Searches from a pose on all levels, judges the outcome, and masks what does not agree; `None` if the frame has
    /// no room for that.
    pub(super) fn search_plainly(
        &mut self,
        pose: &Pose,
        kind: StartKind,
    ) -> Result<Option<PoseEstimate>, Error> {
        let cold = self.options.gauss_newton.cold;
        let Some(found) = self.from(&[*pose], &cold)? else { return Ok(None) };
        let found = self.judged(PoseEstimate { start: kind, ..found })?;
        self.with_masks(found, PARTLY).map(Some)
    }

    /// For a frame that follows a masked one: predicts the pose, masks what does not agree with the render there, and
    /// searches. `None` if no certain pose is found.
    pub(super) fn follow_masked(&mut self) -> Result<Option<PoseEstimate>, Error> {
        let Some((pose, start)) = self.starts.near() else { return Ok(None) };
        if self.draw_within(&pose)?.is_none() {
            return Ok(None);
        }
        let agreement = self.agreement();
        if !agreement.confirms() {
            return Ok(None);
        }
        self.take_light(&agreement);
        let found = self.masked_from(&pose)?.filter(|found| found.certain || found.goes_on());
        Ok(found.map(|found| PoseEstimate { start, ..found }))
    }

    /// Searches from the pose at which the render was compared last, and masks what does not agree there. The error is
    /// that of the whole picture. `None` if the frame has no room for a search.
    fn masked_from(&mut self, pose: &Pose) -> Result<Option<PoseEstimate>, Error> {
        let comparison = &mut self.comparison;
        self.objective.set_field(|field| comparison.describe(field));
        let found = self.from(&[*pose], &self.nearby(1));
        let correction = *self.objective.correction();
        self.objective.set_correction(&correction);
        let Some(found) = found? else { return Ok(None) };
        let agreement = self.agreement();
        let outcome = Outcome { mse: self.objective.error(), ..found.outcome };
        let masked = self.comparison.is_uneven(&agreement, MOSTLY);
        let certain = agreement.confirms() && found.finished;
        Ok(Some(PoseEstimate { outcome, agreement, certain, masked, ..found }))
    }

    /// Uses the frame's light in searches from here on, if it differs from the light used so far. Returns whether it
    /// does.
    fn take_light(&mut self, agreement: &Agreement) -> bool {
        let Some(correction) = agreement.correction else { return false };
        let other = differs(&correction, self.objective.correction());
        if other {
            self.objective.set_correction(&correction);
        }
        other
    }

    /// Searches for a blurred frame, or a sharp one, from here on. Returns whether that is a change.
    fn take_sharpness(&mut self, agreement: &Agreement) -> bool {
        let told = agreement.confirms() && !agreement.sharpness.is_nan();
        let changes = told && self.blurred != (agreement.sharpness < BLURRED);
        self.blurred ^= changes;
        changes
    }

    fn is_uneven(&self, agreement: &Agreement, max: f64) -> bool {
        self.options.masks && self.comparison.is_uneven(agreement, max)
    }

    /// How to search from a pose that is nearly right.
    fn nearby(&self, level: usize) -> Schedule {
        let cold = self.options.gauss_newton.cold;
        Schedule { first_level: level, follow_level: level, far_level: 0, ..cold }
    }

    /// How the frame agrees with the picture drawn last.
    pub(super) fn agreement(&mut self) -> Agreement {
        let (frame, render) = self.objective.pictures();
        self.comparison.compare(frame, render)
    }
}

/// Whether two corrections differ by more than a search would notice.
fn differs(a: &Correction, b: &Correction) -> bool {
    let apart = |channel: usize| {
        let ends = [0.2, 0.8].map(|v| (a.of(channel, v) - b.of(channel, v)).abs());
        ends[0].max(ends[1])
    };
    // The limit is in the frame's own values, which the factor makes larger.
    (0..3).any(|c| apart(c) > LIGHT * a.factor[c].max(1.0))
}
