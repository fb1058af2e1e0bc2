//! What `nvspenc` does with a frame, without GStreamer's part of it.

use nvsprior::image::ImageView;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Camera, Encoded, Encoder, EncoderOptions, Error, Rate};

use crate::coding::{Coding, SetUpError, Views};
use crate::held_prior::HeldPrior;

/// What becomes of a frame.
#[derive(Debug)]
pub enum Taken {
    /// There is a packet, [`Frames::encoded`].
    Packet,
    /// No pose is known to start the search at.
    NoStart(Error),
}

pub struct Frames {
    encoder: Encoder,
    views: Views,
    encoded: Encoded,
    /// Frames per second.
    frame_rate: Option<f64>,
    /// Number of the next packet's frame, if all frames are sent.
    next: u32,
    /// When the frame before was taken, seconds, and its number.
    before: Option<(f64, u32)>,
    /// Why a property that changes while frames come was left aside.
    refused: Option<SetUpError>,
}

impl Frames {
    /// For frames of a size, as the properties say.
    pub fn new(
        held: &HeldPrior,
        coding: &Coding,
        size: (u32, u32),
        frame_rate: Option<f64>,
    ) -> Result<Frames, SetUpError> {
        let (camera, mut views, mask) = Views::new(coding, size)?;
        let options = EncoderOptions { rate: None, ..coding.encoder_options() };
        let mut encoder = Encoder::new(&held.engine, &held.scene, &camera, options)?;
        encoder.set_mask(mask.as_ref())?;
        views.look(coding, &mut encoder)?;
        Ok(Frames {
            encoder,
            views,
            encoded: Encoded::with_room(camera.width, camera.height),
            frame_rate,
            next: 0,
            before: None,
            refused: None,
        })
    }

    /// Goes on with frames of another size or rate. Numbers and poses carry over.
    pub fn change(
        &mut self,
        coding: &Coding,
        size: (u32, u32),
        frame_rate: Option<f64>,
    ) -> Result<(), SetUpError> {
        self.views = Views::changed(coding, size, &mut self.encoder)?;
        self.frame_rate = frame_rate;
        Ok(())
    }

    pub fn encoded(&self) -> &Encoded {
        &self.encoded
    }

    pub fn camera(&self) -> &Camera {
        self.encoder.camera()
    }

    /// The next packet is intra, and says what packets are about.
    pub fn announce(&mut self) {
        self.encoder.announce();
    }

    pub fn reset(&mut self) {
        self.encoder.reset();
        self.before = None;
    }

    /// Counts a frame that came at `time`, seconds. Numbers count all frames of the camera, also those that never came
    /// here, so that the topside knows when each was taken.
    fn number(&mut self, time: f64) -> u32 {
        let steps = match (self.before, self.frame_rate) {
            (None, _) => 0,
            (Some(_), None) => 1,
            (Some((before, _)), Some(rate)) => ((time - before) * rate).round().max(1.0) as u32,
        };
        let number = self.before.map_or(self.next, |(_, number)| number.wrapping_add(steps));
        self.before = Some((time, number));
        number
    }

    /// A frame's time, not before that of the frame before, whatever the source says.
    fn forward(&self, time: f64) -> f64 {
        self.before.map_or(time, |(before, _)| time.max(before))
    }

    /// Counts a frame that is not encoded.
    pub fn skip(&mut self, time: f64) {
        self.number(self.forward(time));
    }

    /// Encodes the frame of `time`, seconds.
    pub fn take(
        &mut self,
        image: &ImageView,
        time: f64,
        mut info: FrameInfo,
        coding: &Coding,
        rate: Option<Rate>,
    ) -> Result<Taken, Error> {
        let time = self.forward(time);
        let number = self.number(time);
        self.encoder.set_rate(rate);
        if let Err(error) = self.views.look(coding, &mut self.encoder) {
            self.refused = Some(error.into());
        }
        self.encoder.skip(number.wrapping_sub(self.next));
        self.next = number;
        info.time = Some(time);
        match self.encode(image, info) {
            Err(error @ Error::NoStart { .. }) => return Ok(Taken::NoStart(error)),
            done => done?,
        }
        self.next = number.wrapping_add(1);
        Ok(Taken::Packet)
    }

    /// Encodes the picture. A packet that also tells the camera may take more than its bytes.
    fn encode(&mut self, image: &ImageView, mut info: FrameInfo) -> Result<(), Error> {
        let picture = self.views.picture(image)?;
        let mut done = self.encoder.encode_into(picture, info, &mut self.encoded);
        if let Err(error @ (Error::HintPose { .. } | Error::HintFar { .. })) = done {
            self.refused = Some(error.into());
            info.hint = None;
            done = self.encoder.encode_into(picture, info, &mut self.encoded);
        }
        if let Err(Error::Budget { needed, .. }) = done {
            self.encoder.set_rate(Some(Rate::Bytes(needed)));
            done = self.encoder.encode_into(picture, info, &mut self.encoded);
        }
        done
    }

    /// Why a pose from outside or a region was left aside, if one was. What held before goes on.
    pub fn take_refused(&mut self) -> Option<SetUpError> {
        self.refused.take()
    }
}
