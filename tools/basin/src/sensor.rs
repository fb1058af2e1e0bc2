//! From radiance to an 8-bit picture: marine snow in front of the lens, exposure, noise, sRGB.

use glam::Vec3;
use nvsprior::Picture;

use super::noise::{Stream, hash};

/// Gain from radiance to the sensor's full scale.
const EXPOSURE: f32 = 2.2;

/// What disturbs a frame besides the light.
#[derive(Clone, Copy, Debug)]
pub struct Disturbance {
    /// Specks of marine snow in the picture.
    pub snow: u32,
    /// Standard deviation of the noise, in steps of the 8-bit picture.
    pub noise: f32,
}

/// The picture a sensor makes of a frame's radiance (linear RGB, row-major). `seed` tells frames
/// apart.
pub fn expose(
    mut radiance: Vec<Vec3>,
    width: u32,
    height: u32,
    disturbance: &Disturbance,
    seed: u32,
) -> Picture {
    let mut specks = Stream::new(hash(seed ^ 0x0005_0040));
    for _ in 0..disturbance.snow {
        add_speck(&mut radiance, width, height, &mut specks);
    }
    let mut noise = Stream::new(hash(seed ^ 0x0401_5e00));
    let mut picture = Picture::new(width, height);
    for (pixel, value) in std::iter::zip(picture.data.chunks_exact_mut(3), radiance) {
        for (byte, linear) in std::iter::zip(pixel, value.to_array()) {
            let step = disturbance.noise * noise.normal();
            *byte = (255.0 * srgb(EXPOSURE * linear) + step).round().clamp(0.0, 255.0) as u8;
        }
    }
    picture
}

/// The sRGB transfer function (IEC 61966-2-1) of a linear value, clipped to [0, 1].
fn srgb(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A blurred bright speck at a random place and range: near ones are larger.
fn add_speck(radiance: &mut [Vec3], width: u32, height: u32, draws: &mut Stream) {
    let (x, y) = (draws.within(0.0, width as f32), draws.within(0.0, height as f32));
    let range = draws.within(0.3, 2.5);
    let radius = 0.45 + 0.35 / range;
    let glow = Vec3::new(0.20, 0.26, 0.28) * draws.within(0.3, 1.0) * (-0.4 * range).exp();
    let reach = (3.0 * radius).ceil();
    let columns = pixels_about(x, reach, width);
    for row in pixels_about(y, reach, height) {
        for column in columns.clone() {
            let (dx, dy) = (column as f32 + 0.5 - x, row as f32 + 0.5 - y);
            let share = (-(dx * dx + dy * dy) / (2.0 * radius * radius)).exp();
            radiance[(row * width + column) as usize] += glow * share;
        }
    }
}

/// Pixels within `reach` of a coordinate, cut to `0..side`.
pub fn pixels_about(at: f32, reach: f32, side: u32) -> std::ops::Range<u32> {
    (at - reach).max(0.0) as u32..((at + reach).ceil() as u32).min(side)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLEAR: Disturbance = Disturbance { snow: 0, noise: 0.0 };

    #[test]
    fn exposure_is_srgb() {
        let grey = vec![Vec3::new(0.0, 0.5, 2.0) / EXPOSURE];
        assert_eq!(expose(grey, 1, 1, &CLEAR, 0).data, [0, 188, 255]);
    }

    #[test]
    fn snow_brightens_and_differs_between_frames() {
        let dark = || vec![Vec3::ZERO; 64 * 36];
        let snow = Disturbance { snow: 12, noise: 0.0 };
        let (a, b) = (expose(dark(), 64, 36, &snow, 1), expose(dark(), 64, 36, &snow, 2));
        assert_eq!(a, expose(dark(), 64, 36, &snow, 1));
        assert!(a != b && a.data.iter().any(|v| *v > 60));
    }

    #[test]
    fn noise_has_the_spread_asked_for() {
        let grey = || vec![Vec3::splat(0.1); 64 * 64];
        let noisy = expose(grey(), 64, 64, &Disturbance { snow: 0, noise: 2.0 }, 3);
        let clear = expose(grey(), 64, 64, &CLEAR, 3);
        let deviation = noisy.mse(&clear).sqrt() * 255.0;
        assert!((deviation - 2.0).abs() < 0.1, "{deviation}");
    }
}
