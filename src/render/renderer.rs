//! The recorded chain of stages, at every level of the pyramid.

use std::sync::Arc;

use crate::shared::{Counters, PIXEL};
use crate::vulkan::{Commands, Device, Error, Recorder, StageTime};
use crate::{Camera, Picture, Pose};

use super::radix::Fineness;
use super::view::{NormalEquations, View};
use super::workspace::Workspace;
use super::{Kernels, Scene, derive, lists, reduce, splat};

/// Which pose Jacobian the normal equations are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Jacobian {
    /// Optical flow of each pixel's own ray (DESIGN: the same renders and final error as the exact).
    Flow,
    /// Of exactly what is drawn: means, covariances, colours.
    Exact,
}

/// What a renderer is to be ready for; only that is allocated and recorded.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Reduction factors of the pyramid's levels. Level 0 should be 1, the full picture.
    pub factors: Vec<u32>,
    /// Jacobians that will be asked for.
    pub jacobians: Vec<Jacobian>,
    /// Have the device time each stage.
    pub profiled: bool,
}

impl Plan {
    /// The full picture alone, without normal equations.
    pub fn picture() -> Plan {
        Plan { factors: vec![1], jacobians: Vec::new(), profiled: false }
    }
}

/// A level's buffers and its recorded commands.
struct Level {
    view: View,
    recorded: Recorded,
}

/// What a level can be asked for.
struct Recorded {
    draw: Commands,
    flow: Option<Commands>,
    exact: Option<Commands>,
}

/// Renders one prior for one camera. All commands are recorded beforehand; a render writes the pose,
/// submits and waits.
pub struct Renderer {
    device: Device,
    kernels: Arc<Kernels>,
    scene: Arc<Scene>,
    plan: Plan,
    work: Workspace,
    levels: Vec<Level>,
    renders: Vec<u32>,
}

/// The commands of a level that a caller wants run.
#[derive(Clone, Copy)]
enum Job {
    Draw,
    Sums(Jacobian),
}

impl Renderer {
    /// Allocates and records everything of `plan`. Levels that would have no pixel are left out.
    pub fn new(
        device: &Device,
        kernels: &Arc<Kernels>,
        scene: &Arc<Scene>,
        camera: &Camera,
        plan: Plan,
    ) -> Result<Renderer, Error> {
        let exact = plan.jacobians.contains(&Jacobian::Exact);
        // Room for a few tiles a splat; a picture that needs more makes it grow once.
        let pairs = (scene.splats.saturating_mul(8)).clamp(1 << 14, 1 << 22);
        let work = Workspace::new(device, scene, pairs, exact)?;
        let mut renderer = Renderer {
            device: device.clone(),
            kernels: kernels.clone(),
            scene: scene.clone(),
            work,
            levels: Vec::new(),
            renders: Vec::new(),
            plan,
        };
        for factor in renderer.plan.factors.clone() {
            let camera = camera.reduced(factor);
            if camera.width > 0 && camera.height > 0 {
                let view = View::new(device, &camera)?;
                let recorded = renderer.record_all(&renderer.work, &view)?;
                renderer.levels.push(Level { view, recorded });
                renderer.renders.push(0);
            }
        }
        Ok(renderer)
    }

    fn record_all(&self, work: &Workspace, view: &View) -> Result<Recorded, Error> {
        let sums = |jacobian| {
            let wanted = self.plan.jacobians.contains(&jacobian);
            wanted.then(|| self.record(work, view, Job::Sums(jacobian))).transpose()
        };
        Ok(Recorded {
            flow: sums(Jacobian::Flow)?,
            exact: sums(Jacobian::Exact)?,
            draw: self.record(work, view, Job::Draw)?,
        })
    }

    fn record(&self, work: &Workspace, view: &View, job: Job) -> Result<Commands, Error> {
        let (kernels, scene) = (&*self.kernels, &*self.scene);
        let mut recorder = if self.plan.profiled {
            Recorder::profiled(&self.device)?
        } else {
            Recorder::new(&self.device)?
        };
        let r = &mut recorder;
        lists::record(r, kernels, scene, view, work, Fineness::Exact)?;
        match job {
            Job::Draw => splat::record(r, kernels, view, work)?,
            Job::Sums(Jacobian::Flow) => {
                splat::record_flow(r, kernels, view, work)?;
                reduce::record(r, kernels, view)?;
            }
            Job::Sums(Jacobian::Exact) => {
                derive::record(r, kernels, scene, view, work)?;
                splat::record_exact(r, kernels, view, work)?;
                reduce::record(r, kernels, view)?;
            }
        }
        r.copy(&work.counters, &work.counters_read)?;
        recorder.finish()
    }

