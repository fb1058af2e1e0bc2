//! The levels of the pyramid: the camera at each, and the buffers of what is drawn there.

use bytemuck::Zeroable;
use glam::{DQuat, DVec3};

use crate::image::Mask;
use crate::search::{Anchor, LEVELS, Placement, Search, set_pose};
use crate::shared::{Groups, PIXEL, Params, SUMS, TILE, frustum, tiles_per_group};
use crate::vulkan::{Buffer, Device, Error, Memory};
use crate::{Camera, Pose, RenderOptions};

use super::binning::{self, Binning};
use super::splat_buffers::{DrawnSplats, SplatBuffers};
use super::{Scene, kernels};

/// One picture size.
pub struct Level {
    pub camera: Camera,
    /// Side of the block of frame pixels that becomes one.
    pub factor: u32,
    /// The stages' parameters, except the pose.
    pub params: Params,
    /// The same if only some rows of tiles are drawn.
    pub sparse: Params,
    /// Pixels that count, by the frame's mask: of all, and of the rows of tiles that `sparse` draws.
    pub counted: [usize; 2],
}

impl Level {
    /// Counts the pixels that count, by a mask of this level.
    pub fn count(&mut self, mask: Option<&Mask>) {
        let width = self.camera.width as usize;
        let rows = |params: &Params| {
            let drawn = (0..self.camera.height).filter(|y| params.draws(y / TILE));
            let of = |y: u32| match mask {
                Some(mask) => {
                    mask.data[y as usize * width..][..width].iter().filter(|c| **c).count()
                }
                None => width,
            };
            drawn.map(of).sum()
        };
        self.counted = [rows(&self.params), rows(&self.sparse)];
    }
}

/// Fewest pixels that a sparse evaluation draws. With half as many, poses in the demo's basin came out 0.14 dB worse.
const SPARSE_PIXELS: usize = 24_000;
/// Most rows of tiles of which a sparse evaluation draws one, as a power of 2.
const MOST_SPARSE: u32 = 2;

/// Of how many rows of tiles a sparse evaluation of this camera draws one, as a power of 2.
fn sparse_shift(camera: &Camera) -> u32 {
    (camera.pixels() / SPARSE_PIXELS).max(1).ilog2().min(MOST_SPARSE)
}

/// Buffers of all levels, and how many workgroups share the splats. Each buffer is as large as the largest level needs,
/// except `frame`, which holds all levels.
pub struct LevelBuffers {
    pub sizes: Vec<Level>,
    /// Logarithm of the number of workgroups that share the sort of the splats.
    pub log_sort_blocks: u32,
    pub binning: Binning,
    /// [`Level::params`] and [`Level::sparse`] of each level, for stages that choose between them.
    pub prototypes: Buffer,
    /// What the host asks for. It is copied to `params` and `groups` before the host's renders.
    pub params_asked: Buffer,
    pub groups_asked: Buffer,
    pub params: Buffer,
    /// Two [`Groups`]: see [`Pass`].
    pub groups: Buffer,
    pub ranges: Buffer,
    pub image: Buffer,
    pub image_read: Buffer,
    pub frame: Buffer,
    pub partials: Buffer,
    /// Pairs of each band of tiles.
    pub bands: Buffer,
    pub sums: Buffer,
}

/// Which of the two [`Groups`] says how many workgroups of a stage run.
#[derive(Clone, Copy)]
pub enum Pass {
    /// An evaluation of a search, or what the host asks for.
    Evaluation,
    /// The final picture of a search.
    Picture,
}

impl Pass {
    /// Byte of a field of [`Groups`] in the buffer.
    pub fn at(self, field: usize) -> u64 {
        (self as usize * size_of::<Groups>() + field) as u64
    }
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
    /// Number of residuals: three a pixel that counts.
    pub residuals: usize,
}

