//! Small grey pictures, on which frames are judged.

/// A grey picture, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    pub width: usize,
    pub height: usize,
    pub data: Vec<f32>,
}

impl Plane {
    pub fn from_luma(width: u32, height: u32, luma: &[u8]) -> Plane {
        let data = luma.iter().map(|value| f32::from(*value)).collect();
        Plane { width: width as usize, height: height as usize, data }
    }

    fn map(&self, by: impl Fn(f32) -> f32) -> Plane {
        Plane { data: self.data.iter().map(|value| by(*value)).collect(), ..*self }
    }

    pub fn with(&self, other: &Plane, by: impl Fn(f32, f32) -> f32) -> Plane {
        let pairs = self.data.iter().zip(&other.data);
        Plane { data: pairs.map(|(a, b)| by(*a, *b)).collect(), ..*self }
    }

    /// Means of squares of `factor` pixels' side. What is left over at the right and below is left out.
    pub fn reduced(&self, factor: usize) -> Plane {
        let (width, height) = (self.width / factor, self.height / factor);
        let mut data = vec![0.0; width * height];
        for y in 0..height * factor {
            let row = &self.data[y * self.width..][..width * factor];
            let sums = &mut data[y / factor * width..][..width];
            for (sum, part) in sums.iter_mut().zip(row.chunks_exact(factor)) {
                *sum += part.iter().sum::<f32>();
            }
        }
        let share = 1.0 / (factor * factor) as f32;
        data.iter_mut().for_each(|sum| *sum *= share);
        Plane { width, height, data }
    }

    /// Means over squares of `2 radius + 1` pixels about each, cut at the edges.
    fn blurred(&self, radius: usize) -> Plane {
        let rows = self.blurred_rows(radius).transposed();
        rows.blurred_rows(radius).transposed()
    }

    fn blurred_rows(&self, radius: usize) -> Plane {
        let mut data = Vec::with_capacity(self.data.len());
        let mut sums = vec![0.0f64; self.width + 1];
        for row in self.data.chunks_exact(self.width.max(1)) {
            for (i, value) in row.iter().enumerate() {
                sums[i + 1] = sums[i] + f64::from(*value);
            }
            for x in 0..self.width {
                let (from, to) = (x.saturating_sub(radius), (x + radius + 1).min(self.width));
                data.push(((sums[to] - sums[from]) / (to - from) as f64) as f32);
            }
        }
        Plane { data, ..*self }
    }

    fn transposed(&self) -> Plane {
        let columns = (0..self.width).flat_map(|x| self.data.iter().skip(x).step_by(self.width));
        Plane { width: self.height, height: self.width, data: columns.copied().collect() }
    }

    /// Its texture alone: brightness and contrast are the same everywhere, whatever the light is. What has none stays
    /// near zero.
    pub fn levelled(&self, radius: usize) -> Plane {
        /// Contrast, in steps of 8-bit brightness, that counts half.
        const FAINT: f32 = 2.0;
        /// So that few pixels, such as letters over the picture, do not outweigh all others.
        const MOST: f32 = 2.5;
        let high = self.with(&self.blurred(radius), |value, mean| value - mean);
        let contrast = high.map(|value| value * value).blurred(radius);
        high.with(&contrast, |value, square| {
            (value / (square.max(0.0).sqrt() + FAINT)).clamp(-MOST, MOST)
        })
    }

    /// Mean of squared gradients (Tenengrad, with Sobel's kernels), for brightness in steps of 8 bits.
    pub fn gradient_energy(&self) -> f64 {
        let (width, height) = (self.width, self.height);
        if width < 3 || height < 3 {
            return 0.0;
        }
        let mut sum = 0.0;
        for y in 1..height - 1 {
            let rows: [&[f32]; 3] =
                std::array::from_fn(|i| &self.data[(y + i - 1) * width..][..width]);
            let mut of_row = 0.0f32;
            for x in 1..width - 1 {
                let side = |at: usize| rows[0][at] + 2.0 * rows[1][at] + rows[2][at];
                let line = |row: &[f32]| row[x - 1] + 2.0 * row[x] + row[x + 1];
                let (dx, dy) = (side(x + 1) - side(x - 1), line(rows[2]) - line(rows[0]));
                of_row += dx * dx + dy * dy;
            }
            sum += f64::from(of_row);
        }
        /// Sobel's kernels give eight times the gradient.
        const SCALE: f64 = 1.0 / 64.0;
        SCALE * sum / ((width - 2) * (height - 2)) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: usize, height: usize) -> Plane {
        let data = (0..width * height).map(|i| (3 * (i % width) + i / width) as f32).collect();
        Plane { width, height, data }
    }

    #[test]
    fn gradients_are_those_of_a_ramp() {
        assert!((ramp(9, 7).gradient_energy() - 10.0).abs() < 1e-6);
        assert_eq!(ramp(2, 9).gradient_energy(), 0.0);
    }

    #[test]
    fn reducing_takes_means() {
        let small = ramp(5, 4).reduced(2);
        assert_eq!((small.width, small.height), (2, 2));
        assert_eq!(small.data, [2.0, 8.0, 4.0, 10.0]);
    }

    #[test]
    fn light_does_not_change_texture() {
        let noise = |i: usize| (i.wrapping_mul(2_654_435_761) >> 7) % 64;
        let data: Vec<f32> = (0..40 * 30).map(|i| 100.0 + noise(i) as f32).collect();
        let plane = Plane { width: 40, height: 30, data };
        let other = plane.map(|value| 0.6 * value + 20.0);
        let pairs = plane.levelled(4).with(&other.levelled(4), |a, b| (a - b).abs());
        assert!(pairs.data.iter().all(|difference| *difference < 0.2));
        let flat = plane.map(|_| 7.0).levelled(4);
        assert!(flat.data.iter().all(|value| value.abs() < 1e-3));
    }
}
