//! The poses that the relocaliser gives without any start, as the paper's estimator does: corners alone decide.

use nvsprior::Pose;
use nvsprior::render::{Jacobian, Plan};
use nvsprior::tracking::{Candidate, Objective, Relocaliser};
use nvsprior::{Camera, Picture};
use nvsprior_inputs::args::progress;

use crate::bench::context::{Context, Shot};
use crate::bench::forward::timed;

/// Proposed poses that are looked at more closely.
const PROPOSED: usize = 4;
/// Poses that explain fewer corners may be chance: then each key frame is compared with the frame.
const FEW: u32 = 13;

pub struct Estimates {
    pub poses: Vec<Pose>,
    /// Time of an estimate, mean, milliseconds.
    pub ms: f64,
}

/// Estimates all frames' poses. `None` if the prior has no key frames.
pub fn estimates(context: &Context) -> anyhow::Result<Option<Estimates>> {
    let key_frames = context.scene.key_frames().poses();
    if key_frames.is_empty() {
        return Ok(None);
    }
    let mut estimates = Estimates { poses: Vec::new(), ms: 0.0 };
    let mut estimator: Option<(Camera, Estimator)> = None;
    let bar = progress(context.shots.len(), "key frames, estimates of poses");
    for Shot { camera, picture, .. } in &context.shots {
        let estimator = match &mut estimator {
            Some((of, estimator)) if of == camera => estimator,
            slot => {
                bar.inc_length(key_frames.len() as u64);
                let estimator = Estimator::new(context, camera, || bar.inc(1))?;
                &mut slot.insert((*camera, estimator)).1
            }
        };
        let (pose, ms) = timed(|| estimator.estimate(picture))?;
        // With key frames there is always one that is likeliest.
        estimates.poses.push(pose.unwrap_or(key_frames[0]));
        estimates.ms += ms / context.shots.len() as f64;
        bar.inc(1);
    }
    Ok(Some(estimates))
}

struct Estimator {
    objective: Objective,
    relocaliser: Relocaliser,
}

impl Estimator {
    fn new(context: &Context, camera: &Camera, done: impl Fn()) -> anyhow::Result<Estimator> {
        let plan = Plan { jacobians: vec![Jacobian::Flow], ..Plan::picture() };
        let renderer = context.engine.renderer(&context.scene, camera, plan)?;
        let mut objective = Objective::new(renderer);
        let key_frames = context.scene.key_frames().poses();
        let mut relocaliser = Relocaliser::new(&mut objective, key_frames);
        while relocaliser.left() > 0 {
            relocaliser.learn(&mut objective, 1)?;
            done();
        }
        Ok(Estimator { objective, relocaliser })
    }

    /// The pose that explains most of the frame's corners.
    fn estimate(&mut self, frame: &Picture) -> anyhow::Result<Option<Pose>> {
        self.relocaliser.set_frame(frame);
        let proposed = self.relocaliser.propose(|| true).to_vec();
        let mut best = self.closer(&proposed)?;
        if best.is_none_or(|best| best.features < FEW) {
            let compared = self.relocaliser.compare_some(usize::MAX, 0, || true).to_vec();
            let closer = self.closer(&compared)?;
            best = best.into_iter().chain(closer).max_by_key(|candidate| candidate.features);
        }
        Ok(best.map(|best| best.pose).or_else(|| self.relocaliser.likeliest()))
    }

    /// The best of the first few candidates, improved by renders at them.
    fn closer(&mut self, candidates: &[Candidate]) -> anyhow::Result<Option<Candidate>> {
        let mut best: Option<Candidate> = None;
        for candidate in candidates.iter().take(PROPOSED) {
            let found =
                self.relocaliser.approach(&mut self.objective, &candidate.pose, usize::MAX)?;
            let found = found.unwrap_or(*candidate);
            if best.is_none_or(|best| found.features > best.features) {
                best = Some(found);
            }
        }
        Ok(best)
    }
}
