//! Exposure and white balance that a camera sets by the pictures before: late, and never quite still.

use glam::Vec3;

/// What a camera holds from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AutoExposure {
    /// Logarithms of the gain, and of that of each channel beside it.
    gain: f32,
    balance: Vec3,
    /// Tells dives apart.
    phase: f32,
}

/// What a frame is taken with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// From radiance to the sensor's full scale, by channel.
    pub gain: Vec3,
    /// Seconds that the shutter is open.
    pub shutter: f64,
    /// How much of the gain is the amplifier's, from 1: it lifts the noise, too.
    pub amplified: f32,
}

/// The mean that is brought about, as a share of full scale: most of the picture is black, so steel is bright.
const TARGET: f32 = 0.10;
/// Seconds until a step of brightness is made up for to 63 %, and one of colour.
const LAG: f32 = 1.8;
const COLOUR_LAG: f32 = 6.0;
/// How much of a cast is taken out.
const GREY_WORLD: f32 = 0.6;
/// Limits of the gain's logarithm.
const GAINS: (f32, f32) = (2.0, 7.0);
/// The gain at which the shutter is open for 1/30 s, and the longest time.
const GAIN_AT_30: f32 = 60.0;
const SHUTTERS: (f32, f32) = (1.0 / 120.0, 1.0 / 12.0);

impl AutoExposure {
    /// After a long look at a picture of a mean radiance.
    pub fn settled(mean: Vec3, phase: f32) -> AutoExposure {
        AutoExposure { gain: wanted_gain(mean), balance: wanted_balance(mean), phase }
    }

    /// After a frame of a mean radiance, `seconds` before the next one.
    pub fn after(self, mean: Vec3, seconds: f32) -> AutoExposure {
        let part = |lag: f32| 1.0 - (-seconds / lag).exp();
        let gain = self.gain + part(LAG) * (wanted_gain(mean) - self.gain);
        let balance = self.balance.lerp(wanted_balance(mean), part(COLOUR_LAG));
        AutoExposure { gain, balance, ..self }
    }

    /// For the frame `time` seconds into the run.
    pub fn at(&self, time: f32) -> Exposure {
        let drift = |period: f32, offset: f32| {
            (std::f32::consts::TAU * time / period + self.phase + offset).sin()
        };
        let gain = (self.gain + 0.07 * drift(19.0, 0.0) + 0.04 * drift(7.3, 1.0)).exp();
        let shift = Vec3::new(0.05 * drift(31.0, 2.0), 0.0, 0.06 * drift(43.0, 0.3));
        let shutter = (gain / GAIN_AT_30 / 30.0).clamp(SHUTTERS.0, SHUTTERS.1);
        Exposure {
            gain: gain * (self.balance + shift).exp(),
            shutter: shutter.into(),
            amplified: (gain / (30.0 * GAIN_AT_30 * shutter)).max(1.0),
        }
    }
}

fn wanted_gain(mean: Vec3) -> f32 {
    (TARGET / mean.y.max(1e-6)).ln().clamp(GAINS.0, GAINS.1)
}

fn wanted_balance(mean: Vec3) -> Vec3 {
    let cast = (Vec3::splat(mean.y) / mean.max(Vec3::splat(1e-6)))
        .clamp(Vec3::splat(0.3), Vec3::splat(3.0));
    Vec3::from_array(cast.to_array().map(f32::ln)) * GREY_WORLD
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIM: Vec3 = Vec3::new(5e-4, 1e-3, 8e-4);

    #[test]
    fn exposure_follows_brightness_late() {
        let settled = AutoExposure::settled(DIM, 0.0);
        let gain = |state: &AutoExposure| state.at(0.0).gain.y;
        let (before, mut state) = (gain(&settled), settled);
        state = state.after(4.0 * DIM, 0.3);
        assert!(gain(&state) < 0.95 * before && gain(&state) > 0.5 * before);
        for _ in 0..100 {
            state = state.after(4.0 * DIM, 0.3);
        }
        assert!((gain(&state) / before - 0.25).abs() < 0.01);
        assert!(state.at(0.0).shutter < settled.at(0.0).shutter);
    }

    #[test]
    fn exposure_and_colour_drift_under_an_even_light() {
        let settled = AutoExposure::settled(DIM, 0.4);
        let gains: Vec<Vec3> = (0..40).map(|i| settled.at(i as f32).gain).collect();
        let spread = |of: &dyn Fn(&Vec3) -> f32| {
            let (low, high) = gains
                .iter()
                .map(of)
                .fold((f32::MAX, 0.0f32), |(low, high), v| (low.min(v), high.max(v)));
            high / low
        };
        assert!((1.1..1.4).contains(&spread(&|gain| gain.y)));
        assert!((1.03..1.3).contains(&spread(&|gain| gain.x / gain.y)));
        assert!(gains[0].x > gains[0].y, "red is lifted");
    }
}
