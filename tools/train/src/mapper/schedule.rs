//! How fast what is trained, and when splats move elsewhere.

use crate::trainer::{FADING, Training};
use nvsprior_kernels::shared::sh_coefficients;

/// Rates and pulls. The defaults are those of gsplat's MCMC preset, but for trainings of some thousand steps: splats
/// are added faster, all but opacities move faster, pulls are weaker, and all rates fall in the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Rate of positions at the start, in extents of the scene.
    pub position: f32,
    /// Share of it at the end; it falls geometrically.
    pub position_end: f32,
    /// Share of the other rates at the end; they fall geometrically in the last part of the training.
    pub others_end: f32,
    /// Share of the training before that part.
    pub others_until: f32,
    pub log_scale: f32,
    pub rotation: f32,
    pub opacity: f32,
    /// Rate of the first coefficient of the spherical harmonics.
    pub sh_first: f32,
    /// Rate of the others.
    pub sh_others: f32,
    pub ssim: f32,
    /// Errors below it count by their squares (Huber's loss), of 1; 0 if none does.
    pub knee: f32,
    /// Pull of opacities.
    pub opacity_pull: f32,
    /// Pull of standard deviations.
    pub scale_pull: f32,
    /// Noise of positions, in rates of positions.
    pub noise: f32,
    /// Steps until the next degree of the spherical harmonics is trained.
    pub degree_every: u32,
    /// No relocation before this step: opacities say nothing yet.
    pub relocate_from: u32,
    pub relocate_every: u32,
    /// Share of the splats in use that a relocation adds, as long as there is room.
    pub growth: f64,
    /// Share of the steps after which no splat is relocated.
    pub relocate_until: f32,
    /// Share of the training in which pictures are reduced, to half their sides in the end; 0: none are.
    pub reduced_until: f32,
}

impl Default for Schedule {
    fn default() -> Schedule {
        Schedule {
            position: 3e-4,
            position_end: 0.03,
            others_end: 0.1,
            others_until: 0.75,
            log_scale: 1e-2,
            rotation: 3e-3,
            opacity: 5e-2,
            sh_first: 5e-3,
            sh_others: 1e-3,
            ssim: 0.2,
            knee: 0.1,
            opacity_pull: 0.004,
            scale_pull: 0.004,
            noise: 5e5,
            degree_every: 300,
            relocate_from: 500,
            relocate_every: 100,
            growth: 0.12,
            relocate_until: 0.9,
            reduced_until: 0.2,
        }
    }
}

/// No picture is reduced to a shorter side than this one. A window of SSIM has 11 pixels.
const COARSEST: u32 = 80;

pub struct Progress {
    pub step: u32,
    /// Share of the training that is done, 0 to 1.
    pub share: f64,
    /// Splats in use.
    pub alive: u32,
}

impl Schedule {
    /// For splats that are trained already: `pace` times rates that are at most those of a new training fall to the
    /// share `end`, without noise and pulls, so that a splat that no picture shows stays what it is.
    pub fn further(pace: f32, end: f32) -> Schedule {
        let new = Schedule::default();
        Schedule {
            position: pace * new.position,
            position_end: end,
            others_end: end,
            others_until: 0.0,
            log_scale: pace * 5e-3,
            rotation: pace * 1e-3,
            opacity: pace * new.opacity,
            sh_first: pace * 2.5e-3,
            sh_others: pace * 5e-4,
            opacity_pull: 0.0,
            scale_pull: 0.0,
            noise: 0.0,
            degree_every: 0,
            relocate_from: 0,
            relocate_every: 50,
            growth: 0.02,
            relocate_until: 0.8,
            reduced_until: 0.0,
            ..new
        }
    }

    /// What a step is told. `scene`: its extent, the prior's unit, and the pixels of a picture.
    pub fn at(&self, progress: &Progress, sh_degree: u32, scene: (f64, usize)) -> Training {
        let Progress { step, share, alive } = *progress;
        let (extent, pixels) = scene;
        let fall = f64::from(self.position_end).powf(share.clamp(0.0, 1.0));
        let position = f64::from(self.position) * extent * fall;
        let until = f64::from(self.others_until);
        let last = ((share - until) / (1.0 - until).max(1e-6)).clamp(0.0, 1.0);
        let others = f64::from(self.others_end).powf(last) as f32;
        let degree = (step / self.degree_every.max(1)).min(sh_degree);
        let unbias = |fading: f32| 1.0 / (1.0 - f64::from(fading).powf(f64::from(step) + 1.0));
        Training {
            sh_coefficients: sh_coefficients(sh_degree),
            sh_trained: sh_coefficients(degree),
            slot_capacity: 0,
            step,
            rates: [
                position as f32,
                others * self.log_scale,
                others * self.rotation,
                others * self.opacity,
                others * self.sh_first,
                others * self.sh_others,
            ],
            unbias: FADING.map(|fading| unbias(fading) as f32),
            opacity_pull: self.opacity_pull / alive as f32,
            scale_pull: self.scale_pull / (3.0 * alive as f32),
            noise: (position * f64::from(self.noise)) as f32,
            ssim: self.ssim,
            per_value: 1.0 / (3 * pixels) as f32,
            knee: self.knee,
            first_trained: 0,
            trained: 0,
            in_use: 0,
            rounding: [0.0; 5],
        }
    }

    /// By which factor pictures are reduced, a power of 2, once this share of the training is done. The coarsest ones
    /// are small; each finer size has as much of the training.
    pub fn factor(&self, share: f64, size: [u32; 2]) -> u32 {
        let halvings = (size[0].min(size[1]) / COARSEST).max(1).ilog2();
        let until = f64::from(self.reduced_until);
        if !(share < until) {
            return 1;
        }
        1 << (f64::from(halvings) * (1.0 - share / until)).ceil() as u32
    }

    /// Whether splats are relocated once so many steps, and this share of the training, are done.
    pub fn relocates_after(&self, steps: u32, share: f64) -> bool {
        let due = steps >= self.relocate_from && steps.is_multiple_of(self.relocate_every.max(1));
        due && share <= f64::from(self.relocate_until)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_grow_to_their_size() {
        let schedule = Schedule { reduced_until: 0.4, ..Schedule::default() };
        let factors = |size: [u32; 2]| {
            [0.0, 0.1, 0.19, 0.21, 0.39, 0.41, 1.0].map(|share| schedule.factor(share, size))
        };
        assert_eq!(factors([320, 180]), [2, 2, 2, 2, 2, 1, 1]);
        assert_eq!(factors([480, 640]), [4, 4, 4, 2, 2, 1, 1]);
        assert_eq!(factors([160, 100]), [1; 7]);
        let never = Schedule { reduced_until: 0.0, ..schedule };
        assert_eq!(never.factor(0.0, [1280, 720]), 1);
    }
}
