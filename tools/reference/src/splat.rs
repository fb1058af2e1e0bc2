//! Twin of stage `splat`: front-to-back blending (Kerbl et al. 2023, eq. 3).

use glam::DVec2;
use rayon::prelude::*;

use nvsprior::{Camera, RenderOptions};
use nvsprior_kernels::portable::{POWER_SCALE, POWER_SHIFT, POWER_SUM};
use nvsprior_kernels::shared::{ALPHA_MIN, TRANSMITTANCE_STOP};

use super::Channels;
use super::project::Projected;

pub fn background(options: &RenderOptions) -> Channels {
    let [r, g, b] = options.background.map(f64::from);
    [r, g, b, 0.0, 1.0]
}

#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Alpha after the clamp, before the cut.
    pub alpha: f64,
    /// Alpha before the clamp: the cut looks at this.
    pub full: f64,
    /// Whether the clamp holds it.
    pub clamped: bool,
    /// `v = Q d`, with d from the pixel's centre to the mean.
    pub v: DVec2,
}

impl Hit {
    /// The splat at a pixel centre; `None` if the exponent is positive.
    pub fn at(s: &Projected, options: &RenderOptions, centre: DVec2) -> Option<Hit> {
        let d = s.mean - centre;
        let [l11, l21, l22] = s.factor;
        let (u, w) = (l11 * d.x + l21 * d.y, l22 * d.y);
        let v = DVec2::new(l11 * u, l21 * u + l22 * w);
        let exponent = -0.5 * (u * u + w * w);
        let full = s.opacity * exponent.exp();
        let alpha_max = f64::from(options.alpha_max);
        let hit = Hit { alpha: full.min(alpha_max), full, clamped: full > alpha_max, v };
        (exponent <= 0.0).then_some(hit)
    }

    /// With the alpha that pictures are drawn with: the power of 2 by the definition's polynomial. `moved`: how far its
    /// argument is moved.
    pub fn drawn(self, options: &RenderOptions, moved: f64) -> Hit {
        let s = f64::from(POWER_SHIFT) + f64::from(POWER_SCALE) * self.full.log2() + moved;
        let alpha = (s * s + f64::from(POWER_SUM)).powi(32);
        Hit { alpha: alpha.min(f64::from(options.alpha_max)), ..self }
    }

    /// Whether it is above the cut.
    pub fn counts(&self) -> bool {
        self.full >= f64::from(ALPHA_MIN)
    }
}

/// A pixel while it is blended.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// `Σ wᵢ payloadᵢ` so far.
    pub sum: Channels,
    pub transmittance: f64,
    /// Whether a splat met the transmittance stop, so that no further one counts.
    pub stopped: bool,
}

impl Default for Pixel {
    fn default() -> Pixel {
        Pixel { sum: [0.0; 5], transmittance: 1.0, stopped: false }
    }
}

impl Pixel {
    /// Blends a splat; returns whether it counted.
    pub fn blend(&mut self, s: &Projected, hit: &Hit) -> bool {
        if self.stopped || !hit.counts() {
            return false;
        }
        let next = self.transmittance * (1.0 - hit.alpha);
        self.stopped = !(next > f64::from(TRANSMITTANCE_STOP));
        let weight = hit.alpha * self.transmittance;
        for (sum, payload) in self.sum.iter_mut().zip(s.payload()) {
            *sum += weight * payload;
        }
        self.transmittance = next;
        true
    }

    pub fn value(&self, background: &Channels) -> Channels {
        std::array::from_fn(|k| self.sum[k] + self.transmittance * background[k])
    }
}

/// Blends splats, in the given order, into every pixel of a picture that starts as `empty`. `blend`
/// gets the pixel, the splat's place in the order, and the pixel's centre.
pub fn blend_rows<P: Clone + Send + Sync>(
    splats: &[Projected],
    camera: &Camera,
    empty: &P,
    blend: impl Fn(&mut P, usize, DVec2) + Sync,
) -> Vec<P> {
    let mut rows = vec![Vec::new(); camera.height as usize];
    for (i, s) in splats.iter().enumerate() {
        for y in s.rows(camera.height) {
            rows[y as usize].push(i);
        }
    }
    let row = |(y, list): (usize, &Vec<usize>)| {
        let mut row = vec![empty.clone(); camera.width as usize];
        for &i in list {
            for x in splats[i].columns(camera.width) {
                let centre = DVec2::new(f64::from(x) + 0.5, y as f64 + 0.5);
                blend(&mut row[x as usize], i, centre);
            }
        }
        row
    };
    rows.par_iter().enumerate().flat_map_iter(row).collect()
}
