//! Makes a prior from posed pictures and the points of a surface.
//!
//! If another system has already found the surfaces (a reconstruction, a sonar, a drawing), the
//! hard part of training is done. Flat Gaussians are laid along the surfaces. Their colours are
//! solved for, which is a linear problem. Some gradient steps then move, shape and blend them. It
//! runs on the CPU and takes well under a minute for a hundred small pictures. For a scene without
//! known surfaces use a full trainer, such as nerfstudio's Splatfacto.

pub(crate) mod fit;
pub(crate) mod harmonics;
pub(crate) mod project;
pub(crate) mod raster;
pub(crate) mod train;

use glam::{Quat, Vec3};

use nvsprior::geometry::CameraError;
use nvsprior::prior::{RenderOptions, Splats};
use nvsprior::{Camera, Picture, Pose};

use crate::PosedPicture;

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// World axes, the prior's unit.
    pub position: [f32; 3],
    /// Normal out of the surface, world axes, of any length but zero.
    pub normal: [f32; 3],
    /// Half the distance to the neighbouring points, the prior's unit.
    pub radius: f32,
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
    /// Opacity of every Gaussian before training, in (0, 1).
    pub opacity: f32,
    /// Degree of the spherical harmonics, 0 or 1.
    pub sh_degree: u32,
    /// Steps of the colours' solver; each rasterises every view.
    pub sweeps: u32,
    /// Gradient steps after it; each rasterises two views.
    pub steps: u32,
    /// The solver's pull of every colour towards grey, in squared weights of pixels.
    pub damping: f32,
    /// The solver's pull of every colour towards the same colour from all sides.
    pub view_damping: f32,
}

impl Default for MappingOptions {
    fn default() -> MappingOptions {
        MappingOptions {
            render: RenderOptions::INRIA,
            spread: 0.5,
            flatness: 0.1,
            opacity: 0.95,
            sh_degree: 1,
            sweeps: 3,
            steps: 400,
            damping: 0.02,
            view_damping: 1.0,
        }
    }
}

/// Why no prior was made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MappingError {
    /// There is nothing to lay Gaussians on.
    #[error("no surface points")]
    NoPoints,
    /// There is nothing to fit to.
    #[error("no views")]
    NoViews,
    /// A surface point is not finite, has no direction or no size.
    #[error(
        "surface point {index}: position, normal and radius must be finite, the last two not 0"
    )]
    Point {
        /// Which one.
        index: usize,
    },
    /// A view's camera cannot be used.
    #[error("view {index}")]
    Camera {
        /// Which view.
        index: usize,
        /// What is wrong with it.
        source: CameraError,
    },
    /// A view's pose is not finite.
    #[error("view {index}: its pose is not finite")]
    Pose {
        /// Which view.
        index: usize,
    },
    /// A view's picture has not the camera's size.
    #[error("view {index}: a picture of {width}×{height} for another camera")]
    PictureSize {
        /// Which view.
        index: usize,
        /// The picture's width.
        width: u32,
        /// The picture's height.
        height: u32,
    },
    /// An option lies outside its range.
    #[error("option {name} = {value} is out of range")]
    Option {
        /// Which one.
        name: &'static str,
        /// Its value.
        value: f32,
    },
}

/// Makes a prior whose renders resemble the views. Calls `progress` with (work done, all work)
/// after every step. The result is the same for any number of threads.
pub fn make_prior(
    points: &[SurfacePoint],
    views: &[PosedPicture],
    options: &MappingOptions,
    progress: &mut dyn FnMut(u32, u32),
) -> Result<Splats, MappingError> {
    check_options(options)?;
    check_points(points)?;
    check_views(views)?;
    let all = options.sweeps.saturating_add(options.steps);
    let mut done = 0;
    let mut step = || {
        done += 1;
        progress(done, all);
    };
    let mut splats = discs(points, options);
    fit::fit_colours(&mut splats, views, options, &mut step);
    train::train(&mut splats, views, options, 1.0, &mut step);
    Ok(splats)
}

