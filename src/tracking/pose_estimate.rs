//! What was found for a frame: one result that goes from the device's search to the frame's statistics.

use crate::Pose;
use crate::search::PoseCode;

use super::{
    Agreement, Covariance, Observability, Outcome, PoseCovariance, Start, StartKind, Stop,
};

/// How many times further off a pose may be than the blocks of the picture tell, by the share of what the prior shows
/// that agrees: for errors that all of the picture has in common. Straight lines lie between; beyond, it stays.
/// Chosen on dives of the basin and the quay: see docs/poses.md.
const DOUBT: [(f64, f64); 3] = [(0.75, 4.4), (0.90, 3.4), (0.95, 1.8)];

/// What was found for a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEstimate {
    /// Pose and error.
    pub outcome: Outcome,
    /// Where the search started.
    pub start: StartKind,
    /// The pose as a packet holds it, if the search has already drawn its picture and taken the
    /// difference.
    pub drawn: Option<PoseCode>,
    /// Submissions to the device that the search took; 0 if the host led it.
    pub submissions: u32,
    /// Error at the start, at the search's first level; not a number if the host led the search.
    pub first_mse: f64,
    /// What of the pose the picture determines.
    pub observability: Observability,
    /// How far the pose may be off, as the picture alone tells it.
    pub covariance: PoseCovariance,
    /// Where the search began.
    pub begun: Pose,
    /// Whether the picture confirms the pose.
    pub certain: bool,
    /// How the frame agrees with the picture drawn.
    pub agreement: Agreement,
    /// Whether what does not agree was left out of the search.
    pub masked: bool,
    /// False if the frame's renders or its time ended before the search had arrived. Such a pose is never certain.
    pub finished: bool,
    /// Corners of the frame that the candidate explained; 0 if the search did not start at a candidate.
    pub features: u32,
}

impl PoseEstimate {
    /// An outcome, not judged yet, of a search from a start.
    pub(super) fn from_start(start: &Start, outcome: Outcome) -> PoseEstimate {
        PoseEstimate {
            outcome,
            start: start.kind,
            drawn: None,
            submissions: 0,
            first_mse: f64::NAN,
            observability: Observability::default(),
            covariance: PoseCovariance::default(),
            begun: start.pose,
            certain: false,
            agreement: Agreement::default(),
            masked: false,
            finished: true,
            features: 0,
        }
    }

    /// A certain pose that is known otherwise, with its mean squared error.
    pub fn known(pose: Pose, mse: f64) -> PoseEstimate {
        let start = Start { pose, kind: StartKind::Previous };
        let agreement = Agreement {
            share: 1.0,
            score: 1.0,
            is_conclusive: true,
            correction: None,
            sharpness: f64::NAN,
        };
        let outcome = Outcome { pose, mse, stop: Stop::Progress };
        PoseEstimate {
            first_mse: mse,
            certain: true,
            agreement,
            ..PoseEstimate::from_start(&start, outcome)
        }
    }

    /// How far the pose may be off, of ρ in the prior's unit and θ in radians: infinite along the axes of directions
    /// that the picture leaves open, and along all axes if the picture does not confirm the pose. `prior_doubt`:
    /// how many times further off poses are in the prior than pictures tell.
    pub fn stated_covariance(&self, prior_doubt: f64) -> Covariance {
        let covariance = if self.certain { self.covariance } else { PoseCovariance::default() };
        covariance.stated(prior_doubt * doubt(self.agreement.share))
    }

    /// Whether the picture agrees with a pose that is searched on in the next frame.
    pub(super) fn goes_on(&self) -> bool {
        self.agreement.confirms() && !self.finished
    }

    /// A pose that was drawn, with its mean squared error, and from which nothing was searched.
    pub(super) fn unsearched(
        start: &Start,
        (code, mse): (PoseCode, f64),
        agreement: Agreement,
    ) -> PoseEstimate {
        let outcome = Outcome { pose: start.pose, mse, stop: Stop::Iterations };
        let found = PoseEstimate::from_start(start, outcome);
        PoseEstimate { drawn: Some(code), agreement, finished: false, ..found }
    }

    /// Returns the result with less error, this one or the last search's. If it is this one, the last search has drawn
    /// over its picture.
    pub(super) fn or_last(self, last: PoseEstimate) -> PoseEstimate {
        let better = if last.outcome.mse <= self.outcome.mse {
            last
        } else {
            PoseEstimate { drawn: None, ..self }
        };
        PoseEstimate { submissions: self.submissions + last.submissions, ..better }
    }

    /// As [`or_last`](Self::or_last), if there was room for another search. Else this one is not finished.
    pub(super) fn or_retried(self, last: Option<PoseEstimate>) -> PoseEstimate {
        let finished = last.is_some_and(|last| last.finished);
        let better = last.map_or(self, |last| self.or_last(last));
        PoseEstimate { finished: finished && better.finished, ..better }
    }

    /// The result of the last search, which went on from this one.
    pub(super) fn gone_on(&self, last: PoseEstimate, agreement: Agreement) -> PoseEstimate {
        let submissions = self.submissions + last.submissions;
        let certain = agreement.confirms() && last.finished;
        let PoseEstimate { start, begun, features, .. } = *self;
        PoseEstimate { start, begun, features, submissions, agreement, certain, ..last }
    }

    /// Returns the better of two judged results. If both are certain: the one that the frame agrees with more. If one
    /// is certain: that one. Else: the one with less error.
    pub(super) fn or_judged(before: Option<PoseEstimate>, last: PoseEstimate) -> PoseEstimate {
        let Some(before) = before else { return last };
        let both = before.certain && last.certain;
        let rank =
            |f: &PoseEstimate| (f.certain, if both { f.agreement.score } else { -f.outcome.mse });
        let better = if rank(&last) >= rank(&before) {
            last
        } else {
            PoseEstimate { drawn: None, ..before }
        };
        PoseEstimate { submissions: before.submissions + last.submissions, ..better }
    }
}

/// See [`DOUBT`].
fn doubt(share: f64) -> f64 {
    let mut doubt = DOUBT[0].1;
    for [(from, high), (to, low)] in [[DOUBT[0], DOUBT[1]], [DOUBT[1], DOUBT[2]]] {
        let part = ((share - from) / (to - from)).clamp(0.0, 1.0);
        doubt += part * (low - high);
    }
    doubt
}

#[cfg(test)]
mod tests {
    use super::doubt;

    #[test]
    fn the_less_agrees_the_greater_is_the_doubt() {
        let doubts = [0.0, 0.75, 0.825, 0.90, 0.925, 0.95, 1.0].map(doubt);
        let wanted = [4.4, 4.4, 3.9, 3.4, 2.6, 1.8, 1.8];
        let same = |(a, b): (f64, f64)| (a - b).abs() < 1e-9;
        assert!(std::iter::zip(doubts, wanted).all(same), "{doubts:?}");
    }
}
