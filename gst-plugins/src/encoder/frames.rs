//! What `nvspenc` does with a frame, without GStreamer's part of it.

use nvsprior::image::{Converter, ImageView, Mask};
use nvsprior::modem::{ModemError, RateControl};
use nvsprior::packet::Extent;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Camera, Encoded, Encoder, Error, Picture, Rate};

use crate::budget::Budget;
use crate::held_prior::HeldPrior;
use crate::property::{self, PropertyError};

use super::settings::{RateKind, Settings};

#[derive(Debug, thiserror::Error)]
pub enum FramesError {
    #[error(transparent)]
    Property(#[from] PropertyError),
    #[error(transparent)]
    Library(#[from] Error),
    #[error("{0}; this is about the properties bit-rate, mtu, latency, delay, spread, loss, burst")]
    Modem(#[from] ModemError),
}

/// What becomes of a frame.
#[derive(Debug)]
pub enum Taken {
    /// There is a packet, [`Frames::encoded`]. A budget if the link decides the rate.
    Packet(Option<Budget>),
    /// The link has no bytes for it.
    LeftOut,
    /// The budget holds no packet. The text says what would help.
    TooSmall(ModemError),
    /// No pose is known to start the search at.
    NoStart(Error),
}

pub struct Frames {
    encoder: Encoder,
    converter: Converter,
    picture: Picture,
    encoded: Encoded,
    /// While the link decides the rate.
    control: Option<RateControl>,
    /// Frames per second.
    frame_rate: Option<f64>,
    /// Number of the next packet's frame, if all frames are sent.
    next: u32,
    /// When the frame before was taken, seconds, and its number.
    before: Option<(f64, u32)>,
    /// The region of interest as the properties had it last, and its weight.
    region: Option<(String, u32)>,
    /// Why a property that changes while frames come was left aside.
    refused: Option<FramesError>,
}

impl Frames {
    /// For frames of a size, as the properties say.
    pub fn new(
        held: &HeldPrior,
        settings: &Settings,
        size: (u32, u32),
        frame_rate: Option<f64>,
    ) -> Result<Frames, FramesError> {
        let (camera, converter, mask) = views(settings, size)?;
        let (engine, scene) = (&held.engine, &held.scene);
        let mut encoder = Encoder::new(engine, scene, &camera, settings.encoder_options())?;
        encoder.set_mask(mask.as_ref())?;
        let mut frames = Frames {
            encoder,
            converter,
            picture: Picture::new(camera.width, camera.height),
            encoded: Encoded::with_room(camera.width, camera.height),
            control: None,
            frame_rate,
            next: 0,
            before: None,
            region: None,
            refused: None,
        };
        frames.look(settings)?;
        Ok(frames)
    }

    /// Follows the region of interest.
    fn look(&mut self, settings: &Settings) -> Result<(), PropertyError> {
        let region = settings.region.clone().map(|text| (text, settings.region_weight));
        if self.region == region {
            return Ok(());
        }
        self.region = region;
        let Camera { width, height, .. } = *self.encoder.camera();
        let weight = |weight: u32| u8::try_from(weight).unwrap_or(u8::MAX);
        let interest = self.region.as_ref();
        let interest = interest
            .map(|(text, of)| property::region(text, (width, height), weight(*of)))
            .transpose()?;
        self.encoder.set_interest(interest);
        Ok(())
    }

    /// Goes on with frames of another size or rate. Numbers and poses carry over.
    pub fn change(
        &mut self,
        settings: &Settings,
        size: (u32, u32),
        frame_rate: Option<f64>,
    ) -> Result<(), FramesError> {
        let (camera, converter, mask) = views(settings, size)?;
        self.encoder.set_mask(None)?;
        self.encoder.set_camera(&camera)?;
        self.encoder.set_mask(mask.as_ref())?;
        self.converter = converter;
        self.control = None;
        self.frame_rate = frame_rate;
        self.region = None;
        Ok(self.look(settings)?)
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
        self.control = None;
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
        settings: &Settings,
    ) -> Result<Taken, FramesError> {
        let time = self.forward(time);
        let number = self.number(time);
        let budget = match settings.rate {
            RateKind::Link => match self.plan(time, settings)? {
                Ok(planned) => Some(planned),
                Err(outcome) => return Ok(outcome),
            },
            _ => {
                self.control = None;
                self.encoder.set_rate(settings.fixed_rate());
                None
            }
        };
        if let Err(error) = self.look(settings) {
            self.refused = Some(error.into());
        }
        self.converter.convert(image, &mut self.picture).map_err(Error::from)?;
        self.encoder.skip(number.wrapping_sub(self.next));
        self.next = number;
        info.time = Some(time);
        match self.encode(info) {
            Err(error @ Error::NoStart { .. }) => return Ok(Taken::NoStart(error)),
            done => done?,
        }
        self.next = number.wrapping_add(1);
        match budget {
            None => Ok(Taken::Packet(None)),
            Some(budget) => self.spend(time, budget),
        }
    }

    /// The budget of a frame, and its rate.
    fn plan(&mut self, now: f64, settings: &Settings) -> Result<Result<Budget, Taken>, ModemError> {
        let options = settings.rate_control(self.frame_rate);
        let control = match &mut self.control {
            Some(control) => control,
            none => none.insert(RateControl::new(options)?),
        };
        if control.options().bit_rate != options.bit_rate {
            control.set_bit_rate(now, options.bit_rate)?;
        }
        if control.options().loss != options.loss {
            control.set_loss(options.loss)?;
        }
        let Some(budget) = control.plan(now) else { return Ok(Err(Taken::LeftOut)) };
        match control.capacity(budget) {
            Ok(bytes) => {
                // A packet that tells the camera takes more, for once.
                self.encoder.set_steady_bytes(bytes);
                Ok(Ok(Budget::of(control, budget, settings.tag())))
            }
            Err(error) => Ok(Err(Taken::TooSmall(error))),
        }
    }

    /// Encodes the picture. A packet that also tells the camera may take more than its bytes: what does not fit its
    /// shares is cut off.
    fn encode(&mut self, mut info: FrameInfo) -> Result<(), Error> {
        let mut done = self.encoder.encode_into(&self.picture, info, &mut self.encoded);
        if let Err(error @ (Error::HintPose { .. } | Error::HintFar { .. })) = done {
            self.refused = Some(error.into());
            info.hint = None;
            done = self.encoder.encode_into(&self.picture, info, &mut self.encoded);
        }
        if let Err(Error::Budget { needed, .. }) = done {
            self.encoder.set_rate(Some(Rate::Bytes(needed)));
            done = self.encoder.encode_into(&self.picture, info, &mut self.encoded);
        }
        done
    }

    /// Why a pose from outside or a region was left aside, if one was. What held before goes on.
    pub fn take_refused(&mut self) -> Option<FramesError> {
        self.refused.take()
    }

    /// Counts what the packet takes of the link.
    fn spend(&mut self, now: f64, mut budget: Budget) -> Result<Taken, FramesError> {
        let packet = &self.encoded.packet;
        let picture = Extent::read(packet).map_err(Error::from)?.head;
        let Some(control) = &mut self.control else { return Ok(Taken::Packet(Some(budget))) };
        match control.divide_longer(budget.bytes as usize, picture, packet.len()) {
            Ok((sharing, bytes)) => {
                budget.bytes = u32::try_from(bytes).unwrap_or(u32::MAX);
                control.sent(now + control.options().delay, control.cost(&sharing));
                Ok(Taken::Packet(Some(budget)))
            }
            Err(error) => {
                // The topside has not heard of what this packet says.
                self.encoder.announce();
                Ok(Taken::TooSmall(error))
            }
        }
    }
}

/// The camera, what makes its pictures of frames of a size, and which of their pixels count.
fn views(
    settings: &Settings,
    size: (u32, u32),
) -> Result<(Camera, Converter, Option<Mask>), FramesError> {
    let lens = settings.lens.as_deref().map(property::lens).transpose()?;
    let mask = settings.mask.as_deref().map(property::mask).transpose()?;
    let camera = match (&settings.camera, &lens) {
        (Some(camera), _) => property::camera(camera, size)?,
        (None, Some(lens)) => lens.pinhole(),
        (None, None) => {
            let what = "give fx,fy,cx,cy or width,height,fx,fy,cx,cy in pixels, or a lens";
            return Err(PropertyError::Missing("camera", what).into());
        }
    };
    let camera = camera.at_most_wide(settings.width);
    camera.check().map_err(PropertyError::from)?;
    let Some(lens) = lens else {
        let converter = Converter::new(camera.width, camera.height).map_err(Error::from)?;
        let mask = mask.map(|mask| mask.resized(camera.width, camera.height));
        return Ok((camera, converter, mask));
    };
    let converter = Converter::undistorting(&lens, &camera).map_err(PropertyError::from)?;
    let mask = match mask {
        Some(mask) => Some(mask.undistorted(&lens, &camera).map_err(PropertyError::from)?),
        None => converter.covered().cloned(),
    };
    Ok((camera, converter, mask))
}
