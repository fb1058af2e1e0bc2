//! A mission's views, how a prior's pictures look there, and how long they take.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use nvsprior::render::{Plan, Renderer};
use nvsprior::study::samples::Margin;
use nvsprior::{Camera, Engine, Picture, Pose, Prior};

use crate::args::SizeArgs;
use crate::camera_file::{CameraFile, View};
use crate::frame_file;

/// Where a mission's cameras stand.
#[derive(clap::Args)]
pub struct MissionArgs {
    /// Only the views of this split of the camera file
    #[arg(long, value_name = "NAME", requires = "cameras")]
    split: Option<String>,
    #[command(flatten)]
    size: SizeArgs,
    /// How far cameras may stand from the camera file's, in the prior's unit
    #[arg(long, value_name = "LENGTH", default_value_t = 0.0, value_parser = not_negative)]
    margin_distance: f64,
    /// How far they may be turned from them, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, value_parser = not_negative)]
    margin_angle: f64,
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|e| format!("{e}"))?;
    match value.is_finite() && value >= 0.0 {
        true => Ok(value),
        false => Err("must be a finite number, not negative".into()),
    }
}

/// One view and, where its file is there, what the camera saw.
pub struct Sight {
    pub camera: Camera,
    pub pose: Pose,
    pub frame: Option<Picture>,
}

/// The views that count and those that check.
pub struct Mission {
    pub margin: Margin,
    /// Those of the split.
    pub views: Vec<Sight>,
    /// Those of every other split.
    pub others: Vec<Sight>,
}

impl MissionArgs {
    /// Reads the views, with their frames where the files are there.
    pub fn read(&self, cameras: &PathBuf) -> anyhow::Result<Mission> {
        let file = CameraFile::open(cameras)?;
        let chosen = file.select(self.split.as_deref())?;
        let views = self.sights(&chosen)?;
        anyhow::ensure!(!views.is_empty(), "{}: no view has a pose", cameras.display());
        let apart = |view: &&View| self.split.is_some() && view.split != self.split;
        let others: Vec<View> = file.views.iter().filter(apart).cloned().collect();
        let angle = self.margin_angle.to_radians();
        let margin = Margin { distance: self.margin_distance, angle };
        Ok(Mission { margin, views, others: self.sights(&others)? })
    }

    fn sights(&self, views: &[View]) -> anyhow::Result<Vec<Sight>> {
        let posed = views.iter().filter_map(|view| Some((view, view.pose?)));
        posed.map(|(view, pose)| self.sight(view, pose)).collect()
    }

    fn sight(&self, view: &View, pose: Pose) -> anyhow::Result<Sight> {
        let camera = self.size.reduced(&view.camera);
        camera.check().with_context(|| view.name.clone())?;
        let read = || frame_file::read_frame(&view.file, camera.width, camera.height);
        let frame = view.file.exists().then(read).transpose()?;
        Ok(Sight { camera, pose, frame })
    }
}

impl Mission {
    /// Cameras and poses of the views.
    pub fn places(&self) -> Vec<(Camera, Pose)> {
        places(&self.views)
    }
}

/// Cameras and poses of views.
pub fn places(sights: &[Sight]) -> Vec<(Camera, Pose)> {
    sights.iter().map(|sight| (sight.camera, sight.pose)).collect()
}

/// Draws a prior's 8-bit pictures, for any camera.
pub struct Painter {
    engine: Engine,
    scene: std::sync::Arc<nvsprior::render::Scene>,
    renderer: Option<(Camera, Renderer)>,
    picture: Picture,
}

impl Painter {
    pub fn new(engine: &Engine, prior: &Prior) -> anyhow::Result<Painter> {
        let scene = engine.upload(prior)?;
        Ok(Painter { engine: engine.clone(), scene, renderer: None, picture: Picture::default() })
    }

    /// The picture at a view.
    pub fn paint(&mut self, camera: &Camera, pose: &Pose) -> anyhow::Result<&Picture> {
        if self.renderer.as_ref().is_none_or(|(kept, _)| kept != camera) {
            let renderer = self.engine.renderer(&self.scene, camera, Plan::picture())?;
            self.renderer = Some((*camera, renderer));
            self.picture.resize(camera.width, camera.height);
        }
        if let Some((_, renderer)) = &mut self.renderer {
            renderer.picture(pose, &mut self.picture)?;
        }
        Ok(&self.picture)
    }

    /// The pictures at views.
    pub fn paint_all(&mut self, places: &[(Camera, Pose)]) -> anyhow::Result<Vec<Picture>> {
        places.iter().map(|(camera, pose)| self.paint(camera, pose).cloned()).collect()
    }
}

/// Milliseconds of a picture by each of two, medians over the views of renders turn by turn, and the
/// median of their ratios.
pub struct Times {
    pub first: f64,
    pub second: f64,
    /// First over second.
    pub ratio: f64,
}

/// Renders of each at every view; the first is not counted.
const TURNS: usize = 6;

/// Times two priors' pictures, turn by turn.
pub fn compare_times(
    first: &mut Painter,
    second: &mut Painter,
    places: &[(Camera, Pose)],
) -> anyhow::Result<Times> {
    let (mut a, mut b, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for (camera, pose) in places {
        for turn in 0..TURNS {
            let (ta, tb) = (timed(first, camera, pose)?, timed(second, camera, pose)?);
            if turn > 0 {
                a.push(ta);
                b.push(tb);
                ratios.push(ta / tb);
            }
        }
    }
    Ok(Times { first: median(a), second: median(b), ratio: median(ratios) })
}

fn timed(painter: &mut Painter, camera: &Camera, pose: &Pose) -> anyhow::Result<f64> {
    let since = Instant::now();
    painter.paint(camera, pose)?;
    Ok(since.elapsed().as_secs_f64() * 1e3)
}

/// The upper median; NaN where there is no value.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
