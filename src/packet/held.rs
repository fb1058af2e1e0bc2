//! The poses of the last frames, which those of later frames may be predicted from.

use super::Session;
use super::error::{PacketError, Part};
use super::head::PoseKind;
use super::latent::{Latent, Layout, Read, nearest_frame};
use super::pose::ShortCode;
use super::predicted::{FARTHEST, From, LONGEST_BASE, Prediction, Stated};

/// Frames that are remembered. Packets may be decoded some time after they came.
const SLOTS: usize = 128;

/// The poses of a stream of packets that a side holds, of its last 128 frames. A topside has one, and so has a vehicle:
/// of what it has sent, and of what the topside is known to hold.
#[derive(Clone, Debug, Default)]
pub struct HeldPoses {
    /// Each at its frame number modulo [`SLOTS`].
    slots: Vec<Option<HeldPose>>,
    /// The frame number that came last.
    last: Option<u32>,
}

/// A frame's pose, and what it is about.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeldPose {
    /// Frame number.
    frame: u32,
    pub pose: ShortCode,
    /// [`Session::check`].
    session: u32,
}

impl HeldPoses {
    /// Takes all memory that it will need here; that of [`HeldPoses::default`] comes with the first pose.
    pub fn with_room() -> HeldPoses {
        HeldPoses { slots: vec![None; SLOTS], last: None }
    }

    /// Holds a frame's pose from here on, if later poses can be predicted from it. `session`: what the frame is about.
    ///
    /// # Errors
    /// If the camera's size does not fit a packet.
    pub fn hold(
        &mut self,
        frame: u32,
        latent: &Latent,
        session: &Session,
    ) -> Result<(), PacketError> {
        match latent.pose.short() {
            Some(pose) => self.put(HeldPose { frame, pose, session: session.check()? }),
            None => self.forget(frame),
        }
        Ok(())
    }

    fn put(&mut self, pose: HeldPose) {
        if self.slots.is_empty() {
            self.slots.resize(SLOTS, None);
        }
        self.slots[pose.frame as usize % SLOTS] = Some(pose);
        // One that is decoded some time after it came is not the last.
        let is_late = |last: u32| (1..SLOTS as u32).contains(&(last.wrapping_sub(pose.frame)));
        if !self.last.is_some_and(is_late) {
            self.last = Some(pose.frame);
        }
    }

    /// Holds the poses that `other` holds of a frame. `frame` may be modulo 2¹⁶.
    pub(crate) fn take_from(&mut self, other: &HeldPoses, frame: u32) {
        if let Some(pose) = other.get(frame) {
            self.put(*pose);
        }
    }

    /// Forgets the pose of a frame, which may be modulo 2¹⁶.
    pub(crate) fn forget(&mut self, frame: u32) {
        if self.holds(frame) {
            self.slots[frame as usize % SLOTS] = None;
        }
    }

    /// A packet with a predicted pose could not be read. What is held under its number is not its pose. If its check
    /// does not match, the vehicle means other poses than those that it is predicted from: it has begun anew.
    pub fn refuse(&mut self, packet: &[u8], error: &PacketError) {
        let Ok(Layout { frame, stated: Some(stated), .. }) = Layout::read(packet) else { return };
        let frame = self.nearest(frame);
        self.forget(frame);
        if *error == PacketError::Check(Part::Latent) {
            let reference = frame.wrapping_sub(stated.distance);
            self.forget(reference);
            self.forget(reference.wrapping_sub(stated.base));
        }
    }

    /// Completes the 16 bits of a frame number.
    fn nearest(&self, frame: u32) -> u32 {
        nearest_frame(frame, Latent::FRAMES, self.last)
    }

    /// Forgets all.
    pub(crate) fn clear(&mut self) {
        self.slots.fill(None);
        self.last = None;
    }

    /// Whether the pose of a frame is held, whose number may be modulo 2¹⁶.
    pub fn holds(&self, frame: u32) -> bool {
        self.get(frame).is_some()
    }

    /// The frame number that came last.
    pub fn last(&self) -> Option<u32> {
        self.last
    }

