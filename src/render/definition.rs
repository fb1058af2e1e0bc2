//! The definition of the final picture: on the host, the operations of stages `project`, `splat` and `quantize_rgb8` in
//! plain scalar f32, in their order. A device is portable if it draws the same bytes. docs/portability.md lists the
//! operations, and what Vulkan promises of each.
//!
//! Every tile blends every splat that is seen. So a device may list more splats per tile than it draws, but never
//! fewer.

use glam::DVec3;

use crate::portable;
use crate::prior::analysis::PriorAnalysis;
use crate::search::{Anchor, PoseCode, placed, set_pose};
use crate::shared::{
    self, CULLED, LOG_ALPHA_MIN, NOWHERE, PIXEL, POWER_FACTOR, POWER_MIN, Params, Projected, TILE,
    TRANSMITTANCE_STOP,
};
use crate::{Camera, Pose, Prior, RenderOptions};

use super::levels::{posed, prototype};
use super::splat_buffers::{DrawnSplats, Planes, centre};

/// A prior, ready to be drawn.
pub struct Definition {
    planes: Planes,
    options: RenderOptions,
    centre: DVec3,
    anchor: Anchor,
    splats: u32,
    sh_degree: u32,
    clamps_alpha: bool,
}

/// A splat as stage `project` leaves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// Mean, pixels.
    pub mean: [f32; 2],
    /// Factor of the conic.
    pub conic: [f32; 3],
    /// log₂ of the opacity.
    pub log_opacity: f32,
    /// Linear colour.
    pub rgb: [f32; 3],
    /// Camera z.
    pub depth: f32,
}

/// A picture, and what each stage left.
pub struct Drawn {
    /// The camera that was drawn with.
    pub params: Params,
    /// Stage `project`; `None` if the splat is culled.
    pub records: Vec<Option<Record>>,
    /// The splats that are seen, nearest first, ties by index.
    pub order: Vec<u32>,
    /// Stage `splat`: height × width × 5 (linear R, G, B before clamping, depth Σ wᵢ zᵢ, transmittance).
    pub image: Vec<f32>,
    /// Stage `quantize_rgb8`: height × width × 3.
    pub rgb8: Vec<u8>,
}

impl Definition {
    /// Prepares a prior. Leaves out splats that no picture shows, as on a device.
    pub fn new(prior: &Prior) -> Definition {
        let analysis = PriorAnalysis::of(prior);
        let frame = prior.coordinate_frame();
        Definition {
            planes: Planes::of(prior, &analysis, analysis.splats.len()),
            options: *prior.options(),
            centre: centre(prior),
            anchor: Anchor { centre: frame.centre, step: frame.step() as f32 },
            splats: analysis.splats.len() as u32,
            sh_degree: analysis.sh_degree,
            clamps_alpha: analysis.clamps_alpha,
        }
    }

    /// The picture from a pose.
    pub fn draw(&self, camera: &Camera, pose: &Pose) -> Drawn {
        self.draw_with(&posed(&self.prototype(camera), self.centre, pose))
    }

    /// The picture from a packet's pose.
    pub fn draw_coded(&self, camera: &Camera, code: &PoseCode) -> Drawn {
        let mut params = self.prototype(camera);
        set_pose(&mut params, &placed(code, &self.anchor));
        self.draw_with(&params)
    }

    fn prototype(&self, camera: &Camera) -> Params {
        prototype(&self.options, &DrawnSplats::all(self.splats, self.planes.radius), camera, 1, 0)
    }

    fn draw_with(&self, params: &Params) -> Drawn {
        let records: Vec<_> = (0..self.splats).map(|i| self.project(params, i)).collect();
        let key = |i: &u32| records[*i as usize].map_or(CULLED, |(key, _)| key);
        let mut order: Vec<u32> = (0..self.splats).filter(|i| key(i) != CULLED).collect();
        order.sort_by_key(key);
        let records: Vec<_> = records.iter().map(|r| r.map(|(_, record)| record)).collect();
        let image = self.splat(params, &records, &order);
        let rgb8 = quantize(&image);
        Drawn { params: *params, records, order, image, rgb8 }
    }

