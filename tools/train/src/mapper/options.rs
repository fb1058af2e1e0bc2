//! What is asked of a training.

use glam::DVec3;
use nvsprior::{Camera, RenderOptions};

use super::Schedule;
use crate::trainer::TrainingPlan;

#[derive(Clone, Debug, PartialEq)]
pub struct MapOptions {
    pub render: RenderOptions,
    /// Most splats.
    pub splats: u32,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
    pub schedule: Schedule,
    /// Fit each picture's light, and train on the pictures without it: see [`super::Exposure`].
    pub exposure: bool,
    /// Correct the poses: see [`super::Mapper::poses`].
    pub correct_poses: bool,
    pub seed: u64,
    /// The sizes that the prior is trained for, each in its turn: how much smaller than the pictures they are. 1: as
    /// large.
    pub reductions: Vec<u32>,
    /// Have the device time its stages.
    pub profiled: bool,
}

impl Default for MapOptions {
    fn default() -> MapOptions {
        MapOptions {
            render: RenderOptions::INRIA,
            splats: 40_000,
            sh_degree: 1,
            schedule: Schedule::default(),
            exposure: false,
            correct_poses: false,
            seed: 1,
            reductions: vec![1],
            profiled: false,
        }
    }
}

impl MapOptions {
    /// The same, for a prior that states the focal length of this camera, unless another is asked for: its low-pass
    /// then fits pictures of all sizes.
    pub fn stating_focal(self, camera: &Camera) -> MapOptions {
        let trained_focal = self.render.trained_focal.or(Some(camera.fx));
        MapOptions { render: RenderOptions { trained_focal, ..self.render }, ..self }
    }

    /// What the device trains, on pictures of this size. Positions are relative to `centre`.
    pub fn plan(&self, size: [u32; 2], centre: DVec3) -> TrainingPlan {
        TrainingPlan {
            size,
            options: self.render,
            sh_degree: self.sh_degree,
            splats: self.splats,
            centre,
            ssim: self.schedule.ssim > 0.0,
            profiled: self.profiled,
        }
    }
}
