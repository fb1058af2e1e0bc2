//! The prior: a trained 3D Gaussian Splatting scene that vehicle and topside share.

use serde::{Deserialize, Serialize};

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
}

/// Trained parameters of all splats, as files hold them: scales as logarithms, opacities as logits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Splats {
    /// Means, world axes, the prior's unit.
    pub positions: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the splat's own axes.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions (w, x, y, z), splat to world; any length but zero.
    pub rotations: Vec<[f32; 4]>,
    /// Logits of the opacities.
    pub opacity_logits: Vec<f32>,
    /// Spherical harmonics: per splat `(degree + 1)²` coefficients of RGB triples.
    pub sh: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
}
