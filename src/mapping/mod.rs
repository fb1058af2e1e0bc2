//! Making a prior from posed pictures and the points of a surface.
//!
//! Where another system has already found the surfaces (a reconstruction, a sonar, a drawing), flat
//! Gaussians are laid along them and only their colours are fitted to the pictures: a convex
//! problem that takes seconds where a full training takes minutes on a GPU.

mod fit;
mod harmonics;
mod raster;

use glam::{Quat, Vec3};

use crate::camera::CameraError;
use crate::prior::{RenderOptions, Splats};
use crate::{Camera, Picture, Pose};

use fit::Fit;
use raster::{Geometry, Projection};

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// World axes, the prior's unit.
    pub position: [f32; 3],
    /// Unit normal, out of the surface, world axes.
    pub normal: [f32; 3],
    /// Half the distance to the neighbouring points.
    pub radius: f32,
}

/// A picture and where it was taken.
#[derive(Clone, Debug)]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Its pose.
    pub pose: Pose,
    /// What it saw, of the camera's size.
    pub picture: Picture,
}

impl View {
    /// A pixel's colour, values in [0, 1].
    fn colour(&self, pixel: usize) -> Vec3 {
        let rgb = &self.picture.data[3 * pixel..3 * pixel + 3];
        Vec3::new(rgb[0].into(), rgb[1].into(), rgb[2].into()) / 255.0
    }
}

/// How a prior is made.
#[derive(Clone, Copy, Debug)]
pub struct MappingOptions {
    /// How the prior will be rendered.
    pub render: RenderOptions,
    /// Standard deviation along the surface, as a share of the distance between points.
    pub spread: f32,
    /// Standard deviation across the surface, as a share of that along it.
    pub flatness: f32,
    /// Opacity of every Gaussian.
    pub opacity: f32,
    /// Degree of the spherical harmonics, 0 or 1.
    pub sh_degree: u32,
    /// Steps of the solver.
    pub sweeps: u32,
    /// Pull of every colour towards grey, in squared weights of pixels.
    pub damping: f32,
    /// Pull of every colour towards one that is the same from all sides.
    pub view_damping: f32,
}

impl Default for MappingOptions {
    fn default() -> MappingOptions {
        MappingOptions {
            render: RenderOptions::INRIA,
            spread: 0.6,
            flatness: 0.1,
            opacity: 0.95,
            sh_degree: 1,
            sweeps: 12,
            damping: 0.02,
            view_damping: 1.0,
        }
    }
}

/// Lays flat Gaussians along the surface.
fn discs(points: &[SurfacePoint], options: &MappingOptions) -> Splats {
    let logit = (options.opacity / (1.0 - options.opacity)).ln();
    let scales = |p: &SurfacePoint| {
        let along = (options.spread * 2.0 * p.radius).ln();
        [along, along, along + options.flatness.ln()]
    };
    let rotation = |p: &SurfacePoint| {
        let q = Quat::from_rotation_arc(Vec3::Z, Vec3::from(p.normal));
        [q.w, q.x, q.y, q.z]
    };
    Splats {
        positions: points.iter().map(|p| p.position).collect(),
        log_scales: points.iter().map(scales).collect(),
        rotations: points.iter().map(rotation).collect(),
        opacity_logits: vec![logit; points.len()],
        sh: Vec::new(),
        sh_degree: options.sh_degree,
    }
}

/// Makes a prior.
pub fn make_prior(
    points: &[SurfacePoint],
    views: &[View],
    options: &MappingOptions,
    progress: &mut dyn FnMut(u32, u32),
) -> Splats {
    let mut splats = discs(points, options);
    let geometry = Geometry::of(&splats);
    let mut x = vec![Vec3::ZERO; points.len() * harmonics::count(options.sh_degree)];
    let mut n = 0;
    Fit::new(&geometry, views, options).solve(&mut x, options.sweeps, &mut || {
        n += 1;
        progress(n, options.sweeps)
    });
    splats.sh = x.iter().flat_map(|c| c.to_array()).collect();
    splats
}

/// Renders.
pub fn render(splats: &Splats, options: &RenderOptions, camera: &Camera, pose: &Pose) -> Picture {
    let geometry = Geometry::of(splats);
    let terms = harmonics::count(splats.sh_degree);
    let centre = pose.centre().as_vec3();
    let colours: Vec<Vec3> = std::iter::zip(splats.sh.chunks_exact(3 * terms), &geometry.positions)
        .map(|(own, p)| {
            let basis = harmonics::basis((*p - centre).normalize_or_zero());
            let sum = std::iter::zip(own.chunks_exact(3), basis)
                .fold(Vec3::splat(0.5), |sum, (c, b)| sum + Vec3::from_slice(c) * b);
            sum.max(Vec3::ZERO)
        })
        .collect();
    let mut picture = Picture::new(camera.width, camera.height);
    let background = Vec3::from(options.background);
    let projection = Projection::new(&geometry, camera, pose, options);
    projection.sweep(&colours, &mut vec![Vec3::ZERO; colours.len()], |pixel, value, left| {
        let colour = ((value + left * background) * 255.0).round().clamp(Vec3::ZERO, Vec3::splat(255.0));
        for (byte, v) in std::iter::zip(&mut picture.data[3 * pixel..3 * pixel + 3], colour.to_array()) {
            *byte = v as u8;
        }
        Vec3::ZERO
    });
    picture
}
