//! The vehicle's end: frames in, modem frames out.

use std::sync::Arc;

use crate::modem::Division;
use nvsprior::render::Scene;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Camera, Encoded, Encoder, EncoderOptions, Engine, Error, Picture};

use super::error::LinkError;
use super::options::VehicleOptions;
use super::vehicle_link::VehicleLink;

/// A camera frame.
#[derive(Clone, Copy)]
pub struct CameraFrame<'a> {
    /// When it was exposed, seconds on the clock of the calls.
    pub exposed: f64,
    /// The picture, of the camera's size.
    pub picture: &'a Picture,
    /// What is known of it besides. Its time is [`exposed`](Self::exposed) if it states none.
    pub info: FrameInfo,
    /// User bytes that travel with it: [`VehicleOptions::user_bytes`].
    pub user: &'a [u8],
}

/// The vehicle's end of a link: an encoder, and all that sends its packets.
///
/// Give it frames and what the modem received; take modem frames and events: see [the rooms' page](super).
pub struct Vehicle {
    encoder: Encoder,
    link: VehicleLink,
    encoded: Encoded,
}

impl Vehicle {
    /// Makes it for frames of `camera`'s size. Poses are predicted if the topside sends reports, unless
    /// [`VehicleOptions::state_poses`] says otherwise.
    ///
    /// # Errors
    /// As [`VehicleLink::new`] and [`Encoder::new`].
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        encoder: EncoderOptions,
        options: &VehicleOptions,
    ) -> Result<Vehicle, LinkError> {
        let link = VehicleLink::new(options)?;
        let predict_poses = options.expect_reports && !options.state_poses;
        let encoder = EncoderOptions { predict_poses, first_frame: link.next_frame(), ..encoder };
        let encoder = Encoder::new(engine, scene, camera, encoder)?;
        let encoded = Encoded::with_room(camera.width, camera.height);
        Ok(Vehicle { encoder, link, encoded })
    }

    /// Takes a camera frame: all of them count. `ready` tells the time once it is coded. `None`: it is left out, as the
    /// link has no bytes for it. [`Vehicle::encoded`] is what it came to.
    ///
    /// # Errors
    /// If the frame cannot be encoded. The next one goes on from the frame before.
    pub fn frame(
        &mut self,
        now: f64,
        frame: &CameraFrame,
        ready: impl FnOnce() -> f64,
    ) -> Result<Option<Division>, LinkError> {
        let CameraFrame { exposed, picture, info, user } = *frame;
        let Some(planned) = self.link.plan(now, exposed)? else { return Ok(None) };
        self.link.instruct(&mut self.encoder).map_err(Error::from)?;
        self.encoder.skip(planned.number.wrapping_sub(self.encoder.frame_number()));
        self.encoder.set_steady_bytes(planned.bytes);
        let info = FrameInfo { time: info.time.or(Some(exposed)), ..info };
        let encoded = self.encoder.encode_into(picture, info, &mut self.encoded);
        encoded.inspect_err(|_| self.link.drop_plan())?;
        self.link.push(ready(), &self.encoded.packet, user).map(Some)
    }

    /// What the last frame came to that was encoded.
    pub fn encoded(&self) -> &Encoded {
        &self.encoded
    }

    /// The encoder: its mask, its camera.
    pub fn encoder(&mut self) -> &mut Encoder {
        &mut self.encoder
    }

    /// The end without its encoder: what the modem received goes in, modem frames and events come out. Its frames are
    /// those of [`Vehicle::frame`].
    pub fn link(&mut self) -> &mut VehicleLink {
        &mut self.link
    }
}
