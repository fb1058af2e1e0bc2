//! The frames after the first: header and check.

use crate::packet::bytes::crc16;

use super::ModemError;
use super::layout::{HEADER_LEN, Layout};

/// How many packets the frames tell apart: each frame carries the frame number modulo this.
pub(super) const TAGS: usize = 4;

/// High two bits of a first frame, which are a packet's.
pub(super) const FIRST: u8 = 0b10;
/// High two bits of a later frame.
pub(super) const LATER: u8 = 0b11;

/// The name of a packet in the checks of its later frames, made from its first frame.
pub(super) fn binding(first: &[u8]) -> u32 {
    crc32fast::hash(first)
}

/// The low bits of a frame number.
pub(super) fn tag_of(frame: u32) -> usize {
    frame as usize % TAGS
}

/// A frame after the first, not yet checked.
#[derive(Clone, Copy)]
pub(super) struct Fragment<'a> {
    /// Frame number modulo [`TAGS`].
    pub(super) tag: usize,
    /// 1 to [`MAX_INDEX`](super::layout::MAX_INDEX).
    pub(super) index: usize,
    /// The check that it came with.
    pub(super) check: u16,
    /// One byte or more, at most the layout's full frame; may end with padding.
    pub(super) data: &'a [u8],
}

impl<'a> Fragment<'a> {
    /// Reads a frame whose high two bits are [`LATER`].
    pub(super) fn read(frame: &'a [u8], layout: Layout) -> Result<Fragment<'a>, ModemError> {
        let frame = &frame[..frame.len().min(layout.mtu)];
        let &[first, second, low, high, ref data @ ..] = frame else {
            return Err(ModemError::Cut { found: frame.len(), needed: HEADER_LEN + 1 });
        };
        let index = usize::from(first & 0xF) << 8 | usize::from(second);
        if index == 0 {
            return Err(ModemError::NotAFrame(first));
        }
        if data.is_empty() {
            return Err(ModemError::Cut { found: frame.len(), needed: HEADER_LEN + 1 });
        }
        let tag = usize::from(first >> 4) % TAGS;
        Ok(Fragment { tag, index, check: u16::from_le_bytes([low, high]), data })
    }

    /// Whether the check matches if the first `len` bytes of data are the packet's.
    pub(super) fn binds(&self, binding: u32, len: usize) -> bool {
        let data = self.data.get(..len);
        data.is_some_and(|data| self.check == check(binding, self.tag, self.index, data))
    }
}

/// A later frame's header.
pub(super) fn header(binding: u32, tag: usize, index: usize, data: &[u8]) -> [u8; HEADER_LEN] {
    let [first, second] = start(tag, index);
    let [low, high] = check(binding, tag, index, data).to_le_bytes();
    [first, second, low, high]
}

fn check(binding: u32, tag: usize, index: usize, data: &[u8]) -> u16 {
    crc16(&[&binding.to_le_bytes(), &start(tag, index), data])
}

fn start(tag: usize, index: usize) -> [u8; 2] {
    let [second, high] = (index as u16).to_le_bytes();
    [LATER << 6 | (tag as u8) << 4 | high, second]
}
