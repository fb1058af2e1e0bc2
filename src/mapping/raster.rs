//! A small rasteriser that tells which splat has which weight in which pixel.
//!
//! The picture of splats with colours `c` is `Σ wᵢ cᵢ + T · background`, where the weights follow
//! from geometry and opacity alone: `wᵢ = αᵢ Π (1 − αⱼ)` over the splats `j` before `i`. For a
//! fixed geometry the picture is therefore linear in the colours, and this module offers that
//! linear map and its transpose, tile by tile. Constants as in the GPU renderer: low-pass 0.3 px²,
//! cut at 1/255, stop at a transmittance of 1e-4.

use glam::{Mat3, Quat, Vec2, Vec3};

use crate::prior::{RenderOptions, Splats};
use crate::{Camera, Pose};

/// Side of a tile, pixels.
const TILE: usize = 16;
const TILE_PIXELS: usize = TILE * TILE;
/// Added to the diagonal of every projected covariance, px².
const LOW_PASS: f32 = 0.3;
/// Smallest alpha that is blended.
const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Blending ends before the transmittance falls to this.
const TRANSMITTANCE_MIN: f32 = 1e-4;
/// Standard deviations beyond which no splat reaches.
const REACH: f32 = 3.33;

/// What decides the weights: where splats are, how they spread, how opaque they are.
pub struct Geometry {
    pub positions: Vec<Vec3>,
    covariances: Vec<Mat3>,
    opacities: Vec<f32>,
}

impl Geometry {
    pub fn of(splats: &Splats) -> Geometry {
        let covariance = |(q, s): (&[f32; 4], &[f32; 3])| {
            let axes = Mat3::from_quat(Quat::from_xyzw(q[1], q[2], q[3], q[0]).normalize());
            let m = axes * Mat3::from_diagonal(Vec3::from(*s).exp());
            m * m.transpose()
        };
        let opacity = |logit: &f32| 1.0 / (1.0 + (-logit).exp());
        Geometry {
            positions: splats.positions.iter().copied().map(Vec3::from).collect(),
            covariances: splats.rotations.iter().zip(&splats.log_scales).map(covariance).collect(),
            opacities: splats.opacity_logits.iter().map(opacity).collect(),
        }
    }
}

/// A splat in the picture.
struct Projected {
    mean: Vec2,
    /// Inverse of the 2D covariance: xx, xy, yy.
    conic: [f32; 3],
    opacity: f32,
    depth: f32,
    /// First and last pixel that it may touch, columns then rows.
    low: [usize; 2],
    high: [usize; 2],
    /// Which splat of the geometry.
    index: u32,
}

/// All splats in a view, front to back, sorted into tiles.
pub struct Projection {
    splats: Vec<Projected>,
    /// Per tile, its part of `tile_splats`.
    tile_starts: Vec<usize>,
    /// Places in `splats`, tile by tile, front to back.
    tile_splats: Vec<u32>,
    width: usize,
    height: usize,
    alpha_max: f32,
}

/// One splat's weight in one pixel of a tile.
struct Weight {
    pixel: u8,
    /// Place in `Projection::splats`.
    slot: u32,
    weight: f32,
}

/// Working memory of a tile, kept from tile to tile.
#[derive(Default)]
struct Tile {
    weights: Vec<Weight>,
    transmittance: Vec<f32>,
    open: Vec<bool>,
}

impl Projection {
    pub fn new(
        geometry: &Geometry,
        camera: &Camera,
        pose: &Pose,
        options: &RenderOptions,
    ) -> Projection {
        let projector = Projector::new(camera, pose, options);
        let mut splats: Vec<Projected> =
            (0..geometry.positions.len()).filter_map(|i| projector.project(geometry, i)).collect();
        splats.sort_unstable_by(|a, b| a.depth.total_cmp(&b.depth).then(a.index.cmp(&b.index)));
        let (width, height) = (camera.width as usize, camera.height as usize);
        let (tile_starts, tile_splats) = into_tiles(&splats, width, height);
        let alpha_max = options.alpha_max;
        Projection { splats, tile_starts, tile_splats, width, height, alpha_max }
    }

