//! What an end needs of encoder and decoder.

use nvsprior::residual::Interest;
use nvsprior::{Camera, Decoded, Decoder, Encoder, Error, Picture, Pose, Trust};

/// An encoder, as far as a vehicle's end tells it what the topside said.
pub trait LinkEncoder {
    /// See [`Encoder::acknowledge`].
    fn acknowledge(&mut self, frame: u32);
    /// See [`Encoder::acknowledge_pose`].
    fn acknowledge_pose(&mut self, frame: u32, held: bool);
    /// See [`Encoder::announce`].
    fn announce(&mut self);
    /// See [`Encoder::set_interest`].
    fn set_interest(&mut self, interest: Option<Interest>);
    /// Width and height of the next frame's picture, pixels.
    fn size(&self) -> (u32, u32);
}

impl LinkEncoder for Encoder {
    fn acknowledge(&mut self, frame: u32) {
        self.acknowledge(frame);
    }

    fn acknowledge_pose(&mut self, frame: u32, held: bool) {
        self.acknowledge_pose(frame, held);
    }

    fn announce(&mut self) {
        self.announce();
    }

    fn set_interest(&mut self, interest: Option<Interest>) {
        self.set_interest(interest);
    }

    fn size(&self) -> (u32, u32) {
        (self.camera().width, self.camera().height)
    }
}

/// A decoder, as far as a topside's end asks it.
pub trait LinkDecoder {
    /// See [`Decoder::hold`].
    ///
    /// # Errors
    /// As there.
    fn hold(&mut self, packet: &[u8]) -> Result<(), Error>;
    /// Decodes the undamaged start of a packet: [`Decoder::decode_into`].
    ///
    /// # Errors
    /// As there.
    fn decode(&mut self, packet: &[u8], decoded: &mut Decoded) -> Result<(), Error>;
    /// See [`Decoder::draw`].
    ///
    /// # Errors
    /// As there.
    fn draw(&mut self, pose: &Pose, picture: &mut Picture) -> Result<bool, Error>;
    /// See [`Decoder::holds_pose`].
    fn holds_pose(&self, frame: u32) -> bool;
    /// See [`Decoder::pose_of`].
    ///
    /// # Errors
    /// As there.
    fn pose_of(&self, packet: &[u8]) -> Result<(Pose, bool), Error>;
    /// See [`Decoder::camera`].
    fn camera(&self) -> Option<&Camera>;
    /// See [`Decoder::add_camera`].
    ///
    /// # Errors
    /// As there.
    fn add_camera(&mut self, camera: &Camera) -> Result<(), Error>;
}

impl LinkDecoder for Decoder {
    fn hold(&mut self, packet: &[u8]) -> Result<(), Error> {
        self.hold(packet)
    }

    fn decode(&mut self, packet: &[u8], decoded: &mut Decoded) -> Result<(), Error> {
        self.decode_into(packet, Trust::Start, decoded)
    }

    fn draw(&mut self, pose: &Pose, picture: &mut Picture) -> Result<bool, Error> {
        self.draw(pose, picture)
    }

    fn holds_pose(&self, frame: u32) -> bool {
        self.holds_pose(frame)
    }

    fn pose_of(&self, packet: &[u8]) -> Result<(Pose, bool), Error> {
        self.pose_of(packet)
    }

    fn camera(&self) -> Option<&Camera> {
        self.camera()
    }

    fn add_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        self.add_camera(camera)
    }
}
