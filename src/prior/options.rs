//! How a prior is rendered.

use serde::{Deserialize, Serialize};

use super::error::PriorError;
use crate::Camera;
use crate::shared::{DILATION, low_pass};

/// How a prior was trained to be rendered; stored with it, and part of its identity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderOptions {
    /// Splats whose camera z is not above this are culled. gsplat: 0.01, Inria: 0.2.
    pub near: f32,
    /// Alpha is clamped to this. Inria and newest gsplat: 0.99, gsplat before 2026-03: 0.999.
    pub alpha_max: f32,
    /// Scale opacity by `√max(2.5e-5, det/det⁺)` (gsplat's anti-aliased mode).
    pub antialiased: bool,
    /// Linear RGB behind everything.
    pub background: [f32; 3],
    /// Focal length of the pictures that the prior was trained on, pixels. If it is stated, the low-pass is that of
    /// their pixels, whatever size is drawn: a prior serves other sizes than its own. `None`: that of the pixels that
    /// are drawn. An anti-aliased prior needs none.
    pub trained_focal: Option<f32>,
}

/// Bounds of [`RenderOptions::trained_focal`], pixels.
const FOCAL: std::ops::RangeInclusive<f32> = 1.0..=1e6;
/// No picture's low-pass is that of pixels larger than so many of its own.
const MOST_MAGNIFIED: f32 = 64.0;

impl RenderOptions {
    /// As Inria's trainer renders.
    pub const INRIA: RenderOptions = RenderOptions {
        near: 0.2,
        alpha_max: 0.99,
        antialiased: false,
        background: [0.0; 3],
        trained_focal: None,
    };
    /// As gsplat (nerfstudio's Splatfacto) renders.
    pub const GSPLAT: RenderOptions = RenderOptions { near: 0.01, ..RenderOptions::INRIA };

    /// Checks that the renderer's formulas hold: `near` finite and positive, `alpha_max` strictly
    /// between 0 and 1, background within `[0, 1]`, `trained_focal` from 1 to 10⁶.
    pub fn check(&self) -> Result<(), PriorError> {
        let refuse = |option, value| Err(PriorError::Option { option, value });
        if !(self.near.is_finite() && self.near > 0.0) {
            return refuse("near", self.near);
        }
        if !(self.alpha_max > 0.0 && self.alpha_max < 1.0) {
            return refuse("alpha_max", self.alpha_max);
        }
        if let Some(focal) = self.trained_focal.filter(|focal| !FOCAL.contains(focal)) {
            return refuse("trained_focal", focal);
        }
        match self.background.into_iter().find(|v| !(0.0..=1.0).contains(v)) {
            Some(value) => refuse("background", value),
            None => Ok(()),
        }
    }

    /// Low-pass of a camera's picture, and the part of it that opacity does not compensate, both in pixels² of that
    /// picture. `factor`: how much smaller its sides are than those of the camera's full picture.
    pub fn low_pass(&self, camera: &Camera, factor: u32) -> [f32; 2] {
        let Some(focal) = self.trained_focal.filter(|_| !self.antialiased) else {
            return low_pass(self.antialiased, factor);
        };
        let pixels = (camera.fx / focal).min(MOST_MAGNIFIED);
        let kept = DILATION * (pixels * pixels);
        [DILATION.max(kept), kept]
    }
}

/// Render options of a user that replace those of a prior's file; `None` keeps the file's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RenderOverrides {
    /// In place of [`RenderOptions::near`].
    pub near: Option<f32>,
    /// In place of [`RenderOptions::alpha_max`].
    pub alpha_max: Option<f32>,
    /// In place of [`RenderOptions::antialiased`].
    pub antialiased: Option<bool>,
    /// In place of [`RenderOptions::background`].
    pub background: Option<[f32; 3]>,
    /// In place of [`RenderOptions::trained_focal`].
    pub trained_focal: Option<f32>,
}

impl RenderOverrides {
    /// `options` with what is given here put in their place.
    pub fn over(&self, options: RenderOptions) -> RenderOptions {
        RenderOptions {
            near: self.near.unwrap_or(options.near),
            alpha_max: self.alpha_max.unwrap_or(options.alpha_max),
            antialiased: self.antialiased.unwrap_or(options.antialiased),
            background: self.background.unwrap_or(options.background),
            trained_focal: self.trained_focal.or(options.trained_focal),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { width: 320, height: 180, fx: 270.0, fy: 270.0, cx: 160.0, cy: 90.0 };

    #[test]
    fn the_low_pass_is_one_of_the_trained_pictures() {
        let of = |trained_focal, antialiased, camera: &Camera, factor| {
            let options = RenderOptions { trained_focal, antialiased, ..RenderOptions::INRIA };
            options.check().unwrap();
            options.low_pass(camera, factor)
        };
        let stated = Some(CAMERA.fx);
        // At the trained size, and at its levels, nothing changes.
        for factor in [1, 2, 8] {
            let level = CAMERA.reduced(factor);
            assert_eq!(of(stated, false, &level, factor), of(None, false, &level, factor));
        }
        assert_eq!(of(stated, false, &CAMERA.resized(640, 360), 1), [4.0 * DILATION; 2]);
        assert_eq!(of(stated, false, &CAMERA.resized(160, 90), 1), [DILATION, 0.25 * DILATION]);
        assert_eq!(of(stated, true, &CAMERA.resized(640, 360), 1), [DILATION, 0.0]);
        assert!(of(Some(1.0), false, &Camera { fx: 3e38, ..CAMERA }, 1)[0] < 2000.0);
    }

    #[test]
    fn a_focal_length_that_none_has_is_refused() {
        for focal in [0.0, -3.0, f32::NAN, f32::INFINITY] {
            let options = RenderOptions { trained_focal: Some(focal), ..RenderOptions::INRIA };
            let refused =
                matches!(options.check(), Err(PriorError::Option { option: "trained_focal", .. }));
            assert!(refused, "{focal}");
        }
    }
}
