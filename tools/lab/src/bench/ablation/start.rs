//! Compares sources of starts, as the paper's "Initialization": searches for each frame after the first from each
//! source.

use nvsprior::render::Plan;
use nvsprior::tracking::{Objective, Relocaliser};
use nvsprior::{EncoderOptions, Picture, Pose};

use super::super::context::{Context, Sample};
use super::super::perturbed::{NEAR, steps};
use super::judge::{Judge, Judged};
use super::method::{Attempt, Method};
use super::searches::Searches;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartSource {
    /// What was found for the frame before.
    Previous,
    /// A pose from outside, off by up to 0.11 units and 3° per axis (the paper's public data sets).
    External,
    /// The frame alone, by the prior's key frames, if it has any (in place of the paper's PoseLSTM).
    Relocaliser,
}

impl StartSource {
    pub const ALL: [StartSource; 3] =
        [StartSource::Previous, StartSource::External, StartSource::Relocaliser];

    pub fn name(self) -> &'static str {
        match self {
            StartSource::Previous => "previous",
            StartSource::External => "external",
            StartSource::Relocaliser => "relocaliser",
        }
    }
}

fn sources(context: &Context) -> Vec<StartSource> {
    let key_frames = !context.prior.key_frames().is_empty();
    let there = |source: &StartSource| *source != StartSource::Relocaliser || key_frames;
    StartSource::ALL.into_iter().filter(there).collect()
}

/// Finds poses by frames alone.
struct Estimator {
    objective: Objective,
    relocaliser: Relocaliser,
}

impl Estimator {
    /// Of a context's prior and first camera. Renders all key frames.
    fn new(context: &Context) -> anyhow::Result<Estimator> {
        let EncoderOptions { factors, refine, .. } = context.options();
        let plan = Plan { factors, search: Some(refine.jacobian), ..Plan::picture() };
        let renderer = context.engine.renderer(&context.scene, &context.shots[0].camera, plan)?;
        let mut objective = Objective::new(renderer);
        let key_frames = context.prior.key_frames().poses();
        let mut relocaliser = Relocaliser::new(&mut objective, key_frames);
        relocaliser.learn(&mut objective, usize::MAX)?;
        Ok(Estimator { objective, relocaliser })
    }

    /// The pose that explains most of a frame's corners; the likeliest key frame's if there is none.
    fn pose(&mut self, frame: &Picture) -> anyhow::Result<Option<Pose>> {
        self.relocaliser.set_frame(frame);
        let proposed = self.relocaliser.propose(|| true).first().map(|candidate| candidate.pose);
        let Some(pose) = proposed else { return Ok(self.relocaliser.likeliest()) };
        let nearer = self.relocaliser.approach(&mut self.objective, &pose, usize::MAX)?;
        Ok(Some(nearer.map_or(pose, |candidate| candidate.pose)))
    }
}

/// Methods that sources are compared with.
pub const METHODS: [Method; 2] = [Method::BFGS, Method::GAUSS_NEWTON];

/// Seed of the external poses.
const SEED: u64 = 13;

/// A frame from one source with one method.
pub struct StartTrial {
    pub source: StartSource,
    pub outcome: Judged,
}

pub fn count(context: &Context) -> usize {
    METHODS.len() * sources(context).len() * (context.shots.len() - 1)
}

/// Every frame after the first, from every source.
pub fn measure(
    context: &mut Context,
    searches: &mut Searches,
    judge: &mut Judge,
    done: impl Fn(),
) -> anyhow::Result<Vec<StartTrial>> {
    let poses: Vec<_> = context.best.iter().map(|best| best.pose).collect();
    let relocaliser = sources(context).contains(&StartSource::Relocaliser);
    let mut estimator = relocaliser.then(|| Estimator::new(context)).transpose()?;
    let mut trials = Vec::new();
    for shot in 1..poses.len() {
        let estimated = match &mut estimator {
            Some(estimator) => estimator.pose(&context.shots[shot].picture)?,
            None => None,
        };
        for method in METHODS {
            for source in sources(context) {
                let pose = match source {
                    StartSource::Previous => None,
                    StartSource::External => {
                        steps(NEAR, SEED).nth(shot).map(|step| poses[shot].stepped(&step))
                    }
                    StartSource::Relocaliser => estimated,
                };
                let sample = sample(context, searches, method, shot, pose, &poses[shot - 1])?;
                let outcome = judge.judge(context, shot, method, Attempt::of(&sample))?;
                trials.push(StartTrial { source, outcome });
                done();
            }
        }
    }
    Ok(trials)
}

/// Measures a frame that starts from a pose from outside, or only from the frame before, which is found from `before`.
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