    /// For every pixel: blends `colours` (one per splat of the geometry) to a value, asks `pull`
    /// what to hand back for (pixel, value, transmittance), and adds that times each weight to
    /// `gradient` (one per splat). With a `pull` that answers zero this is plain rendering.
    pub fn sweep(
        &self,
        colours: &[Vec3],
        gradient: &mut [Vec3],
        mut pull: impl FnMut(usize, Vec3, f32) -> Vec3,
    ) {
        let mut tile = Tile::default();
        for index in 0..self.tile_starts.len() - 1 {
            self.blend(index, &mut tile);
            let mut values = [Vec3::ZERO; TILE_PIXELS];
            for w in &tile.weights {
                let splat = self.splats[w.slot as usize].index as usize;
                values[w.pixel as usize] += w.weight * colours[splat];
            }
            for (inside, value) in values.iter_mut().enumerate() {
                *value = match self.pixel_of(index, inside) {
                    Some(pixel) => pull(pixel, *value, tile.transmittance[inside]),
                    None => Vec3::ZERO,
                };
            }
            for w in &tile.weights {
                let splat = self.splats[w.slot as usize].index as usize;
                gradient[splat] += w.weight * values[w.pixel as usize];
            }
        }
    }

    /// Adds every splat's sum of squared weights to `sums`: the diagonal of the normal equations.
    pub fn add_squared_weights(&self, sums: &mut [f32]) {
        let mut tile = Tile::default();
        for index in 0..self.tile_starts.len() - 1 {
            self.blend(index, &mut tile);
            for w in &tile.weights {
                sums[self.splats[w.slot as usize].index as usize] += w.weight * w.weight;
            }
        }
    }

    fn columns(&self) -> usize {
        self.width.div_ceil(TILE)
    }

    /// Left and upper pixel of a tile.
    fn corner(&self, tile: usize) -> [usize; 2] {
        [tile % self.columns() * TILE, tile / self.columns() * TILE]
    }

    /// The picture's pixel at a place in a tile; `None` beyond the picture's edge.
    fn pixel_of(&self, tile: usize, inside: usize) -> Option<usize> {
        let [left, upper] = self.corner(tile);
        let (x, y) = (left + inside % TILE, upper + inside / TILE);
        (x < self.width && y < self.height).then_some(y * self.width + x)
    }

    /// Blends a tile front to back: lists the weights, and what light is left.
    fn blend(&self, index: usize, tile: &mut Tile) {
        tile.weights.clear();
        tile.transmittance.clear();
        tile.transmittance.resize(TILE_PIXELS, 1.0);
        tile.open.clear();
        tile.open.resize(TILE_PIXELS, true);
        let mut left_open = TILE_PIXELS;
        let corner = self.corner(index);
        for &slot in &self.tile_splats[self.tile_starts[index]..self.tile_starts[index + 1]] {
            if left_open == 0 {
                break;
            }
            left_open -= self.blend_splat(slot, corner, tile);
        }
    }

    /// Blends one splat into a tile; how many pixels it closed.
    fn blend_splat(&self, slot: u32, corner: [usize; 2], tile: &mut Tile) -> usize {
        let splat = &self.splats[slot as usize];
        let [xx, xy, yy] = splat.conic;
        let range = |axis: usize| {
            splat.low[axis].max(corner[axis])..(splat.high[axis] + 1).min(corner[axis] + TILE)
        };
        let mut closed = 0;
        for y in range(1) {
            let dy = y as f32 + 0.5 - splat.mean.y;
            for x in range(0) {
                let pixel = (y - corner[1]) * TILE + x - corner[0];
                let dx = x as f32 + 0.5 - splat.mean.x;
                let power = -0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy;
                if !tile.open[pixel] || !(power <= 0.0) {
                    continue;
                }
                let alpha = (splat.opacity * power.exp()).min(self.alpha_max);
                if !(alpha >= ALPHA_MIN) {
                    continue;
                }
                let before = tile.transmittance[pixel];
                let after = before * (1.0 - alpha);
                if after <= TRANSMITTANCE_MIN {
                    tile.open[pixel] = false;
                    closed += 1;
                    continue;
                }
                tile.transmittance[pixel] = after;
                tile.weights.push(Weight { pixel: pixel as u8, slot, weight: alpha * before });
            }
        }
        closed
    }
}