    /// Runs a level's job at a pose. Where the picture needs more pairs than there is room for,
    /// makes room and runs again: nothing is left out of a result.
    fn run(&mut self, level: usize, job: Job, pose: &Pose) -> Result<(), Error> {
        loop {
            let capacity = self.work.pair_capacity;
            let Level { view, recorded: Recorded { draw, flow, exact } } = &mut self.levels[level];
            view.set_pose(&self.scene, capacity, pose);
            let commands = match job {
                Job::Draw => Some(draw),
                Job::Sums(Jacobian::Flow) => flow.as_mut(),
                Job::Sums(Jacobian::Exact) => exact.as_mut(),
            };
            commands.expect("only planned Jacobians are asked for").run()?;
            self.renders[level] += 1;
            let counters = self.counters();
            if counters.pairs_needed <= capacity {
                return Ok(());
            }
            self.grow(counters.pairs_needed)?;
        }
    }

    /// Makes room for more pairs. Where that fails, everything is as before.
    fn grow(&mut self, pairs: u32) -> Result<(), Error> {
        let room = pairs.saturating_add(pairs / 4);
        let exact = self.plan.jacobians.contains(&Jacobian::Exact);
        let work = Workspace::new(&self.device, &self.scene, room, exact)?;
        let recorded: Result<Vec<Recorded>, Error> =
            self.levels.iter().map(|level| self.record_all(&work, &level.view)).collect();
        for (level, recorded) in self.levels.iter_mut().zip(recorded?) {
            level.recorded = recorded;
        }
        self.work = work;
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.work.counters_read.read::<Counters>(1)[0]
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// The camera of a level.
    pub fn camera(&self, level: usize) -> &Camera {
        &self.levels[level].view.camera
    }

    /// Draws level 0; see [`draw_level`](Self::draw_level).
    pub fn draw(&mut self, pose: &Pose) -> Result<&[f32], Error> {
        self.draw_level(0, pose)
    }

    /// Draws a level: height × width × 5 floats (linear R, G, B before clamping, depth Σ wᵢ zᵢ,
    /// transmittance).
    pub fn draw_level(&mut self, level: usize, pose: &Pose) -> Result<&[f32], Error> {
        self.run(level, Job::Draw, pose)?;
        let view = &self.levels[level].view;
        Ok(view.image.read(view.camera.pixels() * PIXEL as usize))
    }

    /// Draws level 0 as 8-bit RGB.
    pub fn picture(&mut self, pose: &Pose, into: &mut Picture) -> Result<(), Error> {
        let pixels = self.draw(pose)?;
        for (to, from) in into.data.chunks_exact_mut(3).zip(pixels.chunks_exact(PIXEL as usize)) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = to_byte(*from);
            }
        }
        Ok(())
    }

    /// Gives a level the frame to compare with: height × width × 3 floats in [0, 1].
    ///
    /// # Panics
    /// Where the number of floats is not the level's.
    pub fn set_frame(&mut self, level: usize, rgb: &[f32]) {
        let view = &mut self.levels[level].view;
        assert_eq!(rgb.len(), view.camera.pixels() * 3, "floats of level {level}");
        view.frame.write(rgb);
    }

    /// The normal equations of a level against its frame.
    ///
    /// # Panics
    /// Where the plan does not hold the Jacobian.
    pub fn normal_equations(
        &mut self,
        level: usize,
        jacobian: Jacobian,
        pose: &Pose,
    ) -> Result<NormalEquations, Error> {
        self.run(level, Job::Sums(jacobian), pose)?;
        Ok(self.levels[level].view.normal_equations())
    }

    /// Renders so far, by level.
    pub fn renders(&self) -> &[u32] {
        &self.renders
    }

    /// Device times of the stages of a level's last draw, or of its last normal equations.
    pub fn stage_times(
        &self,
        level: usize,
        jacobian: Option<Jacobian>,
    ) -> Result<Vec<StageTime>, Error> {
        let level = &self.levels[level].recorded;
        let commands = match jacobian {
            None => Some(&level.draw),
            Some(Jacobian::Flow) => level.flow.as_ref(),
            Some(Jacobian::Exact) => level.exact.as_ref(),
        };
        commands.map_or(Ok(Vec::new()), Commands::stage_times)
    }
}

/// A linear value as a byte: clamped, rounded to nearest; a NaN gives 0.
pub fn to_byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}
