//! A small rasteriser that tells which splat has which weight in which pixel.
//!
//! The picture of splats with colours `c` is `Σ wᵢ cᵢ + T · background`. The weights follow from
//! geometry and opacity alone: `wᵢ = αᵢ Π (1 − αⱼ)` over the splats `j` before `i`. So for a fixed
//! geometry the picture is linear in the colours. This module offers that linear map and its
//! transpose, tile by tile. Constants are those of the GPU renderer: cut at 1/255, stop at a
//! transmittance of 1e-4.

use glam::{Vec2, Vec3};

use super::project::{Geometry, Projected, Projector};
use nvsprior::prior::RenderOptions;
use nvsprior::{Camera, Pose};
use nvsprior_kernels::shared::{ALPHA_MIN, TRANSMITTANCE_STOP};

/// Side of a tile, pixels.
const TILE: usize = 16;
const TILE_PIXELS: usize = TILE * TILE;

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
    alpha: f32,
}

/// Derivatives by what a splat is in the picture.
#[derive(Clone, Copy, Default)]
pub struct ImageGradient {
    pub colour: Vec3,
    pub mean: Vec2,
    /// By xx, xy, yy of the conic, xy standing for both places.
    pub conic: [f32; 3],
    pub opacity_logit: f32,
}

/// What leaving one splat out would do to pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Removal {
    /// Sum over pixels and channels of the squared change, values in [0, 1].
    pub error: f32,
    /// Pixels in which the splat is blended.
    pub pixels: f32,
}

impl std::ops::AddAssign for Removal {
    fn add_assign(&mut self, other: Removal) {
        self.error += other.error;
        self.pixels += other.pixels;
    }
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

    /// Renders: gives each pixel and its value to `write`, in the order of the tiles.
    #[cfg(test)]
    pub fn render(&self, colours: &[Vec3], background: Vec3, mut write: impl FnMut(usize, Vec3)) {
        let mut tile = Tile::default();
        for index in 0..self.tiles() {
            self.blend(index, &mut tile);
            for (inside, value) in self.values(&tile, colours, background).iter().enumerate() {
                if let Some(pixel) = self.pixel_of(index, inside) {
                    write(pixel, *value);
                }
            }
        }
    }

