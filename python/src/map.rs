//! Training a prior.

use std::sync::Arc;
use std::time::Instant;

use nvsprior::prior::{Splats, origin_of};
use nvsprior::{Camera, Picture, Prior, RenderOptions};
use nvsprior_train::PosedPicture;
use nvsprior_train::key_frames;
use nvsprior_train::mapper::{ColouredPoint, MapOptions, Mapper};
use pyo3::prelude::*;

use crate::arguments::{Whole, whole};
use crate::arrays::{read_mask, read_picture, rows};
use crate::engine::PyEngine;
use crate::errors::Failure;
use crate::geometry::{Poses, PyCamera, PyPose};
use crate::handle::detached;
use crate::prior::PyPrior;

/// Seconds between two looks at Python's signals.
const SLICE: f64 = 0.2;

/// Trains a prior from posed pictures, by 3D Gaussian Splatting with a fixed budget of splats.
///
/// `pictures`: a list of uint8 arrays, or one array, shape (count, height, width, 3), RGB. `camera`: that of all
/// pictures. `poses`: one for each. `masks`: for each an array of which pixels count, as for `Encoder.set_mask`, or
/// None. `points`, `colours`: where training starts, shape (count, 3), in the prior's unit, and colours in [0, 1];
/// without them from random ones. `splats`: most of them. `sh_degree`: of the spherical harmonics, 0 to 3.
/// `iterations`: steps, each towards one picture. `ssim`: share of SSIM in the loss. `knee`: errors below it count by
/// their squares; 0: none. `exposure`: fit each picture's light. `correct_poses`: correct the poses. `seed`: of all
/// that is random. `progress`: called now and then with the steps done and those of the whole; an exception ends the
/// training.
///
/// The prior gets key frames at some of the poses, thinned out. Types: engine: Engine, pictures: list[uint8 array] |
/// uint8 array, camera: Camera, poses: list[Pose | array] | array, masks: list[array | None] | None, points: array |
/// None, colours: array | None, splats: int, sh_degree: int, iterations: int, ssim: float, knee: float, exposure: bool,
/// correct_poses: bool, seed: int, progress: callable | None. Returns Prior.
#[pyfunction]
#[pyo3(signature = (engine, pictures, camera, poses, *, masks = None, points = None, colours = None,
    splats = 40_000, sh_degree = 1, iterations = 8_000, ssim = 0.2, knee = 0.1, exposure = false,
    correct_poses = false, seed = 1, progress = None))]
#[allow(clippy::too_many_arguments)] // Python names them.
pub fn map(
    py: Python,
    engine: &PyEngine,
    pictures: &Bound<PyAny>,
    camera: &PyCamera,
    poses: Poses,
    masks: Option<Vec<Option<Bound<PyAny>>>>,
    points: Option<&Bound<PyAny>>,
    colours: Option<&Bound<PyAny>>,
    splats: i128,
    sh_degree: i128,
    iterations: i128,
    ssim: f32,
    knee: f32,
    exposure: bool,
    correct_poses: bool,
    seed: i128,
    progress: Option<&Bound<PyAny>>,
) -> PyResult<PyPrior> {
    whole!(splats, sh_degree, seed);
    let iterations: u32 = iterations.whole("iterations")?;
    let share = |name: &str, value: f32| match (0.0..=1.0).contains(&value) {
        true => Ok(value),
        false => Err(Failure::argument(format!("{name}: {value}, must lie in 0 to 1"))),
    };
    if iterations == 0 {
        return Err(Failure::argument("iterations: must be 1 or more").into());
    }
    let new = MapOptions::default();
    let mut options = MapOptions { splats, sh_degree, exposure, correct_poses, seed, ..new };
    options.schedule.ssim = share("ssim", ssim)?;
    options.schedule.knee = share("knee", knee)?;
    let options = options.stating_focal(&camera.0);
    let views = posed_pictures(pictures, &camera.0, &poses.all(), masks)?;
    let points = coloured_points(points, colours)?;
    let (origin, views, points) = near_zero(views, points);
    let mapper = detached(py, || Ok(Mapper::new(engine.get()?, views, &points, &options)?))?;
    let prior =
        Training { mapper, iterations, render: options.render, origin }.run(py, progress)?;
    Ok(PyPrior(Arc::new(prior)))
}

