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
    Cut {
        kept: bool,
    },
    Stop,
    /// The order of this splat and the one before it, which had this payload and alpha.
    Order {
        payload: Channels,
        alpha: f64,
    },
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
}

impl WatchedPixel {
    /// Blends a splat at the pixel's centre.
    pub fn blend(&mut self, s: &Projected, options: &RenderOptions, centre: DVec2) {
        if self.pixel.stopped {
            return;
        }
        let Some(hit) = Hit::at(s, options, centre).map(|hit| hit.drawn(options)) else { return };
        let before = self.pixel;
        let counted = self.pixel.blend(s, &hit);
        let (payload, alpha) = (s.payload(), hit.alpha);
        let near = |value: f64, limit: f32, margin| (value / f64::from(limit) - 1.0).abs() < margin;
        let mut note = |what, before| self.close.push(Close { what, before, payload, alpha });
        if near(hit.full, ALPHA_MIN, CUT_MARGIN) {
            note(Decision::Cut { kept: counted }, before);
        }
        if counted && near(before.transmittance * (1.0 - alpha), TRANSMITTANCE_STOP, STOP_MARGIN) {
            note(Decision::Stop, before);
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
            // Splats behind this one, or the background. What the splats look like is not known. Their weight is 1e-4,
            // and they are assumed to look like this one.
            Decision::Stop => {
                let behind = t * (1.0 - alpha);
                (rest - alpha * t * payload - behind * background).abs()
                    + behind * (payload - background).abs()
            }
            Decision::Order { payload: other, alpha: its } => {
                t * alpha * its * (payload - other[k])
            }
        };
        change.abs()
    }
}
