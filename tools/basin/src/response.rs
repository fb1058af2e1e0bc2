//! From an exposure's radiance to an 8-bit picture, by a camera with a response of its own.

use glam::Vec3;
use nvsprior::{Camera, Picture};

use super::exposure::Exposure;
use super::noise::Stream;
use super::rig::RigCamera;

/// How a camera makes levels of light. It is no sRGB.
pub struct Response {
    /// Of each channel, beside the exposure's.
    gain: Vec3,
    /// Light that bends the curve down. Less bends it more.
    shoulder: f32,
    gamma: f32,
    /// Contrast about the middle, 0 to 1.
    contrast: f32,
    /// The share of light that is lost per squared tangent off the axis.
    vignette: f32,
}

impl Response {
    pub fn of(camera: RigCamera) -> Response {
        match camera {
            RigCamera::First => Response {
                gain: Vec3::ONE,
                shoulder: 1.2,
                gamma: 1.7,
                contrast: 0.30,
                vignette: 0.5,
            },
            RigCamera::Second => Response {
                gain: Vec3::new(1.20, 0.90, 0.72),
                shoulder: 4.0,
                gamma: 2.3,
                contrast: 0.05,
                vignette: 0.9,
            },
        }
    }

    /// A level in [0, 1] of light of which 1 fills the sensor.
    fn level(&self, light: f32) -> f32 {
        let light = light.clamp(0.0, 1.0);
        let bent = (1.0 + self.shoulder) * light / (light + self.shoulder);
        let y = bent.powf(1.0 / self.gamma);
        let turn = std::f32::consts::TAU * y;
        y - self.contrast * turn.sin() / std::f32::consts::TAU
    }

    /// The picture of an exposure. `noise`: its standard deviation in the dark, in steps of the 8-bit picture.
    pub fn picture(
        &self,
        radiance: &[Vec3],
        camera: &Camera,
        exposure: &Exposure,
        noise: f32,
        draws: &mut Stream,
    ) -> Picture {
        let mut picture = Picture::new(camera.width, camera.height);
        let pixels = std::iter::zip(picture.data.chunks_exact_mut(3), radiance);
        for (index, (pixel, radiance)) in pixels.enumerate() {
            let (x, y) = (index as u32 % camera.width, index as u32 / camera.width);
            let across = (x as f32 + 0.5 - camera.cx) / camera.fx;
            let down = (y as f32 + 0.5 - camera.cy) / camera.fy;
            let kept = 1.0 / (1.0 + self.vignette * (across * across + down * down));
            let light = *radiance * exposure.gain * self.gain * kept;
            for (byte, light) in std::iter::zip(pixel, light.to_array()) {
                // Photons' own noise grows with the light.
                let spread =
                    noise * exposure.amplified.sqrt() * (0.6 + 0.8 * light.min(1.0).sqrt());
                let level = 255.0 * self.level(light) + spread * draws.normal();
                *byte = level.round().clamp(0.0, 255.0) as u8;
            }
        }
        picture
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses_rise_and_differ_from_each_other_and_from_srgb() {
        let srgb = |x: f32| 1.055 * x.powf(1.0 / 2.4) - 0.055;
        let [first, second] = [RigCamera::First, RigCamera::Second].map(Response::of);
        let lights = || (1..=100).map(|i| i as f32 / 100.0);
        let most = |a: &dyn Fn(f32) -> f32, b: &dyn Fn(f32) -> f32| {
            lights().map(|x| (a(x) - b(x)).abs()).fold(0.0, f32::max)
        };
        for response in [&first, &second] {
            let levels: Vec<f32> = lights().map(|x| response.level(x)).collect();
            assert!(levels.is_sorted() && (levels[99] - 1.0).abs() < 1e-6);
            assert_eq!((response.level(0.0), response.level(3.0)), (0.0, levels[99]));
            assert!(most(&|x| response.level(x), &srgb) > 0.04);
        }
        assert!(most(&|x| first.level(x), &|x| second.level(x)) > 0.04);
    }
}