/// A view, ready to project splats.
struct Projector<'a> {
    camera: &'a Camera,
    options: &'a RenderOptions,
    rotation: Mat3,
    translation: Vec3,
    /// Bounds of x/z and y/z in the Jacobian: the frustum and 0.3 half-widths beyond.
    slopes: [(f32, f32); 2],
}

impl<'a> Projector<'a> {
    fn new(camera: &'a Camera, pose: &Pose, options: &'a RenderOptions) -> Projector<'a> {
        let bounds = |side: u32, focal: f32, centre: f32| {
            let side = side as f32;
            let margin = 0.15 * side / focal;
            (-centre / focal - margin, (side - centre) / focal + margin)
        };
        Projector {
            camera,
            options,
            rotation: pose.matrix().as_mat3(),
            translation: pose.translation.as_vec3(),
            slopes: [
                bounds(camera.width, camera.fx, camera.cx),
                bounds(camera.height, camera.fy, camera.cy),
            ],
        }
    }

    /// The splat in the picture; `None` where it cannot touch a pixel.
    fn project(&self, geometry: &Geometry, index: usize) -> Option<Projected> {
        let p = self.rotation * geometry.positions[index] + self.translation;
        if !(p.z > self.options.near) {
            return None;
        }
        let Camera { fx, fy, cx, cy, .. } = *self.camera;
        let mean = Vec2::new(fx * p.x / p.z + cx, fy * p.y / p.z + cy);
        let [xx, xy, yy] = self.covariance(&geometry.covariances[index], p);
        let (wide, high) = (xx + LOW_PASS, yy + LOW_PASS);
        let determinant = wide * high - xy * xy;
        if !(determinant > 0.0) {
            return None;
        }
        let mut opacity = geometry.opacities[index];
        if self.options.antialiased {
            opacity *= ((xx * yy - xy * xy) / determinant).max(2.5e-5).sqrt();
        }
        let reach = REACH.min((2.0 * (255.0 * opacity).ln()).sqrt());
        let extent = reach * Vec2::new(wide.sqrt(), high.sqrt());
        let (low_x, high_x) = pixels(mean.x, extent.x, self.camera.width)?;
        let (low_y, high_y) = pixels(mean.y, extent.y, self.camera.height)?;
        Some(Projected {
            mean,
            conic: [high / determinant, -xy / determinant, wide / determinant],
            opacity,
            depth: p.z,
            low: [low_x, low_y],
            high: [high_x, high_y],
            index: index as u32,
        })
    }

    /// `J R Σ Rᵀ Jᵀ` as xx, xy, yy (Zwicker et al., "EWA Splatting", 2002, eq. 31).
    fn covariance(&self, covariance: &Mat3, p: Vec3) -> [f32; 3] {
        let Camera { fx, fy, .. } = *self.camera;
        let [across, down] = self.slopes;
        let (u, v) = ((p.x / p.z).clamp(across.0, across.1), (p.y / p.z).clamp(down.0, down.1));
        let to_world = self.rotation.transpose();
        let row_x = to_world * Vec3::new(fx / p.z, 0.0, -fx * u / p.z);
        let row_y = to_world * Vec3::new(0.0, fy / p.z, -fy * v / p.z);
        let (spread_x, spread_y) = (*covariance * row_x, *covariance * row_y);
        [row_x.dot(spread_x), row_x.dot(spread_y), row_y.dot(spread_y)]
    }
}

/// First and last pixel whose centre lies within `extent` of `mean`, cut to the picture.
fn pixels(mean: f32, extent: f32, side: u32) -> Option<(usize, usize)> {
    let low = (mean - extent - 0.5).ceil().max(0.0);
    let high = (mean + extent - 0.5).floor().min(side as f32 - 1.0);
    (low <= high).then_some((low as usize, high as usize))
}

