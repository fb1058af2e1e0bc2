//! Sources of starts compared, as the paper's "Initialization": each frame after the first is looked
//! for from each source.

use nvsprior::Pose;

use super::super::context::{Context, Sample};
use super::super::perturbed::{NEAR, steps};
use super::judge::{Judge, Verdict};
use super::method::{Attempt, Method, Searches};

/// Where starts come from.
///
/// A relocaliser, which finds a pose by the frame alone (the paper's PoseLSTM), belongs here as a third
/// source: add it to this enum, to `ALL` and to `name`, and give its pose in [`StartSource::pose`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartSource {
    /// What was found for the frame before.
    Previous,
    /// A pose from outside, off by up to 0.11 units and 3° an axis (the paper's public data sets).
    External,
}

impl StartSource {
    pub const ALL: [StartSource; 2] = [StartSource::Previous, StartSource::External];

    pub fn name(self) -> &'static str {
        match self {
            StartSource::Previous => "previous",
            StartSource::External => "external",
        }
    }

    /// The pose that it gives from outside; `None`: the search goes on from the frame before.
    fn pose(self, best: &Pose, shot: usize) -> Option<Pose> {
        match self {
            StartSource::Previous => None,
            StartSource::External => steps(NEAR, SEED).nth(shot).map(|step| best.stepped(&step)),
        }
    }
}

/// Methods that sources are compared with.
pub const METHODS: [Method; 2] = [Method::BFGS, Method::GAUSS_NEWTON];

/// Seed of the external poses.
const SEED: u64 = 13;

/// A frame from one source with one method.
pub struct StartTrial {
    pub shot: usize,
    pub source: StartSource,
    pub method: Method,
    pub attempt: Attempt,
    pub verdict: Verdict,
}

/// Number of trials.
pub fn count(context: &Context) -> usize {
    METHODS.len() * StartSource::ALL.len() * (context.shots.len() - 1)
}

/// Every frame after the first, from every source.
pub fn measure(
    context: &mut Context,
    searches: &mut Searches,
    judge: &mut Judge,
    done: impl Fn(),
) -> anyhow::Result<Vec<StartTrial>> {
    let poses: Vec<_> = context.best.iter().map(|best| best.pose).collect();
    let mut trials = Vec::new();
    for shot in 1..poses.len() {
        for method in METHODS {
            for source in StartSource::ALL {
                let pose = source.pose(&poses[shot], shot);
                let sample = sample(context, searches, method, shot, pose, &poses[shot - 1])?;
                let verdict = judge.judge(context, shot, &sample.pose)?;
                let attempt = Attempt::of(&sample);
                super::learn(context, shot, &attempt, &verdict);
                trials.push(StartTrial { shot, source, method, attempt, verdict });
                done();
            }
        }
    }
    Ok(trials)
}

/// A frame from a pose from outside, or after the frame before alone, which is found from `before`.
fn sample(
    context: &mut Context,
    searches: &mut Searches,
    method: Method,
    shot: usize,
    outside: Option<Pose>,
    before: &Pose,
) -> anyhow::Result<Sample> {
    let encoder = searches.encoder(method);
    encoder.reset();
    if outside.is_none() {
        context.sample(encoder, shot - 1, Some(*before))?;
    }
    context.sample(encoder, shot, outside)
}