    /// The depth key and the record of a splat that is seen.
    fn project(&self, params: &Params, i: u32) -> Option<(u32, Record)> {
        let at = |plane: u32| pair(&self.planes.geometry, plane * self.splats + i);
        let ([x, y], [z, opacity]) = (at(0), at(1));
        let ([a, b], [c, d], [e, f]) = (at(2), at(3), at(4));
        let ([g, h], [k, _]) = (at(5), at(6));
        let world = [x, y, z];
        let turned = shared::transform(&params.rotation, world);
        let camera: [f32; 3] = std::array::from_fn(|k| turned[k] + params.translation[k]);
        let axes =
            [[a, b, c], [d, e, f], [g, h, k]].map(|v| shared::transform(&params.rotation, v));
        let s = shared::project(params, camera, &axes, opacity);
        let [x0, y0, x1, y1] = shared::tile_box(params, &s);
        let seen = s.log_opacity > NOWHERE && x0 < x1 && y0 < y1;
        let Projected { mean, conic, log_opacity, depth, .. } = s;
        seen.then(|| {
            let rgb = self.colour(params, i, world);
            let key = depth.to_bits() - params.near.to_bits();
            (key, Record { mean, conic, log_opacity, rgb, depth })
        })
    }

    /// Colour from spherical harmonics.
    fn colour(&self, params: &Params, i: u32, world: [f32; 3]) -> [f32; 3] {
        let (direction, _) = shared::direction(params, world);
        let basis = shared::sh_basis(direction);
        let mut rgb = [0.5; 3];
        let count = shared::sh_coefficients(self.sh_degree) as usize;
        for (k, weight) in basis.iter().enumerate().take(count) {
            for (channel, value) in rgb.iter_mut().enumerate() {
                let float = 3 * k + channel;
                let [even, odd] = pair(&self.planes.sh, (float / 2) as u32 * self.splats + i);
                *value += weight * if float % 2 == 0 { even } else { odd };
            }
        }
        rgb.map(shared::shown)
    }

    fn splat(&self, params: &Params, records: &[Option<Record>], order: &[u32]) -> Vec<f32> {
        let seen: Vec<Record> = order.iter().filter_map(|i| records[*i as usize]).collect();
        let mut pixels = vec![Pixel::default(); (params.width * params.height) as usize];
        for record in &seen {
            let [columns, rows] = reach(params, record);
            for tile_y in rows.clone() {
                for tile_x in columns.clone() {
                    let s = record.seen_from(tile_x, tile_y);
                    self.blend_tile(params, &s, [tile_x, tile_y], &mut pixels);
                }
            }
        }
        let [r, g, b] = params.background;
        pixels.iter().flat_map(|p| p.over([r, g, b])).collect()
    }

    fn blend_tile(&self, params: &Params, s: &TileSplat, tile: [u32; 2], pixels: &mut [Pixel]) {
        let alpha_max = self.clamps_alpha.then_some(params.alpha_max);
        for y in tile[1] * TILE..((tile[1] + 1) * TILE).min(params.height) {
            for x in tile[0] * TILE..((tile[0] + 1) * TILE).min(params.width) {
                let [column, row] = [x % TILE, y % TILE].map(|v| v as f32 - 3.5);
                let argument = s.argument(column, row);
                if argument >= POWER_MIN {
                    let alpha = portable::power(argument);
                    let alpha = alpha_max.map_or(alpha, |most| shared::min(alpha, most));
                    pixels[(y * params.width + x) as usize].blend(s, alpha);
                }
            }
        }
    }
}

/// Pair `i` of planes.
fn pair(planes: &[f32], i: u32) -> [f32; 2] {
    [planes[2 * i as usize], planes[2 * i as usize + 1]]
}

