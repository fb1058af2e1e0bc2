//! An f64 CPU twin of every GPU stage, with the same names: the oracle of the tests. It follows the textbook formulas,
//! not the reformulations that keep the shaders' f32 exact, so that it checks those too. Only determinant and conic use
//! the shaders' formulas, since needles are beyond f64 otherwise.
//!
//! A pixel has five channels: linear R, G, B before clamping, depth Σ wᵢ zᵢ, transmittance. Each is
//! `Σ wᵢ payloadᵢ + T · background`. For depth the payload is z and the background 0; for
//! transmittance the payload is 0 and the background 1.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

pub mod bin;
pub mod device_check;
pub mod extreme;
pub mod harmonics;
pub mod loss;
pub mod pose_jacobian;
pub mod probe;
pub mod project;
pub mod radix;
pub mod reduce;
pub mod risk;
pub mod splat;
pub mod splat_exact;
pub mod splat_flow;
mod twin;

use nvsprior::{Camera, Pose, RenderOptions};

pub use twin::{Rendered, Twin};

/// Relative distance from alpha's cut within which the decision may fall either way. An f32 rounds
/// a mean at 300 pixels by 2e-5 pixels. At the rim of the smallest splat that changes alpha by
/// about 2e-4.
const CUT_MARGIN: f64 = 1e-3;

/// The five channels of a pixel.
pub type Channels = [f64; 5];

/// A derivative with respect to the pose step τ = (ρ, θ).
pub type Twist = [f64; 6];

/// `a + scale · b`.
pub(crate) fn plus(a: Twist, scale: f64, b: Twist) -> Twist {
    std::array::from_fn(|k| a[k] + scale * b[k])
}

/// What is common to all splats of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint<'a> {
    pub camera: &'a Camera,
    pub pose: &'a Pose,
    pub options: &'a RenderOptions,
    /// See [`nvsprior::RenderOptions::low_pass`].
    pub low_pass: [f32; 2],
}

/// A pixel with its pose derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Linear R, G, B before clamping.
    pub rgb: [f64; 3],
    /// d(rgb)/dτ.
    pub jacobian: [Twist; 3],
}
