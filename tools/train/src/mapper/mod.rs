//! Training a prior from posed pictures, on the device: 3D Gaussian Splatting (Kerbl et al. 2023) with a fixed budget
//! of splats, which noise and relocation spread (3DGS-MCMC, Kheradmand et al. 2024).
//!
//! The prior is trained by the engine's own render path, so it fits the renderer that will draw it. All that is random
//! follows from the seed and the number of the step: the same input gives the same prior on one device, byte for byte,
//! also if training is interrupted and goes on.

mod error;
mod exposure;
mod frames;
mod memory;
mod options;
mod order;
mod poses;
mod relocate;
mod saved;
mod schedule;
mod splats;
mod start;

use crate::trainer::{Trainer, TrainingState, TrainingView};
use glam::DVec3;
use nvsprior::prior::Splats;
use nvsprior::random::Random;
use nvsprior::vulkan::StageTime;
use nvsprior::{Camera, Engine, Picture, Pose, Prior};
use nvsprior_kernels::training::planes;

use crate::PosedPicture;
pub use error::MapError;
pub use exposure::Exposure;
use frames::{Frames, Look};
use memory::{Memory, Now};
pub use options::MapOptions;
pub(crate) use order::Order;
use poses::PoseSteps;
use relocate::{relocate, sort_by_size};
pub use saved::{SavedError, read_state, write_state};
pub(crate) use schedule::Progress;
pub use schedule::Schedule;
use splats::to_roomy_planes;
pub(crate) use splats::{from_planes, to_planes};
pub use start::ColouredPoint;
use start::start;

/// A training as it stands after a step: enough to go on.
#[derive(Clone, Debug, PartialEq)]
pub struct MapState {
    pub step: u32,
    /// Splats in use, the first ones of the planes.
    pub alive: u32,
    /// Parameters, and what Adam knows of them.
    pub training: TrainingState,
    pub exposures: Vec<Exposure>,
    pub poses: Vec<Pose>,
}

/// The pictures' light and poses are fitted after so many rounds through all pictures.
const FITTED_ROUNDS: usize = 8;
/// Poses are not corrected before: the splats are too coarse.
const POSES_FROM: usize = 16;
/// How much stronger pulls are if there are no points to start from: random splats stand where nothing is, and fit what
/// single pictures show.
const WITHOUT_POINTS: f32 = 5.0;

pub struct Mapper {
    engine: Engine,
    trainer: Trainer,
    views: Vec<PosedPicture>,
    /// Their poses, as far as they are corrected.
    poses: Vec<Pose>,
    exposures: Vec<Exposure>,
    /// The pictures without it.
    frames: Frames,
    /// Which picture's turn it is: all in turn, in an order that is another one in each round.
    order: Order,
    options: MapOptions,
    /// What positions are relative to.
    centre: DVec3,
    /// Size of the cameras' volume, the prior's unit.
    extent: f64,
    step: u32,
    alive: u32,
    /// Which of the pictures are of a prior that the training goes on with.
    memory: Option<Memory>,
}

impl Mapper {
    /// Starts from points, or from random ones in front of the cameras if there are none. Then the pulls are stronger
    /// than the options say.
    pub fn new(
        engine: &Engine,
        views: Vec<PosedPicture>,
        points: &[ColouredPoint],
        options: &MapOptions,
    ) -> Result<Mapper, MapError> {
        check(&views, options)?;
        let (centre, extent) = volume(&views);
        check_room(engine, &views, options)?;
        let from = start(&views, points, options, centre, extent);
        let mut options = options.clone();
        if points.is_empty() {
            options.schedule.opacity_pull *= WITHOUT_POINTS;
            options.schedule.scale_pull *= WITHOUT_POINTS;
        }
        Mapper::of(engine, views, &options, (centre, extent), from, None)
    }

