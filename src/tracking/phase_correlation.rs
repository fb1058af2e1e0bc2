//! Phase correlation (Kuglin & Hines 1975): finds the shift between a frame and a render, however
//! far, if both show much the same. It brings a start from outside into reach of Gauss–Newton.

use std::sync::Arc;

use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

/// Width of the low-pass on the whitened spectrum, cycles per pixel.
const BANDWIDTH: f32 = 0.12;

/// Transforms and buffers for pictures of one size, and the spectrum of a reference.
pub(super) struct PhaseCorrelation {
    width: usize,
    height: usize,
    /// Forward then inverse, along rows then along columns.
    rows: [Arc<dyn Fft<f32>>; 2],
    columns: [Arc<dyn Fft<f32>>; 2],
    window: Vec<f32>,
    /// The low-pass on the whitened spectrum; transposed, as spectra are.
    low_pass: Vec<f32>,
    /// The reference's whitened spectrum, conjugate, under the low-pass.
    reference: Vec<Complex32>,
    pictures: Vec<Complex32>,
    turned: Vec<Complex32>,
    scratch: Vec<Complex32>,
}

impl PhaseCorrelation {
    /// For pictures of `width` × `height`, both at least 1.
    pub fn new(width: usize, height: usize) -> PhaseCorrelation {
        let mut planner = FftPlanner::new();
        let mut both = |n| [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)];
        let (rows, columns) = (both(width), both(height));
        let scratch = rows.iter().chain(&columns).map(|f| f.get_inplace_scratch_len()).max();
        let zero = || vec![Complex32::default(); width * height];
        let window = (0..width * height).map(|i| hann(i % width, width) * hann(i / width, height));
        let low_pass = (0..width * height)
            .map(|i| {
                let (x, y) = (signed(i / height, width), signed(i % height, height));
                let (fx, fy) = (x / width as f32, y / height as f32);
                (-0.5 * (fx * fx + fy * fy) / (BANDWIDTH * BANDWIDTH)).exp()
            })
            .collect();
        PhaseCorrelation {
            window: window.collect(),
            low_pass,
            reference: zero(),
            pictures: zero(),
            turned: zero(),
            scratch: vec![Complex32::default(); scratch.unwrap_or(0)],
            rows,
            columns,
            width,
            height,
        }
    }

    /// Sets the picture that others are compared with: luma, row by row.
    pub fn set_reference(&mut self, luma: &[f32]) {
        self.load(luma, luma);
        self.forward();
        let flip = Flip { width: self.width, height: self.height };
        for (i, (to, pass)) in self.reference.iter_mut().zip(&self.low_pass).enumerate() {
            let [one, _] = flip.apart(&self.turned, i);
            *to = whitened(one).conj() * *pass;
        }
    }

    /// How far the content of each of two pictures lies to the right of and below the reference's,
    /// to a fraction of a pixel. One transform serves both pictures. Pictures are luma, row by row.
    pub fn shifts(&mut self, one: &[f32], other: &[f32]) -> [[f32; 2]; 2] {
        self.load(one, other);
        self.forward();
        let flip = Flip { width: self.width, height: self.height };
        // Separates the spectra of the two real pictures, and packs the two correlations into one again.
        for i in 0..self.turned.len() {
            let j = flip.of(i);
            if j < i {
                continue;
            }
            let [a, b] = flip.apart(&self.turned, i).map(whitened);
            let (a, b) = (a * self.reference[i], b * self.reference[i]);
            let i_times = |v: Complex32| Complex32::new(-v.im, v.re);
            self.turned[j] = a.conj() + i_times(b.conj());
            self.turned[i] = a + i_times(b);
        }
        self.inverse();
        [self.peak(|v| v.re), self.peak(|v| v.im)]
    }

    /// Fills the buffer with two pictures, means removed, under the window.
    fn load(&mut self, one: &[f32], other: &[f32]) {
        let count = self.pictures.len();
        assert_eq!((one.len(), other.len()), (count, count), "pixels");
        let mean = |luma: &[f32]| luma.iter().sum::<f32>() / count as f32;
        let (mean_one, mean_other) = (mean(one), mean(other));
        let pixels = one.iter().zip(other).zip(&self.window);
        for (to, ((one, other), window)) in self.pictures.iter_mut().zip(pixels) {
            *to = Complex32::new((one - mean_one) * window, (other - mean_other) * window);
        }
    }

    /// Transforms `pictures` to their spectrum in `turned`.
    fn forward(&mut self) {
        self.rows[0].process_with_scratch(&mut self.pictures, &mut self.scratch);
        turn(&self.pictures, &mut self.turned, self.width);
        self.columns[0].process_with_scratch(&mut self.turned, &mut self.scratch);
    }

    /// Back from `turned` to `pictures`.
    fn inverse(&mut self) {
        self.columns[1].process_with_scratch(&mut self.turned, &mut self.scratch);
        turn(&self.turned, &mut self.pictures, self.height);
        self.rows[1].process_with_scratch(&mut self.pictures, &mut self.scratch);
    }

    /// Place of the highest peak of one of the two correlations.
    fn peak(&self, part: impl Fn(&Complex32) -> f32) -> [f32; 2] {
        let (width, height) = (self.width, self.height);
        let highest = |best: (usize, f32), (i, v): (usize, &Complex32)| {
            if part(v) > best.1 { (i, part(v)) } else { best }
        };
        let start = (0, f32::NEG_INFINITY);
        let (at, peak) = self.pictures.iter().enumerate().fold(start, highest);
        let (x, y) = (at % width, at / width);
        let value = |x: usize, y: usize| part(&self.pictures[y % height * width + x % width]);
        let dx = vertex(value(x + width - 1, y), peak, value(x + 1, y));
        let dy = vertex(value(x, y + height - 1), peak, value(x, y + 1));
        [signed(x, width) + dx, signed(y, height) + dy]
    }
}