    /// The linear map and its transpose at once. Calls `pull` for every pixel with its place, value
    /// and transmittance. Adds the result times each weight to `gradient`, which has one entry per
    /// splat of the geometry.
    pub fn sweep(
        &self,
        colours: &[Vec3],
        gradient: &mut [Vec3],
        mut pull: impl FnMut(usize, Vec3, f32) -> Vec3,
    ) {
        let mut tile = Tile::default();
        for index in 0..self.tiles() {
            self.blend(index, &mut tile);
            let mut values = self.values(&tile, colours, Vec3::ZERO);
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

    /// Derivatives of a loss of the rendered picture, by every splat in view. `pull` gets a pixel
    /// and its value with the background, and gives the loss's derivative by that value.
    pub fn backward(
        &self,
        colours: &[Vec3],
        background: Vec3,
        mut pull: impl FnMut(usize, Vec3) -> Vec3,
    ) -> Vec<ImageGradient> {
        let mut gradients = vec![ImageGradient::default(); self.splats.len()];
        let mut tile = Tile::default();
        for index in 0..self.tiles() {
            self.blend(index, &mut tile);
            let mut values = self.values(&tile, colours, background);
            for (inside, value) in values.iter_mut().enumerate() {
                let pixel = self.pixel_of(index, inside);
                *value = pixel.map_or(Vec3::ZERO, |pixel| pull(pixel, *value));
            }
            // What each pixel shows of everything behind the current splat.
            let mut behind: Vec<Vec3> =
                tile.transmittance.iter().map(|t| *t * background).collect();
            for w in tile.weights.iter().rev() {
                let colour = colours[self.splats[w.slot as usize].index as usize];
                let pixel = w.pixel as usize;
                let gradient = &mut gradients[w.slot as usize];
                gradient.colour += w.weight * values[pixel];
                let by_alpha = values[pixel]
                    .dot(colour * (w.weight / w.alpha) - behind[pixel] / (1.0 - w.alpha));
                behind[pixel] += w.weight * colour;
                self.add_shape(index, w, by_alpha, gradient);
            }
        }
        gradients
    }

    /// Turns the derivative by alpha in one pixel into those by mean, conic and opacity.
    fn add_shape(&self, tile: usize, w: &Weight, by_alpha: f32, gradient: &mut ImageGradient) {
        if w.alpha >= self.alpha_max {
            return;
        }
        let splat = &self.splats[w.slot as usize];
        let [left, upper] = self.corner(tile);
        let (x, y) = (left + w.pixel as usize % TILE, upper + w.pixel as usize / TILE);
        let (dx, dy) = (x as f32 + 0.5 - splat.mean.x, y as f32 + 0.5 - splat.mean.y);
        let [xx, xy, yy] = splat.conic;
        let by_power = by_alpha * w.alpha;
        gradient.mean += by_power * Vec2::new(xx * dx + xy * dy, xy * dx + yy * dy);
        gradient.conic[0] -= 0.5 * by_power * dx * dx;
        gradient.conic[1] -= by_power * dx * dy;
        gradient.conic[2] -= 0.5 * by_power * dy * dy;
        gradient.opacity_logit += by_power * (1.0 - splat.opacity);
    }

    /// The splats in view, in the order of `backward`'s derivatives.
    pub fn splats(&self) -> &[Projected] {
        &self.splats
    }

    /// Adds every splat's sum of squared weights to `sums`: the diagonal of the normal equations.
    pub fn add_squared_weights(&self, sums: &mut [f32]) {
        let mut tile = Tile::default();
        for index in 0..self.tiles() {
            self.blend(index, &mut tile);
            for w in &tile.weights {
                sums[self.splats[w.slot as usize].index as usize] += w.weight * w.weight;
            }
        }
    }

    /// Adds to every splat's sums how this picture would change without that one splat: in each
    /// pixel what lies behind shows in its place, `T α (behind − colour)`.
    pub fn add_removals(&self, colours: &[Vec3], background: Vec3, sums: &mut [Removal]) {
        let mut tile = Tile::default();
        for index in 0..self.tiles() {
            self.blend(index, &mut tile);
            let inside = |pixel: usize| self.pixel_of(index, pixel).is_some();
            let mut behind: Vec<Vec3> =
                tile.transmittance.iter().map(|t| *t * background).collect();
            for w in tile.weights.iter().rev() {
                let splat = self.splats[w.slot as usize].index as usize;
                let (pixel, shown) = (w.pixel as usize, w.weight * colours[splat]);
                let change = behind[pixel] * (w.alpha / (1.0 - w.alpha)) - shown;
                behind[pixel] += shown;
                if inside(pixel) {
                    sums[splat] += Removal { error: change.length_squared(), pixels: 1.0 };
                }
            }
        }
    }

    /// Values of a blended tile's pixels.
    fn values(&self, tile: &Tile, colours: &[Vec3], background: Vec3) -> [Vec3; TILE_PIXELS] {
        let mut values = std::array::from_fn(|inside| tile.transmittance[inside] * background);
        for w in &tile.weights {
            let splat = self.splats[w.slot as usize].index as usize;
            values[w.pixel as usize] += w.weight * colours[splat];
        }
        values
    }

    fn tiles(&self) -> usize {
        self.tile_starts.len() - 1
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
        // Alpha is above the cut if `xx dx² + 2 xy dx dy + yy dy² ≤ 2 ln(255 opacity)`.
        let level = 2.0 * (255.0 * splat.opacity).ln();
        let columns = range(0);
        let mut closed = 0;
        for y in range(1) {
            let dy = y as f32 + 0.5 - splat.mean.y;
            let discriminant = (xy * dy).powi(2) - xx * (yy * dy * dy - level);
            if !(discriminant >= 0.0) {
                continue;
            }
            let middle = splat.mean.x - 0.5 - xy * dy / xx;
            // A hair more than needed: the cut itself is tested per pixel.
            let half = discriminant.sqrt() / xx + 1e-3;
            let first = columns.start.max((middle - half).ceil() as usize);
            let last = columns.end.min((middle + half).floor() as usize + 1);
            for x in first..last {
                let dx = x as f32 + 0.5 - splat.mean.x;
                let power = -0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy;
                let pixel = (y - corner[1]) * TILE + x - corner[0];
                closed += usize::from(self.blend_pixel(slot, pixel, power, tile));
            }
        }
        closed
    }

    /// Blends one splat into one pixel; whether that closed the pixel.
    #[inline]
    fn blend_pixel(&self, slot: u32, pixel: usize, power: f32, tile: &mut Tile) -> bool {
        if !tile.open[pixel] || !(power <= 0.0) {
            return false;
        }
        let alpha = (self.splats[slot as usize].opacity * power.exp()).min(self.alpha_max);
        if !(alpha >= ALPHA_MIN) {
            return false;
        }
        let before = tile.transmittance[pixel];
        let after = before * (1.0 - alpha);
        if after <= TRANSMITTANCE_STOP {
            tile.open[pixel] = false;
            return true;
        }
        tile.transmittance[pixel] = after;
        tile.weights.push(Weight { pixel: pixel as u8, slot, weight: alpha * before, alpha });
        false
    }
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
    use nvsprior::prior::Splats;

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
        let expected = 0.5 * (-0.5f32 * 2.5 * 2.5 / (4.0 + 0.3)).exp();
        view.sweep(&[Vec3::ONE], &mut [Vec3::ZERO], |pixel, value, _| {
            if pixel == 18 * 50 + 27 {
                assert!((value.x - expected).abs() < 1e-6, "{} against {expected}", value.x);
            }
            Vec3::ZERO
        });
    }
}