/// Columns and rows of tiles in which a splat may show: its box, much wider than rounding needs.
fn reach(params: &Params, r: &Record) -> [std::ops::Range<u32>; 2] {
    let [l11, l21, l22] = r.conic.map(f64::from);
    // A splat just at the cut shows as far as the last bit of its exponent does not change; the 0.1 covers that.
    let cut = 2.0 * std::f64::consts::LN_2 * f64::from(r.log_opacity - LOG_ALPHA_MIN) + 0.1;
    // The covariance is the inverse of L Lᵀ.
    let sigma_y = 1.0 / l22;
    let sigma_x = (1.0 + (l21 / l22).powi(2)).sqrt() / l11;
    let range = |mean: f32, sigma: f64, tiles: u32| {
        let (mean, k) = (f64::from(mean), cut.max(0.0).sqrt());
        let half = 1.05 * k * sigma + 2.0 + 1e-5 * mean.abs();
        let tile = |v: f64| (v / f64::from(TILE)).floor().clamp(0.0, f64::from(tiles)) as u32;
        tile(mean - half)..(tile(mean + half) + 1).min(tiles)
    };
    [range(r.mean[0], sigma_x, params.tiles_x), range(r.mean[1], sigma_y, params.tiles_y)]
}

/// A splat relative to a tile's middle. At an offset (x, y), the argument of [`portable::power`] is
/// `level − u² + y (2 v − y curve)`, with `u = u₀ − l₁₁ x` and `2 v = tilt u + down`.
struct TileSplat {
    u: f32,
    l11: f32,
    tilt: f32,
    level: f32,
    down: f32,
    curve: f32,
    rgb: [f32; 3],
    depth: f32,
}

impl Record {
    fn seen_from(&self, tile_x: u32, tile_y: u32) -> TileSplat {
        let middle = |tile: u32| (tile * TILE) as f32 + (TILE / 2) as f32;
        let (dx, dy) = (self.mean[0] - middle(tile_x), self.mean[1] - middle(tile_y));
        let [l11, l21, l22] = self.conic.map(|l| l * POWER_FACTOR);
        let w = l22 * dy;
        TileSplat {
            u: l11 * dx + l21 * dy,
            l11,
            tilt: l21 + l21,
            level: portable::POWER_SHIFT + portable::POWER_SCALE * self.log_opacity - w * w,
            down: (l22 + l22) * w,
            curve: l21 * l21 + l22 * l22,
            rgb: self.rgb,
            depth: self.depth,
        }
    }
}

impl TileSplat {
    /// The argument of alpha before the clamp.
    fn argument(&self, x: f32, y: f32) -> f32 {
        let u = self.u - self.l11 * x;
        let twice_v = self.tilt * u + self.down;
        self.level - u * u + y * (twice_v - y * self.curve)
    }
}

/// A pixel while it is blended.
#[derive(Clone, Copy)]
struct Pixel {
    rgb: [f32; 3],
    depth: f32,
    transmittance: f32,
}

impl Default for Pixel {
    fn default() -> Pixel {
        Pixel { rgb: [0.0; 3], depth: 0.0, transmittance: 1.0 }
    }
}

impl Pixel {
    fn blend(&mut self, s: &TileSplat, alpha: f32) {
        if self.transmittance <= TRANSMITTANCE_STOP {
            return;
        }
        let weight = alpha * self.transmittance;
        for (value, colour) in self.rgb.iter_mut().zip(s.rgb) {
            *value += weight * colour;
        }
        self.depth += weight * s.depth;
        self.transmittance -= weight;
    }

    fn over(&self, background: [f32; 3]) -> [f32; PIXEL as usize] {
        let t = self.transmittance;
        let at = |k: usize| self.rgb[k] + t * background[k];
        [at(0), at(1), at(2), self.depth, t]
    }
}

/// Stage `quantize_rgb8`.
fn quantize(image: &[f32]) -> Vec<u8> {
    let byte = |v: f32| shared::to_byte(v) as u8;
    image.chunks_exact(PIXEL as usize).flat_map(|p| [byte(p[0]), byte(p[1]), byte(p[2])]).collect()
}
