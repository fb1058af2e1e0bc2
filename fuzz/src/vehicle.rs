//! Packets as a vehicle sends them, and what must hold of those that a collector says it has.
use nvsprior::packet::{
    Extent, HeldPoses, Latent, PacketError, PoseProfile, QuantisedPose, Residual, Session,
};
use nvsprior::prior::CoordinateFrame;
use nvsprior::{Camera, Packet, Pose, PriorId};

const CAMERA: Camera = Camera { width: 64, height: 36, fx: 60.0, fy: 60.0, cx: 32.0, cy: 18.0 };
const SESSION: Session = Session { prior: PriorId(7), camera: CAMERA };
/// The low bits of a first byte that say that the pose is predicted.
const POSE: u8 = 0x1F;
const PREDICTED: u8 = 0b1_1001;

/// How a packet states its pose.
#[derive(Clone, Copy, PartialEq)]
pub enum Stated {
    Short,
    Compact,
    /// As what it differs by from that of the frame before.
    Predicted,
}

/// The packet of a frame; each one moves by `step`. `payload`: the residual's bytes, if it has one. `session`: prior
/// and camera are told.
pub fn packet(
    frame: u16,
    step: f64,
    stated: Stated,
    payload: Option<u8>,
    session: bool,
) -> Vec<u8> {
    let profile = if stated == Stated::Compact { PoseProfile::Compact } else { PoseProfile::Short };
    let own = latent(frame, step, profile);
    let mut held = HeldPoses::default();
    if stated == Stated::Predicted {
        let before = frame.wrapping_sub(1);
        let latent = latent(before, step, profile);
        held.hold(before.into(), &latent, &SESSION).expect("a camera that fits");
    }
    let check = SESSION.check().expect("a camera that fits");
    let latent = held.predict(&own, check).unwrap_or(own);
    let bytes: Vec<u8> = (0..payload.unwrap_or(0)).map(|i| i ^ frame as u8).collect();
    let residual = match payload {
        Some(_) => Residual::Coded { small_blocks: false, payload: &bytes },
        None => Residual::None,
    };
    let session = session.then_some(SESSION);
    Packet { latent, session, render: None, residual, truth: None }.encode().expect("small")
}

fn latent(frame: u16, step: f64, profile: PoseProfile) -> Latent {
    let origin = CoordinateFrame { centre: [0.0; 3], spread: 1.0 };
    let pose = Pose::exp(&[step * f64::from(frame % 512); 6]);
    let pose = QuantisedPose::quantise(&pose, &origin, profile).expect("a pose in range");
    Latent::new(frame.into(), &SESSION, pose, false).expect("small")
}

pub fn is_predicted(packet: &[u8]) -> bool {
    packet.first().is_some_and(|first| first & POSE == PREDICTED)
}

/// A complete packet's checks match, unless it needs other poses.
pub fn check_complete(bytes: &[u8]) {
    let extent = Extent::read(bytes).expect("a complete packet has a start");
    assert_eq!(extent.whole, Some(bytes.len()), "a complete packet is whole");
    match Packet::decode(bytes) {
        Ok(_) => {}
        Err(PacketError::PoseNotHeld { .. }) if is_predicted(bytes) => {}
        Err(error) => panic!("a complete packet is valid: {error}"),
    }
}

/// Whether bytes are the start of a packet. The high byte of a predicted one's number does not travel: it is that
/// nearest to the packet before.
pub fn is_start(bytes: &[u8], packet: &[u8]) -> bool {
    let high = is_predicted(packet).then_some(3);
    let same = |(at, (a, b))| a == b || Some(at) == high;
    bytes.len() <= packet.len() && bytes.iter().zip(packet).enumerate().all(same)
}