    fn get(&self, frame: u32) -> Option<&HeldPose> {
        let pose = self.slots.get(frame as usize % SLOTS)?.as_ref()?;
        (pose.frame as u16 == frame as u16).then_some(pose)
    }

    /// A frame's latent part with its pose stated as what it differs by from poses that are held of the same session.
    /// `session`: its [`Session::check`]. `None`: by itself the pose takes as few bytes.
    pub fn predict(&self, latent: &Latent, session: u32) -> Option<Latent> {
        let pose = latent.pose.short()?;
        let mut best: Option<Prediction> = None;
        for distance in 1..=FARTHEST {
            for base in 0..=LONGEST_BASE {
                let Some((from, reference)) = self.from(latent.frame, distance, base) else {
                    continue;
                };
                if reference.session != session {
                    break;
                }
                let Some(prediction) = Prediction::of(&pose, &from) else { continue };
                if best.is_none_or(|best| prediction.bits() < best.bits()) {
                    best = Some(prediction);
                }
            }
        }
        let predicted = Latent { predicted: Some(best?), ..*latent };
        (predicted.encoded_len() < latent.encoded_len()).then_some(predicted)
    }

    /// Where a frame's pose is predicted from; `None`: not all of it is held, or it is of several sessions.
    fn from(&self, frame: u32, distance: u32, base: u32) -> Option<(From, &HeldPose)> {
        let reference = self.get(frame.wrapping_sub(distance))?;
        let before = match base {
            0 => None,
            _ => Some(self.get(reference.frame.wrapping_sub(base))?),
        };
        let is_other = |before: &HeldPose| {
            before.session != reference.session || before.pose.largest != reference.pose.largest
        };
        if before.is_some_and(is_other) {
            return None;
        }
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&reference.session.to_le_bytes());
        for pose in [Some(reference), before].into_iter().flatten().map(|held| held.pose) {
            for number in pose.centre.iter().chain(&pose.small) {
                hasher.update(&number.to_le_bytes());
            }
            hasher.update(&[pose.largest as u8]);
        }
        let context = hasher.finalize();
        let before = before.map(|held| held.pose);
        Some((From { distance, reference: reference.pose, base, before, context }, reference))
    }

    /// Reads the latent part of a packet.
    ///
    /// # Errors
    /// If it is damaged, or what its pose is predicted from is not held.
    pub fn latent(&self, packet: &[u8]) -> Result<Latent, PacketError> {
        self.read(packet).map(|read| read.latent)
    }

    /// Reads the latent part of a packet, and tells where it ends.
    ///
    /// # Errors
    /// [`PacketError::PoseNotHeld`] if what its pose is predicted from is not held.
    pub(super) fn read(&self, bytes: &[u8]) -> Result<Read, PacketError> {
        let layout = Layout::read(bytes)?;
        match (layout.head.pose, &layout.stated) {
            (PoseKind::Absolute(profile), _) => layout.absolute(bytes, profile),
            (PoseKind::Predicted, Some(stated)) => self.predicted(&layout, stated, bytes),
            (PoseKind::Predicted, None) => Err(PacketError::Pose),
        }
    }

    fn predicted(
        &self,
        layout: &Layout,
        stated: &Stated,
        bytes: &[u8],
    ) -> Result<Read, PacketError> {
        let frame = self.nearest(layout.frame);
        let reference = frame.wrapping_sub(stated.distance);
        let from = self.from(frame, stated.distance, stated.base);
        let (from, held) = from.ok_or(PacketError::PoseNotHeld { frame, reference })?;
        if !layout.matches(bytes, Some(from.context)) {
            return Err(PacketError::Check(Part::Latent));
        }
        let (pose, tag) = (stated.pose(&from)?, held.session as u16);
        let latent = layout.latent(frame, tag, pose);
        Ok(Read { latent, head: layout.head, len: layout.len })
    }
}

impl Latent {
    /// Reads the latent part at the start of `bytes`, and nothing after it.
    ///
    /// # Errors
    /// If it is damaged, or states a predicted pose.
    pub fn decode(bytes: &[u8]) -> Result<Latent, PacketError> {
        HeldPoses::default().latent(bytes)
    }
}
