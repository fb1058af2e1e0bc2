//! A rough guess of what coding a frame at a step gives, from its coefficients alone.

use super::geometry::PLANES;
use super::step::Step;

/// What a frame may come to.
pub struct Model {
    /// dB.
    pub psnr: f64,
    /// Of the payload.
    pub bytes: f64,
}

/// Coefficients below this are zero in the end, steps.
const DEAD: f32 = 0.75;
/// Bits of a coefficient that is not zero, and of each octave above.
const BITS: f64 = 6.0;

impl Model {
    /// Of coefficients in steps.
    pub fn of(wanted: &[Vec<f32>; PLANES], step: Step) -> Model {
        let (mut error, mut bits, mut count) = (0.0, 16.0, 0);
        for size in wanted.iter().flatten().map(|v| v.abs()) {
            if size < DEAD {
                error += f64::from(size * size);
            } else {
                let octaves = (size as u32).max(1).ilog2();
                error += 1.0 / 12.0;
                bits += BITS + 1.5 * f64::from(octaves);
            }
            count += 1;
        }
        let mean = error * step.value().powi(2) / f64::from(count.max(1));
        Model { psnr: 10.0 * libm::log10(65_025.0 / mean.max(1e-9)), bytes: bits / 8.0 }
    }
}
