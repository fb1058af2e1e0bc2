//! How far a prior's picture may be off, splat by splat: from the pictures that it was trained on.
//!
//! In each picture the error around a pixel counts for the splats that the pixel is blended of, by their parts of its
//! colour: RMS over 16×16 pixels, as in the truth map. The doubt of a splat is
//!
//! > √(mean of the squared errors + 8² / sides)
//!
//! in values of 0 to 255. Five pixels with an error of 40 are added to the mean, so that a splat which no picture saw
//! is doubtful, and one that few pixels saw may be. *Sides* is the number of different views among the pictures that
//! saw it: directions that differ, or distances by a factor of two.
//!
//! Measured on the reef, with its own prior, on frames that the prior was not trained on: blocks whose mean doubt is
//! more than 16 are off by more than that in 41 and 27 % of all cases (`test_block`, `test`), the others in 10 and 6 %.
//! Sizes, shapes and opacities of splats tell nothing: what ranks blocks right on the basin ranks them wrong there.

use std::collections::HashSet;

use glam::DVec3;

use nvsprior::prior::PriorError;
use nvsprior::truth::BLOCK;
use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Engine, Pose, Prior};

use crate::PosedPicture;
use crate::blending::{Blended, Blender, Pixel};
use crate::drawn::Drawn;

/// Sum of a splat's parts of pixels from which on a picture sees it.
const SEEN: f64 = 0.5;
/// What one side adds to the doubt, RMS of 255.
const ONE_SIDE: f64 = 8.0;
/// Pixels that are added to what is known of a splat, and their error.
const ADDED_PIXELS: f64 = 5.0;
const ADDED_ERROR: f64 = 40.0;
/// Directions differ if they lie in different cells of the unit sphere, that many along a unit.
const CELLS: f64 = 6.0;

#[derive(Debug, thiserror::Error)]
pub enum DoubtError {
    #[error(transparent)]
    Device(#[from] DeviceError),
    #[error(transparent)]
    Prior(#[from] PriorError),
}

/// What pictures say of a splat: sums over pixels, each by the splat's part of it.
#[derive(Clone, Copy, Default)]
struct Told {
    squares: f64,
    parts: f64,
}

/// What pictures say of a splat, and from where.
#[derive(Clone, Default)]
struct Seen {
    told: Told,
    /// In the picture that is looked at.
    now: f64,
    sides: HashSet<[i8; 4]>,
}

/// The doubt of a prior, from pictures and their poses. Calls `told` after each picture.
pub fn doubt_of<'a>(
    engine: &Engine,
    prior: &Prior,
    pictures: impl IntoIterator<Item = (&'a PosedPicture, Pose)>,
    told: &mut dyn FnMut(),
) -> Result<Vec<u8>, DoubtError> {
    let mut drawn = Drawn::new(engine, prior)?;
    let mut blender = Blender::new(engine, prior)?;
    let mut seen = vec![Seen::default(); prior.len()];
    for (picture, pose) in pictures {
        let camera = &picture.camera;
        let squares = squares(picture, drawn.draw(camera, &pose)?);
        let of_pixel = |pixel: &Pixel, blended: &[Blended], sums: &mut [Told]| {
            if picture.counts(pixel.index) {
                for Blended { place, weight, .. } in blended {
                    sums[*place].squares += f64::from(*weight) * squares[pixel.index];
                    sums[*place].parts += f64::from(*weight);
                }
            }
        };
        blender.blend(camera, &pose, &mut seen, of_pixel, |seen, told| {
            seen.told.squares += told.squares;
            seen.told.parts += told.parts;
            seen.now += told.parts;
        })?;
        for (position, seen) in prior.splats().positions.iter().zip(&mut seen) {
            if std::mem::take(&mut seen.now) > SEEN {
                seen.sides.insert(side(position.map(f64::from).into(), &pose));
            }
        }
        told();
    }
    Ok(seen.iter().map(Seen::doubt).collect())
}

/// From where a camera looks at a place: direction and distance, coarsely.
fn side(place: DVec3, pose: &Pose) -> [i8; 4] {
    let from = place - pose.centre();
    let to = from.normalize_or_zero() * CELLS;
    [to.x, to.y, to.z, from.length().log2()].map(|value| value.floor() as i8)
}

impl Seen {
    fn doubt(&self) -> u8 {
        let added = ADDED_PIXELS * ADDED_ERROR.powi(2);
        let mean = (self.told.squares + added) / (self.told.parts + ADDED_PIXELS);
        let sides = self.sides.len().max(1) as f64;
        (mean + ONE_SIDE.powi(2) / sides).sqrt().round() as u8
    }
}

/// Mean squared errors of the 16×16 pixels around each pixel that was [drawn](Drawn::draw), values of 0 to 255.
fn squares(picture: &PosedPicture, pixels: &[[f32; 5]]) -> Vec<f64> {
    let [width, height] = [picture.camera.width, picture.camera.height].map(|s| s as usize);
    let stride = width + 1;
    // Sums over all pixels above and left: of the squared errors, and of the pixels that count.
    let mut sums = vec![[0.0; 2]; stride * (height + 1)];
    for (pixel, values) in pixels.iter().enumerate() {
        let colour = picture.colour(pixel);
        let off = |c: usize| f64::from(255.0 * (values[c].clamp(0.0, 1.0) - colour[c])).powi(2);
        let own = match picture.counts(pixel) {
            true => [(0..3).map(off).sum::<f64>() / 3.0, 1.0],
            false => [0.0; 2],
        };
        let at = (pixel / width + 1) * stride + pixel % width + 1;
        sums[at] = [0, 1]
            .map(|k| own[k] + sums[at - 1][k] + sums[at - stride][k] - sums[at - stride - 1][k]);
    }
    let half = BLOCK as usize / 2;
    let mean = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let [left, right] = [x.saturating_sub(half), (x + half).min(width)];
        let [top, bottom] = [y.saturating_sub(half), (y + half).min(height)];
        let [sum, count] = [0, 1].map(|k| {
            let corners = sums[bottom * stride + right][k] + sums[top * stride + left][k];
            corners - sums[top * stride + right][k] - sums[bottom * stride + left][k]
        });
        sum / f64::max(count, 1.0)
    };
    (0..width * height).map(mean).collect()
}