/// Renders splats on the CPU, slowly: for a look at an unfinished prior, and for tests.
///
/// # Errors
/// If the camera cannot be used.
pub fn preview(
    splats: &Splats,
    options: &RenderOptions,
    camera: &Camera,
    pose: &Pose,
) -> Result<Picture, CameraError> {
    camera.check()?;
    let geometry = project::Geometry::of(splats);
    let colours = harmonics::colours(splats, pose.centre().as_vec3());
    let mut picture = Picture::new(camera.width, camera.height);
    let projection = raster::Projection::new(&geometry, camera, pose, options);
    projection.render(&colours, Vec3::from(options.background), |pixel, value| {
        let bytes = (value * 255.0).round().to_array().map(|v| v.clamp(0.0, 255.0) as u8);
        picture.data[3 * pixel..3 * pixel + 3].copy_from_slice(&bytes);
    });
    Ok(picture)
}

/// Flat Gaussians along the surface, without colours.
fn discs(points: &[SurfacePoint], options: &MappingOptions) -> Splats {
    let scales = |p: &SurfacePoint| {
        let along = (options.spread * 2.0 * p.radius).ln();
        [along, along, along + options.flatness.ln()]
    };
    let rotation = |p: &SurfacePoint| {
        let q = Quat::from_rotation_arc(Vec3::Z, Vec3::from(p.normal).normalize());
        [q.w, q.x, q.y, q.z]
    };
    let logit = (options.opacity / (1.0 - options.opacity)).ln();
    Splats {
        positions: points.iter().map(|p| p.position).collect(),
        log_scales: points.iter().map(scales).collect(),
        rotations: points.iter().map(rotation).collect(),
        opacity_logits: vec![logit; points.len()],
        sh: vec![0.0; points.len() * 3 * harmonics::count(options.sh_degree)],
        sh_degree: options.sh_degree,
    }
}

fn check_options(options: &MappingOptions) -> Result<(), MappingError> {
    let share = |v: f32| v > 0.0 && v < 1.0;
    let positive = |v: f32| v > 0.0 && v.is_finite();
    let checks = [
        ("spread", options.spread, positive(options.spread)),
        ("flatness", options.flatness, positive(options.flatness)),
        ("opacity", options.opacity, share(options.opacity)),
        ("sh_degree", options.sh_degree as f32, options.sh_degree <= 1),
        ("damping", options.damping, positive(options.damping)),
        ("view_damping", options.view_damping, positive(options.view_damping)),
        ("near", options.render.near, positive(options.render.near)),
        ("alpha_max", options.render.alpha_max, share(options.render.alpha_max)),
    ];
    match checks.into_iter().find(|(_, _, fine)| !fine) {
        Some((name, value, _)) => Err(MappingError::Option { name, value }),
        None => Ok(()),
    }
}

fn check_points(points: &[SurfacePoint]) -> Result<(), MappingError> {
    let fine = |p: &SurfacePoint| {
        let normal = Vec3::from(p.normal);
        let sized = p.radius > 0.0 && p.radius.is_finite();
        sized && Vec3::from(p.position).is_finite() && normal.try_normalize().is_some()
    };
    if points.is_empty() {
        return Err(MappingError::NoPoints);
    }
    match points.iter().position(|p| !fine(p)) {
        Some(index) => Err(MappingError::Point { index }),
        None => Ok(()),
    }
}

