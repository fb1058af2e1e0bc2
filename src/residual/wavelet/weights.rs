//! What an error is worth at each place of a frame, if not all count alike.

use crate::Picture;
use crate::residual::Tune;

use super::geometry::{Band, Geometry};
use crate::coder_tables::PLANES;

/// Side of a cell, pixels.
const CELL: usize = 4;
/// SSIM's second constant, `(0.03 · 255)²`: what counts as texture.
const TEXTURE: f32 = 58.522_5;
/// Squared error of a render that is as good as any, grey levels: that of the light.
const LIGHT: f32 = 100.0;
/// What a bit of a plane of colour costs beside one of the first plane, with [`Tune::Ssim`].
const COLOUR: f32 = 2.0;

/// Sums over the pixels of a cell.
#[derive(Clone, Copy, Default)]
struct Sums {
    pixels: f32,
    value: f32,
    square: f32,
    /// Squared error of the render.
    error: f32,
}

/// Weights of a frame's cells. Only sums, products, quotients and square roots: the same on every processor.
pub struct Weights {
    tune: Tune,
    columns: usize,
    rows: usize,
    sums: Vec<Sums>,
    weights: Vec<f32>,
}

impl Weights {
    /// Without cells if all errors count alike.
    pub fn new(geometry: &Geometry, tune: Tune) -> Weights {
        let cells = |pixels: usize| if tune == Tune::Psnr { 0 } else { pixels.div_ceil(CELL) };
        let (columns, rows) = (cells(geometry.width), cells(geometry.height));
        let sums = vec![Sums::default(); columns * rows];
        Weights { tune, columns, rows, sums, weights: vec![1.0; columns * rows] }
    }

    /// Whether all errors count alike.
    pub fn are_even(&self) -> bool {
        self.tune == Tune::Psnr
    }

    /// Weighs a frame; its weights have the mean 1.
    pub fn set(&mut self, frame: &Picture, render: &Picture) {
        if self.are_even() {
            return;
        }
        self.add_up(frame, render);
        let mut total = 0.0;
        for y in 0..self.rows {
            for x in 0..self.columns {
                let weight = self.weight(&self.around(x, y));
                self.weights[y * self.columns + x] = weight;
                total += weight;
            }
        }
        let by = self.weights.len() as f32 / total;
        self.weights.iter_mut().for_each(|weight| *weight *= by);
    }

    fn add_up(&mut self, frame: &Picture, render: &Picture) {
        self.sums.fill(Sums::default());
        let pixels = frame.data.as_chunks::<3>().0.iter().zip(render.data.as_chunks::<3>().0);
        let width = frame.width as usize;
        for (i, (frame, render)) in pixels.enumerate() {
            let (x, y) = (i % width / CELL, i / width / CELL);
            let (value, error) = (luma(frame), luma(frame) - luma(render));
            let cell = &mut self.sums[y * self.columns + x];
            cell.pixels += 1.0;
            cell.value += value;
            cell.square += value * value;
            cell.error += error * error;
        }
    }

    /// Sums over a cell and its neighbours.
    fn around(&self, x: usize, y: usize) -> Sums {
        let mut all = Sums::default();
        for y in y.saturating_sub(1)..(y + 2).min(self.rows) {
            for x in x.saturating_sub(1)..(x + 2).min(self.columns) {
                let cell = &self.sums[y * self.columns + x];
                all.pixels += cell.pixels;
                all.value += cell.value;
                all.square += cell.square;
                all.error += cell.error;
            }
        }
        all
    }

    fn weight(&self, sums: &Sums) -> f32 {
        let mean = sums.value / sums.pixels;
        let variance = (sums.square / sums.pixels - mean * mean).max(0.0);
        let new = (sums.error / sums.pixels + LIGHT).sqrt().sqrt();
        match self.tune {
            Tune::Psnr => 1.0,
            Tune::Ssim => new / (2.0 * variance + TEXTURE).sqrt(),
            Tune::Detection => new,
        }
    }

    /// What a bit costs at a coefficient of each plane, of the mean: more where an error counts less.
    pub fn prices(&self, band: &Band, x: usize, y: usize) -> [f32; PLANES] {
        let size = 1 << band.level;
        let cells = |at: usize, all: usize| {
            let from = (at * size / CELL).min(all - 1);
            from..((at + 1) * size).div_ceil(CELL).clamp(from + 1, all)
        };
        let (across, down) = (cells(x, self.columns), cells(y, self.rows));
        let count = across.len() * down.len();
        let row = |y: usize| &self.weights[y * self.columns..][across.clone()];
        let sum: f32 = down.flat_map(row).sum();
        let price = count as f32 / sum;
        let colour = if self.tune == Tune::Ssim { COLOUR } else { 1.0 };
        [price, colour * price, colour * price]
    }
}

/// BT.601.
fn luma([r, g, b]: &[u8; 3]) -> f32 {
    (299.0 * f32::from(*r) + 587.0 * f32::from(*g) + 114.0 * f32::from(*b)) / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residual::wavelet::geometry::Orientation;

    /// Texture in the left half; the render lacks a bright square in the right half.
    fn pictures() -> (Picture, Picture) {
        let (mut frame, mut render) = (Picture::new(64, 48), Picture::new(64, 48));
        for (i, pixel) in frame.data.chunks_exact_mut(3).enumerate() {
            let (x, y) = (i % 64, i / 64);
            let texture = if x < 32 { 40 * ((x + y) % 2) as u8 } else { 0 };
            let new = if x >= 48 && y < 16 { 60 } else { 0 };
            pixel.fill(100 + texture + new);
            render.data[3 * i..3 * i + 3].fill(100 + texture);
        }
        (frame, render)
    }

    fn at(tune: Tune, x: usize, y: usize) -> [f32; PLANES] {
        let geometry = Geometry::new(64, 48);
        let (frame, render) = pictures();
        let mut weights = Weights::new(&geometry, tune);
        weights.set(&frame, &render);
        // A coefficient of the second level covers a cell.
        weights.prices(&geometry.band(2, Orientation::Horizontal), x / CELL, y / CELL)
    }

    #[test]
    fn texture_hides_errors() {
        let [textured, flat] = [at(Tune::Ssim, 16, 40), at(Tune::Ssim, 44, 40)];
        assert!(textured[0] > 2.0 * flat[0], "{textured:?} {flat:?}");
        assert_eq!(flat[1], 2.0 * flat[0]);
    }

    #[test]
    fn what_is_new_is_cheap_to_code() {
        let [new, known] = [at(Tune::Detection, 56, 8), at(Tune::Detection, 16, 40)];
        assert!(new[0] < 0.7 * known[0], "{new:?} {known:?}");
        assert_eq!(new[0], new[2]);
    }

    #[test]
    fn a_mean_bit_costs_what_it_did() {
        for tune in [Tune::Ssim, Tune::Detection] {
            let geometry = Geometry::new(30, 17);
            let (frame, mut render) = (Picture::new(30, 17), Picture::new(30, 17));
            render.data[..200].fill(90);
            let mut weights = Weights::new(&geometry, tune);
            weights.set(&frame, &render);
            let mean = weights.weights.iter().sum::<f32>() / weights.weights.len() as f32;
            assert!((mean - 1.0).abs() < 1e-5, "{mean}");
            for band in geometry.bands() {
                for (x, y) in (0..band.height).flat_map(|y| (0..band.width).map(move |x| (x, y))) {
                    assert!(weights.prices(&band, x, y).iter().all(|price| *price > 0.0));
                }
            }
        }
    }
}
