//! A picture with its camera and pose.

use nvsprior::image::psnr_of_mse;
use nvsprior::{Camera, Picture, Pose};

/// A picture with its camera and pose.
#[derive(Clone, Debug)]
pub struct PosedPicture {
    pub camera: Camera,
    pub pose: Pose,
    /// What it saw, of the camera's size.
    pub picture: Picture,
    /// Which pixels count, row-major; all without one.
    pub mask: Option<Vec<bool>>,
}

impl PosedPicture {
    /// A picture of which all pixels count.
    pub fn new(camera: Camera, pose: Pose, picture: Picture) -> PosedPicture {
        PosedPicture { camera, pose, picture, mask: None }
    }

    pub fn counts(&self, pixel: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask[pixel])
    }

    /// A pixel's colour, values in [0, 1].
    pub fn colour(&self, pixel: usize) -> [f32; 3] {
        let rgb = &self.picture.data[3 * pixel..3 * pixel + 3];
        [0, 1, 2].map(|channel| f32::from(rgb[channel]) / 255.0)
    }

    /// PSNR of a render over the pixels that count, dB; infinite if none do.
    pub fn psnr(&self, render: &Picture) -> f64 {
        if self.mask.is_none() {
            return render.psnr(&self.picture);
        }
        let counted = (0..self.camera.pixels()).filter(|pixel| self.counts(*pixel));
        let (mut sum, mut values) = (0.0, 0);
        for place in counted.flat_map(|pixel| 3 * pixel..3 * pixel + 3) {
            let difference = f64::from(render.data[place]) - f64::from(self.picture.data[place]);
            sum += (difference / 255.0).powi(2);
            values += 1;
        }
        psnr_of_mse(sum / f64::from(values.max(1)))
    }
}
