//! Light that changes from picture to picture: an affine colour map per picture (a 3×4 matrix, as Inria's trainer and
//! Splatfacto have it), so that it does not become floaters.
//!
//! A picture's map takes the scene's colours to the picture's. It is fitted to the render by least squares in closed
//! form, so it has no rate. The picture is trained on with the map undone, so the gradients need not know of it.

use crate::trainer::TrainingFrame;
use glam::{DMat3, DMat4, DVec3, DVec4};
use nvsprior::Picture;

use crate::PosedPicture;

/// Pull of a map towards "no change", in squared colours per pixel. A picture's colours have 0.01 to 0.3.
const PULL: f64 = 2e-3;
/// A map that takes differences to fewer or more than this says nothing of light.
const GAINS: [f64; 2] = [0.2, 5.0];

/// What light does to a picture: `colour = gain · scene + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Columns: what the scene's red, green and blue add to the picture's.
    pub gain: DMat3,
    /// Colour of what is black.
    pub offset: DVec3,
}

impl Exposure {
    /// The scene as it is.
    pub const NONE: Exposure = Exposure { gain: DMat3::IDENTITY, offset: DVec3::ZERO };

    /// The map from a render to a picture, by least squares over the pixels that count.
    pub fn fit(render: &Picture, view: &PosedPicture) -> Exposure {
        let (mut squares, mut products) = (DMat4::ZERO, [DVec4::ZERO; 3]);
        let (pixels, _) = render.data.as_chunks::<3>();
        let mut counted = 0.0_f64;
        for (i, rgb) in pixels.iter().enumerate().filter(|(i, _)| view.counts(*i)) {
            let seen = DVec3::from(rgb.map(f64::from)) / 255.0;
            let seen = seen.extend(1.0);
            let colour = view.colour(i).map(f64::from);
            for k in 0..4 {
                *squares.col_mut(k) += seen * seen[k];
            }
            for (sum, value) in products.iter_mut().zip(colour) {
                *sum += seen * value;
            }
            counted += 1.0;
        }
        let pull = PULL * counted.max(1.0);
        let inverse = (squares + DMat4::from_diagonal(DVec4::splat(pull))).inverse();
        let rows = [0, 1, 2].map(|c| {
            let mut pulled = products[c];
            pulled[c] += pull;
            inverse * pulled
        });
        let gain = DMat3::from_cols(rows[0].truncate(), rows[1].truncate(), rows[2].truncate());
        let fitted = Exposure { gain: gain.transpose(), offset: DVec3::from(rows.map(|r| r.w)) };
        if fitted.is_valid() { fitted } else { Exposure::NONE }
    }

    /// Whether it can be undone without blowing up noise.
    fn is_valid(&self) -> bool {
        let [low, high] = GAINS.map(|gain| gain.powi(3));
        let inverse = self.gain.inverse();
        let within = |m: &DMat3| m.to_cols_array().iter().all(|v| v.abs() <= GAINS[1]);
        let volume = self.gain.determinant();
        volume >= low && volume <= high && within(&self.gain) && within(&inverse)
    }

    /// First `other`, then this.
    fn after(&self, other: &Exposure) -> Exposure {
        Exposure { gain: self.gain * other.gain, offset: self.gain * other.offset + self.offset }
    }

    fn inverse(&self) -> Exposure {
        let gain = self.gain.inverse();
        Exposure { gain, offset: -(gain * self.offset) }
    }

    /// A picture in the scene's light, 8 bits.
    pub fn undone_picture(&self, view: &PosedPicture) -> Picture {
        let back = self.inverse();
        let mut picture = view.picture.clone();
        if *self != Exposure::NONE {
            for rgb in picture.data.as_chunks_mut::<3>().0 {
                let own = DVec3::from(rgb.map(f64::from)) / 255.0;
                let scene = (back.gain * own + back.offset) * 255.0;
                *rgb = scene.round().to_array().map(|value| value as u8);
            }
        }
        picture
    }