fn posed_pictures(
    pictures: &Bound<PyAny>,
    camera: &Camera,
    poses: &[PyPose],
    masks: Option<Vec<Option<Bound<PyAny>>>>,
) -> PyResult<Vec<PosedPicture>> {
    let count = pictures.len()?;
    let alike = |name: &str, found: usize| match found == count {
        true => Ok(()),
        false => Err(Failure::argument(format!("{name}: {found} for {count} pictures"))),
    };
    alike("poses", poses.len())?;
    masks.as_ref().map_or(Ok(()), |masks| alike("masks", masks.len()))?;
    let (width, height) = (camera.width, camera.height);
    let mut views = Vec::with_capacity(count);
    for (index, pose) in poses.iter().enumerate() {
        let name = format!("pictures[{index}]");
        let mut picture = Picture::default();
        read_picture(&name, &pictures.get_item(index)?, &mut picture)?;
        if (picture.width, picture.height) != (width, height) {
            let found = (picture.width, picture.height);
            let expected = (width, height);
            return Err(Failure::from(nvsprior::Error::FrameSize { expected, found }).into());
        }
        let mask = masks.as_ref().and_then(|masks| masks[index].as_ref());
        let name = format!("masks[{index}]");
        let mask = mask.map(|mask| read_mask(&name, mask, (width, height))).transpose()?;
        views.push(PosedPicture { camera: *camera, pose: pose.0, picture, mask });
    }
    Ok(views)
}

fn coloured_points(
    points: Option<&Bound<PyAny>>,
    colours: Option<&Bound<PyAny>>,
) -> PyResult<Vec<([f64; 3], [f32; 3])>> {
    let of = |name: &str, given: Option<&Bound<PyAny>>| {
        given.map_or(Ok(Vec::new()), |given| rows::<3>(name, given, 0..=usize::MAX))
    };
    let (points, colours) = (of("points", points)?, of("colours", colours)?);
    if points.len() != colours.len() {
        let (found, due) = (colours.len(), points.len());
        return Err(Failure::argument(format!("colours: {found} for {due} points")).into());
    }
    let pairs = points.into_iter().zip(colours);
    Ok(pairs.map(|(point, colour)| (point, colour.map(|value| value as f32))).collect())
}

/// What coordinates should count from, and views and points that do.
fn near_zero(
    mut views: Vec<PosedPicture>,
    points: Vec<([f64; 3], [f32; 3])>,
) -> ([f64; 3], Vec<PosedPicture>, Vec<ColouredPoint>) {
    let cameras = views.iter().map(|view| view.pose.centre().into());
    let places: Vec<[f64; 3]> = cameras.chain(points.iter().map(|(point, _)| *point)).collect();
    let origin = origin_of(&places).unwrap_or_default();
    views.iter_mut().for_each(|view| view.pose = view.pose.relative_to(origin.into()));
    let coloured = |(point, rgb): ([f64; 3], [f32; 3])| {
        let position = std::array::from_fn(|axis| (point[axis] - origin[axis]) as f32);
        ColouredPoint { position, rgb }
    };
    (origin, views, points.into_iter().map(coloured).collect())
}

struct Training {
    mapper: Mapper,
    iterations: u32,
    render: RenderOptions,
    origin: [f64; 3],
}

impl Training {
    fn run(mut self, py: Python, progress: Option<&Bound<PyAny>>) -> PyResult<Prior> {
        while self.mapper.steps() < self.iterations {
            detached(py, || self.slice())?;
            py.check_signals()?;
            if let Some(progress) = progress {
                progress.call1((self.mapper.steps(), self.iterations))?;
            }
        }
        Ok(detached(py, || self.prior())?)
    }

    fn prior(&self) -> Result<Prior, Failure> {
        let splats = Splats { origin: self.origin, ..self.mapper.splats()? };
        let cameras = self.mapper.views().iter().map(|view| view.camera);
        let views: Vec<_> = cameras.zip(self.mapper.poses().iter().copied()).collect();
        let key_frames = key_frames::of_run(&splats, self.render.near, &views)?;
        Ok(Prior::from_splats(splats, self.render)?.with_key_frames(key_frames))
    }

    /// Some steps, for about as long as Python may wait.
    fn slice(&mut self) -> Result<(), Failure> {
        let since = Instant::now();
        while self.mapper.steps() < self.iterations && since.elapsed().as_secs_f64() < SLICE {
            self.mapper.step(f64::from(self.mapper.steps()) / f64::from(self.iterations))?;
        }
        Ok(())
    }
}
