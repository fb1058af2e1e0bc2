//! Finds pictures that a prior was not trained on, as an encoder would, and compares their poses.

use nvsprior::prior::PoseTrial;
use nvsprior::{Encoder, EncoderOptions, Engine, Error, Pose, Prior};

use crate::PosedPicture;

/// Starts that are moved, beside none at all: along and about the camera's axes, in depths of the scene and radians.
const MOVED: [[f64; 6]; 2] =
    [[0.04, -0.03, 0.05, 0.03, -0.04, 0.03], [-0.05, 0.04, -0.03, -0.03, 0.05, -0.02]];

/// Renders that a search may take after its first one: what a prior is not worth must not take long to learn.
const LOST_RENDERS: u32 = 32;

/// What became of pictures that were held out.
#[derive(Clone, Debug, Default)]
pub struct Tried {
    /// Those that an encoder was certain of, once per start.
    pub trials: Vec<PoseTrial>,
    /// How often a picture was looked for.
    pub searches: usize,
}

impl Tried {
    /// Share of the searches that an encoder was certain of.
    pub fn certain(&self) -> f64 {
        self.trials.len() as f64 / self.searches.max(1) as f64
    }

    /// Distance (the prior's unit) and angle (degrees) between the true and the found pose, each such that this share
    /// of the trials does not exceed it.
    pub fn off(&self, share: f64) -> Option<(f64, f64)> {
        let within = (share * self.trials.len() as f64).ceil() as usize;
        let at = |part: fn(&[f32; 6]) -> &[f32]| {
            let square = |trial: &PoseTrial| part(&trial.error).iter().map(|v| v * v).sum();
            let mut squares: Vec<f32> = self.trials.iter().map(square).collect();
            squares.sort_by(f32::total_cmp);
            squares.get(within.saturating_sub(1)).map(|square| f64::from(*square).sqrt())
        };
        Some((at(|error| &error[..3])?, at(|error| &error[3..])?.to_degrees()))
    }
}

/// Starts beside a pose. `depth`: how far away what is seen from it is.
pub fn moved(pose: &Pose, depth: f64) -> [Pose; 2] {
    let scaled = |step: [f64; 6], i| if i < 3 { step[i] * depth } else { step[i] };
    MOVED.map(|step| pose.stepped(&std::array::from_fn(|i| scaled(step, i))))
}

/// Looks for pictures in a prior: from nothing, if it has key frames, and from starts that are moved. `depth`: how far
/// away what they show is. Calls `told` after each picture.
pub fn try_poses(
    engine: &Engine,
    prior: &Prior,
    pictures: &[PosedPicture],
    depth: f64,
    told: &mut dyn FnMut(),
) -> Result<Tried, Error> {
    let mut tried = Tried::default();
    let Some(first) = pictures.first() else { return Ok(tried) };
    let scene = engine.upload(prior)?;
    // Pictures that are trained on are treated already.
    let mut options =
        EncoderOptions { rate: None, frames_treated: true, truth: false, ..Default::default() };
    options.refine.lost_renders = LOST_RENDERS;
    let mut encoder = Encoder::new(engine, &scene, &first.camera, options)?;
    while encoder.prepare(usize::MAX)? > 0 {}
    let from_nothing = !prior.key_frames().is_empty();
    for picture in pictures {
        encoder.set_camera(&picture.camera)?;
        let moved = moved(&picture.pose, depth).map(Some);
        for start in from_nothing.then_some(None).into_iter().chain(moved) {
            encoder.reset();
            let encoded = encoder.encode(&picture.picture, start)?;
            tried.searches += 1;
            if encoded.stats.certain {
                let error = encoded.pose.after(&picture.pose.inverse()).log();
                tried.trials.push(PoseTrial {
                    error: error.map(|v| v as f32),
                    deviation: encoded.stats.pose_deviation().map(|v| v as f32),
                });
            }
        }
        told();
    }
    Ok(tried)
}