impl NormalEquations {
    /// Reads the 28 sums of stage `reduce`: the upper triangle row by row, Jᵀr, Σ r².
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

impl LevelBuffers {
    /// The levels of `camera` at these reduction factors. Levels without a pixel are left out.
    pub fn new(
        device: &Device,
        splats: &SplatBuffers,
        camera: &Camera,
        factors: &[u32],
    ) -> Result<LevelBuffers, Error> {
        let mut floats = 0;
        let mut levels = Vec::new();
        for &factor in factors.iter().take(LEVELS) {
            let camera = camera.reduced(factor);
            if camera.width > 0 && camera.height > 0 {
                let params = prototype(&splats.options, &splats.held(), &camera, factor, floats);
                floats += 3 * camera.pixels() as u32;
                let sparse = params.with_rows(sparse_shift(&camera));
                levels.push(Level { camera, factor, params, sparse, counted: [0; 2] });
            }
        }
        let most = |count: fn(&Level) -> usize| levels.iter().map(count).max().unwrap_or(0);
        let pixels = most(|level| level.camera.pixels());
        let tiles = most(|level| (level.params.tiles_x * level.params.tiles_y) as usize);
        let log_sort_blocks = kernels::log_sort_blocks(device.info(), splats.room);
        let log_bin_blocks = kernels::log_bin_blocks(device.info(), splats.room);
        let log_bin_blocks = binning::log_blocks(log_bin_blocks, tiles as u32);
        let binning = Binning::new(device, log_bin_blocks, tiles as u32)?;
        for level in &mut levels {
            for params in [&mut level.params, &mut level.sparse] {
                params.sort_blocks = 1 << log_sort_blocks;
                binning.share(params);
                params.tiles_per_group = device.info().wave.map_or(1, tiles_per_group);
            }
            level.count(None);
        }
        let image = pixels * PIXEL as usize;
        // The image is a picture's largest buffer, except for the frame's levels.
        let most = device.info().storage_range / (4 * u64::from(PIXEL));
        let room = Error::with_room_for(most, "pixels");
        let own =
            |name, count, memory| Buffer::new::<f32>(device, name, count, memory).map_err(&room);
        Ok(LevelBuffers {
            prototypes: Buffer::new::<Params>(device, "levels", 2 * levels.len(), Memory::Upload)?,
            params_asked: Buffer::new::<Params>(device, "parameters", 1, Memory::Upload)?,
            groups_asked: Buffer::new::<[Groups; 2]>(device, "workgroups", 1, Memory::Upload)?,
            params: Buffer::new::<Params>(device, "parameters", 1, Memory::Device)?,
            groups: Buffer::new::<[Groups; 2]>(device, "workgroups", 1, Memory::Device)?,
            ranges: Buffer::new::<[u32; 2]>(device, "tile ranges", tiles, Memory::Device)?,
            image: own("picture", image, Memory::Device)?,
            image_read: own("picture read back", image, Memory::Readback)?,
            frame: own("frame", floats as usize, Memory::Upload)?,
            binning,
            bands: own("bands", binning::BANDS as usize, Memory::Device)?,
            partials: own("sums by tile", tiles * SUMS as usize, Memory::Device)?,
            sums: own("sums", SUMS as usize, Memory::Readback)?,
            sizes: levels,
            log_sort_blocks,
        })
    }

    /// Tiles of the level that has most.
    pub fn most_tiles(&self) -> u32 {
        let tiles = self.sizes.iter().map(|level| level.params.tiles_x * level.params.tiles_y);
        tiles.max().unwrap_or(0)
    }

    /// Shares the binning in another way; returns the old way. All recordings must be made again.
    pub fn share_binning(&mut self, binning: Binning) -> Binning {
        for Level { params, sparse, .. } in &mut self.sizes {
            binning.share(params);
            binning.share(sparse);
        }
        std::mem::replace(&mut self.binning, binning)
    }

    /// Asks for a level at a pose, with room for `pair_capacity` pairs.
    pub fn ask(&mut self, scene: &Scene, level: usize, pair_capacity: u32, pose: &Pose) {
        let params =
            Params { pair_capacity, ..posed(&self.sizes[level].params, scene.centre(), pose) };
        self.params_asked.write(&[params]);
        self.groups_asked.write(&[[Groups::of(&params); 2]]);
    }

