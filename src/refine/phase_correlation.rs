//! Phase correlation (Kuglin & Hines 1975): the shift between a frame and a render, however far, as
//! long as both show much the same. It brings a start from outside into reach of Gauss–Newton.

use std::sync::Arc;

use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

/// Width of the low-pass on the whitened spectrum, cycles a pixel.
const BANDWIDTH: f32 = 0.12;

/// Transforms and buffers for pictures of one size.
pub(super) struct PhaseCorrelation {
    width: usize,
    height: usize,
    /// Forward then inverse, along rows then along columns.
    rows: [Arc<dyn Fft<f32>>; 2],
    columns: [Arc<dyn Fft<f32>>; 2],
    window: Vec<f32>,
    low_pass: Vec<f32>,
    frame: Vec<Complex32>,
    render: Vec<Complex32>,
    turned: Vec<Complex32>,
    scratch: Vec<Complex32>,
}

impl PhaseCorrelation {
    pub fn new(width: usize, height: usize) -> PhaseCorrelation {
        let mut planner = FftPlanner::new();
        let mut both = |n| [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)];
        let (rows, columns) = (both(width), both(height));
        let scratch = rows.iter().chain(&columns).map(|f| f.get_inplace_scratch_len()).max();
        let zero = || vec![Complex32::default(); width * height];
        let at = |i: usize| (i % width, i / width);
        let window = (0..width * height).map(at).map(|(x, y)| hann(x, width) * hann(y, height));
        let low_pass = (0..width * height).map(at).map(|(x, y)| {
            let (fx, fy) = (signed(x, width) / width as f32, signed(y, height) / height as f32);
            (-0.5 * (fx * fx + fy * fy) / (BANDWIDTH * BANDWIDTH)).exp()
        });
        PhaseCorrelation {
            window: window.collect(),
            low_pass: low_pass.collect(),
            frame: zero(),
            render: zero(),
            turned: zero(),
            scratch: vec![Complex32::default(); scratch.unwrap_or(0)],
            rows,
            columns,
            width,
            height,
        }
    }

    /// How far the frame's content lies to the right of and below the render's, pixels. Pictures as
    /// luma, row by row.
    pub fn shift(
        &mut self,
        frame: impl Iterator<Item = f32>,
        render: impl Iterator<Item = f32>,
    ) -> [f32; 2] {
        load(&mut self.frame, frame, &self.window);
        load(&mut self.render, render, &self.window);
        let mut frame = std::mem::take(&mut self.frame);
        let mut render = std::mem::take(&mut self.render);
        self.transform(&mut frame, 0);
        self.transform(&mut render, 0);
        for ((f, r), pass) in frame.iter_mut().zip(&render).zip(&self.low_pass) {
            let cross = *f * r.conj();
            let size = cross.norm();
            *f = if size > 1e-12 { cross * (pass / size) } else { Complex32::default() };
        }
        self.transform(&mut frame, 1);
        let (peak, _) = frame.iter().enumerate().fold((0, f32::NEG_INFINITY), |best, (i, v)| {
            if v.re > best.1 { (i, v.re) } else { best }
        });
        (self.frame, self.render) = (frame, render);
        [signed(peak % self.width, self.width), signed(peak / self.width, self.height)]
    }

    /// Transforms in place, along rows, then along columns.
    fn transform(&mut self, data: &mut [Complex32], direction: usize) {
        self.rows[direction].process_with_scratch(data, &mut self.scratch);
        turn(data, &mut self.turned, self.width);
        self.columns[direction].process_with_scratch(&mut self.turned, &mut self.scratch);
        turn(&self.turned, data, self.height);
    }
}

/// Fills a buffer with a picture, its mean removed, under the window.
fn load(to: &mut [Complex32], luma: impl Iterator<Item = f32>, window: &[f32]) {
    for (to, luma) in to.iter_mut().zip(luma) {
        *to = Complex32::new(luma, 0.0);
    }
    let mean = to.iter().map(|v| v.re).sum::<f32>() / to.len().max(1) as f32;
    for (to, window) in to.iter_mut().zip(window) {
        to.re = (to.re - mean) * window;
    }
}

/// Transposes a picture of rows of `width`.
fn turn(from: &[Complex32], to: &mut [Complex32], width: usize) {
    let height = from.len() / width;
    for (i, v) in from.iter().enumerate() {
        to[i % width * height + i / width] = *v;
    }
}

/// The Hann window's value at sample `i` of `n`.
fn hann(i: usize, n: usize) -> f32 {
    let phase = std::f32::consts::TAU * (i as f32 + 0.5) / n as f32;
    0.5 - 0.5 * phase.cos()
}

/// Index `i` of `n` as a signed frequency or shift.
fn signed(i: usize, n: usize) -> f32 {
    if 2 * i <= n { i as f32 } else { i as f32 - n as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise (each sample a hash of its place), drawn at an offset.
    fn picture(width: usize, height: usize, dx: i32, dy: i32) -> Vec<f32> {
        let at = |i: usize| {
            let (x, y) = ((i % width) as i32 - dx, (i / width) as i32 - dy);
            let mut z = (x as u32).wrapping_mul(0x9e37_79b9) ^ (y as u32).wrapping_mul(0x85eb_ca6b);
            z = (z ^ (z >> 15)).wrapping_mul(0xc2b2_ae35);
            ((z ^ (z >> 13)) & 0xffff) as f32 / 65_535.0
        };
        (0..width * height).map(at).collect()
    }

    #[test]
    fn finds_a_shift_in_any_size() {
        for (width, height) in [(80, 45), (41, 23), (16, 64)] {
            let mut correlation = PhaseCorrelation::new(width, height);
            let render = picture(width, height, 0, 0);
            for (dx, dy) in [(0, 0), (3, -2), (-4, 5)] {
                let frame = picture(width, height, dx, dy);
                let found = correlation.shift(frame.into_iter(), render.iter().copied());
                assert_eq!(found, [dx as f32, dy as f32], "{width}×{height}");
            }
        }
    }

    #[test]
    fn flat_pictures_do_not_shift() {
        let mut correlation = PhaseCorrelation::new(20, 10);
        let flat = || std::iter::repeat_n(0.5, 200);
        assert_eq!(correlation.shift(flat(), flat()), [0.0, 0.0]);
    }
}
