//! What an end keeps over a restart: a few bytes that its owner stores.
//!
//! Numbers are set aside before they are used, so that none is used twice if the program is killed.
//!
//! | bytes | content, little endian |
//! |---|---|
//! | 4 | `NVS1` |
//! | 1 | 0: a vehicle's; 1: a topside's |
//! | 8, 8 | epoch of the keys, number of what goes next; 0 without keys |
//! | 4 | number of the next frame; 0 of a topside |
//! | 1 | how many streams of keys have brought something |
//! | 13 each | id of the key (4), stream (1), greatest number that was taken (8) |
//! | 1 | 1: a camera follows |
//! | 24 | width, height, and as `f32` focal lengths and principal point |
//! | 4 | CRC-32 of all before |

use crate::keys::{KeyId, Keys, MAX_KEYS, Seen};
use nvsprior::Camera;

use super::error::LinkError;

/// Whose it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Vehicle,
    Topside,
}

/// What is kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Stored {
    pub epoch: u64,
    /// Number of what goes next.
    pub next: u64,
    pub frame: u32,
    pub seen: Vec<Seen>,
    pub camera: Option<Camera>,
}

const MAGIC: &[u8; 4] = b"NVS1";
const SEEN: usize = 13;
const CAMERA: usize = 24;
const STREAMS: usize = 4;
/// Most bytes of a state.
pub const MAX_STATE: usize = 4 + 1 + 8 + 8 + 4 + 1 + MAX_KEYS * STREAMS * SEEN + 1 + CAMERA + 4;

impl Stored {
    /// Replaces what `into` held.
    pub fn write(&self, side: Side, into: &mut Vec<u8>) {
        into.clear();
        into.extend(MAGIC);
        into.push(side as u8);
        into.extend(self.epoch.to_le_bytes());
        into.extend(self.next.to_le_bytes());
        into.extend(self.frame.to_le_bytes());
        into.push(self.seen.len() as u8);
        for Seen { key, stream, number } in &self.seen {
            into.extend(key.0.to_le_bytes());
            into.push(*stream);
            into.extend(number.to_le_bytes());
        }
        into.push(u8::from(self.camera.is_some()));
        if let Some(Camera { width, height, fx, fy, cx, cy }) = &self.camera {
            [width, height].iter().for_each(|side| into.extend(side.to_le_bytes()));
            [fx, fy, cx, cy].iter().for_each(|value| into.extend(value.to_le_bytes()));
        }
        let check = crc32fast::hash(into);
        into.extend(check.to_le_bytes());
    }

    /// # Errors
    /// If the bytes are not those of such a side.
    pub fn read(side: Side, bytes: &[u8]) -> Result<Stored, LinkError> {
        let wrong = LinkError::State { len: bytes.len() };
        let Some((content, check)) = bytes.split_last_chunk::<4>() else { return Err(wrong) };
        if crc32fast::hash(content) != u32::from_le_bytes(*check) {
            return Err(wrong);
        }
        Stored::parse(side, content).ok_or(wrong)
    }

    fn parse(side: Side, mut bytes: &[u8]) -> Option<Stored> {
        let bytes = &mut bytes;
        if take(bytes)? != *MAGIC || take(bytes)? != [side as u8] {
            return None;
        }
        let mut stored = Stored {
            epoch: u64::from_le_bytes(take(bytes)?),
            next: u64::from_le_bytes(take(bytes)?),
            frame: u32::from_le_bytes(take(bytes)?),
            ..Stored::default()
        };
        let [count] = take(bytes)?;
        for _ in 0..count {
            let key = KeyId(u32::from_le_bytes(take(bytes)?));
            let [stream] = take(bytes)?;
            stored.seen.push(Seen { key, stream, number: u64::from_le_bytes(take(bytes)?) });
        }
        if take(bytes)? == [1] {
            let [width, height] = [take(bytes)?, take(bytes)?].map(u32::from_le_bytes);
            let [fx, fy] = [take(bytes)?, take(bytes)?].map(f32::from_le_bytes);
            let [cx, cy] = [take(bytes)?, take(bytes)?].map(f32::from_le_bytes);
            let camera = Camera { width, height, fx, fy, cx, cy };
            stored.camera = camera.check().ok().map(|()| camera);
        }
        bytes.is_empty().then_some(stored)
    }

