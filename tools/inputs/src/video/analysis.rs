//! What each frame of a video is worth for a mapping: how sharp it is, and how the picture has moved.

use super::frame::VideoFrame;
use super::motion::{Similarity, Texture};
use super::plane::Plane;

/// Width at which frames are judged, pixels.
pub const WIDTH: u32 = 640;
/// Width at which motion is looked for; and the one against which sharpness counts.
const COARSE: usize = 160;

/// Correlation from which on a motion is believed.
const BELIEVED: f64 = 0.45;
/// A frame that has less than this in common with the last anchor needs a nearer one.
const NEAR: f64 = 0.7;

/// What is known of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facts {
    /// All frames of the video count, from 0.
    pub index: usize,
    /// Its time stamp, seconds.
    pub time: f64,
    /// Mean of squared gradients, in steps of 8-bit brightness per pixel of [`WIDTH`].
    pub sharpness: f64,
    /// The same, as a share of that of the picture at a quarter of the width: what blur takes away, whatever is shown.
    pub detail: f64,
    /// Frames between which the motion is known are of one stretch.
    pub stretch: usize,
    /// Where the picture's points lie in the stretch's first one.
    pub place: Similarity,
}

impl Facts {
    /// The share that two frames have in common; 0 if nothing is known.
    pub fn overlap(&self, other: &Facts, aspect: f64) -> f64 {
        if self.stretch != other.stretch {
            return 0.0;
        }
        other.place.inverse().after(&self.place).overlap(aspect)
    }
}

/// A frame that others are compared with.
struct Anchor {
    texture: Texture,
    place: Similarity,
}

/// Judges the frames of a video, one after the other.
#[derive(Default)]
pub struct Analysis {
    anchor: Option<Anchor>,
    last: Option<Anchor>,
    stretch: usize,
    /// Height by width.
    aspect: f64,
}

impl Analysis {
    /// The next frame of the video.
    pub fn judge(&mut self, frame: &VideoFrame) -> Facts {
        let (width, height) = frame.size();
        self.aspect = f64::from(height) / f64::from(width);
        let plane = Plane::from_luma(width, height, &frame.luma());
        let factor = (plane.width / COARSE).max(1);
        let coarse = plane.reduced(factor);
        let sharpness = plane.gradient_energy();
        let detail = sharpness / coarse.gradient_energy().max(1e-9);
        let texture = Texture::of(&coarse);
        let place = self.place(&texture);
        self.last = Some(Anchor { texture: texture.clone(), place });
        if self.anchor.is_none() {
            self.anchor = Some(Anchor { texture, place });
        }
        let (index, time, stretch) = (frame.index, frame.time, self.stretch);
        Facts { index, time, sharpness, detail, stretch, place }
    }

    /// Finds out how the picture has moved. Compared with the anchor as long as this is near enough, so that errors do
    /// not add up while the camera stands.
    fn place(&mut self, texture: &Texture) -> Similarity {
        let Some(last) = self.last.take() else { return Similarity::IDENTITY };
        if let Some(anchor) = &self.anchor {
            let start = last.place.inverse().after(&anchor.place);
            let found = anchor.texture.align(texture, &start);
            if found.correlation >= BELIEVED && found.motion.overlap(self.aspect) >= NEAR {
                return anchor.place.after(&found.motion.inverse());
            }
        }
        let found = last.texture.align(texture, &Similarity::IDENTITY);
        if found.correlation >= BELIEVED {
            let place = last.place.after(&found.motion.inverse());
            self.anchor = Some(last);
            return place;
        }
        self.stretch += 1;
        self.anchor = None;
        Similarity::IDENTITY
    }
}
