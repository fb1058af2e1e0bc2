//! The twin of a prior: its pictures, with pose derivatives, and its normal equations.

use rayon::prelude::*;

use nvsprior::render::{Jacobian, NormalEquations};
use nvsprior::{Camera, Pose, Prior};

use super::project::{self, Projected, Splat};
use super::risk::WatchedPixel;
use super::splat_exact::MovingPixel;
use super::{Channels, Sample, Viewpoint, reduce, splat, splat_exact, splat_flow};

/// A picture of the twin, row-major.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// R, G, B, depth, transmittance of each pixel.
    pub pixels: Vec<Channels>,
    /// How much each channel would change if the close decisions in the pixel (the cuts, the order)
    /// fell the other way; see [`super::risk`].
    pub risk: Vec<Channels>,
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
        let pixels = splat::blend_rows(&seen, camera, &WatchedPixel::default(), blend);
        let both = |p: &WatchedPixel| (p.value(&background), p.risk(&background));
        let (pixels, risk) = pixels.par_iter().map(both).unzip();
        Rendered { pixels, risk }
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
