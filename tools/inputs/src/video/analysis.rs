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
    /// How much of the picture's gradients is gone at a coarser width: what blur takes away, whatever is shown and in
    /// which light. Near 0 if nothing is finer than that; a sharp picture has 0.2 and more.
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

/// A smooth picture's energy at the coarse width is that at the fine one times the factor's square; what it has more is
/// detail. 1 if both widths are the same.
fn detail(fine: f64, coarse: f64, factor: usize) -> f64 {
    let smooth = 1.0 / (factor * factor) as f64;
    if factor < 2 || coarse <= 0.0 {
        return 1.0;
    }
    ((fine / coarse - smooth) / (1.0 - smooth)).clamp(0.0, 1.0)
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
        // Those of interlaced videos come whole.
        let larger = (f64::from(width) / f64::from(WIDTH)).round() as usize;
        let plane = if larger > 1 { plane.reduced(larger) } else { plane };
        let factor = (plane.width / COARSE).max(1);
        let coarse = plane.reduced(factor);
        let sharpness = plane.gradient_energy();
        let detail = detail(sharpness, coarse.gradient_energy(), factor);
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

#[cfg(test)]
mod tests {
    use nvsprior::image::Colour;

    use super::super::decoder::Decoder;
    use super::super::frame::Layout;
    use super::super::matroska::Header;
    use super::super::motion::tests::scene;
    use super::*;

    const SIZE: (u32, u32) = (320, 180);

    /// What a camera shows that looks at a place of the test's scene, blurred over so many pixels, in less light.
    fn frame(index: usize, (x, y): (f64, f64), blur: usize, light: f64) -> VideoFrame {
        let (width, height) = SIZE;
        let header = Header { colour: Colour::Bt601Full, ..Header::of_size(width, height) };
        let layout = Layout::of(Decoder::Ffmpeg, header);
        let mut data = vec![128; layout.bytes()];
        for (i, value) in data[..(width * height) as usize].iter_mut().enumerate() {
            let (column, row) = ((i as u32 % width) as f64, (i as u32 / width) as f64);
            let at = |k: usize| scene(x + (column + k as f64) / 320.0, y + row / 320.0);
            let sum: f64 = (0..=blur).map(at).sum();
            *value = (light * sum / (blur + 1) as f64) as u8;
        }
        VideoFrame { index, time: 0.1 * index as f64, layout, data }
    }

    fn aspect() -> f64 {
        f64::from(SIZE.1) / f64::from(SIZE.0)
    }

    #[test]
    fn motion_adds_up_along_the_way() {
        let mut analysis = Analysis::default();
        // Away and back, in steps of 4 % of the picture.
        let way: Vec<f64> = (0..20).chain((0..19).rev()).map(|i| 0.04 * f64::from(i)).collect();
        let facts: Vec<Facts> = way
            .iter()
            .enumerate()
            .map(|(i, x)| analysis.judge(&frame(i, (*x, 0.1), 0, 1.0)))
            .collect();
        assert!(facts.iter().all(|fact| fact.stretch == 0));
        for (a, b) in [(0, 5), (3, 10), (12, 19), (2, 36), (10, 28)] {
            let expected = (1.0 - (way[a] - way[b]).abs()).max(0.0);
            let found = facts[a].overlap(&facts[b], aspect());
            assert!((found - expected).abs() < 0.03, "{a} {b}: {found}, {expected}");
        }
    }

    #[test]
    fn a_camera_that_stands_in_changing_light_does_not_move() {
        let mut analysis = Analysis::default();
        let light = |i: usize| 0.7 + 0.3 * (i as f64).sin();
        let facts: Vec<Facts> =
            (0..60).map(|i| analysis.judge(&frame(i, (0.3, 0.3), 0, light(i)))).collect();
        assert!(facts[0].overlap(&facts[59], aspect()) > 0.98);
    }

    #[test]
    fn a_cut_begins_another_stretch() {
        let mut analysis = Analysis::default();
        let places = [(0.0, 0.0), (0.01, 0.0), (50.0, 20.0), (50.01, 20.0)];
        let facts: Vec<Facts> =
            (0..4).map(|i| analysis.judge(&frame(i, places[i], 0, 1.0))).collect();
        assert_eq!(facts.iter().map(|fact| fact.stretch).collect::<Vec<_>>(), [0, 0, 1, 1]);
        assert_eq!(facts[1].overlap(&facts[2], aspect()), 0.0);
    }

    #[test]
    fn blur_shows_and_light_does_not() {
        let judged = |blur, light| Analysis::default().judge(&frame(0, (0.0, 0.0), blur, light));
        let [sharp, dark, blurred] = [judged(0, 1.0), judged(0, 0.5), judged(9, 1.0)];
        assert!(blurred.sharpness < 0.6 * sharp.sharpness, "{blurred:?} {sharp:?}");
        assert!(blurred.detail < 0.6 * sharp.detail, "{blurred:?} {sharp:?}");
        assert!((dark.detail / sharp.detail - 1.0).abs() < 0.1, "{dark:?} {sharp:?}");
    }
}
