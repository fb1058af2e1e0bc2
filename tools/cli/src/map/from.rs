//! `nvsprior map --from`: going on with a prior.

use std::f64::consts::PI;
use std::path::PathBuf;

use glam::{DQuat, DVec3};
use nvsprior::render::Plan;
use nvsprior::{Camera, Engine, Picture, Pose, Prior};
use nvsprior_inputs::args::{OverrideArgs, open_prior};
use nvsprior_train::PosedPicture;
use nvsprior_train::mapper::{MapOptions, Schedule};

use super::inputs::InputArgs;
use crate::record::{self, Dive};

/// Which prior to go on with, and what to remember of it.
#[derive(clap::Args)]
#[command(next_help_heading = "Going on with a prior")]
pub struct FromArgs {
    /// Go on training this prior with the pictures of a later dive, posed in its frame. What they do not show stays as
    /// it is: views of the prior are trained on beside them
    #[arg(long, value_name = "PRIOR",
        conflicts_with_all = ["unposed", "resume", "points", "sh_degree", "white_balance", "clahe"])]
    from: Option<PathBuf>,
    /// Pictures that the prior was trained on, with their poses, in place of the prior's own views: cameras.json,
    /// transforms.json, or the folder of a COLMAP model
    #[arg(long, value_name = "PATH", requires = "from")]
    earlier: Option<PathBuf>,
    /// What the prior's record calls the dive, such as its date [default: its number]
    #[arg(long, value_name = "NAME", requires = "from", value_parser = record::dive_name)]
    dive: Option<String>,
}

/// Rates of the training at the start, as a share of those of a new one.
const PACE: f32 = 1.0;
/// Share of the rates that is left at the end: as long as they are high, what is known already loses detail.
const END: f32 = 0.02;
/// Splats that may be added, as a share of those that there are.
const MORE: f64 = 0.1;
/// Steps of a training that goes on, if nobody says how many.
pub const ITERATIONS: u32 = 600;
/// If a prior has no key frames: how far the views that are remembered are turned from each picture's, half turns.
const TURNS: [f64; 4] = [0.33, -0.33, 0.67, -0.67];
/// Views of which those that are remembered are chosen, per picture.
pub const CANDIDATES: usize = 3;
/// Share of a view that must show something.
const SHOWN: f32 = 0.5;

impl FromArgs {
    /// The prior to go on with, if one is given.
    pub fn prior(&self, overrides: &OverrideArgs) -> anyhow::Result<Option<Prior>> {
        self.from.as_ref().map(|path| open_prior(path, overrides)).transpose()
    }

    /// The options of a training that goes on with a prior. `splats`: most of them, if that was said.
    pub fn options(&self, prior: &Prior, splats: Option<u32>, new: MapOptions) -> MapOptions {
        let more = (prior.len() as f64 * (1.0 + MORE)) as u32;
        let schedule = Schedule {
            ssim: new.schedule.ssim,
            knee: new.schedule.knee,
            ..Schedule::further(PACE, END)
        };
        MapOptions {
            render: *prior.options(),
            sh_degree: prior.splats().sh_degree,
            splats: splats.unwrap_or(more),
            schedule,
            ..new
        }
    }

    /// What is remembered: the earlier pictures, or views of the prior by a camera.
    pub fn memory(
        &self,
        engine: &Engine,
        prior: &Prior,
        inputs: &InputArgs,
        pictures: &[PosedPicture],
    ) -> anyhow::Result<Vec<PosedPicture>> {
        let (camera, most) = (pictures[0].camera, CANDIDATES * pictures.len());
        if let Some(path) = &self.earlier {
            return inputs.read_others(path, most, &camera, prior);
        }
        let poses: Vec<Pose> = match prior.key_frames().poses() {
            [] => pictures.iter().flat_map(|picture| turned(&picture.pose)).collect(),
            poses => poses.to_vec(),
        };
        let every = poses.len().div_ceil(most).max(1);
        views(engine, prior, &camera, poses.iter().step_by(every))
    }

    /// The dives that the prior was trained on, this one the last. `splats`: of the one that was made of it.
    pub fn record(
        &self,
        prior: &Prior,
        pictures: usize,
        splats: usize,
    ) -> anyhow::Result<Option<String>> {
        let mut dives = record::of(prior)?;
        dives.push(Dive {
            name: self.dive.clone().unwrap_or_else(|| record::next_dive(&dives)),
            pictures,
            splats: splats.saturating_sub(prior.len()),
        });
        Ok(record::text_of(&dives))
    }
}

/// The poses of a camera at one place that looks elsewhere.
fn turned(pose: &Pose) -> impl Iterator<Item = Pose> {
    let pose = *pose;
    TURNS.into_iter().map(move |turn| {
        let by = DQuat::from_axis_angle(DVec3::Y, turn * PI);
        Pose { rotation: by * pose.rotation, translation: by * pose.translation }
    })
}

/// Views of a prior that show something.
fn views<'a>(
    engine: &Engine,
    prior: &Prior,
    camera: &Camera,
    poses: impl Iterator<Item = &'a Pose>,
) -> anyhow::Result<Vec<PosedPicture>> {
    let mut renderer = engine.renderer(&engine.upload(prior)?, camera, Plan::picture())?;
    let mut views = Vec::new();
    for pose in poses {
        let image = renderer.draw(pose)?.as_chunks::<5>().0;
        let shown: f32 = image.iter().map(|pixel| 1.0 - pixel[4]).sum();
        if shown >= SHOWN * image.len() as f32 {
            let mut picture = Picture::new(camera.width, camera.height);
            renderer.picture(pose, &mut picture)?;
            views.push(PosedPicture::new(*camera, *pose, picture));
        }
    }
    Ok(views)
}
