//! Which pixels depend on a close decision. Alpha's cut at 1/255, the transmittance stop and the
//! depth order make true jumps. If a value lies within rounding of a jump, f32 and f64 may fall on
//! either side, and both are right.

use glam::DVec2;

use nvsprior::RenderOptions;
use nvsprior_kernels::shared::{ALPHA_MIN, TRANSMITTANCE_STOP};

use super::project::Projected;
use super::splat::{Hit, Pixel};
use super::{CUT_MARGIN, Channels};

/// Relative distance from the transmittance stop within which the decision may fall either way: if
/// alpha is near 0.99, its errors count a hundredfold in `1 − α`.
pub const STOP_MARGIN: f64 = 1e-2;

/// A decision that might have fallen the other way: the pixel before it, the splat, and its alpha.
#[derive(Clone, Copy, Debug)]
struct Close {
    what: Decision,
    before: Pixel,
    payload: Channels,
    alpha: f64,
}

#[derive(Clone, Copy, Debug)]
enum Decision {
    /// Alpha's cut; `kept` is how it fell.
    Cut { kept: bool },
    /// The transmittance stop, which was not reached.
    Stop,
    /// The order of this splat and the one before it, which had this payload and alpha.
    Order { payload: Channels, alpha: f64 },
}

/// Whether a value lies within a part of a limit from it.
fn is_near(value: f64, limit: f32, margin: f64) -> bool {
    (value / f64::from(limit) - 1.0).abs() < margin
}

/// Whether a transmittance may or may not stop the pixel.
fn at_stop(transmittance: f64) -> bool {
    is_near(transmittance, TRANSMITTANCE_STOP, STOP_MARGIN)
}

/// A splat that counted, for the order's sake.
#[derive(Clone, Copy, Debug)]
struct Last {
    before: Pixel,
    splat: Projected,
    alpha: f64,
}

/// A pixel that takes note of close decisions while it is blended.
#[derive(Clone, Debug, Default)]
pub struct WatchedPixel {
    pixel: Pixel,
    last: Option<Last>,
    close: Vec<Close>,
    /// The pixel as it is if a stop that was close is no stop.
    beyond: Option<Pixel>,
}

impl WatchedPixel {
    /// Blends a splat at the pixel's centre; `moved` as in [`Hit::drawn`].
    pub fn blend(&mut self, s: &Projected, options: &RenderOptions, centre: DVec2, moved: f64) {
        let hit = || Hit::at(s, options, centre).map(|hit| hit.drawn(options, moved));
        if self.pixel.stopped {
            if let Some(beyond) = self.beyond.as_mut().filter(|beyond| !beyond.stopped)
                && let Some(hit) = hit()
            {
                beyond.blend(s, &hit);
                beyond.stopped &= !at_stop(beyond.transmittance);
            }
            return;
        }
        let Some(hit) = hit() else { return };
        let before = self.pixel;
        let counted = self.pixel.blend(s, &hit);
        let (payload, alpha) = (s.payload(), hit.alpha);
        let mut note = |what, before| self.close.push(Close { what, before, payload, alpha });
        if is_near(hit.full, ALPHA_MIN, CUT_MARGIN) {
            note(Decision::Cut { kept: counted }, before);
        }
        if counted && at_stop(self.pixel.transmittance) {
            match self.pixel.stopped {
                true => self.beyond = Some(Pixel { stopped: false, ..self.pixel }),
                false => note(Decision::Stop, before),
            }
        }
        if !counted {
            return;
        }
        if let Some(last) = self.last
            && s.camera.z - last.splat.camera.z < s.depth_error + last.splat.depth_error
        {
            let order = Decision::Order { payload: last.splat.payload(), alpha: last.alpha };
            note(order, last.before);
        }
        self.last = Some(Last { before, splat: *s, alpha });
    }

    pub fn value(&self, background: &Channels) -> Channels {
        self.pixel.value(background)
    }

    /// How much each channel would change if the close decisions fell the other way.
    pub fn risk(&self, background: &Channels) -> Channels {
        let value = self.value(background);
        let mut risk = [0.0; 5];
        for close in &self.close {
            for (k, sum) in risk.iter_mut().enumerate() {
                *sum += close.jump(k, value[k], background[k]);
            }
        }
        if let Some(beyond) = &self.beyond {
            let value_beyond = beyond.value(background);
            for (k, sum) in risk.iter_mut().enumerate() {
                *sum += (value_beyond[k] - value[k]).abs();
            }
        }
        risk
    }
}

impl Close {
    /// The change of channel `k`, whose final value is `value`.
    fn jump(&self, k: usize, value: f64, background: f64) -> f64 {
        let t = self.before.transmittance;
        let (alpha, payload) = (self.alpha, self.payload[k]);
        // What the pixel shows from this splat on, and the part of it behind the splat.
        let rest = value - self.before.sum[k];
        let change = match self.what {
            Decision::Cut { kept: true } => {
                alpha * ((rest - alpha * t * payload) / (1.0 - alpha) - t * payload)
            }
            Decision::Cut { kept: false } => alpha * (rest - t * payload),
            // The background in place of the splats behind this one.
            Decision::Stop => rest - alpha * t * payload - t * (1.0 - alpha) * background,
            Decision::Order { payload: other, alpha: its } => {
                t * alpha * its * (payload - other[k])
            }
        };
        change.abs()
    }
}

#[cfg(test)]
mod tests {
    use nvsprior::prior::Splats;
    use nvsprior::{Camera, Pose, Prior};

    use super::*;
    use crate::Twin;

    /// Red of the picture's middle, and its risk: two opaque splats and a bright one behind them.
    fn middle(alpha_max: f32) -> [f64; 2] {
        let bright = 1e6;
        let splats = Splats {
            origin: [0.0; 3],
            positions: [1.0, 2.0, 3.0].map(|z| [0.0, 0.0, z]).to_vec(),
            log_scales: vec![[3.0; 3]; 3],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            opacity_logits: vec![20.0; 3],
            sh: [0.0, 0.0, bright].iter().flat_map(|red| [*red, 0.0, 0.0]).collect(),
            sh_degree: 0,
        };
        let options = RenderOptions { alpha_max, ..RenderOptions::INRIA };
        let prior = Prior::from_splats(splats, options).unwrap();
        let camera = Camera { width: 3, height: 3, fx: 3.0, fy: 3.0, cx: 1.5, cy: 1.5 };
        let pose = Pose::from_wxyz([1.0, 0.0, 0.0, 0.0], [0.0; 3]).unwrap();
        let drawn = Twin::new(&prior).render(&camera, &pose);
        [drawn.pixels[4][0], drawn.risk[4][0]]
    }

    #[test]
    fn a_close_stop_risks_what_is_behind_it() {
        let behind = 1e-4 * 0.99 * (0.282_094_8 * 1e6);
        let [clear, none] = middle(0.995);
        assert!(clear < 1.0 && none < 1.0, "{clear} {none}");
        // Stopped by a hair: the risk is to go on.
        let [stopped, risk] = middle(0.990_01);
        assert!(stopped < 1.0 && (risk / behind - 1.0).abs() < 0.02, "{stopped} {risk}");
        // Gone on by a hair: the risk is to stop.
        let [further, risk] = middle(0.989_99);
        assert!(
            (further / behind - 1.0).abs() < 0.05 && (risk / behind - 1.0).abs() < 0.05,
            "{further} {risk}"
        );
    }
}