    /// The keys of this side. Their numbers go on after those of the state.
    ///
    /// # Errors
    /// If their epoch lies before that of the state.
    pub fn resumed(&self, keys: &Keys) -> Result<Keys, LinkError> {
        let (epoch, known) = (keys.epoch(), self.epoch);
        if epoch < known {
            return Err(LinkError::Epoch { epoch, known });
        }
        if epoch > known {
            return Ok(keys.clone());
        }
        let next = self.next.max(keys.number());
        Ok(keys.clone().with_number(next)?.with_seen(self.seen.iter().copied()))
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (taken, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*taken)
}

/// Tells when a side's state is to be stored.
#[derive(Debug)]
pub(super) struct Keeper {
    side: Side,
    /// Frames are numbered by this side.
    has_frames: bool,
    /// As its owner has it.
    stored: Stored,
    /// Numbers below these are set aside.
    next: u64,
    frame: u32,
    /// When the owner was told last, seconds.
    told: f64,
    is_told: bool,
}

/// Numbers that are set aside at once, of modem frames and of frames.
const AHEAD: u32 = 1024;
/// What was taken is stored at most so often, seconds.
const EVERY: f64 = 2.0;

/// Where a side is now.
pub(super) struct Position<'a, S: Iterator<Item = Seen>> {
    /// With keys: the number of what goes next.
    pub next: Option<u64>,
    pub frame: u32,
    pub seen: S,
    pub camera: Option<&'a Camera>,
}

impl Keeper {
    /// `stored`: what this side goes on with.
    pub fn new(side: Side, stored: Stored) -> Keeper {
        let has_frames = side == Side::Vehicle;
        let (next, frame) = (stored.next, stored.frame);
        let told = f64::NEG_INFINITY;
        Keeper { side, has_frames, stored, next, frame, told, is_told: false }
    }

    /// Whether its owner is to store it now: told once.
    pub fn is_due(&mut self, now: f64, at: Position<impl Iterator<Item = Seen>>) -> bool {
        let half = u64::from(AHEAD / 2);
        let numbers = at.next.is_some_and(|next| next + half > self.next);
        let frames =
            self.has_frames && at.frame.wrapping_sub(self.frame).wrapping_add(AHEAD / 2) as i32 > 0;
        let is_short = numbers || frames;
        let changed = now >= self.told + EVERY
            && (at.camera != self.stored.camera.as_ref()
                || !at.seen.eq(self.stored.seen.iter().copied()));
        let is_due = is_short || changed;
        is_due && !std::mem::replace(&mut self.is_told, is_due)
    }

    /// Writes the state as it is now: its owner stores it.
    pub fn write(
        &mut self,
        now: f64,
        at: Position<impl Iterator<Item = Seen>>,
        into: &mut Vec<u8>,
    ) {
        self.stored.next = at.next.map_or(0, |next| next + u64::from(AHEAD));
        self.stored.frame = if self.has_frames { at.frame.wrapping_add(AHEAD) } else { 0 };
        self.stored.seen.clear();
        self.stored.seen.extend(at.seen);
        self.stored.camera = at.camera.copied();
        (self.next, self.frame) = (self.stored.next, self.stored.frame);
        (self.told, self.is_told) = (now, false);
        self.stored.write(self.side, into);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn stored() -> Stored {
        Stored {
            epoch: 3,
            next: 1 << 40,
            frame: 70_000,
            seen: vec![Seen { key: KeyId(0xABCD_EF01), stream: 2, number: 77 }],
            camera: Some(Camera {
                width: 320,
                height: 180,
                fx: 300.0,
                fy: 301.0,
                cx: 160.0,
                cy: 90.5,
            }),
        }
    }

    #[test]
    fn a_state_comes_back_and_another_is_refused() {
        let mut bytes = Vec::new();
        for stored in [stored(), Stored::default()] {
            stored.write(Side::Vehicle, &mut bytes);
            assert!(bytes.len() <= MAX_STATE);
            assert_eq!(Stored::read(Side::Vehicle, &bytes).unwrap(), stored);
            assert!(Stored::read(Side::Topside, &bytes).is_err());
            for at in 0..bytes.len() {
                let mut damaged = bytes.clone();
                damaged[at] ^= 0x10;
                assert!(Stored::read(Side::Vehicle, &damaged).is_err());
                assert!(Stored::read(Side::Vehicle, &bytes[..at]).is_err());
            }
        }
    }

    #[test]
    fn numbers_are_set_aside_before_they_are_used() {
        let mut keeper = Keeper::new(Side::Vehicle, Stored::default());
        let at = |next, frame| Position {
            next: Some(next),
            frame,
            seen: std::iter::empty(),
            camera: None,
        };
        let mut bytes = Vec::new();
        let mut kept = Stored::default();
        let mut times = 0;
        for number in 0..5000u32 {
            if keeper.is_due(0.0, at(number.into(), number / 3)) {
                assert!(!keeper.is_due(0.0, at(number.into(), number / 3)), "it is told once");
                keeper.write(0.0, at(number.into(), number / 3), &mut bytes);
                kept = Stored::read(Side::Vehicle, &bytes).unwrap();
                times += 1;
            }
            assert!(kept.next > number.into() && kept.frame > number / 3);
        }
        assert!((8..=12).contains(&times), "{times}");
    }

    proptest! {
        #[test]
        fn any_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..120)) {
            prop_assert!(Stored::read(Side::Topside, &bytes).is_err());
        }
    }
}