pub(crate) fn check_views(views: &[PosedPicture]) -> Result<(), MappingError> {
    if views.is_empty() {
        return Err(MappingError::NoViews);
    }
    for (index, PosedPicture { camera, pose, picture, .. }) in views.iter().enumerate() {
        camera.check().map_err(|source| MappingError::Camera { index, source })?;
        if !pose.is_finite() {
            return Err(MappingError::Pose { index });
        }
        let &Picture { width, height, .. } = picture;
        if (width, height) != (camera.width, camera.height)
            || picture.data.len() != 3 * camera.pixels()
        {
            return Err(MappingError::PictureSize { index, width, height });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };

    /// A wall at z = 2 of points 0.1 apart, facing the camera.
    fn wall() -> Vec<SurfacePoint> {
        (0..25 * 25)
            .map(|i| SurfacePoint {
                position: [(i % 25) as f32 * 0.1 - 1.2, (i / 25) as f32 * 0.1 - 1.2, 2.0],
                normal: [0.0, 0.0, -1.0],
                radius: 0.05,
            })
            .collect()
    }

    /// The wall seen from a few places, painted by `paint` over the picture.
    fn views(paint: impl Fn(usize, usize) -> [u8; 3]) -> Vec<PosedPicture> {
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        for (i, pixel) in picture.data.chunks_exact_mut(3).enumerate() {
            pixel.copy_from_slice(&paint(i % 64, i / 64));
        }
        vec![PosedPicture::new(CAMERA, Pose::IDENTITY, picture)]
    }

    #[test]
    fn the_solver_alone_recovers_known_colours() {
        let options = MappingOptions { sweeps: 25, steps: 0, ..MappingOptions::default() };
        let mut painted = discs(&wall(), &options);
        for (i, sh) in painted.sh.chunks_exact_mut(12).enumerate() {
            sh[..3].copy_from_slice(&[0.3, 1.0, 2.0].map(|f| (f * 0.13 * i as f32).sin()));
        }
        let mut views = views(|_, _| [0; 3]);
        let view = &mut views[0];
        view.picture = preview(&painted, &options.render, &CAMERA, &view.pose).unwrap();
        let splats = make_prior(&wall(), &views, &options, &mut |_, _| ()).unwrap();
        let again = preview(&splats, &options.render, &CAMERA, &Pose::IDENTITY).unwrap();
        let psnr = again.psnr(&views[0].picture);
        assert!(psnr > 40.0, "{psnr} dB");
    }

    #[test]
    fn gradient_steps_bring_out_an_edge_that_colours_alone_cannot() {
        let views = views(|x, y| if x + 2 * y > 77 { [220, 200, 30] } else { [20, 60, 90] });
        let psnr = |steps| {
            let options = MappingOptions { sweeps: 8, steps, ..MappingOptions::default() };
            let splats = make_prior(&wall(), &views, &options, &mut |_, _| ()).unwrap();
            let picture = preview(&splats, &options.render, &CAMERA, &Pose::IDENTITY).unwrap();
            picture.psnr(&views[0].picture)
        };
        let (colours, trained) = (psnr(0), psnr(120));
        assert!(trained > colours + 2.0, "{colours} dB, trained {trained} dB");
    }

    #[test]
    fn the_result_does_not_depend_on_the_number_of_threads() {
        let options = MappingOptions { sweeps: 2, steps: 6, ..MappingOptions::default() };
        let mut views = views(|x, y| [(x * 4) as u8, (y * 5) as u8, 90]);
        views.push(PosedPicture {
            pose: Pose::exp(&[0.1, 0.0, 0.0, 0.0, 0.05, 0.0]),
            ..views[0].clone()
        });
        let make = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| make_prior(&wall(), &views, &options, &mut |_, _| ()).unwrap())
        };
        assert_eq!(make(1), make(3));
    }

    #[test]
    fn progress_ends_at_the_whole() {
        let options = MappingOptions { sweeps: 2, steps: 3, ..MappingOptions::default() };
        let mut told = Vec::new();
        let progress = &mut |done, all| told.push((done, all));
        make_prior(&wall(), &views(|x, _| [x as u8; 3]), &options, progress).unwrap();
        assert_eq!(told, [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]);
    }

    #[test]
    fn refuses_what_cannot_be_fitted() {
        let options = MappingOptions::default();
        let (points, good) = (wall(), views(|_, _| [0; 3]));
        let error = |points: &[SurfacePoint], views: &[PosedPicture], options: &MappingOptions| {
            make_prior(points, views, options, &mut |_, _| ()).unwrap_err()
        };
        assert_eq!(error(&[], &good, &options), MappingError::NoPoints);
        assert_eq!(error(&points, &[], &options), MappingError::NoViews);
        let flat = [points[0], SurfacePoint { normal: [0.0; 3], ..points[1] }];
        assert_eq!(error(&flat, &good, &options), MappingError::Point { index: 1 });
        let lost = [SurfacePoint { radius: f32::NAN, ..points[0] }];
        assert_eq!(error(&lost, &good, &options), MappingError::Point { index: 0 });
        let small = PosedPicture { picture: Picture::new(64, 47), ..good[0].clone() };
        let size = MappingError::PictureSize { index: 0, width: 64, height: 47 };
        assert_eq!(error(&points, &[small], &options), size);
        let opaque = MappingOptions { opacity: 1.0, ..options };
        let range = MappingError::Option { name: "opacity", value: 1.0 };
        assert_eq!(error(&points, &good, &opaque), range);
    }
}
