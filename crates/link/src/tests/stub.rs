//! A stub in place of the device: packets as an encoder makes them, and pictures whose first bytes are what was seen.

use std::collections::VecDeque;

use super::{CAMERA_INTERVAL, Coder, Told, World};
use crate::{LinkDecoder, LinkEncoder};
use nvsprior::packet::{
    HeldPoses, Latent, Packet, PacketError, Parsed, PoseProfile, QuantisedPose, Reference,
    Residual, SentPoses, Session,
};
use nvsprior::prior::CoordinateFrame;
use nvsprior::residual::Interest;
use nvsprior::{Camera, Decoded, Error, Picture, Pose, PriorId};

const CAMERA: Camera = Camera { width: 16, height: 16, fx: 20.0, fy: 20.0, cx: 8.0, cy: 8.0 };
const SITE: CoordinateFrame = CoordinateFrame { centre: [0.0; 3], spread: 8.0 };
const SESSION: Session = Session { prior: PriorId(7), camera: CAMERA };
/// Frames that a difference picture may be predicted from.
const REFERENCES: u32 = 32;

pub(super) struct Stub;

impl World for Stub {
    type Encoder = StubEncoder;
    type Decoder = StubDecoder;

    fn encoder(&self, run: u32, first: u32, stream: bool, predicts: bool) -> StubEncoder {
        StubEncoder::new(run, first, stream, predicts)
    }

    fn decoder(&self) -> StubDecoder {
        StubDecoder::new()
    }

    fn content(decoded: &Decoded) -> u64 {
        u64::from_le_bytes(*decoded.picture.data.first_chunk().unwrap())
    }
}

impl Coder for StubEncoder {
    fn code(&mut self, number: u32, bytes: usize, _: f64) -> (Vec<u8>, Told) {
        self.frame = number;
        self.encode(bytes)
    }
}

/// What the camera saw: any two frames of a run differ.
fn seen(run: u32, frame: u32) -> u64 {
    let mixed = (u64::from(run) << 32 | u64::from(frame)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9) ^ mixed >> 32
}

fn pose(run: u32, frame: u32) -> QuantisedPose {
    let along = f64::from(frame % 500) * 0.004 + f64::from(run) * 0.3;
    let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.1], [along, 0.2 * along.sin(), 1.0]).unwrap();
    QuantisedPose::quantise(&pose, &SITE, PoseProfile::Short).unwrap()
}

/// Makes packets as an encoder does, of what a run of the vehicle sees.
pub(super) struct StubEncoder {
    run: u32,
    frame: u32,
    poses: Option<SentPoses>,
    session_age: Option<u32>,
    acknowledged: Vec<u32>,
    /// What was sent, by frame.
    sent: VecDeque<(u32, u64)>,
    stream: bool,
    asked: u32,
}

impl StubEncoder {
    fn new(run: u32, frame: u32, stream: bool, predicts: bool) -> StubEncoder {
        StubEncoder {
            run,
            frame,
            poses: predicts.then(SentPoses::default),
            session_age: None,
            acknowledged: Vec::new(),
            sent: VecDeque::new(),
            stream,
            asked: 0,
        }
    }

    /// A packet of at most so many bytes, if pose and session leave so many, and what it tells.
    fn encode(&mut self, bytes: usize) -> (Vec<u8>, Told) {
        let states = self.session_age.is_none_or(|age| age >= CAMERA_INTERVAL);
        let profile = if states { PoseProfile::Compact } else { PoseProfile::Short };
        let pose = pose(self.run, self.frame);
        let pose = match states {
            true => QuantisedPose::quantise(&pose.dequantise(&SITE), &SITE, profile).unwrap(),
            false => pose,
        };
        let exact = pose.dequantise(&SITE);
        let latent = Latent::new(self.frame, &SESSION, pose, false).unwrap();
        let latent = match self.poses.as_ref().filter(|_| !states) {
            Some(poses) => poses.predicted(&latent, &SESSION).unwrap(),
            None => latent,
        };
        let content = seen(self.run, self.frame);
        let reference = self.reference().filter(|_| !states);
        // An inter frame tells what it saw less what its reference saw.
        let base = reference.map_or(0, |(_, content)| content);
        let mut payload = content.wrapping_sub(base).to_le_bytes().to_vec();
        payload.push(1);
        let session = states.then_some(SESSION);
        let bare = Packet { latent, session, render: None, residual: Residual::None, truth: None };
        let room = bytes.saturating_sub(bare.encoded_len() + 5);
        payload.resize(payload.len().max(room.min(200)), 0x5A);
        let payload = payload.as_slice();
        let residual = match (self.stream, reference) {
            _ if room < 9 => Residual::Omitted,
            (false, _) => Residual::Coded { small_blocks: false, payload },
            (true, reference) => Residual::Stream {
                reference: reference.map(|(frame, content)| Reference {
                    distance: (self.frame - frame) as u8,
                    tag: content as u16,
                }),
                small_blocks: false,
                payload,
            },
        };
        let packet = Packet { residual, ..bare }.encode().unwrap();
        if let Some(poses) = &mut self.poses {
            poses.add(&latent, &SESSION).unwrap();
        }
        self.session_age = Some(if states { 1 } else { self.session_age.unwrap_or(0) + 1 });
        self.sent.push_back((self.frame, content));
        if self.sent.len() > 64 {
            self.sent.pop_front();
        }
        self.frame = self.frame.wrapping_add(1);
        let shown = if matches!(residual, Residual::Omitted) { 0 } else { content };
        (packet, (shown, exact))
    }

