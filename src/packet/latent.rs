//! The latent part: header and pose, a picture by itself.

use super::bytes::{Reader, crc16};
use super::error::{PacketError, Part};
use super::head::{self, Head, PoseKind};
use super::known::PoseBound;
use super::pose::{PoseProfile, QuantisedPose};
use super::predicted::{Prediction, Stated};
use super::session::Session;

/// Bytes of the frame number, of the tag and of the check.
pub(super) const NUMBER: usize = 2;
const TAG: usize = 2;
pub(super) const CHECK: usize = 2;
/// Where the pose begins.
const POSE_AT: usize = head::LEN + NUMBER;
/// Later versions keep a check of all bytes before at the end of so many, if the pose's kind is one that is not known
/// here.
const LATER_LEN: usize = 18;

/// What a packet says first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latent {
    /// Frame number; its low 16 bits travel.
    pub frame: u32,
    /// Names prior and camera: [`Session::tag`](super::Session::tag).
    pub tag: u16,
    /// The pose to render at.
    pub pose: QuantisedPose,
    /// The pose is not certain: the picture does not confirm it.
    pub uncertain: bool,
    /// Within how much the position is known; `None`: it is not. It travels only if the pose is certain.
    pub known: Option<PoseBound>,
    /// The encoder's device draws what every portable device draws.
    pub portable: bool,
    /// The pose is stated as what it differs by from others; `None`: by itself, or the part was read.
    pub predicted: Option<Prediction>,
}

/// The latent part of a packet that was read, and where it ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Read {
    pub latent: Latent,
    pub head: Head,
    pub len: usize,
}

impl Latent {
    /// Frame numbers are sent modulo this.
    pub const FRAMES: u32 = 1 << 16;

    /// The latent part of a frame of a session, on a portable device, with its pose stated by itself.
    ///
    /// # Errors
    /// If the camera's size does not fit a packet.
    pub fn new(
        frame: u32,
        session: &Session,
        pose: QuantisedPose,
        uncertain: bool,
    ) -> Result<Latent, PacketError> {
        let tag = session.tag()?;
        Ok(Latent { frame, tag, pose, uncertain, known: None, portable: true, predicted: None })
    }

    /// The frame number that ends in the 16 bits that are stated: of all such, the one nearest to `last`, the number of
    /// a packet read before. If `last` is `None`, it is the 16 bits. It is right unless 32,768 frames in a row are
    /// missing.
    pub fn frame_near(&self, last: Option<u32>) -> u32 {
        nearest_frame(self.frame % Latent::FRAMES, Latent::FRAMES, last)
    }

    pub(super) fn pose_kind(&self) -> PoseKind {
        match self.predicted {
            Some(_) => PoseKind::Predicted,
            None => PoseKind::Absolute(self.pose.written_as()),
        }
    }

    /// Length of the part, bytes.
    pub fn encoded_len(&self) -> usize {
        let pose = match &self.predicted {
            Some(prediction) => prediction.len(),
            None => TAG + self.pose.written_as().encoded_len(),
        };
        head::LEN + NUMBER + pose + CHECK
    }

    /// Writes the part at the start of an empty packet.
    pub(super) fn write(&self, head: &Head, bytes: &mut Vec<u8>) -> Result<(), PacketError> {
        bytes.extend_from_slice(&head.bytes());
        bytes.extend_from_slice(&(self.frame as u16).to_le_bytes());
        let context = match &self.predicted {
            Some(prediction) => {
                bytes.extend(prediction.bytes());
                Some(prediction.context)
            }
            None => {
                if self.pose.profile() == PoseProfile::Free {
                    return Err(PacketError::Pose);
                }
                bytes.extend_from_slice(&self.tag.to_le_bytes());
                self.pose.write(bytes);
                None
            }
        };
        let check = check_of(context, bytes);
        bytes.extend_from_slice(&check.to_le_bytes());
        Ok(())
    }
}

