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

    /// Distances between the true and the found place, the least first, the prior's unit.
    pub fn distances(&self) -> Vec<f64> {
        self.sorted(|error| &error[..3])
    }

    /// Angles between the true and the found attitude, the least first, radians.
    pub fn angles(&self) -> Vec<f64> {
        self.sorted(|error| &error[3..])
    }

    fn sorted(&self, part: fn(&[f32; 6]) -> &[f32]) -> Vec<f64> {
        let length = |trial: &PoseTrial| {
            part(&trial.error).iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt()
        };
        let mut lengths: Vec<f64> = self.trials.iter().map(length).collect();
        lengths.sort_by(f64::total_cmp);
        lengths
    }
}

/// Looks for pictures in a prior: from nothing, if it has key frames, and from starts that are moved. `seen`: poses of
/// the pictures that it was trained on; `depth`: how far away what they show is. Calls `told` after each picture.
pub fn try_poses(
    engine: &Engine,
    prior: &Prior,
    pictures: &[PosedPicture],
    seen: &[Pose],
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
        let moved = MOVED.map(|step| {
            let step = std::array::from_fn(|i| if i < 3 { step[i] * depth } else { step[i] });
            Some(picture.pose.stepped(&step))
        });
        for start in from_nothing.then_some(None).into_iter().chain(moved) {
            encoder.reset();
            let encoded = encoder.encode(&picture.picture, start)?;
            tried.searches += 1;
            if encoded.stats.certain {
                let error = encoded.pose.after(&picture.pose.inverse()).log();
                tried.trials.push(PoseTrial {
                    error: error.map(|v| v as f32),
                    deviation: encoded.stats.pose_deviation().map(|v| v as f32),
                    distance: nearest(&picture.pose, seen) as f32,
                });
            }
        }
        told();
    }
    Ok(tried)
}

/// Distance of the nearest of some poses.
fn nearest(pose: &Pose, seen: &[Pose]) -> f64 {
    let apart = |other: &Pose| (pose.centre() - other.centre()).length();
    seen.iter().map(apart).fold(f64::MAX, f64::min)
}
