//! The device: a wall that a vehicle passes.

use std::sync::Arc;

use super::{Coder, RATE, Told, World};
use crate::LinkEncoder;
use crate::scene::{CAMERA, clean_frame, on_device, pose, wall};
use nvsprior::render::Scene;
use nvsprior::residual::{Interest, Structure};
use nvsprior::tracking::{FrameInfo, Hint};
use nvsprior::{Decoded, Decoder, Encoded, Encoder, EncoderOptions, Engine, Mode, Picture};

/// Different frames.
const FRAMES: usize = 16;

pub(super) struct Device {
    engine: Engine,
    scene: Arc<Scene>,
    frames: Arc<[Picture]>,
}

impl Device {
    pub fn new() -> Device {
        let (engine, scene) = on_device(&wall(5));
        let frames = (0..FRAMES).map(|t| clean_frame(&engine, &scene, &pose(t as f64))).collect();
        Device { engine, scene, frames }
    }
}

impl World for Device {
    type Encoder = DeviceEncoder;
    type Decoder = Decoder;

    fn encoder(
        &self,
        _: u32,
        first_frame: u32,
        stream: bool,
        predict_poses: bool,
    ) -> DeviceEncoder {
        let mode = if stream { Mode::Stream(Structure::Acknowledged) } else { Mode::Intra };
        let options = EncoderOptions { mode, first_frame, predict_poses, ..Default::default() };
        let encoder = Encoder::new(&self.engine, &self.scene, &CAMERA, options).unwrap();
        let (frames, encoded) = (self.frames.clone(), Encoded::default());
        DeviceEncoder { encoder, frames, encoded, is_first: true }
    }

    fn decoder(&self) -> Decoder {
        Decoder::new(&self.engine, &self.scene)
    }

    fn content(decoded: &Decoded) -> u64 {
        number_of(&decoded.picture)
    }
}

/// A number by which pictures differ.
fn number_of(picture: &Picture) -> u64 {
    crc32fast::hash(&picture.data).into()
}

pub(super) struct DeviceEncoder {
    encoder: Encoder,
    frames: Arc<[Picture]>,
    encoded: Encoded,
    is_first: bool,
}

impl Coder for DeviceEncoder {
    fn code(&mut self, number: u32, bytes: usize, time: f64) -> (Vec<u8>, Told) {
        // Forth and back along the wall.
        let step = (time * RATE) as usize % (2 * FRAMES - 2);
        let place = if step < FRAMES { step } else { 2 * FRAMES - 2 - step };
        let hint = std::mem::take(&mut self.is_first).then(|| Hint::of(pose(place as f64)));
        self.encoder.skip(number.wrapping_sub(self.encoder.frame_number()));
        self.encoder.set_steady_bytes(bytes);
        let info = FrameInfo { hint, time: Some(time) };
        self.encoder.encode_into(&self.frames[place], info, &mut self.encoded).unwrap();
        let told = (number_of(&self.encoded.picture), self.encoded.pose);
        (self.encoded.packet.clone(), told)
    }
}

impl LinkEncoder for DeviceEncoder {
    fn acknowledge(&mut self, frame: u32) {
        self.encoder.acknowledge(frame);
    }

    fn acknowledge_pose(&mut self, frame: u32, held: bool) {
        self.encoder.acknowledge_pose(frame, held);
    }

    fn announce(&mut self) {
        self.encoder.announce();
    }

    fn set_interest(&mut self, interest: Option<Interest>) {
        self.encoder.set_interest(interest);
    }

    fn size(&self) -> (u32, u32) {
        (CAMERA.width, CAMERA.height)
    }
}