/// The check of the bytes before it. `context`: of a predicted pose, what both sides must agree in.
fn check_of(context: Option<u32>, bytes: &[u8]) -> u16 {
    match context {
        Some(context) => crc16(&[&context.to_le_bytes(), bytes]),
        None => crc16(&[bytes]),
    }
}

/// Where the parts of a latent part lie, before its check is tested.
pub(super) struct Layout {
    pub head: Head,
    pub frame: u32,
    /// A pose that is predicted.
    pub stated: Option<Stated>,
    /// Length of the part, bytes.
    pub len: usize,
}

impl Layout {
    /// Reads the start of a packet.
    ///
    /// # Errors
    /// If the bytes are too few, or begin as no packet does.
    pub fn read(bytes: &[u8]) -> Result<Layout, PacketError> {
        let short =
            |needed| PacketError::TooShort { part: Part::Latent, needed, found: bytes.len() };
        let Some((first, number)) = bytes.split_first_chunk() else { return Err(short(POSE_AT)) };
        let head = Head::read(*first).ok_or_else(|| refusal(bytes))?;
        let number = number.get(..NUMBER).ok_or(short(POSE_AT))?;
        let frame = u16::from_le_bytes([number[0], number[1]]).into();
        let (stated, end) = match head.pose {
            PoseKind::Predicted => {
                let stated = Stated::read(bytes, POSE_AT)?;
                let end = stated.end;
                (Some(stated), end)
            }
            PoseKind::Absolute(profile) => (None, POSE_AT + TAG + profile.encoded_len()),
        };
        let len = end + CHECK;
        match bytes.len() < len {
            true if head::is_later(bytes[0]) => Err(refusal(bytes)),
            true => Err(short(len)),
            false => Ok(Layout { head, frame, stated, len }),
        }
    }

    /// Whether the check matches. `context`: see [`check_of`].
    pub fn matches(&self, bytes: &[u8], context: Option<u32>) -> bool {
        let (part, check) = bytes[..self.len].split_at(self.len - CHECK);
        check_of(context, part).to_le_bytes() == *check
    }

    /// What the part says, with the frame's whole number.
    pub fn latent(&self, frame: u32, tag: u16, pose: QuantisedPose) -> Latent {
        let Head { confidence, portable, .. } = self.head;
        let (uncertain, known) = (confidence.is_uncertain(), confidence.known());
        Latent { frame, tag, pose, uncertain, known, portable, predicted: None }
    }

    /// Reads the part if its pose is stated by itself.
    pub fn absolute(&self, bytes: &[u8], profile: PoseProfile) -> Result<Read, PacketError> {
        if !self.matches(bytes, None) {
            return Err(refusal(bytes));
        }
        let mut reader = Reader::new(&bytes[POSE_AT..], Part::Latent, self.len - POSE_AT)?;
        let tag = u16::from_le_bytes(reader.take());
        let pose = QuantisedPose::read(&mut reader, profile)?;
        Ok(Read { latent: self.latent(self.frame, tag, pose), head: self.head, len: self.len })
    }
}

/// Why bytes are no packet of this version.
fn refusal(bytes: &[u8]) -> PacketError {
    let part = bytes.get(..LATER_LEN).and_then(|part| part.split_last_chunk());
    let checked = part.is_some_and(|(part, check)| crc16(&[part]).to_le_bytes() == *check);
    // Garbage begins so, too.
    match checked && bytes.first().is_some_and(|first| head::is_later(*first)) {
        true => PacketError::Version,
        false => PacketError::Check(Part::Latent),
    }
}

/// Finds the frame number nearest to `last`, among those that are `frame` modulo `frames`.
pub fn nearest_frame(frame: u32, frames: u32, last: Option<u32>) -> u32 {
    let Some(last) = last else { return frame };
    let ahead = frame.wrapping_sub(last) % frames;
    let behind = if ahead > frames / 2 { frames } else { 0 };
    last.wrapping_add(ahead).wrapping_sub(behind)
}