    /// Goes on with a prior, by pictures of a later dive. `memory`: views of the prior as it was; at most as many as
    /// there are pictures are trained on beside these, where they show what has not changed. The options' degree and
    /// render options are the prior's. [`Mapper::state`] does not hold the memory: such a training cannot be resumed.
    pub fn going_on(
        engine: &Engine,
        prior: &Prior,
        mut views: Vec<PosedPicture>,
        memory: Vec<PosedPicture>,
        options: &MapOptions,
    ) -> Result<Mapper, MapError> {
        let options = MapOptions {
            render: *prior.options(),
            sh_degree: prior.splats().sh_degree,
            ..options.clone()
        };
        check(&views, &options)?;
        if prior.len() > options.splats as usize {
            let value = options.splats.into();
            let range = "at least as many as the prior has";
            return Err(MapError::Option { name: "splats", value, range });
        }
        check_room(engine, &views, &options)?;
        let memory = Memory::new(engine, prior, &mut views, memory)?;
        check(&views, &options)?;
        let (centre, extent) = volume(&views);
        let planes = to_roomy_planes(prior.splats(), centre, options.splats as usize);
        let from = (planes, prior.len() as u32);
        Mapper::of(engine, views, &options, (centre, extent), from, Some(memory))
    }

    fn of(
        engine: &Engine,
        views: Vec<PosedPicture>,
        options: &MapOptions,
        (centre, extent): (DVec3, f64),
        (parameters, alive): (Vec<f32>, u32),
        memory: Option<Memory>,
    ) -> Result<Mapper, MapError> {
        let camera = views[0].camera;
        let plan = options.plan([camera.width, camera.height], centre);
        let mut trainer = Trainer::new(engine, &plan)?;
        let zero = vec![0.0; parameters.len()];
        trainer.set(&TrainingState { parameters, first: zero.clone(), second: zero })?;
        trainer.set_in_use(alive);
        let exposures = vec![Exposure::NONE; views.len()];
        let mut mapper = Mapper {
            engine: engine.clone(),
            trainer,
            poses: views.iter().map(|view| view.pose).collect(),
            exposures,
            frames: Frames::new(
                &options.reductions,
                options.schedule.factor(0.0, [camera.width, camera.height]),
            ),
            order: Order::new(options.seed, 0..views.len()),
            views,
            options: options.clone(),
            centre,
            extent,
            step: 0,
            alive,
            memory,
        };
        mapper.undo_exposures();
        Ok(mapper)
    }

    /// Leaves these pictures out from here on, and no others: nothing but their own light and poses is fitted to them.
    pub fn hold_out(&mut self, places: &[usize]) {
        let others = (0..self.views.len()).filter(|place| !places.contains(place));
        self.order = Order::new(self.options.seed, others);
    }

    /// Whether some pictures are left out.
    pub fn holds_out(&self) -> bool {
        self.order.pictures() < self.views.len()
    }

    /// Takes one step, on the picture whose turn it is. `share`: of the training that is done, 0 to 1, by which rates
    /// fall.
    pub fn step(&mut self, share: f64) -> Result<(), MapError> {
        let (round, place) = self.order.at(self.step);
        if place == 0 && round > 0 && round.is_multiple_of(FITTED_ROUNDS) {
            self.fit_views(round)?;
        }
        let turn = self.order.picture(round, place);
        let camera = self.views[turn].camera;
        let factor = self.options.schedule.factor(share, [camera.width, camera.height]);
        if self.frames.reduce(factor) {
            self.undo_exposures();
        }
        let Look { frame, reduction, low_pass } = self.frames.of(turn, round);
        let (camera, pose) = (&camera.reduced(reduction), &self.poses[turn]);
        let progress = Progress { step: self.step, share, alive: self.alive };
        let scene = (self.extent, camera.pixels());
        let training = self.options.schedule.at(&progress, self.options.sh_degree, scene);
        let view = TrainingView { camera, pose, frame, factor: low_pass };
        self.trainer.step(&view, &training)?;
        self.step += 1;
        if self.options.schedule.relocates_after(self.step, share) {
            self.relocate()?;
        }
        Ok(())
    }

    /// Fits what is not known of the pictures to the splats as they are.
    fn fit_views(&mut self, round: usize) -> Result<(), MapError> {
        if self.options.exposure {
            self.fit_exposures()?;
        }
        if self.options.correct_poses && round >= POSES_FROM {
            self.correct_poses()?;
        }
        Ok(())
    }

