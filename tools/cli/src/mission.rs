//! A mission's views: the poses of its cameras, and their frames.

use std::path::Path;

use anyhow::Context as _;
use glam::DVec3;
use nvsprior::image::Preprocessor;
use nvsprior::{Camera, Picture, Pose, Prior};
use nvsprior_train::samples::Margin;

use nvsprior_inputs::args::SizeArgs;
use nvsprior_inputs::camera_file::{CameraFile, View};
use nvsprior_inputs::{frame_file, values};

/// Where a mission's cameras stand.
#[derive(clap::Args)]
pub struct MissionArgs {
    /// Only the views of this split of the camera file
    #[arg(long, value_name = "NAME", requires = "cameras")]
    split: Option<String>,
    #[command(flatten)]
    size: SizeArgs,
    /// How far cameras may stand from the camera file's, in the prior's unit, and how far they may be turned from them,
    /// degrees
    #[arg(long, value_name = "LENGTH[,DEGREES]", default_value = "0", value_parser = margin,
        allow_hyphen_values = true)]
    margin: Margin,
}

fn margin(text: &str) -> Result<Margin, String> {
    let (distance, angle) = values::pair(text)?;
    Ok(Margin { distance, angle: angle.unwrap_or(0.0).to_radians() })
}

/// One view, its pose as from the prior's origin, and, if its file is there, what the camera saw, treated.
pub struct PosedFrame {
    pub camera: Camera,
    pub pose: Pose,
    pub frame: Option<Picture>,
}

/// The views that count and those that check.
pub struct Mission {
    pub margin: Margin,
    /// Those of the split.
    pub views: Vec<PosedFrame>,
    /// Those of every other split.
    pub others: Vec<PosedFrame>,
}

impl MissionArgs {
    /// Reads the views of a mission, with their frames if the files are there. Frames are treated as the prior's
    /// pictures were.
    pub fn read(&self, cameras: &Path, prior: &Prior) -> anyhow::Result<Mission> {
        let mut preprocessor = Preprocessor::new(prior.preprocessing());
        let file = CameraFile::open(cameras)?;
        let chosen = file.select(self.split.as_deref())?;
        let origin = prior.origin();
        let views = self.posed_frames(&chosen, origin, &mut preprocessor)?;
        anyhow::ensure!(!views.is_empty(), "{}: no view has a pose", cameras.display());
        let apart = |view: &&View| self.split.is_some() && view.split != self.split;
        let others: Vec<View> = file.views.iter().filter(apart).cloned().collect();
        let margin = self.margin;
        let others = self.posed_frames(&others, origin, &mut preprocessor)?;
        Ok(Mission { margin, views, others })
    }

    fn posed_frames(
        &self,
        views: &[View],
        origin: DVec3,
        preprocessor: &mut Preprocessor,
    ) -> anyhow::Result<Vec<PosedFrame>> {
        let posed = views.iter().filter_map(|view| Some((view, view.pose?.relative_to(origin))));
        posed.map(|(view, pose)| self.posed(view, pose, preprocessor)).collect()
    }

    fn posed(
        &self,
        view: &View,
        pose: Pose,
        preprocessor: &mut Preprocessor,
    ) -> anyhow::Result<PosedFrame> {
        let camera = self.size.reduced(&view.camera);
        camera.check().with_context(|| view.name.clone())?;
        let read = || frame_file::read_frame(&view.file, camera.width, camera.height);
        let mut frame = view.file.exists().then(read).transpose()?;
        if let Some(frame) = &mut frame {
            preprocessor.apply(frame);
        }
        Ok(PosedFrame { camera, pose, frame })
    }
}

/// Fewest poses within the margin that stand for it.
const MIN_NEAR: usize = 64;

impl Mission {
    /// Poses within the margin; each `turn` gives other ones. None if there is no margin.
    pub fn near(&self, turn: u64) -> Vec<(Camera, Pose)> {
        if self.margin.is_none() {
            return Vec::new();
        }
        let count = self.views.len().max(MIN_NEAR);
        self.margin.around(&self.places(), turn * count as u64, count)
    }

    pub fn places(&self) -> Vec<(Camera, Pose)> {
        places(&self.views)
    }
}

/// At most `max` of some views, evenly spaced.
pub fn spaced<T>(views: &[T], max: usize) -> impl Iterator<Item = &T> {
    views.iter().step_by(views.len().div_ceil(max).max(1))
}

pub fn places<'a>(posed_frames: impl IntoIterator<Item = &'a PosedFrame>) -> Vec<(Camera, Pose)> {
    posed_frames.into_iter().map(|posed| (posed.camera, posed.pose)).collect()
}
