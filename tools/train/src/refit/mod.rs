//! Fits splats to pictures again after some of them were left out, on the CPU: gradient steps on all that a splat has,
//! then one correction of all colours.

pub(crate) mod fit;
pub(crate) mod harmonics;
pub(crate) mod project;
pub(crate) mod raster;
pub(crate) mod train;

use nvsprior::Picture;
use nvsprior::geometry::CameraError;
use nvsprior::prior::{RenderOptions, Splats};

use crate::PosedPicture;

/// How splats are fitted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RefitOptions {
    /// How the prior will be rendered.
    pub render: RenderOptions,
    /// Gradient steps; each rasterises two views.
    pub steps: u32,
    /// Length of the gradient steps, as a share of that for a new prior.
    pub pace: f32,
    /// Steps of the colours' solver; each rasterises every view.
    pub sweeps: u32,
}

/// Why views cannot be fitted to.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ViewError {
    /// There is nothing to fit to.
    #[error("no views")]
    NoViews,
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
}

/// Fits splats to the views. Calls `done` after each step. The result is the same for any number of threads.
pub(crate) fn refit(
    splats: &mut Splats,
    views: &[PosedPicture],
    options: &RefitOptions,
    done: &mut dyn FnMut(),
) {
    train::train(splats, views, options, done);
    // Comes last, since it sees all views at once: it corrects what the gradient steps fitted to their last views only.
    fit::correct_colours(splats, views, options, done);
}

pub(crate) fn check_views(views: &[PosedPicture]) -> Result<(), ViewError> {
    if views.is_empty() {
        return Err(ViewError::NoViews);
    }
    for (index, PosedPicture { camera, pose, picture, .. }) in views.iter().enumerate() {
        camera.check().map_err(|source| ViewError::Camera { index, source })?;
        if !pose.is_finite() {
            return Err(ViewError::Pose { index });
        }
        let &Picture { width, height, .. } = picture;
        if (width, height) != (camera.width, camera.height)
            || picture.data.len() != 3 * camera.pixels()
        {
            return Err(ViewError::PictureSize { index, width, height });
        }
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::Vec3;
    use nvsprior::{Camera, Pose};

    const CAMERA: Camera = Camera { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };

    /// The render of splats on the CPU.
    pub fn preview(
        splats: &Splats,
        options: &RenderOptions,
        camera: &Camera,
        pose: &Pose,
    ) -> Picture {
        let geometry = project::Geometry::of(splats);
        let colours = harmonics::colours(splats, pose.centre().as_vec3());
        let mut picture = Picture::new(camera.width, camera.height);
        let projection = raster::Projection::new(&geometry, camera, pose, options);
        projection.render(&colours, Vec3::from(options.background), |pixel, value| {
            let bytes = (value * 255.0).round().to_array().map(|v| v.clamp(0.0, 255.0) as u8);
            picture.data[3 * pixel..3 * pixel + 3].copy_from_slice(&bytes);
        });
        picture
    }

    fn options(steps: u32, sweeps: u32) -> RefitOptions {
        RefitOptions { render: RenderOptions::INRIA, steps, pace: 1.0, sweeps }
    }

    /// A grey wall of discs at z = 2, 0.1 apart.
    fn wall() -> Splats {
        let count = 25 * 25;
        let position = |i: usize| [(i % 25) as f32 * 0.1 - 1.2, (i / 25) as f32 * 0.1 - 1.2, 2.0];
        Splats {
            positions: (0..count).map(position).collect(),
            log_scales: vec![[0.05f32.ln(), 0.05f32.ln(), 0.005f32.ln()]; count],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
            opacity_logits: vec![(0.95f32 / 0.05).ln(); count],
            sh: vec![0.0; count * 12],
            sh_degree: 1,
        }
    }

    /// The wall seen from one place, painted by `paint` over the picture.
    fn views(paint: impl Fn(usize, usize) -> [u8; 3]) -> Vec<PosedPicture> {
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        for (i, pixel) in picture.data.chunks_exact_mut(3).enumerate() {
            pixel.copy_from_slice(&paint(i % 64, i / 64));
        }
        vec![PosedPicture::new(CAMERA, Pose::IDENTITY, picture)]
    }

    fn refitted(views: &[PosedPicture], options: &RefitOptions) -> Splats {
        let mut splats = wall();
        refit(&mut splats, views, options, &mut || ());
        splats
    }

    #[test]
    fn the_solver_alone_recovers_known_colours() {
        let options = options(0, 25);
        let mut painted = wall();
        for (i, sh) in painted.sh.chunks_exact_mut(12).enumerate() {
            sh[..3].copy_from_slice(&[0.3, 1.0, 2.0].map(|f| (f * 0.13 * i as f32).sin()));
        }
        let mut views = views(|_, _| [0; 3]);
        views[0].picture = preview(&painted, &options.render, &CAMERA, &views[0].pose);
        let splats = refitted(&views, &options);
        let again = preview(&splats, &options.render, &CAMERA, &Pose::IDENTITY);
        let psnr = again.psnr(&views[0].picture);
        assert!(psnr > 40.0, "{psnr} dB");
    }

    #[test]
    fn gradient_steps_bring_out_an_edge_that_colours_alone_cannot() {
        let views = views(|x, y| if x + 2 * y > 77 { [220, 200, 30] } else { [20, 60, 90] });
        let psnr = |steps| {
            let options = options(steps, 8);
            let splats = refitted(&views, &options);
            preview(&splats, &options.render, &CAMERA, &Pose::IDENTITY).psnr(&views[0].picture)
        };
        let (colours, trained) = (psnr(0), psnr(120));
        assert!(trained > colours + 2.0, "{colours} dB, trained {trained} dB");
    }

    #[test]
    fn the_result_does_not_depend_on_the_number_of_threads() {
        let mut views = views(|x, y| [(x * 4) as u8, (y * 5) as u8, 90]);
        views.push(PosedPicture {
            pose: Pose::exp(&[0.1, 0.0, 0.0, 0.0, 0.05, 0.0]),
            ..views[0].clone()
        });
        let make = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| refitted(&views, &options(6, 2)))
        };
        assert_eq!(make(1), make(3));
    }

    #[test]
    fn each_step_is_told() {
        let (mut splats, mut told) = (wall(), 0);
        refit(&mut splats, &views(|x, _| [x as u8; 3]), &options(2, 3), &mut || told += 1);
        assert_eq!(told, 5);
    }

    #[test]
    fn views_that_cannot_be_fitted_to_are_refused() {
        let good = views(|_, _| [0; 3]);
        assert_eq!(check_views(&good), Ok(()));
        assert_eq!(check_views(&[]), Err(ViewError::NoViews));
        let small = PosedPicture { picture: Picture::new(64, 47), ..good[0].clone() };
        let size = ViewError::PictureSize { index: 0, width: 64, height: 47 };
        assert_eq!(check_views(&[small]), Err(size));
        let mut lost = good[0].clone();
        lost.pose.translation.x = f64::NAN;
        assert_eq!(check_views(&[good[0].clone(), lost]), Err(ViewError::Pose { index: 1 }));
    }
}