    fn fit_exposures(&mut self) -> Result<(), MapError> {
        let new = self.pictures();
        let views = self.views[..new].iter().zip(&self.poses);
        for ((view, pose), exposure) in views.zip(&mut self.exposures) {
            let mut render = Picture::new(view.camera.width, view.camera.height);
            self.trainer.picture(&view.camera, pose, &mut render)?;
            *exposure = Exposure::fit(&render, view);
        }
        // The views of a prior hold the scene's light.
        if self.memory.is_none() {
            exposure::centre(&mut self.exposures);
        }
        self.undo_exposures();
        Ok(())
    }

    fn correct_poses(&mut self) -> Result<(), MapError> {
        let prior = Prior::from_splats(self.splats()?, self.options.render)?;
        let mut steps = PoseSteps::new(&self.engine, &prior)?;
        let new = self.pictures();
        let views = self.views[..new].iter().zip(&self.exposures);
        for ((view, exposure), pose) in views.zip(&mut self.poses) {
            *pose = steps.step(view, &exposure.undone_picture(view), pose)?;
        }
        Ok(())
    }

    fn undo_exposures(&mut self) {
        self.frames.set(&self.views, &self.exposures);
    }

    /// Moves splats that show nothing to where others show much, and adds some.
    fn relocate(&mut self) -> Result<(), MapError> {
        let mut state = self.trainer.state()?;
        let seed = self.options.seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ u64::from(self.step);
        let n = self.options.splats;
        let (alive, growth) = (self.alive, self.options.schedule.growth);
        let weights = self.remember()?;
        let mut random = Random::new(seed);
        self.alive = relocate(&mut state, n, alive, growth, weights.as_deref(), &mut random);
        sort_by_size(&mut state, n as usize, self.alive as usize, self.extent as f32);
        self.trainer.set(&state)?;
        self.trainer.set_in_use(self.alive);
        Ok(())
    }

    /// If the training goes on with a prior: renews what is remembered of it. Returns how much each splat is to be
    /// divided: the more, the more wrong it is.
    fn remember(&mut self) -> Result<Option<Vec<f32>>, MapError> {
        let Some(memory) = &self.memory else { return Ok(None) };
        let splats = self.splats()?;
        let (engine, options) = (&self.engine, &self.options.render);
        let (poses, exposures) = (&self.poses[..], &self.exposures[..]);
        let now = Now { engine, splats: &splats, options, poses, exposures };
        let errors = memory.renew(&now, &mut self.views)?;
        self.undo_exposures();
        Ok(Some(errors.iter().map(|error| error.powi(2)).collect()))
    }

    /// How many of the views are pictures; the others are of a prior that the training goes on with.
    pub fn pictures(&self) -> usize {
        self.memory.as_ref().map_or(self.views.len(), |memory| memory.first)
    }

    pub fn steps(&self) -> u32 {
        self.step
    }

    /// Splats in use.
    pub fn alive(&self) -> u32 {
        self.alive
    }

    /// The pictures it is trained on, and the views of a prior that it goes on with.
    pub fn views(&self) -> &[PosedPicture] {
        &self.views
    }

    /// The pictures' poses, corrected if the options say so.
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// The splats as they are, in world axes.
    pub fn splats(&self) -> Result<Splats, MapError> {
        let state = self.trainer.state()?;
        let Mapper { options, centre, alive, .. } = self;
        Ok(from_planes(&state.parameters, options, *centre, *alive))
    }

    /// Draws the splats as they are.
    pub fn picture(&mut self, camera: &Camera, pose: &Pose) -> Result<Picture, MapError> {
        let mut picture = Picture::new(camera.width, camera.height);
        self.trainer.picture(camera, pose, &mut picture)?;
        Ok(picture)
    }

    /// Device times of the last step's stages, if the options asked for them.
    pub fn stage_times(&self) -> Result<Vec<StageTime>, MapError> {
        Ok(self.trainer.stage_times()?)
    }