/// The vertex of the parabola through a highest sample and its two neighbours, −½ to ½.
fn vertex(before: f32, peak: f32, after: f32) -> f32 {
    let bend = before - 2.0 * peak + after;
    if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Places of a transposed spectrum.
struct Flip {
    width: usize,
    height: usize,
}

impl Flip {
    /// The place of the opposite frequency.
    fn of(&self, i: usize) -> usize {
        let (x, y) = (i / self.height, i % self.height);
        let (x, y) = ((self.width - x) % self.width, (self.height - y) % self.height);
        x * self.height + y
    }

    /// The spectra at `i` of two real pictures that were transformed as real and imaginary part.
    fn apart(&self, both: &[Complex32], i: usize) -> [Complex32; 2] {
        let (here, there) = (both[i], both[self.of(i)].conj());
        let difference = (here - there) * 0.5;
        [(here + there) * 0.5, Complex32::new(difference.im, -difference.re)]
    }
}

fn whitened(v: Complex32) -> Complex32 {
    let size = v.norm();
    if size > 1e-6 { v / size } else { Complex32::default() }
}

/// Transposes a picture of rows of `width`.
fn turn(from: &[Complex32], to: &mut [Complex32], width: usize) {
    let height = from.len() / width;
    for (x, column) in to.chunks_exact_mut(height).enumerate() {
        for (y, to) in column.iter_mut().enumerate() {
            *to = from[y * width + x];
        }
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
    fn finds_two_shifts_at_once_in_any_size() {
        for (width, height) in [(80, 45), (41, 23), (16, 64)] {
            let mut correlation = PhaseCorrelation::new(width, height);
            correlation.set_reference(&picture(width, height, 0, 0));
            let shifts = [[0, 0], [3, -2], [-4, 5], [2, 6]];
            for pair in shifts.chunks(2) {
                let [one, other] = [0, 1].map(|i| picture(width, height, pair[i][0], pair[i][1]));
                let found = correlation.shifts(&one, &other);
                for (found, shift) in found.iter().zip(pair) {
                    for axis in 0..2 {
                        let error = found[axis] - shift[axis] as f32;
                        assert!(error.abs() < 0.25, "{width}×{height}: {found:?}, not {shift:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn gain_and_offset_do_not_matter() {
        let mut correlation = PhaseCorrelation::new(80, 45);
        correlation.set_reference(&picture(80, 45, 0, 0));
        let bright = picture(80, 45, 5, -3);
        let dark: Vec<f32> = bright.iter().map(|v| 0.02 * v + 0.3).collect();
        let [one, other] = correlation.shifts(&bright, &dark);
        assert!((0..2).all(|axis| (one[axis] - other[axis]).abs() < 1e-2), "{one:?} {other:?}");
    }

    #[test]
    fn flat_pictures_do_not_shift() {
        let mut correlation = PhaseCorrelation::new(20, 10);
        let flat = [0.5; 200];
        correlation.set_reference(&flat);
        assert_eq!(correlation.shifts(&flat, &flat), [[0.0; 2]; 2]);
        correlation.set_reference(&picture(20, 10, 0, 0));
        assert_eq!(correlation.shifts(&flat, &[f32::NAN; 200])[0], [0.0; 2]);
    }
}
