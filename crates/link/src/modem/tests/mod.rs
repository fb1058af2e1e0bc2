//! Packets to modem frames and back.

mod predicted;
mod protected;
mod unprotected;

use nvsprior::packet::{Latent, Packet, PoseProfile, QuantisedPose, Residual, Session};
use nvsprior::prior::{CoordinateFrame, PriorId};
use nvsprior::{Camera, Pose};

const PRIOR: PriorId = PriorId(0xd4a5_d0ed);
const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 274.5, fy: 274.25, cx: 160.0, cy: 90.0 };
const SESSION: Session = Session { prior: PRIOR, camera: CAMERA };

/// What a packet is made of; the payload's length, if there is one.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    pub frame: u32,
    pub profile: PoseProfile,
    /// It states prior and camera.
    pub stated: bool,
    pub payload: Option<usize>,
}

/// The packet of a recipe. Packets that differ in frame number or length do so in the pose, too.
pub fn packet_of(recipe: Recipe) -> Vec<u8> {
    let Recipe { frame, profile, stated, payload } = recipe;
    let frame_of_prior = CoordinateFrame { centre: [-3.5, 2.25, 24.0], spread: 8.25 };
    let turn = f64::from((frame + 1000 * payload.unwrap_or(0) as u32) % 10_007) * 1e-3;
    let pose = Pose::from_wxyz([0.9, 0.1, -0.3, turn], [1.0, turn, 3.0]).unwrap();
    let pose = QuantisedPose::quantise(&pose, &frame_of_prior, profile).unwrap();
    let residual = match payload {
        Some(len) => Residual::Coded { small_blocks: false, payload: noise(frame, len).leak() },
        None => Residual::None,
    };
    let session = stated.then_some(SESSION);
    Packet { latent: latent_of(frame, pose), session, render: None, residual, truth: None }
        .encode()
        .unwrap()
}

pub fn latent_of(frame: u32, pose: QuantisedPose) -> Latent {
    let tag = SESSION.tag().unwrap();
    Latent { frame, tag, pose, uncertain: false, known: None, portable: true, predicted: None }
}

/// Bytes, of which the last one is not zero.
pub fn noise(seed: u32, len: usize) -> Vec<u8> {
    let step = |v: &u32| Some(v.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let words = std::iter::successors(Some(seed ^ 0x9E37_79B9), step);
    let mut bytes: Vec<u8> = words.map(|v| (v >> 24) as u8).take(len).collect();
    bytes.last_mut().into_iter().for_each(|last| *last |= 1);
    bytes
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
