//! How much pictures would change if one splat were missing.
//!
//! In a pixel, what lies behind the splat shows in its place: the change is `T α (behind − colour)`. The device
//! projects the splats and lists them tile by tile; each list is blended here, since no stage keeps the change of one
//! splat.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use nvsprior::render::probe::{SortPrecision, Stages};
use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Camera, Engine, Pose, Prior, RenderOptions};
use nvsprior_kernels::portable::{POWER_SCALE, POWER_SHIFT, power};
use nvsprior_kernels::shared::{LOG_ALPHA_MIN, TILE, TRANSMITTANCE_STOP};

/// What leaving one splat out would do to pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Removal {
    /// Sum over pixels and channels of the squared change, values in [0, 1].
    pub error: f32,
    /// Pixels in which the splat is blended.
    pub pixels: u32,
}

/// Room for pairs of a splat and a tile at first; it grows as pictures need more.
const FIRST_ROOM: u32 = 1 << 18;

/// For each splat, how the pictures at some places would change without it.
///
/// # Errors
/// What the device fails with.
pub fn removals(
    engine: &Engine,
    prior: &Prior,
    places: &[(Camera, Pose)],
) -> Result<Vec<Removal>, DeviceError> {
    // All of them: what shows in no picture has its place in the result.
    let scene = engine.upload_whole(prior)?;
    let mut room = FIRST_ROOM;
    let mut sums = vec![Removal::default(); prior.len()];
    for (camera, pose) in places {
        let stages = loop {
            let probe = engine.probe();
            let stages = probe.stages(&scene, camera, pose, room, SortPrecision::Exact)?;
            if stages.pairs_needed <= room {
                break stages;
            }
            if stages.pairs_needed == u32::MAX {
                return Err(DeviceError::TooManyPairs);
            }
            room = stages.pairs_needed;
        };
        let view = View { stages: &stages, camera, options: prior.options() };
        view.add_to(&mut sums);
    }
    Ok(sums)
}

/// Which splats stay if the share `share` of them goes, those that show least first. At least one stays.
pub fn max_needed(removals: &[Removal], share: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..removals.len()).collect();
    let error = |i: &usize| removals[*i].error;
    // Of equal splats the later ones go first.
    order.sort_by(|a, b| error(a).total_cmp(&error(b)).then(b.cmp(a)));
    let max = removals.len().saturating_sub(1);
    let gone = ((share * removals.len() as f64).ceil() as usize).min(max);
    let mut kept = vec![true; removals.len()];
    order[..gone].iter().for_each(|i| kept[*i] = false);
    kept
}

/// The splats in a picture, tile by tile.
struct View<'a> {
    stages: &'a Stages,
    camera: &'a Camera,
    options: &'a RenderOptions,
}

struct Blended {
    /// Its place in the tile's list.
    place: usize,
    alpha: f32,
    weight: f32,
}

impl View<'_> {
    /// Adds each splat's change of this picture.
    fn add_to(&self, sums: &mut [Removal]) {
        let tiles = self.stages.ranges.par_iter().enumerate();
        let tiles: Vec<_> = tiles.map(|(tile, range)| self.tile(tile as u32, *range)).collect();
        // In the tiles' order, so that sums do not depend on the threads.
        for (range, tile) in self.stages.ranges.iter().zip(&tiles) {
            for (splat, removal) in self.list(*range).iter().zip(tile) {
                let sum = &mut sums[*splat as usize];
                sum.error += removal.error;
                sum.pixels += removal.pixels;
            }
        }
    }

    fn list(&self, [start, end]: [u32; 2]) -> &[u32] {
        &self.stages.pair_splats[start as usize..end as usize]
    }

    /// What the splats of a tile's list do in the tile.
    fn tile(&self, tile: u32, range: [u32; 2]) -> Vec<Removal> {
        let Camera { width, height, .. } = *self.camera;
        let columns = width.div_ceil(TILE);
        let [left, top] = [tile % columns * TILE, tile / columns * TILE];
        let list = self.list(range);
        let mut sums = vec![Removal::default(); list.len()];
        let mut blended = Vec::new();
        for y in top..(top + TILE).min(height) {
            for x in left..(left + TILE).min(width) {
                let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let transmittance = self.blend(list, centre, &mut blended);
                self.add_pixel(list, &blended, transmittance, &mut sums);
            }
        }
        sums
    }

    /// Blends a list at a pixel's centre, front to back; what light is left.
    fn blend(&self, list: &[u32], centre: Vec2, blended: &mut Vec<Blended>) -> f32 {
        blended.clear();
        let mut transmittance = 1.0;
        for (place, splat) in list.iter().enumerate() {
            let [u, v, l11, l21, l22, log_opacity, ..] = self.stages.records[*splat as usize];
            let d = Vec2::new(u, v) - centre;
            let (a, b) = (l11 * d.x + l21 * d.y, l22 * d.y);
            let exponent = log_opacity - 0.5 * std::f32::consts::LOG2_E * (a * a + b * b);
            if exponent >= LOG_ALPHA_MIN {
                let alpha = power(POWER_SHIFT + POWER_SCALE * exponent).min(self.options.alpha_max);
                blended.push(Blended { place, alpha, weight: alpha * transmittance });
                transmittance *= 1.0 - alpha;
                if transmittance <= TRANSMITTANCE_STOP {
                    break;
                }
            }
        }
        transmittance
    }

    /// Adds the changes of one pixel, back to front.
    fn add_pixel(&self, list: &[u32], blended: &[Blended], left: f32, sums: &mut [Removal]) {
        // What the pixel shows of everything behind the current splat.
        let mut behind = left * Vec3::from(self.options.background);
        for Blended { place, alpha, weight } in blended.iter().rev() {
            let [.., r, g, b, _] = self.stages.records[list[*place] as usize];
            let shown = *weight * Vec3::new(r, g, b);
            let change = behind * (alpha / (1.0 - alpha)) - shown;
            behind += shown;
            sums[*place].error += change.length_squared();
            sums[*place].pixels += 1;
        }
    }
}
