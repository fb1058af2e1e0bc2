//! Posed pictures as the training wants them: of a pinhole camera.

use std::path::Path;

use image::imageops::FilterType;
use nvsprior::geometry::{Lens, LensError};
use nvsprior::image::Mask;
use nvsprior::{Camera, Picture};

use super::{PosedError, PosedInput};
use crate::frame_file::{FrameFileError, alpha, open_image, same_shape};
use crate::undistort::undistort;

impl PosedInput {
    /// Reads the picture (PNG, JPEG or WebP), undistorts it and brings it to the camera's size, in
    /// one step. Which camera is up to the caller; [`Lens::pinhole_at`] gives the natural one.
    ///
    /// A picture of another size than its lens, but of the same shape, is taken with intrinsics that
    /// scale with its sides. It is taken as it is stored: EXIF's rotation is not applied. Without
    /// distortion it is resized as [`crate::frame_file::read_frame`] does it, to the bit.
    pub fn load(&self, to: &Camera) -> Result<Picture, PosedError> {
        self.undistorted(to).map(|(picture, _)| picture)
    }

    /// [`PosedInput::load`] with those of its pixels that count: all of which lies on the picture as
    /// it was taken, on what of it is opaque, and on white of the mask, if there is one.
    pub fn load_masked(&self, to: &Camera) -> Result<(Picture, Mask), PosedError> {
        let (picture, mut counts) = self.undistorted(to)?;
        if let Some(path) = &self.mask {
            let grey = open_image(path)?.to_luma8();
            counts.intersect(&self.mask_of(grey.dimensions(), grey.as_raw(), path, to)?);
        }
        Ok((picture, counts))
    }

    /// What counts by the values of a picture of this size, at the camera's.
    fn mask_of(
        &self,
        (width, height): (u32, u32),
        values: &[u8],
        path: &Path,
        to: &Camera,
    ) -> Result<Mask, PosedError> {
        let lens = self.lens_for((width, height), path)?;
        let failed = |error| PosedError::Lens { path: path.to_path_buf(), error };
        let white = values.iter().map(|value| *value >= Mask::WHITE).collect();
        Mask { width, height, data: white }.undistorted(&lens, to).map_err(failed)
    }

    fn undistorted(&self, to: &Camera) -> Result<(Picture, Mask), PosedError> {
        let failed = |error: LensError| PosedError::Lens { path: self.file.clone(), error };
        to.check().map_err(|error| failed(error.into()))?;
        let found = open_image(&self.file)?;
        let alpha = alpha(&found);
        let found = found.into_rgb8();
        let (width, height) = found.dimensions();
        let lens = self.lens_for((width, height), &self.file)?;
        let opaque = alpha.map(|alpha| self.mask_of((width, height), &alpha, &self.file, to));
        let opaque = opaque.transpose()?;
        if !lens.is_only_resized(to) {
            let found = Picture { width, height, data: found.into_raw() };
            let (picture, mut counts) = undistort(&lens, &found, to).map_err(failed)?;
            opaque.iter().for_each(|opaque| counts.intersect(opaque));
            return Ok((picture, counts));
        }
        let found = if (width, height) == (to.width, to.height) {
            found
        } else {
            image::imageops::resize(&found, to.width, to.height, FilterType::Lanczos3)
        };
        let picture = Picture { width: to.width, height: to.height, data: found.into_raw() };
        Ok((picture, opaque.unwrap_or_else(|| Mask::all(to.width, to.height))))
    }

    /// The lens for a picture of this size.
    fn lens_for(&self, found: (u32, u32), path: &Path) -> Result<Lens, PosedError> {
        let own = self.lens.intrinsics();
        let expected = (own.width, own.height);
        if found == expected {
            return Ok(self.lens);
        }
        if !same_shape(found, expected) {
            let path = path.to_path_buf();
            return Err(FrameFileError::Shape { path, found, expected }.into());
        }
        let failed = |error| PosedError::Lens { path: path.to_path_buf(), error };
        self.lens.resized(found.0, found.1).map_err(failed)
    }
}
