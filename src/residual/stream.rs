//! Streams: frames whose difference pictures are predicted from those of earlier frames.

use crate::Picture;
use crate::packet::{Latent, Reference, Residual};

use super::ResidualError;
use super::references::{REFERENCES, ReferenceFrame, References, frames_behind};
use super::warp::{Viewpoint, warp};
use super::wavelet::{Earlier, Planes};

/// Whether frames are predicted from earlier ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Every frame by itself: a lost packet costs its frame alone.
    #[default]
    Intra,
    /// Frames are predicted from earlier ones, and take fewer bytes. A frame whose reference is missing is shown as the
    /// render alone.
    Stream(Structure),
}

/// Which frame a frame of a stream is predicted from. A frame is intra if there is no such frame among the last 32, or
/// if prediction saves nothing; it then counts as a key frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Structure {
    /// The newest frame that the topside has acknowledged: see [`Encoder::acknowledge`](crate::Encoder::acknowledge).
    /// No loss costs more than its frame. It takes a return channel; the longer its delay, the less is saved.
    Acknowledged,
    /// The frame before. It saves most; a loss costs all frames up to the next key frame.
    Chain {
        /// A key frame, which is intra, comes after this many frames; 0: no more after the first.
        key_every: u32,
    },
    /// Layers: of four frames, the first is predicted from the first of the four before, the third from the first,
    /// and the second and the fourth from the one before. A loss of one of the latter costs its frame alone.
    Layers {
        /// As for a chain.
        key_every: u32,
    },
    /// The last key frame. A loss costs its frame alone, unless it is the key frame.
    Keys {
        /// As for a chain.
        key_every: u32,
    },
}

/// Frames between two of the lowest layer.
const LAYERED: u32 = 4;

impl Structure {
    /// Whether a frame may be predicted from a kept one. `position`: its number of frames after the last key frame.
    fn suits(self, position: u32, kept: &ReferenceFrame, acknowledged: &Acknowledged) -> bool {
        match self {
            Structure::Acknowledged => acknowledged.contains(kept.frame),
            Structure::Chain { .. } => true,
            Structure::Layers { .. } => {
                let layer = 1 << position.trailing_zeros().min(LAYERED.ilog2());
                kept.position.is_multiple_of(layer)
            }
            Structure::Keys { .. } => kept.position == 0,
        }
    }

    fn key_every(self) -> u32 {
        match self {
            Structure::Acknowledged => 0,
            Structure::Chain { key_every }
            | Structure::Layers { key_every }
            | Structure::Keys { key_every } => key_every,
        }
    }
}

/// The frames that were acknowledged last.
#[derive(Clone, Copy, Debug, Default)]
pub struct Acknowledged {
    frames: [Option<u32>; REFERENCES],
    next: usize,
}

impl Acknowledged {
    /// Adds a frame, modulo 2¹⁶, in place of the one added longest ago.
    pub fn add(&mut self, frame: u32) {
        let frame = frame % Latent::FRAMES;
        if !self.contains(frame) {
            self.frames[self.next] = Some(frame);
            self.next = (self.next + 1) % REFERENCES;
        }
    }

    fn contains(&self, frame: u32) -> bool {
        self.frames.contains(&Some(frame % Latent::FRAMES))
    }
}

/// What a frame of a stream is coded with beyond its pictures.
#[derive(Clone, Copy)]
pub struct StreamFrame<'a> {
    /// Its number.
    pub frame: u32,
    /// Where it was seen from, as its packet says it.
    pub viewpoint: &'a Viewpoint,
    /// Depths of the render's pixels, row by row: see [`Renderer::depths`](crate::render::Renderer::depths).
    pub depths: &'a [f32],
}

impl StreamFrame<'_> {
    /// Checks that it has the size of a picture, and a depth for every pixel.
    pub(super) fn check(&self, expected: (u32, u32)) -> Result<(), ResidualError> {
        let camera = &self.viewpoint.camera;
        let found = (camera.width, camera.height);
        if expected != found {
            return Err(ResidualError::Size { expected, found });
        }
        let (expected, found) = (camera.pixels(), self.depths.len());
        if expected == found { Ok(()) } else { Err(ResidualError::Depths { expected, found }) }
    }
}

impl ReferenceFrame {
    /// What a frame may be predicted from. `warped`: room for its planes.
    fn seen_from<'a>(&'a self, frame: &StreamFrame, warped: &'a mut Planes) -> Earlier<'a> {
        let ReferenceFrame { difference, shown, viewpoint, .. } = self;
        warp(difference, viewpoint, frame.viewpoint, frame.depths, warped);
        Earlier { warped, shown, difference }
    }
}

/// What an encoder of a stream remembers.
#[derive(Default)]
pub(super) struct StreamEncoder {
    references: References,
    /// Number of the last frame that is intra.
    key: Option<u32>,
    warped: Planes,
}

impl StreamEncoder {
    pub fn clear(&mut self) {
        self.references.clear();
        self.key = None;
    }

    /// Makes room for frames of a view.
    pub fn prepare(&mut self, viewpoint: &Viewpoint) {
        prepare(&mut self.warped, viewpoint);
        self.references.prepare(viewpoint);
    }

    /// What a frame may be predicted from.
    pub fn reference(
        &mut self,
        frame: &StreamFrame,
        structure: Structure,
        acknowledged: &Acknowledged,
    ) -> Option<(Reference, Earlier<'_>)> {
        self.prepare(frame.viewpoint);
        let position = frames_behind(self.key?, frame.frame);
        let key_every = structure.key_every();
        if key_every > 0 && position >= key_every {
            return None;
        }
        let suits = |kept: &ReferenceFrame| structure.suits(position, kept, acknowledged);
        let (reference, kept) = self.references.newest(frame.frame, suits)?;
        Some((reference, kept.seen_from(frame, &mut self.warped)))
    }

