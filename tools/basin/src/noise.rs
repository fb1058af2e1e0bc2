//! Seeded noise from integer hashes: the same on every platform and in every run.

use glam::{IVec3, Vec3};

/// A 32-bit integer hash with low bias (C. Wellons, "Prospecting for Hash Functions", lowbias32).
pub fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// What tells the axes of a lattice apart, and its seeds.
const CELL: [u32; 3] = [0x9e37_79b1, 0x85eb_ca77, 0xc2b2_ae3d];
const CELL_SEED: u32 = 0x27d4_eb2f;

/// The hash of a lattice point.
pub fn hash_cell(cell: IVec3, seed: u32) -> u32 {
    let mixed = (cell.x as u32).wrapping_mul(CELL[0])
        ^ (cell.y as u32).wrapping_mul(CELL[1])
        ^ (cell.z as u32).wrapping_mul(CELL[2]);
    hash(mixed ^ seed.wrapping_mul(CELL_SEED))
}

/// A hash as a number in [0, 1).
pub fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 / (1 << 24) as f32
}

/// A stream of numbers in [0, 1), each the hash of a counter.
pub struct Stream {
    state: u32,
}

impl Stream {
    pub fn new(seed: u32) -> Stream {
        Stream { state: hash(seed ^ 0x5bd1_e995) }
    }

    /// The next number in [0, 1).
    pub fn unit(&mut self) -> f32 {
        self.state = self.state.wrapping_add(0x9e37_79b9);
        unit(hash(self.state))
    }

    /// The next number in [low, high).
    pub fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// The next number of a normal distribution of unit variance (Box–Muller).
    pub fn normal(&mut self) -> f32 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f32::consts::TAU * self.unit()).cos()
    }
}

/// Value noise in [−1, 1] with a period of one cell and a quintic blend.
pub fn value_noise(p: Vec3, seed: u32) -> f32 {
    let floor = p.floor();
    let cell = floor.as_ivec3();
    let f = p - floor;
    let s = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    // As `hash_cell` of the eight corners, with what they share worked out once.
    let shared = |at: i32, by: u32| [at, at.wrapping_add(1)].map(|at| (at as u32).wrapping_mul(by));
    let [xs, ys, zs] = [shared(cell.x, CELL[0]), shared(cell.y, CELL[1]), shared(cell.z, CELL[2])];
    let seeded = seed.wrapping_mul(CELL_SEED);
    let corner = |x: usize, y: usize, z: usize| unit(hash(xs[x] ^ ys[y] ^ zs[z] ^ seeded));
    let along_x = |y, z| {
        let (a, b) = (corner(0, y, z), corner(1, y, z));
        a + (b - a) * s.x
    };
    let face = |z| {
        let (a, b) = (along_x(0, z), along_x(1, z));
        a + (b - a) * s.y
    };
    let (a, b) = (face(0), face(1));
    2.0 * (a + (b - a) * s.z) - 1.0
}

/// Fractal noise of about [−1, 1]: octaves from `wavelength` metres down, each with half the size
/// and height of the last. Octaves fade out towards two sample `footprint`s, and finer ones are
/// left out, so that nothing aliases.
pub fn fractal(p: Vec3, wavelength: f32, octaves: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut height, mut length) = (0.0, 0.6, wavelength);
    for octave in 0..octaves {
        let kept = (length / (2.0 * footprint) - 1.0).min(1.0);
        if !(kept > 0.0) {
            break;
        }
        sum += kept * height * value_noise(p / length, seed.wrapping_add(octave));
        height *= 0.5;
        length *= 0.5;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_at_lattice_points_is_their_hash() {
        for i in -40..40 {
            let cell = IVec3::new(3 * i, i - 7, 5 - 2 * i);
            let expected = 2.0 * unit(hash_cell(cell, 9)) - 1.0;
            assert!((value_noise(cell.as_vec3(), 9) - expected).abs() < 1e-6, "{cell}");
            let corner = value_noise(cell.as_vec3() - Vec3::splat(1e-4), 9);
            assert!((corner - expected).abs() < 1e-3, "{cell}");
        }
    }

    #[test]
    fn noise_is_continuous_across_cells_and_bounded() {
        for i in 0..200 {
            let p = Vec3::new(i as f32 * 0.37, -2.0, i as f32 * 0.11);
            let (a, b) = (value_noise(p, 7), value_noise(p - Vec3::Y * 1e-4, 7));
            assert!((a - b).abs() < 1e-3 && a.abs() <= 1.0, "at {p}: {a}, {b}");
        }
    }

    #[test]
    fn fine_octaves_fade_with_the_footprint() {
        let p = Vec3::new(0.3, 0.4, 0.7);
        assert_eq!(fractal(p, 0.5, 6, 0.5, 3), 0.0);
        assert_ne!(fractal(p, 0.5, 6, 0.01, 3), fractal(p, 0.5, 6, 0.1, 3));
    }

    #[test]
    fn streams_have_the_moments_they_claim() {
        let mut stream = Stream::new(1);
        let n = 20_000;
        let draws: Vec<f32> = (0..n).map(|_| stream.normal()).collect();
        let mean = draws.iter().sum::<f32>() / n as f32;
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / n as f32;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean}, {variance}");
    }
}
