//! The poses of the last frames, which those of later frames may be predicted from.

use crate::Camera;
use crate::prior::PriorId;

use super::camera_tag::{intrinsics, size_bytes};
use super::error::{PacketError, Part};
use super::form::{Follows, PREDICTED_FRAMES};
use super::latent::nearest_frame;
use super::pose::ShortCode;
use super::predicted::{FARTHEST, From, LONGEST_BASE, Prediction, Stated, is_predicted};
use super::{Latent, Session};

/// Frames that are remembered. Packets may be decoded some time after they came.
const SLOTS: usize = 128;

/// The poses of a stream of packets that a side holds, of its last 128 frames. A topside has one, and so has a vehicle:
/// of what it has sent, and of what the topside is known to hold.
#[derive(Clone, Debug, Default)]
pub struct HeldPoses {
    /// Each at its frame number modulo [`SLOTS`].
    slots: Vec<Option<HeldPose>>,
    /// The frame number that came last, modulo 2²⁴.
    last: Option<u32>,
}

/// A frame's pose, and what it is about.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeldPose {
    /// Frame number, modulo 2²⁴.
    frame: u32,
    pub pose: ShortCode,
    /// Names prior and camera, as the packet did.
    session: Session,
    update: Option<u8>,
    portable: bool,
    /// [`session_check`].
    check: u32,
}

/// What a frame is about, in 32 bits: the state of the prior, the camera, and whether the device is portable.
///
/// # Errors
/// If the camera's size does not fit a packet.
pub fn session_check(state: PriorId, camera: &Camera, latent: &Latent) -> Result<u32, PacketError> {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&state.to_bytes());
    hasher.update(&size_bytes(camera.width, camera.height)?);
    hasher.update(&intrinsics(camera));
    hasher.update(&[latent.portable.into(), latent.update.is_some().into()]);
    hasher.update(&[latent.update.unwrap_or(0)]);
    Ok(hasher.finalize())
}

impl HeldPoses {
    /// Takes all memory that it will need here; that of [`HeldPoses::default`] comes with the first pose.
    pub(crate) fn with_room() -> HeldPoses {
        HeldPoses { slots: vec![None; SLOTS], last: None }
    }

    /// Holds a frame's pose from here on, if later poses can be predicted from it. `session`: its [`session_check`].
    pub fn hold(&mut self, frame: u32, latent: &Latent, session: u32) {
        let frame = frame % Latent::FRAMES;
        let Some(pose) = latent.pose.short() else { return self.forget(frame) };
        self.put(HeldPose {
            frame,
            pose,
            session: latent.session,
            update: latent.update,
            portable: latent.portable,
            check: session,
        });
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

    /// A packet in the predicted form could not be read. What is held under its number is not its pose. If its check
    /// does not match, the vehicle means other poses than those that it is predicted from: it has begun anew.
    pub(crate) fn refuse(&mut self, packet: &[u8], error: &PacketError) {
        let Ok(Stated { frame, distance, base, .. }) = Stated::read(packet) else { return };
        let frame = nearest_frame(frame, PREDICTED_FRAMES, self.last);
        self.forget(frame);
        if *error == PacketError::Check(Part::Latent) {
            let reference = frame.wrapping_sub(distance);
            self.forget(reference);
            self.forget(reference.wrapping_sub(base));
        }
    }

    /// Forgets all.
    pub(crate) fn clear(&mut self) {
        self.slots.fill(None);
        self.last = None;
    }

    /// Whether the pose of a frame is held, whose number may be modulo 2¹⁶.
    pub(crate) fn holds(&self, frame: u32) -> bool {
        self.get(frame).is_some()
    }

    /// The frame number that came last.
    pub(crate) fn last(&self) -> Option<u32> {
        self.last
    }

    fn get(&self, frame: u32) -> Option<&HeldPose> {
        let pose = self.slots.get(frame as usize % SLOTS)?.as_ref()?;
        (pose.frame as u16 == frame as u16).then_some(pose)
    }

    /// Gives the latent part of a frame the predicted form, from the poses that are held of the same session. `None`:
    /// the short form takes as few bytes.
    pub fn predict(&self, frame: u32, latent: &Latent, session: u32) -> Option<Latent> {
        let pose = latent.pose.short()?;
        let mut best: Option<Prediction> = None;
        for distance in 1..=FARTHEST {
            for base in 0..=LONGEST_BASE {
                let Some((from, reference)) = self.from(frame, distance, base) else { continue };
                if reference.check != session {
                    break;
                }
                let Some(prediction) = Prediction::of(&pose, &from) else { continue };
                if best.is_none_or(|best| prediction.bits() < best.bits()) {
                    best = Some(prediction);
                }
            }
        }
        let predicted = Some(best?);
        let latent = Latent { predicted, ..*latent };
        (latent.encoded_len() < Latent { predicted: None, ..latent }.encoded_len())
            .then_some(latent)
    }

    /// Where a frame's pose is predicted from; `None`: not all of it is held, or it is of several sessions.
    fn from(&self, frame: u32, distance: u32, base: u32) -> Option<(From, &HeldPose)> {
        let reference = self.get(frame.wrapping_sub(distance))?;
        let before = match base {
            0 => None,
            _ => Some(self.get(reference.frame.wrapping_sub(base))?),
        };
        let is_other = |before: &HeldPose| {
            before.check != reference.check || before.pose.largest != reference.pose.largest
        };
        if before.is_some_and(is_other) {
            return None;
        }
        let mut hasher = crc32fast::Hasher::new();
        // A topside may not know more of the number.
        hasher.update(&(frame as u16).to_le_bytes());
        hasher.update(&reference.check.to_le_bytes());
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

    /// Reads the latent part of a packet in any form.
    ///
    /// # Errors
    /// If it is damaged, or what its pose is predicted from is not held.
    pub fn latent(&self, packet: &[u8]) -> Result<Latent, PacketError> {
        match is_predicted(packet) {
            true => self.read(packet).map(|(latent, _, _)| latent),
            false => Latent::decode(packet),
        }
    }

    /// Reads a latent part in the predicted form. Returns it as if it had the form of its reference, what follows it,
    /// and its length.
    ///
    /// # Errors
    /// [`PacketError::PoseNotHeld`] if what it is predicted from is not held.
    pub(super) fn read(&self, bytes: &[u8]) -> Result<(Latent, Follows, usize), PacketError> {
        let stated = Stated::read(bytes)?;
        let frame = nearest_frame(stated.frame, PREDICTED_FRAMES, self.last);
        let from = self.from(frame, stated.distance, stated.base);
        let reference = frame.wrapping_sub(stated.distance) % Latent::FRAMES;
        let (from, held) = from.ok_or(PacketError::PoseNotHeld { frame, reference })?;
        let pose = stated.pose(&from)?;
        let HeldPose { session, update, portable, .. } = *held;
        let latent =
            Latent { frame, session, update, pose, uncertain: false, portable, predicted: None };
        Ok((latent, stated.follows, stated.len))
    }
}
