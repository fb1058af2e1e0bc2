//! The shares of an unprotected packet after its first: header and check.

use crate::modem::error::ModemError;
use crate::packet::bytes::crc16;

use super::layout::{HEADER_LEN, Layout};

/// Continuations name their packet by its frame number modulo this.
pub const TAGS: usize = 4;
/// High two bits of an unprotected packet's first share, which are a packet's.
pub const START: u8 = 0b10;
/// High two bits of a continuation.
pub const CONTINUATION: u8 = 0b11;

/// The name of a packet in the checks of its continuations, made from its first share.
pub fn binding(first: &[u8]) -> u32 {
    crc32fast::hash(first)
}

/// The low bits of a frame number.
pub fn tag_of(frame: u32) -> usize {
    frame as usize % TAGS
}

/// A continuation, not yet checked.
#[derive(Clone, Copy)]
pub struct Continuation<'a> {
    /// Frame number modulo [`TAGS`].
    pub tag: usize,
    /// Which share of the packet it is, 1 to 4095.
    pub index: usize,
    /// The check that it came with.
    pub check: u16,
    /// One byte or more, at most the layout's full share; may end with padding.
    pub data: &'a [u8],
}

impl<'a> Continuation<'a> {
    /// Reads a modem frame whose high two bits are [`CONTINUATION`].
    pub fn read(frame: &'a [u8], layout: Layout) -> Result<Continuation<'a>, ModemError> {
        let frame = &frame[..frame.len().min(layout.mtu)];
        let cut = ModemError::Cut { found: frame.len(), needed: HEADER_LEN + 1 };
        let &[first, second, low, high, ref data @ ..] = frame else { return Err(cut) };
        let index = usize::from(first & 0xF) << 8 | usize::from(second);
        if index == 0 {
            return Err(ModemError::NotAFrame(first));
        }
        if data.is_empty() {
            return Err(cut);
        }
        let tag = usize::from(first >> 4) % TAGS;
        Ok(Continuation { tag, index, check: u16::from_le_bytes([low, high]), data })
    }

    /// Whether the check matches if the first `len` bytes of data are the packet's.
    pub fn binds(&self, binding: u32, len: usize) -> bool {
        let data = self.data.get(..len);
        data.is_some_and(|data| self.check == check(binding, self.tag, self.index, data))
    }
}

pub fn header(binding: u32, tag: usize, index: usize, data: &[u8]) -> [u8; HEADER_LEN] {
    let [first, second] = start(tag, index);
    let [low, high] = check(binding, tag, index, data).to_le_bytes();
    [first, second, low, high]
}

fn check(binding: u32, tag: usize, index: usize, data: &[u8]) -> u16 {
    crc16(&[&binding.to_le_bytes(), &start(tag, index), data])
}

fn start(tag: usize, index: usize) -> [u8; 2] {
    let [second, high] = (index as u16).to_le_bytes();
    [CONTINUATION << 6 | (tag as u8) << 4 | high, second]
}
