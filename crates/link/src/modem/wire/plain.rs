//! The headers of unprotected shares: first ones, later ones, and small ones.

use crate::modem::error::ModemError;
use nvsprior::packet::crc16;
use nvsprior::packet::without_zeros;

use super::layout::Layout;

/// Continuations name their packet by its frame number modulo this.
pub const TAGS: usize = 4;
/// High two bits of an unprotected packet's first share.
pub const START: u8 = 0b10;
/// High two bits of a continuation.
pub const CONTINUATION: u8 = 0b11;
/// Bit of the first byte: the packet ends in this share.
const LAST: u8 = 1 << 5;
const LAST_LATER: u8 = 1 << 3;
/// Of a small share: its mark, and the same.
pub const SMALL: u8 = 1 << 7;
const LAST_SMALL: u8 = 1 << 3;

/// The first share of an unprotected packet.
#[derive(Clone, Copy, Debug)]
pub struct First<'a> {
    /// Low 8 bits of the frame number.
    pub number: u32,
    /// The packet ends in it.
    pub last: bool,
    /// May end with padding if the packet ends in it.
    pub data: &'a [u8],
}

impl<'a> First<'a> {
    /// Reads a modem frame whose high two bits are [`START`].
    pub fn read(frame: &'a [u8], layout: Layout) -> Result<First<'a>, ModemError> {
        let &[first, number, ref data @ ..] = frame else {
            return Err(ModemError::Cut { found: frame.len(), needed: 2 });
        };
        if first & 0x1F != 0 {
            return Err(ModemError::NotAFrame(first));
        }
        let last = first & LAST != 0;
        if !last && frame.len() < layout.mtu {
            return Err(ModemError::Cut { found: frame.len(), needed: layout.mtu });
        }
        Ok(First { number: number.into(), last, data })
    }

    /// Its header.
    pub fn header(number: u32, last: bool) -> [u8; 2] {
        [START << 6 | if last { LAST } else { 0 }, number as u8]
    }

    /// The name of the packet in the checks of its continuations.
    pub fn binding(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&First::header(self.number, self.last));
        hasher.update(without_zeros(self.data));
        hasher.finalize()
    }
}

/// A continuation, not yet checked.
#[derive(Clone, Copy)]
pub struct Continuation<'a> {
    /// Frame number modulo [`TAGS`].
    pub tag: usize,
    /// Which share of the packet it is, 1 to 2047.
    pub index: usize,
    /// The packet ends in it.
    pub last: bool,
    /// The check that it came with.
    pub check: u16,
    /// May end with padding if the packet ends in it.
    pub data: &'a [u8],
}

impl<'a> Continuation<'a> {
    /// Reads a modem frame whose high two bits are [`CONTINUATION`].
    pub fn read(frame: &'a [u8], layout: Layout) -> Result<Continuation<'a>, ModemError> {
        let cut = |needed| ModemError::Cut { found: frame.len(), needed };
        let &[first, second, low, high, ref data @ ..] = frame else { return Err(cut(4)) };
        let index = usize::from(first & 7) << 8 | usize::from(second);
        if index == 0 {
            return Err(ModemError::NotAFrame(first));
        }
        let last = first & LAST_LATER != 0;
        if !last && data.len() < layout.full() {
            return Err(cut(layout.mtu));
        }
        let tag = usize::from(first >> 4) % TAGS;
        Ok(Continuation { tag, index, last, check: u16::from_le_bytes([low, high]), data })
    }

    /// Whether it is of the packet of this name.
    pub fn binds(&self, binding: u32) -> bool {
        self.check == self.check_of(binding)
    }

    /// Its header in the packet of this name.
    pub fn header(&self, binding: u32) -> [u8; 4] {
        let [first, second] = self.start();
        let [low, high] = self.check_of(binding).to_le_bytes();
        [first, second, low, high]
    }

    /// Zeros at its end do not count: a modem may have put them there.
    fn check_of(&self, binding: u32) -> u16 {
        crc16(&[&binding.to_le_bytes(), &self.start(), without_zeros(self.data)])
    }

    fn start(&self) -> [u8; 2] {
        let [second, high] = (self.index as u16).to_le_bytes();
        let last = if self.last { LAST_LATER } else { 0 };
        [CONTINUATION << 6 | (self.tag as u8) << 4 | last | high, second]
    }
}

/// A share in a small modem frame.
#[derive(Clone, Copy, Debug)]
pub struct Small<'a> {
    /// Tells its packet from those before and after.
    pub number: u32,
    pub index: usize,
    /// The packet ends in it.
    pub last: bool,
    /// May end with padding if the packet ends in it.
    pub data: &'a [u8],
}

impl<'a> Small<'a> {
    /// Reads a modem frame whose first bit is [`SMALL`].
    pub fn read(frame: &'a [u8], layout: Layout) -> Result<Small<'a>, ModemError> {
        let cut = ModemError::Cut { found: frame.len(), needed: layout.mtu };
        let Some((&first, data)) = frame.split_first() else { return Err(cut) };
        let last = first & LAST_SMALL != 0;
        if !last && frame.len() < layout.mtu {
            return Err(cut);
        }
        let (number, index) = (u32::from(first >> 4 & 7), usize::from(first & 7));
        Ok(Small { number, index, last, data })
    }

    /// Its header.
    pub fn header(number: u32, index: usize, last: bool) -> u8 {
        SMALL | (number as u8 & 7) << 4 | if last { LAST_SMALL } else { 0 } | index as u8
    }
}
