//! The splats of a prior as the device holds them, in planes.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{DMat3, DQuat, DVec3};

use crate::prior::Splats;
use crate::prior::analysis::PriorAnalysis;
use crate::shared::{self, GEOMETRY_PLANES};
use crate::vulkan::Buffer;
use crate::{Prior, RenderOptions};

use super::SceneKernels;

/// Splats on the device, activated and laid out in planes, and the pipelines that draw them: what the stages read.
pub struct SplatBuffers {
    pub kernels: Arc<SceneKernels>,
    pub geometry: Buffer,
    pub sh: Buffer,
    /// How many splats the planes have room for.
    pub room: u32,
    /// How many there are, and the bits of [`DrawnSplats::radius`]. They change between frames only.
    held: [AtomicU32; 2],
    pub options: RenderOptions,
}

/// The splats that are drawn: the first ones of the planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnSplats {
    /// How many.
    pub splats: u32,
    /// See [`Params::stride`](crate::shared::Params::stride).
    pub stride: u32,
    /// See [`Params::radius`](crate::shared::Params::radius).
    pub radius: f32,
}

impl DrawnSplats {
    /// All that there is room for.
    pub fn all(splats: u32, radius: f32) -> DrawnSplats {
        DrawnSplats { splats, stride: splats, radius }
    }
}

impl SplatBuffers {
    pub fn new(
        kernels: Arc<SceneKernels>,
        [geometry, sh]: [Buffer; 2],
        held: &DrawnSplats,
        options: RenderOptions,
    ) -> SplatBuffers {
        let words = [held.splats, held.radius.to_bits()].map(AtomicU32::new);
        SplatBuffers { kernels, geometry, sh, room: held.stride, held: words, options }
    }

    /// Sets how many splats are drawn from the next frame on, and the distance that none exceeds.
    pub fn hold(&self, splats: u32, radius: f32) {
        let words = [splats, radius.to_bits()];
        self.held.iter().zip(words).for_each(|(to, word)| to.store(word, Ordering::Release));
    }

    pub fn held(&self) -> DrawnSplats {
        let [splats, radius] = [0, 1].map(|i: usize| self.held[i].load(Ordering::Acquire));
        DrawnSplats { splats, stride: self.room, radius: f32::from_bits(radius) }
    }
}

/// A splat's scaled axes in the world, the columns of `A = R S`. The covariance is `A Aᵀ`, which
/// stays positive however thin the splat.
fn scaled_axes(splats: &Splats, i: usize) -> DMat3 {
    let [w, x, y, z] = splats.unit_rotation(i).map(f64::from);
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let scale = splats.log_scales[i].map(|s| libm::exp(f64::from(s)));
    DMat3::from_cols(
        rotation.x_axis * scale[0],
        rotation.y_axis * scale[1],
        rotation.z_axis * scale[2],
    )
}

/// What the device holds of a prior's splats, in planes of a pair of floats per splat.
pub struct Planes {
    /// See [`GEOMETRY_PLANES`].
    pub geometry: Vec<f32>,
    /// See [`shared::sh_planes`].
    pub sh: Vec<f32>,
    /// See [`Params::radius`](crate::shared::Params::radius).
    pub radius: f32,
}

impl Planes {
    /// With room for `stride` splats.
    pub fn of(prior: &Prior, analysis: &PriorAnalysis, stride: usize) -> Planes {
        let splats = prior.splats();
        let shown = analysis.splats.iter().map(|i| &splats.positions[*i as usize]);
        Planes {
            geometry: geometry(splats, &analysis.splats, stride, centre(prior)),
            sh: sh_planes(splats, &analysis.splats, stride, analysis.sh_degree),
            radius: prior.coordinate_frame().radius_of(shown),
        }
    }
}

/// What the device's positions are relative to.
pub fn centre(prior: &Prior) -> DVec3 {
    DVec3::from(prior.coordinate_frame().centre.map(f64::from))
}

/// Planes of position (relative to `centre`), opacity and axes of the splats that `which` names,
/// computed in f64 and rounded once.
pub fn geometry(splats: &Splats, which: &[u32], stride: usize, centre: DVec3) -> Vec<f32> {
    pair_planes(which, stride, GEOMETRY_PLANES, |i| {
        let axes = scaled_axes(splats, i).to_cols_array();
        let position = DVec3::from(splats.positions[i].map(f64::from)) - centre;
        position
            .to_array()
            .map(|v| v as f32)
            .into_iter()
            .chain([splats.opacity(i) as f32])
            .chain(axes.map(|v| v as f32))
    })
}

/// Planes of the coefficients that are needed, RGB after RGB. Two coefficients take three planes.
pub fn sh_planes(splats: &Splats, which: &[u32], stride: usize, degree: u32) -> Vec<f32> {
    let own = splats.sh_stride();
    let needed = 3 * shared::sh_coefficients(degree) as usize;
    let of = |i: usize| splats.sh[i * own..][..needed].iter().copied();
    pair_planes(which, stride, shared::sh_planes(degree), of)
}

/// Packs the values of every splat that `which` names, two per plane; 0 if a splat has no more values. The planes have
/// room for `stride` splats.
fn pair_planes<I: Iterator<Item = f32>>(
    which: &[u32],
    stride: usize,
    planes: u32,
    values: impl Fn(usize) -> I,
) -> Vec<f32> {
    let mut words = vec![0.0; stride * planes as usize * 2];
    for (place, i) in which.iter().enumerate() {
        for (k, value) in values(*i as usize).enumerate() {
            words[(k / 2 * stride + place) * 2 + k % 2] = value;
        }
    }
    words
}