/// Lists, tile by tile, the splats that may touch it, keeping their order.
fn into_tiles(splats: &[Projected], width: usize, height: usize) -> (Vec<usize>, Vec<u32>) {
    let columns = width.div_ceil(TILE);
    let touched = |s: &Projected| {
        let columns_touched = s.low[0] / TILE..=s.high[0] / TILE;
        (s.low[1] / TILE..=s.high[1] / TILE)
            .flat_map(move |row| columns_touched.clone().map(move |c| row * columns + c))
    };
    let mut starts = vec![0; columns * height.div_ceil(TILE) + 1];
    for tile in splats.iter().flat_map(touched) {
        starts[tile + 1] += 1;
    }
    for tile in 1..starts.len() {
        starts[tile] += starts[tile - 1];
    }
    let mut next = starts.clone();
    let mut listed = vec![0; starts[starts.len() - 1]];
    for (slot, splat) in splats.iter().enumerate() {
        for tile in touched(splat) {
            listed[next[tile]] = slot as u32;
            next[tile] += 1;
        }
    }
    (starts, listed)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera { width: 50, height: 37, fx: 40.0, fy: 40.0, cx: 25.0, cy: 18.5 };

    fn cloud(count: usize) -> Splats {
        let wave = |i: usize, f: f32| (i as f32 * f).sin();
        let each = |f: &dyn Fn(usize) -> [f32; 3]| (0..count).map(f).collect::<Vec<_>>();
        Splats {
            positions: each(&|i| [wave(i, 1.7), wave(i, 2.9), 2.5 + wave(i, 0.3)]),
            log_scales: each(&|i| [-2.0 + wave(i, 0.7), -2.5, -3.0 + wave(i, 1.1)]),
            rotations: (0..count).map(|i| [1.0, wave(i, 0.2), wave(i, 0.9), 0.3]).collect(),
            opacity_logits: (0..count).map(|i| 2.0 * wave(i, 1.3)).collect(),
            sh: vec![0.0; 3 * count],
            sh_degree: 0,
        }
    }

    #[test]
    fn weights_and_transmittance_sum_to_one() {
        let splats = cloud(400);
        let geometry = Geometry::of(&splats);
        let view = Projection::new(&geometry, &CAMERA, &Pose::IDENTITY, &RenderOptions::INRIA);
        let white = vec![Vec3::ONE; 400];
        let (mut seen, mut covered) = (0, 0);
        view.sweep(&white, &mut vec![Vec3::ZERO; 400], |_, value, transmittance| {
            assert!((value.x + transmittance - 1.0).abs() < 1e-5);
            seen += 1;
            covered += usize::from(transmittance < 0.5);
            Vec3::ZERO
        });
        assert_eq!(seen, CAMERA.pixels());
        assert!(covered > CAMERA.pixels() / 4, "{covered}");
    }

    #[test]
    fn the_second_map_is_the_transpose_of_the_first() {
        let splats = cloud(200);
        let geometry = Geometry::of(&splats);
        let view = Projection::new(&geometry, &CAMERA, &Pose::IDENTITY, &RenderOptions::INRIA);
        let colours: Vec<Vec3> = (0..200).map(|i| Vec3::splat((i as f32 * 0.9).cos())).collect();
        let picture = |pixel: usize| Vec3::splat((pixel as f32 * 0.31).sin());
        let mut transposed = vec![Vec3::ZERO; 200];
        let mut forward = 0.0;
        view.sweep(&colours, &mut transposed, |pixel, value, _| {
            forward += f64::from(value.dot(picture(pixel)));
            picture(pixel)
        });
        let backward: f64 =
            std::iter::zip(&colours, &transposed).map(|(a, b)| f64::from(a.dot(*b))).sum();
        assert!((forward - backward).abs() < 1e-3 * forward.abs(), "{forward}, {backward}");
    }

    #[test]
    fn a_lone_splat_has_the_alpha_of_the_formula() {
        let mut splats = cloud(1);
        splats.positions = vec![[0.0, 0.0, 2.0]];
        splats.log_scales = vec![[0.1f32.ln(); 3]];
        splats.opacity_logits = vec![0.0];
        let geometry = Geometry::of(&splats);
        let view = Projection::new(&geometry, &CAMERA, &Pose::IDENTITY, &RenderOptions::INRIA);
        // σ = 40 · 0.1 / 2 px; the pixel (27, 18) has its centre 2.5 px to the right of the mean.
        let expected = 0.5 * (-0.5f32 * 2.5 * 2.5 / (4.0 + LOW_PASS)).exp();
        view.sweep(&[Vec3::ONE], &mut [Vec3::ZERO], |pixel, value, _| {
            if pixel == 18 * 50 + 27 {
                assert!((value.x - expected).abs() < 1e-6, "{} against {expected}", value.x);
            }
            Vec3::ZERO
        });
    }
}
