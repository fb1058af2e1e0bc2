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

use rayon::prelude::*;

use nvsprior::render::{Jacobian, NormalEquations};
use nvsprior::{Camera, Pose, Prior, RenderOptions};

use project::{Projected, Splat};
use risk::WatchedPixel;
use splat_exact::MovingPixel;

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

/// A picture of the twin, row-major.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// R, G, B, depth, transmittance of each pixel.
    pub pixels: Vec<Channels>,
    /// How much each channel would change if the close decisions in the pixel (the cuts, the order)
    /// fell the other way; see [`risk`].
    pub risk: Vec<Channels>,
}

/// A pixel with its pose derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Linear R, G, B before clamping.
    pub rgb: [f64; 3],
    /// d(rgb)/dτ.
    pub jacobian: [Twist; 3],
}

/// A prior ready to be rendered in f64.
pub struct Twin<'a> {
    prior: &'a Prior,
    splats: Vec<Splat<'a>>,
    factor: u32,
    /// How far the argument of alpha's power is moved.
    power_moved: f64,
}

impl<'a> Twin<'a> {
    /// Activates the prior's splats.
    pub fn new(prior: &'a Prior) -> Twin<'a> {
        let splats = prior.splats();
        let splats = (0..splats.len()).map(|i| Splat::new(splats, i)).collect();
        Twin { prior, splats, factor: 1, power_moved: 0.0 }
    }

    /// The twin at a level of the pyramid, for cameras reduced by `factor`.
    pub fn reduced(self, factor: u32) -> Twin<'a> {
        Twin { factor, ..self }
    }

    /// The twin with the argument of alpha's power moved by one unit in the last place of an f32. The power multiplies
    /// what rounding loses there by 64.
    pub fn with_power_moved(self) -> Twin<'a> {
        Twin { power_moved: 0.5 * f64::from(f32::EPSILON), ..self }
    }

    /// The prior's splats, activated.
    pub fn splats(&self) -> &[Splat<'a>] {
        &self.splats
    }

    /// The view of this prior from a pose.
    pub fn view<'v>(&'v self, camera: &'v Camera, pose: &'v Pose) -> Viewpoint<'v> {
        let options = self.prior.options();
        Viewpoint { camera, pose, options, low_pass: options.low_pass(camera, self.factor) }
    }

    /// All splats in front of the near plane, nearest first, ties by index.
    pub fn project(&self, view: &Viewpoint) -> Vec<Projected> {
        let each = |(i, splat)| project::project(view, i as u32, splat);
        let mut seen: Vec<Projected> =
            self.splats.par_iter().enumerate().filter_map(each).collect();
        seen.sort_by(|a, b| a.camera.z.total_cmp(&b.camera.z).then(a.index.cmp(&b.index)));
        seen
    }

    pub fn render(&self, camera: &Camera, pose: &Pose) -> Rendered {
        let view = self.view(camera, pose);
        let background = splat::background(view.options);
        let seen = self.project(&view);
        let blend = |pixel: &mut WatchedPixel, i: usize, centre| {
            pixel.blend(&seen[i], view.options, centre, self.power_moved);
        };
        splat::blend_rows(&seen, camera, &WatchedPixel::default(), blend)
            .par_iter()
            .map(|p| (p.value(&background), p.risk(&background)))
            .unzip::<_, _, Vec<_>, Vec<_>>()
            .into()
    }

    /// The picture with each pixel's pose Jacobian. Order and cuts are held fixed.
    pub fn samples(&self, camera: &Camera, pose: &Pose, jacobian: Jacobian) -> Vec<Sample> {
        let view = self.view(camera, pose);
        let seen = self.project(&view);
        let pixels = match jacobian {
            Jacobian::Flow => splat_flow::blend(&view, &seen),
            Jacobian::Exact => splat_exact::blend(&view, &seen, &self.splats),
        };
        let sample = |p: &MovingPixel| p.sample(view.options.background);
        pixels.iter().map(sample).collect()
    }

    /// The normal equations against a frame of height × width × 3 floats in [0, 1].
    ///
    /// # Panics
    /// If the number of floats is not the camera's.
    pub fn normal_equations(
        &self,
        camera: &Camera,
        pose: &Pose,
        frame: &[f32],
        jacobian: Jacobian,
    ) -> NormalEquations {
        assert_eq!(frame.len(), camera.pixels() * 3, "floats of the frame");
        reduce::reduce(&self.samples(camera, pose, jacobian), frame)
    }
}

impl From<(Vec<Channels>, Vec<Channels>)> for Rendered {
    fn from((pixels, risk): (Vec<Channels>, Vec<Channels>)) -> Rendered {
        Rendered { pixels, risk }
    }
}
