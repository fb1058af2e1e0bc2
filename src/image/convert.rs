//! A camera's image to the encoder's picture.

use super::scaler::Scaler;
use super::undistortion::Undistortion;
use super::view::check_size;
use super::{ImageView, Mask, PixelError};
use crate::geometry::{Lens, LensError};
use crate::{Camera, Picture};

/// Makes pictures of one size from images of any, or pictures of a pinhole camera from those of a lens.
///
/// Without a lens, every sample of the result is within one step of the exact value, for images up to 32 times the
/// picture's size. Planes are scaled before colours are converted, chroma at its own resolution. Nothing is allocated
/// if the image before had the same size and format and the picture is large enough.
///
/// With a lens ([`Converter::undistorting`]) images have the lens's size. A pixel of the picture is very nearly a
/// parallelogram on the image, its footprint. First the image is reduced by area averaging, as without a lens, by the
/// largest whole number by which all footprints are still at least one pixel wide. Then each pixel is the mean of a
/// grid of samples over its footprint, at most one reduced pixel apart, each interpolated linearly between four reduced
/// pixels. A footprint of less than a pixel has one sample. Nothing is allocated from the first image on.
///
/// All of it is integer arithmetic. The lens's formulas are f64, whose operations are the same on every machine.
pub struct Converter {
    scaler: Scaler,
    undistortion: Option<Undistortion>,
}

impl Converter {
    /// Makes a converter for pictures of this size, that of the encoder's camera: sides of 1 to
    /// [`Camera::MAX_SIDE`] pixels.
    pub fn new(width: u32, height: u32) -> Result<Converter, PixelError> {
        check_size(width, height, Camera::MAX_SIDE)?;
        Ok(Converter { scaler: Scaler::new(width, height), undistortion: None })
    }

    /// Makes a converter for images of this lens, into pictures of this pinhole camera. It keeps 25 bytes per pixel of
    /// the camera, and at most three per pixel of the lens.
    ///
    /// # Errors
    /// If a side of the lens's pictures is above [`ImageView::MAX_SIDE`], if a corner of them has no ray, if the camera
    /// cannot be rendered, or if it sees nothing that the lens sees.
    pub fn undistorting(lens: &Lens, camera: &Camera) -> Result<Converter, LensError> {
        let undistortion = Undistortion::new(lens, camera)?;
        let (width, height) = undistortion.reduced_size();
        let mut scaler = Scaler::new(width, height);
        let (width, height) = lens.size();
        scaler.prepare(width, height);
        Ok(Converter { scaler, undistortion: Some(undistortion) })
    }

    /// Which pixels of the pictures show the lens's images; `None`: all do. The others are black, and must not count:
    /// see [`Encoder::set_mask`](crate::Encoder::set_mask).
    pub fn covered(&self) -> Option<&Mask> {
        self.undistortion.as_ref().map(Undistortion::covered)
    }

    /// Makes `into` a picture of the image, 8-bit RGB. Scales it if its size differs, or undistorts it.
    ///
    /// # Errors
    /// If [`ImageView::check`] refuses the image, or its shape is not the picture's (ratios of the
    /// sides more than 1 % apart), or its size not the lens's. The picture is then left as it was.
    pub fn convert(&mut self, image: &ImageView, into: &mut Picture) -> Result<(), PixelError> {
        image.check()?;
        let found = (image.width, image.height);
        match &mut self.undistortion {
            None => {
                check_shape(self.scaler.size(), found)?;
                self.scaler.scale_image(image, into);
            }
            Some(undistortion) => {
                let expected = undistortion.size();
                if found != expected {
                    return Err(PixelError::LensSize { expected, found });
                }
                self.scaler.scale_image(image, undistortion.reduced());
                undistortion.apply(into);
            }
        }
        Ok(())
    }

    /// Where the buffers lie, and their capacities.
    #[cfg(test)]
    pub(super) fn buffers(&self) -> Vec<(usize, usize)> {
        self.scaler.buffers()
    }
}

/// Refuses ratios of the sides that are more than 1 % apart: less is the rounding of sizes.
fn check_shape(expected: (u32, u32), found: (u32, u32)) -> Result<(), PixelError> {
    let product = |a: u32, b: u32| u64::from(a) * u64::from(b);
    let (wide, high) = (product(found.0, expected.1), product(found.1, expected.0));
    if wide.abs_diff(high) * 100 > high {
        return Err(PixelError::Shape { expected, found });
    }
    Ok(())
}
