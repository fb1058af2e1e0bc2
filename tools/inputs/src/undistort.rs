//! Pictures of a lens as pictures of a pinhole camera.
//!
//! Each new pixel is a square on the pinhole's picture, and very nearly a parallelogram on the
//! lens's: its footprint. The new pixel is the mean of the old ones, weighted by Lanczos' kernel of
//! three lobes along both of the footprint's sides. So undistorting and reducing are one step: the
//! kernel grows with the footprint and lets no frequency through that the new size cannot hold. If
//! a footprint is smaller than an old pixel, the kernel is as wide as that pixel, and interpolates.
//! Without distortion this is the filter by which [`crate::frame_file::read_frame`] resizes.

use glam::{DMat2, DVec2};
use nvsprior::geometry::{Footprint, Lens, LensError};
use nvsprior::image::Mask;
use nvsprior::{Camera, Picture};

/// Lobes of the kernel to either side.
const LOBES: f64 = 3.0;

/// Entries of the kernel's table for each unit.
const TABLE_STEP: f32 = 2048.0;

/// Lanczos' kernel as a table.
struct Kernel(Vec<f32>);

impl Kernel {
    fn new() -> Kernel {
        let sinc = |x: f64| if x == 0.0 { 1.0 } else { x.sin() / x };
        let value = |i: u32| {
            let x = f64::from(i) / f64::from(TABLE_STEP) * std::f64::consts::PI;
            (sinc(x) * sinc(x / LOBES)) as f32
        };
        Kernel((0..=(LOBES as f32 * TABLE_STEP) as u32).map(value).collect())
    }

    /// Zero outside of its lobes.
    fn at(&self, x: f32) -> f32 {
        self.0.get((x.abs() * TABLE_STEP + 0.5) as usize).copied().unwrap_or(0.0)
    }

    /// The weighted mean of a picture's pixels about a footprint.
    fn mean(&self, picture: &Picture, footprint: &Footprint) -> [u8; 3] {
        // A kernel narrower than an old pixel would miss them all.
        let widened = |side: DVec2| side / side.length().min(1.0);
        let sides = footprint.sides;
        let sides = DMat2::from_cols(widened(sides.x_axis), widened(sides.y_axis));
        let size = (picture.width, picture.height);
        let (mut sum, mut weights) = ([0.0f32; 3], 0.0f32);
        footprint.visit(sides, LOBES, size, |index, place| {
            let weight = self.at(place.x) * self.at(place.y);
            for (sum, value) in sum.iter_mut().zip(&picture.data[3 * index..3 * index + 3]) {
                *sum += weight * f32::from(*value);
            }
            weights += weight;
        });
        if weights > 1e-3 {
            return sum.map(|sum| (sum / weights).round() as u8);
        }
        let index = 3 * footprint.nearest(size);
        std::array::from_fn(|channel| picture.data[index + channel])
    }
}

/// Undistorts a picture of a lens and brings it to a camera's size in one step.
///
/// The mask holds the pixels all of which lies on the old picture. The others hold its last
/// pixels if their centres lie on it, else black. Errors: the picture is of another size than
/// the lens, or `to` cannot be rendered.
pub fn undistort(
    lens: &Lens,
    picture: &Picture,
    to: &Camera,
) -> Result<(Picture, Mask), LensError> {
    let samples = 3 * u64::from(picture.width) * u64::from(picture.height);
    to.check()?;
    let (found, expected) = ((picture.width, picture.height), lens.size());
    if found != expected || picture.data.len() as u64 != samples {
        return Err(LensError::Size { found, expected });
    }
    let kernel = Kernel::new();
    let mut new = Picture::new(to.width, to.height);
    let mut mask = Mask::none(to.width, to.height);
    lens.each_footprint(to, |index, footprint| {
        let mean = kernel.mean(picture, &footprint);
        new.data[3 * index..3 * index + 3].copy_from_slice(&mean);
        mask.data[index] = footprint.whole;
    });
    Ok((new, mask))
}

#[cfg(test)]
mod tests;
