//! How a prior is rendered.

use serde::{Deserialize, Serialize};

use super::error::PriorError;

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
}

impl RenderOptions {
    /// As Inria's trainer renders.
    pub const INRIA: RenderOptions =
        RenderOptions { near: 0.2, alpha_max: 0.99, antialiased: false, background: [0.0; 3] };
    /// As gsplat (nerfstudio's Splatfacto) renders.
    pub const GSPLAT: RenderOptions = RenderOptions { near: 0.01, ..RenderOptions::INRIA };

    /// Checks that the renderer's formulas hold: `near` finite and positive, `alpha_max` strictly
    /// between 0 and 1, background within `[0, 1]`.
    pub fn check(&self) -> Result<(), PriorError> {
        let refuse = |option, value| Err(PriorError::Option { option, value });
        if !(self.near.is_finite() && self.near > 0.0) {
            return refuse("near", self.near);
        }
        if !(self.alpha_max > 0.0 && self.alpha_max < 1.0) {
            return refuse("alpha_max", self.alpha_max);
        }
        match self.background.into_iter().find(|v| !(0.0..=1.0).contains(v)) {
            Some(value) => refuse("background", value),
            None => Ok(()),
        }
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
}

impl RenderOverrides {
    /// `options` with what is given here put in their place.
    pub fn over(&self, options: RenderOptions) -> RenderOptions {
        RenderOptions {
            near: self.near.unwrap_or(options.near),
            alpha_max: self.alpha_max.unwrap_or(options.alpha_max),
            antialiased: self.antialiased.unwrap_or(options.antialiased),
            background: self.background.unwrap_or(options.background),
        }
    }
}