    /// Asks for a search's first evaluation, with room for `pair_capacity` pairs.
    pub fn ask_first(&mut self, search: &Search, pair_capacity: u32) {
        let level = &self.sizes[search.level as usize];
        let sparse = search.program.sparse >> search.level & 1 == 1;
        let mut params = if sparse { level.sparse } else { level.params };
        params.pair_capacity = pair_capacity;
        set_pose(&mut params, &search.trial);
        self.params_asked.write(&[params]);
        self.groups_asked.write(&[[Groups::of(&params), Groups::NONE]]);
    }

    /// Draws so many splats from here on, with room for `pair_capacity` pairs.
    pub fn hold(&mut self, held: &DrawnSplats, pair_capacity: u32) {
        for Level { params, sparse, .. } in &mut self.sizes {
            for params in [params, sparse] {
                (params.splats, params.radius) = (held.splats, held.radius);
            }
        }
        self.set_room(pair_capacity);
    }

    /// Tells stages that choose between levels how many pairs there is room for.
    pub fn set_room(&mut self, pair_capacity: u32) {
        let mut prototypes = [Params::zeroed(); 2 * LEVELS];
        for (to, level) in prototypes.chunks_exact_mut(2).zip(&self.sizes) {
            to[0] = Params { pair_capacity, ..level.params };
            to[1] = Params { pair_capacity, ..level.sparse };
        }
        self.prototypes.write(&prototypes[..2 * self.sizes.len()]);
    }

    /// The sums of the last run, at a level.
    pub fn normal_equations(&self, level: usize) -> NormalEquations {
        let mut sums = [0.0; SUMS as usize];
        for (to, from) in sums.iter_mut().zip(self.sums.read::<f32>(SUMS as usize)) {
            *to = f64::from(*from);
        }
        NormalEquations::from_sums(&sums, self.sizes[level].counted[0].max(1) * 3)
    }
}

/// The stages' parameters of a level, except the pose and the room for pairs.
pub fn prototype(
    options: &RenderOptions,
    held: &DrawnSplats,
    camera: &Camera,
    factor: u32,
    frame_offset: u32,
) -> Params {
    let [dilation, dilation_kept] = options.low_pass(camera, factor);
    let x = frustum(camera.width, camera.fx, camera.cx);
    let y = frustum(camera.height, camera.fy, camera.cy);
    Params {
        focal: [camera.fx, camera.fy],
        principal: [camera.cx, camera.cy],
        frustum: [x[0], x[1], y[0], y[1]],
        background: options.background,
        near: options.near,
        radius: held.radius,
        alpha_max: options.alpha_max,
        dilation,
        dilation_kept,
        width: camera.width,
        height: camera.height,
        tiles_x: camera.width.div_ceil(TILE),
        tiles_y: camera.height.div_ceil(TILE),
        tiles_per_group: 1,
        splats: held.splats,
        stride: held.stride,
        frame_offset,
        ..Params::zeroed()
    }
}

/// The parameters at a pose, each from f64 and rounded once. `centre` is what the device's positions are relative to.
pub fn posed(params: &Params, centre: DVec3, pose: &Pose) -> Params {
    Params {
        rotation: pose.matrix().transpose().to_cols_array().map(|v| v as f32),
        translation: placement_from(centre, pose).translation,
        centre: (pose.centre() - centre).to_array().map(|v| v as f32),
        ..*params
    }
}

/// A pose as the device holds it: of points relative to the prior's centre.
pub fn placement(scene: &Scene, pose: &Pose) -> Placement {
    placement_from(scene.centre(), pose)
}

fn placement_from(centre: DVec3, pose: &Pose) -> Placement {
    let translation = pose.translation + pose.rotation * centre;
    Placement {
        rotation: pose.wxyz().map(|v| v as f32),
        translation: translation.to_array().map(|v| v as f32),
    }
}

/// The pose that the device holds so.
pub fn pose_of(scene: &Scene, placement: &Placement) -> Pose {
    let [w, x, y, z] = placement.rotation.map(f64::from);
    let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
    let translation = DVec3::from(placement.translation.map(f64::from));
    Pose { rotation, translation: translation - rotation * scene.centre() }
}

/// What codes of poses are relative to.
pub fn anchor(scene: &Scene) -> Anchor {
    let frame = scene.coordinate_frame();
    Anchor { centre: frame.centre, step: frame.step() as f32 }
}
