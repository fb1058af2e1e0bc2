//! Twin of stage `splat_exact`: blending with the exact pose Jacobian; order and cuts held fixed.

use rayon::prelude::*;

use nvsprior::RenderOptions;

use super::pose_jacobian::{Motion, derive};
use super::project::{Projected, Splat};
use super::splat::{Hit, Pixel, blend_rows};
use super::{Sample, Twist, Viewpoint, plus};

/// A pixel and its pose derivatives while it is blended.
#[derive(Clone, Copy, Debug, Default)]
pub struct MovingPixel {
    pixel: Pixel,
    d_rgb: [Twist; 3],
    d_transmittance: Twist,
}

impl MovingPixel {
    /// `dα = α (d ln α − v·dμ + ½ vᵀ dΣ v)`, `dC += c (T dα + α dT) + α T dc`,
    /// `dT ← (1 − α) dT − T dα`.
    pub fn blend(&mut self, s: &Projected, hit: &Hit, motion: &Motion) {
        let t = self.pixel.transmittance;
        if !self.pixel.blend(s, hit) {
            return;
        }
        let (alpha, v) = (hit.alpha, hit.v);
        let mut d_alpha = [0.0; 6];
        // Nothing moves an alpha that the clamp holds.
        if !hit.clamped {
            let [s00, s01, s11] = motion.covariance;
            d_alpha = plus(d_alpha, alpha, motion.ln_alpha);
            d_alpha = plus(d_alpha, -alpha * v.x, motion.mean[0]);
            d_alpha = plus(d_alpha, -alpha * v.y, motion.mean[1]);
            d_alpha = plus(d_alpha, 0.5 * alpha * v.x * v.x, s00);
            d_alpha = plus(d_alpha, alpha * v.x * v.y, s01);
            d_alpha = plus(d_alpha, 0.5 * alpha * v.y * v.y, s11);
        }
        for channel in 0..3 {
            let d = &mut self.d_rgb[channel];
            *d = plus(*d, s.rgb[channel] * t, d_alpha);
            *d = plus(*d, s.rgb[channel] * alpha, self.d_transmittance);
            *d = plus(*d, alpha * t, motion.rgb[channel]);
        }
        let kept = self.d_transmittance.map(|d| (1.0 - alpha) * d);
        self.d_transmittance = plus(kept, -t, d_alpha);
    }

    /// Colour and Jacobian over a background.
    pub fn sample(&self, background: [f32; 3]) -> Sample {
        let background = background.map(f64::from);
        let t = self.pixel.transmittance;
        let d_t = self.d_transmittance;
        Sample {
            rgb: std::array::from_fn(|k| self.pixel.sum[k] + t * background[k]),
            jacobian: std::array::from_fn(|k| plus(self.d_rgb[k], background[k], d_t)),
        }
    }
}

/// Every pixel with its derivatives, from `seen` in depth order of the prior's `splats`.
pub fn blend(view: &Viewpoint, seen: &[Projected], splats: &[Splat]) -> Vec<MovingPixel> {
    let options: &RenderOptions = view.options;
    let motion = |s: &Projected| derive(view, &splats[s.index as usize], s);
    let motions: Vec<Motion> = seen.par_iter().map(motion).collect();
    blend_rows(seen, view.camera, &MovingPixel::default(), |pixel, i, centre| {
        if let Some(hit) = Hit::at(&seen[i], options, centre) {
            pixel.blend(&seen[i], &hit, &motions[i]);
        }
    })
}
