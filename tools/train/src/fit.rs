//! Fits splats to pictures after some of them were left out: by the steps of [`mapper`](crate::mapper), without noise,
//! pulls and relocations, so that each splat stays what it is.

use glam::DVec3;

use crate::trainer::{NoRoom, Trainer, TrainingFrame, TrainingState, TrainingView};
use nvsprior::prior::{RenderOptions, Splats};
use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Camera, Engine};

use crate::PosedPicture;
use crate::mapper::{MapOptions, Order, Progress, Schedule, from_planes, to_planes, volume};

#[derive(Debug, thiserror::Error)]
pub enum FitError {
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
    #[error(transparent)]
    Device(#[from] DeviceError),
}

pub(crate) struct Fit<'a> {
    engine: &'a Engine,
    views: &'a [PosedPicture],
    frames: Vec<TrainingFrame>,
    /// Middle and size of the cameras' volume.
    centre: DVec3,
    extent: f64,
}

/// The course of a fit: rates fall to a tenth, and all errors count by their squares, as in a PSNR.
fn schedule(pace: f32) -> Schedule {
    Schedule { ssim: 0.0, knee: 1.0, ..Schedule::further(pace, 0.1) }
}

impl<'a> Fit<'a> {
    /// To these pictures, at least one.
    pub fn new(engine: &'a Engine, views: &'a [PosedPicture]) -> Fit<'a> {
        let frames = views.iter().map(|view| TrainingFrame::new(&view.picture)).collect();
        let (centre, extent) = volume(views);
        Fit { engine, views, frames, centre, extent }
    }

    /// Takes so many steps, each towards one picture. Calls `told` after each.
    pub fn run(
        &self,
        splats: &mut Splats,
        render: &RenderOptions,
        (steps, pace): (u32, f32),
        told: &mut dyn FnMut(),
    ) -> Result<(), FitError> {
        if steps == 0 {
            return Ok(());
        }
        let (count, sh_degree) = (splats.len() as u32, splats.sh_degree);
        let schedule = schedule(pace);
        let options = MapOptions {
            render: *render,
            splats: count,
            sh_degree,
            schedule: schedule.clone(),
            ..MapOptions::default()
        };
        let (first, start) = (&self.views[0].camera, to_planes(splats, self.centre));
        let mut trainers = Trainers { fit: self, options: &options, all: Vec::new() };
        trainers.start(size(first), new_state(start))?;
        let mut order = Order::new(options.seed, 0..self.views.len());
        for step in 0..steps {
            let (round, place) = order.at(step);
            let turn = order.picture(round, place);
            let PosedPicture { camera, pose, .. } = &self.views[turn];
            let share = f64::from(step) / f64::from(steps);
            let progress = Progress { step, share, alive: count };
            let training = schedule.at(&progress, sh_degree, (self.extent, camera.pixels()));
            let trainer = trainers.of(size(camera))?;
            trainer.step(
                &TrainingView { camera, pose, frame: &self.frames[turn], factor: 1 },
                &training,
            )?;
            told();
        }
        let state = trainers.last().state()?;
        let fitted = from_planes(&state.parameters, &options, self.centre, count);
        *splats = Splats { origin: splats.origin, ..fitted };
        Ok(())
    }
}

fn size(camera: &Camera) -> [u32; 2] {
    [camera.width, camera.height]
}

fn new_state(parameters: Vec<f32>) -> TrainingState {
    let zero = vec![0.0; parameters.len()];
    TrainingState { parameters, first: zero.clone(), second: zero }
}

/// A trainer for each size of pictures.
struct Trainers<'a> {
    fit: &'a Fit<'a>,
    options: &'a MapOptions,
    /// At least one; the last one has the splats.
    all: Vec<([u32; 2], Trainer)>,
}

impl Trainers<'_> {
    fn last(&mut self) -> &mut Trainer {
        let last = self.all.len() - 1;
        &mut self.all[last].1
    }

    /// The one for a size, with the splats.
    fn of(&mut self, size: [u32; 2]) -> Result<&mut Trainer, FitError> {
        if self.all.last().is_some_and(|(last, _)| *last != size) {
            let state = self.last().state()?;
            match self.all.iter().position(|(other, _)| *other == size) {
                Some(place) => {
                    let (size, mut trainer) = self.all.remove(place);
                    trainer.set(&state)?;
                    self.all.push((size, trainer));
                }
                None => self.start(size, state)?,
            }
        }
        Ok(self.last())
    }

    /// Makes the one for a size, and gives it splats.
    fn start(&mut self, size: [u32; 2], state: TrainingState) -> Result<(), FitError> {
        let plan = self.options.plan(size, self.fit.centre);
        plan.memory(self.fit.engine.device())?;
        let mut trainer = Trainer::new(self.fit.engine, &plan)?;
        trainer.set(&state)?;
        self.all.push((size, trainer));
        Ok(())
    }
}
