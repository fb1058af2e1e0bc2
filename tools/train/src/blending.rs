//! Which splats a picture's pixels are blended of, and with what weights.
//!
//! The device projects the splats and lists them tile by tile. Each list is blended here, since no stage keeps what
//! single splats add.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use nvsprior::render::Scene;
use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Camera, Engine, Pose, Prior, RenderOptions};
use nvsprior_kernels::portable::{POWER_SCALE, POWER_SHIFT, power};
use nvsprior_kernels::shared::{LOG_ALPHA_MIN, TILE, TRANSMITTANCE_STOP};
use nvsprior_reference::probe::{Probe, SortPrecision, Stages};

/// Room for pairs of a splat and a tile at first; it grows as pictures need more.
const FIRST_ROOM: u32 = 1 << 18;

/// A splat in a pixel.
pub struct Blended {
    /// Its place in the tile's list.
    pub place: usize,
    pub alpha: f32,
    /// Its part of the pixel's colour.
    pub weight: f32,
    pub colour: Vec3,
}

/// A pixel that is blended.
pub struct Pixel {
    /// Its place in the picture, row by row.
    pub index: usize,
    /// Part of the background in its colour.
    pub left: f32,
    pub background: Vec3,
}

/// Blends pictures of a prior.
pub struct Blender<'a> {
    engine: &'a Engine,
    scene: Arc<Scene>,
    options: RenderOptions,
    room: u32,
}

impl<'a> Blender<'a> {
    pub fn new(engine: &'a Engine, prior: &Prior) -> Result<Blender<'a>, DeviceError> {
        // All of them: what shows in no picture has its place in the result, too.
        let scene = engine.upload_whole(prior)?;
        Ok(Blender { engine, scene, options: *prior.options(), room: FIRST_ROOM })
    }

    /// Blends a picture. `pixel` adds up what each pixel tells of the splats in a tile's list, by their places there.
    /// `add` adds that to a splat's entry in `sums`.
    pub fn blend<S, T: Clone + Default + Send>(
        &mut self,
        camera: &Camera,
        pose: &Pose,
        sums: &mut [S],
        pixel: impl Fn(&Pixel, &[Blended], &mut [T]) + Sync,
        add: impl Fn(&mut S, &T),
    ) -> Result<(), DeviceError> {
        let view = View { stages: &self.stages(camera, pose)?, camera, options: &self.options };
        let tiles = view.stages.ranges.par_iter().enumerate();
        let tiles: Vec<_> =
            tiles.map(|(tile, range)| view.tile(tile as u32, *range, &pixel)).collect();
        // In the tiles' order, so that sums do not depend on the threads.
        for (range, tile) in view.stages.ranges.iter().zip(&tiles) {
            for (splat, told) in view.list(*range).iter().zip(tile) {
                add(&mut sums[*splat as usize], told);
            }
        }
        Ok(())
    }

    fn stages(&mut self, camera: &Camera, pose: &Pose) -> Result<Stages, DeviceError> {
        loop {
            let probe = Probe::of(self.engine);
            let stages =
                probe.stages(&self.scene, camera, pose, self.room, SortPrecision::Exact)?;
            if stages.pairs_needed <= self.room {
                return Ok(stages);
            }
            if stages.pairs_needed == u32::MAX {
                return Err(DeviceError::TooManyPairs);
            }
            self.room = stages.pairs_needed;
        }
    }
}

/// The splats in a picture, tile by tile.
struct View<'a> {
    stages: &'a Stages,
    camera: &'a Camera,
    options: &'a RenderOptions,
}

impl View<'_> {
    fn list(&self, [start, end]: [u32; 2]) -> &[u32] {
        &self.stages.pair_splats[start as usize..end as usize]
    }

    /// What the pixels of a tile tell of the splats in its list.
    fn tile<T: Clone + Default>(
        &self,
        tile: u32,
        range: [u32; 2],
        told: &impl Fn(&Pixel, &[Blended], &mut [T]),
    ) -> Vec<T> {
        let Camera { width, height, .. } = *self.camera;
        let columns = width.div_ceil(TILE);
        let [left, top] = [tile % columns * TILE, tile / columns * TILE];
        let list = self.list(range);
        let mut sums = vec![T::default(); list.len()];
        let mut blended = Vec::new();
        for y in top..(top + TILE).min(height) {
            for x in left..(left + TILE).min(width) {
                let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let left = self.blend(list, centre, &mut blended);
                let background = Vec3::from(self.options.background);
                let index = (y * width + x) as usize;
                told(&Pixel { index, left, background }, &blended, &mut sums);
            }
        }
        sums
    }

    /// Blends a list at a pixel's centre, front to back; what light is left.
    fn blend(&self, list: &[u32], centre: Vec2, blended: &mut Vec<Blended>) -> f32 {
        blended.clear();
        let mut transmittance = 1.0;
        for (place, splat) in list.iter().enumerate() {
            let [u, v, l11, l21, l22, log_opacity, .., r, g, b, _] =
                self.stages.records[*splat as usize];
            let d = Vec2::new(u, v) - centre;
            let (x, y) = (l11 * d.x + l21 * d.y, l22 * d.y);
            let exponent = log_opacity - 0.5 * std::f32::consts::LOG2_E * (x * x + y * y);
            if exponent >= LOG_ALPHA_MIN {
                let alpha = power(POWER_SHIFT + POWER_SCALE * exponent).min(self.options.alpha_max);
                let (weight, colour) = (alpha * transmittance, Vec3::new(r, g, b));
                blended.push(Blended { place, alpha, weight, colour });
                transmittance *= 1.0 - alpha;
                if transmittance <= TRANSMITTANCE_STOP {
                    break;
                }
            }
        }
        transmittance
    }
}