    /// All that it takes to go on later.
    pub fn state(&self) -> Result<MapState, MapError> {
        let training = self.trainer.state()?;
        let (exposures, poses) = (self.exposures.clone(), self.poses.clone());
        Ok(MapState { step: self.step, alive: self.alive, training, exposures, poses })
    }

    /// Goes on from a state of the same training.
    pub fn resume(&mut self, state: &MapState) -> Result<(), MapError> {
        if self.memory.is_some() {
            return Err(MapError::State { what: "it does not hold what is remembered of a prior" });
        }
        let numbers = self.options.splats as usize * planes(self.options.sh_degree) as usize;
        let TrainingState { parameters, first, second } = &state.training;
        if [parameters, first, second].into_iter().any(|planes| planes.len() != numbers) {
            return Err(MapError::State { what: "the number of splats or of their coefficients" });
        }
        if state.alive > self.options.splats {
            return Err(MapError::State { what: "the number of splats" });
        }
        let pictures = [state.exposures.len(), state.poses.len()];
        if pictures != [self.views.len(); 2] {
            return Err(MapError::State { what: "the number of pictures" });
        }
        self.trainer.set(&state.training)?;
        (self.step, self.alive) = (state.step, state.alive);
        self.trainer.set_in_use(self.alive);
        self.exposures.clone_from(&state.exposures);
        self.poses.clone_from(&state.poses);
        self.undo_exposures();
        Ok(())
    }
}

fn check(views: &[PosedPicture], options: &MapOptions) -> Result<(), MapError> {
    let first = views.first().ok_or(MapError::NoPictures)?;
    for (index, view) in views.iter().enumerate() {
        let Picture { width, height, .. } = view.picture;
        let same = (width, height) == (first.camera.width, first.camera.height)
            && (view.camera.width, view.camera.height) == (width, height);
        if !same {
            return Err(MapError::Size { index, width, height });
        }
        if !view.pose.translation.is_finite() || !view.pose.rotation.is_finite() {
            return Err(MapError::Pose { index });
        }
    }
    let in_range = [
        ("splats", f64::from(options.splats), 1.0..=16e6, "1 to 16,000,000"),
        ("sh-degree", f64::from(options.sh_degree), 0.0..=3.0, "0 to 3"),
    ];
    for (name, value, allowed, range) in in_range {
        if !allowed.contains(&value) {
            return Err(MapError::Option { name, value, range });
        }
    }
    check_reductions(options, &first.camera)
}

/// SSIM needs a window of pixels at each size.
const LEAST_SIDE: u32 = 11;

fn check_reductions(options: &MapOptions, camera: &Camera) -> Result<(), MapError> {
    let (name, most) = ("reductions", camera.width.min(camera.height) / LEAST_SIDE);
    let value = f64::from(options.reductions.iter().copied().max().unwrap_or(0));
    let range = "at least one; sides at least 11 pixels";
    if options.reductions.is_empty() {
        return Err(MapError::Option { name, value, range });
    }
    if options.reductions.iter().any(|by| *by == 0 || (*by > 1 && *by > most)) {
        return Err(MapError::Option { name, value, range });
    }
    Ok(())
}

/// Refuses what the device has no room for, before anything is made.
fn check_room(
    engine: &Engine,
    views: &[PosedPicture],
    options: &MapOptions,
) -> Result<(), MapError> {
    let camera = views[0].camera;
    options.plan([camera.width, camera.height], DVec3::ZERO).memory(engine.device())?;
    Ok(())
}

/// Middle of the cameras, and their greatest distance from it (gsplat's scene scale: a tenth more).
pub(crate) fn volume(views: &[PosedPicture]) -> (DVec3, f64) {
    let sum: DVec3 = views.iter().map(|view| view.pose.centre()).sum();
    let centre = sum / views.len() as f64;
    let distance = |view: &PosedPicture| view.pose.centre().distance(centre);
    let extent = 1.1 * views.iter().map(distance).fold(0.0, f64::max);
    (centre.as_vec3().as_dvec3(), if extent > 1e-6 { extent } else { 1.0 })
}