    /// A picture in the scene's light, for training.
    pub fn undone(&self, view: &PosedPicture) -> TrainingFrame {
        let back = self.inverse();
        TrainingFrame::from_fn(view.camera.pixels(), |pixel| {
            let own = || view.colour(pixel);
            // To the bit as it was if there is nothing to undo.
            let colour = || match *self == Exposure::NONE {
                true => own(),
                false => {
                    let own = DVec3::from(own().map(f64::from));
                    (back.gain * own + back.offset).clamp(DVec3::ZERO, DVec3::ONE).as_vec3().into()
                }
            };
            view.counts(pixel).then(colour)
        })
    }
}

/// Makes the mean of all maps "no change": else scene and maps could drift together.
pub fn centre(exposures: &mut [Exposure]) {
    let count = exposures.len().max(1) as f64;
    let gain = exposures.iter().fold(DMat3::ZERO, |sum, e| sum + e.gain) * (1.0 / count);
    let offset = exposures.iter().map(|e| e.offset).sum::<DVec3>() / count;
    let mean = Exposure { gain, offset };
    if mean.is_valid() {
        let back = mean.inverse();
        exposures.iter_mut().for_each(|exposure| *exposure = exposure.after(&back));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nvsprior::random::Random;
    use nvsprior::{Camera, Pose};

    const CAMERA: Camera = Camera { width: 40, height: 30, fx: 40.0, fy: 40.0, cx: 20.0, cy: 15.0 };

    fn scene() -> Picture {
        let mut random = Random::new(5);
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        picture.data.iter_mut().for_each(|byte| *byte = random.within(60.0, 190.0) as u8);
        picture
    }

    fn in_light(scene: &Picture, light: &Exposure) -> PosedPicture {
        let mut picture = scene.clone();
        for rgb in picture.data.as_chunks_mut::<3>().0 {
            let own = DVec3::from(rgb.map(f64::from)) / 255.0;
            let lit = (light.gain * own + light.offset) * 255.0;
            *rgb = lit.round().to_array().map(|value| value as u8);
        }
        PosedPicture::new(CAMERA, Pose::IDENTITY, picture)
    }

    fn light() -> Exposure {
        let gain = DMat3::from_diagonal(DVec3::new(0.7, 0.9, 1.1));
        Exposure { gain, offset: DVec3::new(0.02, 0.05, 0.08) }
    }

    #[test]
    fn light_is_found_and_undone() {
        let (scene, light) = (scene(), light());
        let mut view = in_light(&scene, &light);
        // An object hides a part of the scene: it does not count.
        view.picture.data[..600].fill(255);
        view.mask = Some((0..CAMERA.pixels()).map(|pixel| pixel >= 200).collect());
        let found = Exposure::fit(&scene, &view);
        assert!((found.offset - light.offset).length() < 0.06, "{found:?}");
        let undone = found.undone(&view);
        let expected = TrainingFrame::new(&scene);
        let (mut sum, mut count) = (0.0, 0);
        for pixel in 200..CAMERA.pixels() {
            let (a, b) = (undone.colour(pixel), expected.colour(pixel));
            let (Some(a), Some(b)) = (a, b) else { panic!("pixel {pixel} does not count") };
            sum += a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
            count += 3;
        }
        assert!(sum / f64::from(count) < 0.02, "{}", sum / f64::from(count));
        assert_eq!(undone.colour(10), None);
    }

    #[test]
    fn nothing_is_made_of_black_or_flat_pictures() {
        let black = PosedPicture::new(CAMERA, Pose::IDENTITY, Picture::new(40, 30));
        for render in [scene(), Picture::new(40, 30)] {
            let found = Exposure::fit(&render, &black);
            assert!(found.is_valid(), "{found:?}");
        }
    }

    #[test]
    fn the_mean_is_no_change() {
        let mut all = [light(), Exposure::NONE, light().inverse()];
        centre(&mut all);
        let gain = all.iter().fold(DMat3::ZERO, |sum, e| sum + e.gain) * (1.0 / 3.0);
        assert!(gain.abs_diff_eq(DMat3::IDENTITY, 1e-9), "{gain}");
    }
}
