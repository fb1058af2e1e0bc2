//! One picture size of a renderer: a level of the pyramid.

use crate::shared::{PIXEL, Params, SUMS, TILE};
use crate::vulkan::{Buffer, Device, Error, Memory};
use crate::{Camera, Pose};

use super::Scene;

/// Buffers of one picture size.
pub(crate) struct View {
    pub camera: Camera,
    pub tiles: [u32; 2],
    pub params: Buffer,
    pub ranges: Buffer,
    pub image: Buffer,
    pub frame: Buffer,
    pub partials: Buffer,
    pub sums: Buffer,
}

/// The normal equations of all pixels and channels of a picture, values in [0, 1], per channel
/// (not averaged): `JᵀJ δ = −Jᵀr` with `r` = render − frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalEquations {
    /// JᵀJ, symmetric.
    pub jtj: [[f64; 6]; 6],
    /// Jᵀr.
    pub jtr: [f64; 6],
    /// Σ r².
    pub square: f64,
    /// Number of residuals: three a pixel.
    pub residuals: usize,
}

impl NormalEquations {
    /// From the 28 sums of stage `reduce`: the upper triangle row by row, Jᵀr, Σ r².
    pub fn from_sums(sums: &[f64; SUMS as usize], residuals: usize) -> NormalEquations {
        let mut jtj = [[0.0; 6]; 6];
        let upper = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
        for ((row, column), value) in upper.zip(sums) {
            jtj[row][column] = *value;
            jtj[column][row] = *value;
        }
        let mut jtr = [0.0; 6];
        jtr.copy_from_slice(&sums[21..27]);
        NormalEquations { jtj, jtr, square: sums[27], residuals }
    }

    /// Mean squared error over pixels and channels: the objective.
    pub fn mse(&self) -> f64 {
        self.square / self.residuals as f64
    }

    /// Gradient of [`mse`](Self::mse) with respect to the pose step, `2 Jᵀr / N`.
    pub fn gradient(&self) -> [f64; 6] {
        self.jtr.map(|g| 2.0 * g / self.residuals as f64)
    }
}

impl View {
    pub fn new(device: &Device, camera: &Camera) -> Result<View, Error> {
        let tiles = [camera.width.div_ceil(TILE), camera.height.div_ceil(TILE)];
        let count = (tiles[0] * tiles[1]) as usize;
        let pixels = camera.pixels();
        Ok(View {
            camera: *camera,
            tiles,
            params: Buffer::new::<Params>(device, "parameters", 1, Memory::Upload)?,
            ranges: Buffer::new::<[u32; 2]>(device, "tile ranges", count, Memory::Device)?,
            image: Buffer::new::<f32>(
                device,
                "picture",
                pixels * PIXEL as usize,
                Memory::Readback,
            )?,
            frame: Buffer::new::<[f32; 3]>(device, "frame", pixels, Memory::Upload)?,
            partials: Buffer::new::<[f32; SUMS as usize]>(
                device,
                "sums by tile",
                count,
                Memory::Device,
            )?,
            sums: Buffer::new::<f32>(device, "sums", SUMS as usize, Memory::Readback)?,
        })
    }

    /// Tells the stages where the camera stands.
    pub fn set_pose(&mut self, scene: &Scene, pair_capacity: u32, pose: &Pose) {
        let rotation = pose.matrix().transpose().to_cols_array().map(|v| v as f32);
        let camera = &self.camera;
        let options = &scene.options;
        let params = Params {
            rotation,
            translation: pose.translation.to_array().map(|v| v as f32),
            centre: pose.centre().to_array().map(|v| v as f32),
            focal: [camera.fx, camera.fy],
            principal: [camera.cx, camera.cy],
            background: options.background,
            near: options.near,
            alpha_max: options.alpha_max,
            antialiased: options.antialiased.into(),
            width: camera.width,
            height: camera.height,
            tiles_x: self.tiles[0],
            tiles_y: self.tiles[1],
            splats: scene.splats,
            sh_degree: scene.sh_degree,
            pair_capacity,
        };
        self.params.write(&[params]);
    }

    pub fn tile_count(&self) -> u32 {
        self.tiles[0] * self.tiles[1]
    }

    /// The sums of the last run.
    pub fn normal_equations(&self) -> NormalEquations {
        let mut sums = [0.0; SUMS as usize];
        for (to, from) in sums.iter_mut().zip(self.sums.read::<f32>(SUMS as usize)) {
            *to = f64::from(*from);
        }
        NormalEquations::from_sums(&sums, self.camera.pixels() * 3)
    }
}