    /// The newest frame that was acknowledged, and what it saw.
    fn reference(&self) -> Option<(u32, u64)> {
        let near = |(frame, _): &&(u32, u64)| self.frame - frame < REFERENCES;
        let told = |(frame, _): &&(u32, u64)| self.acknowledged.contains(&(frame % (1 << 16)));
        self.sent.iter().rev().filter(near).find(told).copied().filter(|_| self.stream)
    }
}

impl LinkEncoder for StubEncoder {
    fn acknowledge(&mut self, frame: u32) {
        self.acknowledged.push(frame % (1 << 16));
    }

    fn acknowledge_pose(&mut self, frame: u32, held: bool) {
        if let Some(poses) = &mut self.poses {
            poses.acknowledge(frame, held);
        }
    }

    fn announce(&mut self) {
        self.session_age = None;
        self.asked += 1;
        self.acknowledged.clear();
        if let Some(poses) = &mut self.poses {
            poses.forget_acknowledged();
        }
    }

    fn set_interest(&mut self, _: Option<Interest>) {}

    fn size(&self) -> (u32, u32) {
        (CAMERA.width, CAMERA.height)
    }
}

/// Reads packets as a decoder does. Its picture's first eight bytes are what the camera saw, as far as it knows.
pub(super) struct StubDecoder {
    poses: HeldPoses,
    camera: Option<Camera>,
    /// What was decoded in full.
    kept: VecDeque<(u32, u64)>,
    last: Option<u32>,
}

impl StubDecoder {
    fn new() -> StubDecoder {
        let (kept, last) = (VecDeque::new(), None);
        StubDecoder { poses: HeldPoses::with_room(), camera: None, kept, last }
    }

    fn parse(&mut self, bytes: &[u8]) -> Result<(Parsed, u32), Error> {
        let packet = Parsed::with(bytes, &self.poses)
            .inspect_err(|error| self.poses.refuse(bytes, error))?;
        if let Ok(Some(session)) = packet.session() {
            self.camera = Some(session.camera);
        }
        let frame = packet.latent().frame_near(self.poses.last().or(self.last));
        Ok((packet, frame))
    }
}

impl LinkDecoder for StubDecoder {
    fn hold(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let (packet, frame) = self.parse(bytes)?;
        if self.camera.is_some() {
            self.poses.hold(frame, packet.latent(), &SESSION)?;
        }
        Ok(())
    }

    fn decode(&mut self, bytes: &[u8], decoded: &mut Decoded) -> Result<(), Error> {
        let (packet, frame) = self.parse(bytes)?;
        let latent = *packet.latent();
        if self.camera.is_none() {
            let (tag, prior) = (latent.tag, SESSION.prior);
            return Err(Error::SessionUnknown { frame, tag, prior, cameras: 0 });
        }
        decoded.picture.resize(CAMERA.width, CAMERA.height);
        decoded.picture.data.fill(0);
        (decoded.frame, decoded.pose) = (frame, latent.pose.dequantise(&SITE));
        (decoded.rows, decoded.kept, decoded.reference, decoded.damage) = (0, false, None, None);
        let content = |payload: &[u8]| Some(u64::from_le_bytes(*payload.first_chunk()?));
        match packet.residual(bytes) {
            Ok(Residual::Coded { payload, .. }) => {
                decoded.rows = 16;
                decoded.picture.data[..8].copy_from_slice(&content(payload).unwrap().to_le_bytes());
            }
            Ok(Residual::Stream { reference, payload, .. }) => {
                let base = match reference {
                    None => Some(0),
                    Some(Reference { distance, tag }) => {
                        let number = frame.wrapping_sub(distance.into());
                        decoded.reference = Some(number);
                        let is_it =
                            |(kept, seen): &&(u32, u64)| *kept == number && *seen as u16 == tag;
                        self.kept.iter().rev().find(is_it).map(|kept| kept.1)
                    }
                };
                match base {
                    Some(base) => {
                        let seen = content(payload).unwrap().wrapping_add(base);
                        decoded.picture.data[..8].copy_from_slice(&seen.to_le_bytes());
                        (decoded.rows, decoded.kept) = (16, true);
                        self.kept.push_back((frame, seen));
                        if self.kept.len() > 64 {
                            self.kept.pop_front();
                        }
                    }
                    None => decoded.damage = Some(PacketError::Pose.into()),
                }
            }
            _ => {}
        }
        self.last = Some(frame);
        Ok(self.poses.hold(frame, &latent, &SESSION)?)
    }

    fn draw(&mut self, _: &Pose, picture: &mut Picture) -> Result<bool, Error> {
        picture.resize(CAMERA.width, CAMERA.height);
        Ok(self.camera.is_some())
    }

    fn holds_pose(&self, frame: u32) -> bool {
        self.poses.holds(frame)
    }

    fn pose_of(&self, packet: &[u8]) -> Result<(Pose, bool), Error> {
        let latent = self.poses.latent(packet)?;
        Ok((latent.pose.dequantise(&SITE), !latent.uncertain))
    }

    fn camera(&self) -> Option<&Camera> {
        self.camera.as_ref()
    }

    fn add_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        self.camera = Some(*camera);
        Ok(())
    }
}