    /// Remembers a coded frame, if later ones may be predicted from it.
    pub fn keep(
        &mut self,
        frame: &StreamFrame,
        residual: &Residual,
        shown: &Picture,
        render: &Picture,
    ) {
        let Residual::Stream { reference, .. } = residual else { return };
        if reference.is_none() {
            self.key = Some(frame.frame);
        }
        let position = self.key.map_or(0, |key| frames_behind(key, frame.frame));
        self.references.keep(frame.frame, frame.viewpoint, position, shown, render);
    }
}

/// What a decoder of a stream remembers.
#[derive(Default)]
pub(super) struct StreamDecoder {
    references: References,
    warped: Planes,
    /// The render of the frame under way.
    render: Picture,
}

impl StreamDecoder {
    /// Whether a frame's reference is there, and the same as the encoder's.
    pub fn holds(&self, reference: Reference, frame: u32, viewpoint: &Viewpoint) -> bool {
        self.references.find(reference, frame, viewpoint).is_some()
    }

    /// The frame that a reference names, warped to a frame's view. `None` if it is missing.
    pub fn earlier(&mut self, reference: Reference, frame: &StreamFrame) -> Option<Earlier<'_>> {
        prepare(&mut self.warped, frame.viewpoint);
        let kept = self.references.find(reference, frame.frame, frame.viewpoint)?;
        Some(kept.seen_from(frame, &mut self.warped))
    }

    /// Takes the render of a frame, before anything is added to it.
    pub fn set_render(&mut self, frame: &StreamFrame, render: &Picture) {
        prepare(&mut self.warped, frame.viewpoint);
        self.references.prepare(frame.viewpoint);
        self.render.clone_from(render);
    }

    /// Remembers a frame that was decoded in full.
    pub fn keep(&mut self, frame: &StreamFrame, shown: &Picture) {
        self.references.keep(frame.frame, frame.viewpoint, 0, shown, &self.render);
    }
}

/// Gives planes the size of a view.
fn prepare(planes: &mut Planes, viewpoint: &Viewpoint) {
    planes.iter_mut().for_each(|plane| plane.resize(viewpoint.camera.pixels(), 0));
}

#[cfg(test)]
mod tests {
    use crate::Camera;
    use crate::search::Placement;

    use super::*;

    fn viewpoint() -> Viewpoint {
        let camera = Camera { width: 8, height: 6, fx: 9.0, fy: 9.0, cx: 4.0, cy: 3.0 };
        let placement = Placement { rotation: [1.0, 0.0, 0.0, 0.0], translation: [0.0; 3] };
        Viewpoint { camera, placement }
    }

    /// The distances that a structure chooses over frames that are all inter if they can be.
    fn distances(structure: Structure, frames: u32, heard: impl Fn(u32) -> Option<u32>) -> Vec<u8> {
        let (mut encoder, mut acknowledged) = (StreamEncoder::default(), Acknowledged::default());
        let (viewpoint, picture) = (viewpoint(), Picture::new(8, 6));
        let first = crate::packet::Latent::FRAMES - 3;
        let number = |i: u32| first.wrapping_add(i) % crate::packet::Latent::FRAMES;
        let distances = (0..frames).map(|i| {
            let frame = StreamFrame { frame: number(i), viewpoint: &viewpoint, depths: &[1.0; 48] };
            heard(i).map(number).into_iter().for_each(|frame| acknowledged.add(frame));
            let reference = encoder.reference(&frame, structure, &acknowledged).map(|(r, _)| r);
            let residual = Residual::Stream { reference, small_blocks: false, payload: &[] };
            encoder.keep(&frame, &residual, &picture, &picture);
            reference.map_or(0, |reference| reference.distance)
        });
        distances.collect()
    }

    #[test]
    fn a_chain_is_predicted_from_the_frame_before_up_to_the_next_key() {
        let found = distances(Structure::Chain { key_every: 4 }, 9, |_| None);
        assert_eq!(found, [0, 1, 1, 1, 0, 1, 1, 1, 0]);
        let endless = distances(Structure::Chain { key_every: 0 }, 100, |_| None);
        assert_eq!(endless.iter().filter(|distance| **distance == 0).count(), 1);
    }

    #[test]
    fn others_are_predicted_from_the_key() {
        let found = distances(Structure::Keys { key_every: 4 }, 9, |_| None);
        assert_eq!(found, [0, 1, 2, 3, 0, 1, 2, 3, 0]);
        // Beyond the frames that are remembered there is nothing to predict from.
        let far = distances(Structure::Keys { key_every: 0 }, 40, |_| None);
        assert_eq!((far[31], far[32], far[33], far[34]), (31, 32, 0, 1));
    }

    #[test]
    fn layers_are_predicted_from_lower_ones() {
        let found = distances(Structure::Layers { key_every: 10 }, 12, |_| None);
        assert_eq!(found, [0, 1, 2, 1, 4, 1, 2, 1, 4, 1, 0, 1]);
    }

    #[test]
    fn only_acknowledged_frames_are_references() {
        let found = distances(Structure::Acknowledged, 8, |i| [4, 7].contains(&i).then(|| i - 3));
        assert_eq!(found, [0, 0, 0, 0, 3, 4, 5, 3]);
        assert_eq!(distances(Structure::Acknowledged, 3, |_| None), [0, 0, 0]);
    }
}
