//! How much pictures would change if one splat were missing.
//!
//! In a pixel, what lies behind the splat shows in its place: the change is `T α (behind − colour)`.

use glam::Vec3;

use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Camera, Engine, Pose, Prior};

use crate::blending::{Blended, Blender, Pixel};

/// What leaving one splat out would do to pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Removal {
    /// Sum over pixels and channels of the squared change, values in [0, 1].
    pub error: f32,
    /// Pixels in which the splat is blended.
    pub pixels: u32,
}

/// For each splat, how the pictures at some places would change without it.
///
/// # Errors
/// What the device fails with.
pub fn removals(
    engine: &Engine,
    prior: &Prior,
    places: &[(Camera, Pose)],
) -> Result<Vec<Removal>, DeviceError> {
    let mut blender = Blender::new(engine, prior)?;
    let mut sums = vec![Removal::default(); prior.len()];
    for (camera, pose) in places {
        blender.blend(camera, pose, &mut sums, add_pixel, |sum, removal: &Removal| {
            sum.error += removal.error;
            sum.pixels += removal.pixels;
        })?;
    }
    Ok(sums)
}

/// Which splats stay if the share `share` of them goes, those that show least first. At least one stays.
pub fn max_needed(removals: &[Removal], share: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..removals.len()).collect();
    let error = |i: &usize| removals[*i].error;
    // Of equal splats the later ones go first.
    order.sort_by(|a, b| error(a).total_cmp(&error(b)).then(b.cmp(a)));
    let max = removals.len().saturating_sub(1);
    let gone = ((share * removals.len() as f64).ceil() as usize).min(max);
    let mut kept = vec![true; removals.len()];
    order[..gone].iter().for_each(|i| kept[*i] = false);
    kept
}

/// Adds the changes of one pixel, back to front.
fn add_pixel(pixel: &Pixel, blended: &[Blended], sums: &mut [Removal]) {
    // What the pixel shows of everything behind the current splat.
    let mut behind = pixel.left * pixel.background;
    for Blended { place, alpha, weight, colour } in blended.iter().rev() {
        let shown = *weight * *colour;
        let change: Vec3 = behind * (alpha / (1.0 - alpha)) - shown;
        behind += shown;
        sums[*place].error += change.length_squared();
        sums[*place].pixels += 1;
    }
}
