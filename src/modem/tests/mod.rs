//! Packets to modem frames and back.

mod predicted;
mod protected;
mod unprotected;
mod updates;

use crate::packet::{Coder, Latent, Packet, PoseProfile, QuantisedPose, Residual};
use crate::prior::{CoordinateFrame, PriorId};
use crate::{Camera, Pose};

const PRIOR: PriorId = PriorId(0xd4a5_d0ed);
const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 274.5, fy: 274.25, cx: 160.0, cy: 90.0 };

/// What a packet is made of; the payload's length, if there is one.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    pub frame: u32,
    pub profile: PoseProfile,
    pub camera: bool,
    pub payload: Option<usize>,
}

/// The packet of a recipe. Packets that differ in frame number or length do so in the pose, too.
pub fn packet_of(recipe: Recipe) -> Vec<u8> {
    let Recipe { frame, profile, camera, payload } = recipe;
    let frame_of_prior = CoordinateFrame { centre: [-3.5, 2.25, 24.0], spread: 8.25 };
    let turn = f64::from((frame + 1000 * payload.unwrap_or(0) as u32) % 10_007) * 1e-4;
    let pose = Pose::from_wxyz([0.9, 0.1, -0.3, turn], [1.0, turn, 3.0]).unwrap();
    let pose = QuantisedPose::quantise(&pose, &frame_of_prior, profile).unwrap();
    let latent = Latent::new(frame, PRIOR, &CAMERA, pose, false).unwrap();
    let latent = match profile {
        PoseProfile::Short => latent.shortened(PRIOR, &CAMERA).unwrap(),
        _ => latent,
    };
    let camera = camera && !latent.is_short();
    let residual = match payload {
        Some(len) => Residual::Coded { coder: Coder::Vp8, payload: noise(frame, len).leak() },
        None => Residual::None,
    };
    Packet { latent, camera: camera.then_some(CAMERA), render: None, residual, truth: None }
        .encode()
        .unwrap()
}

pub fn noise(seed: u32, len: usize) -> Vec<u8> {
    let step = |v: &u32| Some(v.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    std::iter::successors(Some(seed ^ 0x9E37_79B9), step)
        .map(|v| (v >> 24) as u8)
        .take(len)
        .collect()
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
