//! Packets of the paper's system.
//!
//! | bytes | content |
//! |---|---|
//! | 1 | 0: no difference picture, 1: WebP without what the packet says anyway, 2: a WebP file; 128 more: prior and camera follow |
//! | 28 | the pose: translation (x, y, z) and quaternion (w, x, y, z), f32 |
//! | 4 | CRC-32 of all other bytes |
//! | 24 | if stated: prior, width and height (u16), fx, fy, cx, cy (f32) |
//! | … | the difference picture |
//!
//! Numbers are little endian. The first packet of an encoder states prior and camera.

use nvsprior::packet::QuantisedPose;
use nvsprior::parts::{FREE, PoseCode};
use nvsprior::{Camera, PriorId};

use crate::error::Error;
use crate::webp::Payload;

/// Bytes of the pose, as in the paper.
pub const POSE_LEN: usize = 28;
/// Bytes in front of the difference picture of a packet that states no camera.
pub const HEAD_LEN: usize = CHECK_AT + 4;
/// Bytes that prior and camera take.
pub const SESSION_LEN: usize = 24;

const CHECK_AT: usize = 1 + POSE_LEN;
const STATES_SESSION: u8 = 0x80;

/// What packets are about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Session {
    pub prior: PriorId,
    pub camera: Camera,
}

impl Session {
    fn write(&self, bytes: &mut Vec<u8>) {
        let Camera { width, height, fx, fy, cx, cy } = self.camera;
        bytes.extend(self.prior.to_bytes());
        // A camera that can be drawn has at most 4096 pixels along a side.
        [width, height].iter().for_each(|side| bytes.extend((*side as u16).to_le_bytes()));
        [fx, fy, cx, cy].iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    }

    fn read(bytes: &[u8; SESSION_LEN]) -> Session {
        let word = |at: usize| std::array::from_fn(|i| bytes[at + i]);
        let side = |at: usize| u32::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
        let float = |at: usize| f32::from_le_bytes(word(at));
        let (width, height) = (side(4), side(6));
        let [fx, fy, cx, cy] = [8, 12, 16, 20].map(float);
        Session {
            prior: PriorId::from_bytes(word(0)),
            camera: Camera { width, height, fx, fy, cx, cy },
        }
    }
}

/// A frame as it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Packet<'a> {
    pub pose: QuantisedPose,
    pub session: Option<Session>,
    pub payload: Option<Payload<'a>>,
}

impl<'a> Packet<'a> {
    /// Replaces the content of `bytes`.
    pub fn write(&self, bytes: &mut Vec<u8>) {
        let kind = self.payload.map_or(0, |payload| 1 + u8::from(payload.whole));
        bytes.clear();
        bytes.push(kind | if self.session.is_some() { STATES_SESSION } else { 0 });
        bytes.extend(self.pose.words().words.iter().flat_map(|word| word.to_le_bytes()));
        bytes.extend([0; 4]);
        self.session.iter().for_each(|session| session.write(bytes));
        self.payload.iter().for_each(|payload| bytes.extend(payload.bytes));
        let check = check_of(bytes);
        bytes[CHECK_AT..HEAD_LEN].copy_from_slice(&check);
    }

    /// Reads a packet.
    ///
    /// # Errors
    /// If its check does not match, or its pose is none.
    pub fn read(bytes: &'a [u8]) -> Result<Packet<'a>, Error> {
        let short = |needed| Error::TooShort { found: bytes.len(), needed };
        let (head, rest) = bytes.split_first_chunk::<HEAD_LEN>().ok_or(short(HEAD_LEN))?;
        if head[CHECK_AT..] != check_of(bytes) {
            return Err(Error::Check);
        }
        let words = head[1..CHECK_AT].as_chunks::<4>().0;
        let words = std::array::from_fn(|i| i32::from_le_bytes(words[i]));
        let pose =
            QuantisedPose::of_words(&PoseCode { profile: FREE, words }).map_err(|_| Error::Pose)?;
        let (session, rest) = match head[0] & STATES_SESSION {
            0 => (None, rest),
            _ => {
                let (session, rest) =
                    rest.split_first_chunk().ok_or(short(HEAD_LEN + SESSION_LEN))?;
                (Some(Session::read(session)), rest)
            }
        };
        let payload = match head[0] & !STATES_SESSION {
            0 => None,
            kind @ (1 | 2) => Some(Payload { whole: kind == 2, bytes: rest }),
            _ => return Err(Error::Check),
        };
        Ok(Packet { pose, session, payload })
    }
}

/// The check of a packet's other bytes.
fn check_of(packet: &[u8]) -> [u8; 4] {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&packet[..CHECK_AT]);
    hasher.update(&packet[HEAD_LEN..]);
    hasher.finalize().to_le_bytes()
}

#[cfg(test)]
mod tests {
    use nvsprior::Pose;
    use nvsprior::packet::PoseProfile;
    use nvsprior::prior::CoordinateFrame;
    use proptest::prelude::*;

    use super::*;

    const CAMERA: Camera =
        Camera { width: 320, height: 180, fx: 250.5, fy: 251.0, cx: 160.0, cy: 90.25 };

    fn pose(tau: [f64; 6]) -> QuantisedPose {
        let frame = CoordinateFrame { centre: [0.0; 3], spread: 1.0 };
        QuantisedPose::quantise(&Pose::exp(&tau), &frame, PoseProfile::Free).unwrap()
    }

    proptest! {
        #[test]
        fn what_was_written_is_read(
            tau in prop::array::uniform6(-2.0..2.0),
            stated in any::<bool>(),
            payload in prop::option::of((any::<bool>(), prop::collection::vec(any::<u8>(), 0..40))),
        ) {
            let session = stated.then_some(Session { prior: PriorId(77), camera: CAMERA });
            let payload = payload.as_ref().map(|(whole, bytes)| Payload { whole: *whole, bytes });
            let packet = Packet { pose: pose(tau), session, payload };
            let mut bytes = Vec::new();
            packet.write(&mut bytes);
            prop_assert_eq!(Packet::read(&bytes).unwrap(), packet);
        }

        #[test]
        fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            let _ = Packet::read(&bytes);
        }

        #[test]
        fn damage_is_found(at in any::<prop::sample::Index>(), bit in 0..8) {
            let session = Some(Session { prior: PriorId(77), camera: CAMERA });
            let payload = Some(Payload { whole: false, bytes: &[1, 2, 3] });
            let mut bytes = Vec::new();
            Packet { pose: pose([0.1; 6]), session, payload }.write(&mut bytes);
            let at = at.index(bytes.len());
            bytes[at] ^= 1_u8 << bit;
            prop_assert!(Packet::read(&bytes).is_err());
        }
    }
}
