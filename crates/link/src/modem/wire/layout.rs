//! Which bytes of an unprotected packet lie in which share.

use std::ops::Range;

use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_MTU, MAX_SMALL, MAX_UNPROTECTED, MIN_CHECKED_MTU, MIN_MTU};

use super::travelling::Travelling;

/// Header bytes of the first share, and of each share after it.
const FIRST: usize = 2;
const LATER: usize = 4;
/// Header bytes of a small share.
const SMALL: usize = 1;

/// Shares that an unprotected packet of `packet_len` bytes takes at most at an MTU of `mtu` bytes.
///
/// # Errors
/// If the MTU is outside 8 to 65,535 bytes or the packet longer than [`largest_packet`].
pub fn share_count(packet_len: usize, mtu: usize) -> Result<usize, ModemError> {
    let layout = Layout::new(mtu)?;
    layout.count_of(packet_len - layout.travelling().least().min(packet_len), layout.max_shares())
}

/// The longest packet that travels unprotected at an MTU of `mtu` bytes, bytes.
///
/// # Errors
/// If the MTU is outside 8 to 65,535 bytes.
pub fn largest_packet(mtu: usize) -> Result<usize, ModemError> {
    let layout = Layout::new(mtu)?;
    Ok(layout.start(layout.max_shares()) + layout.travelling().least())
}

/// Where what travels of a packet lies in shares of one MTU.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub mtu: usize,
}

impl Layout {
    pub fn new(mtu: usize) -> Result<Layout, ModemError> {
        match (MIN_MTU..=MAX_MTU).contains(&mtu) {
            true => Ok(Layout { mtu }),
            false => Err(ModemError::Mtu(mtu)),
        }
    }

    /// Whether modem frames are small: their header has one byte, and they have no check of their own.
    pub fn is_small(self) -> bool {
        self.mtu < MIN_CHECKED_MTU
    }

    /// What of a packet travels in them.
    pub fn travelling(self) -> Travelling {
        if self.is_small() { Travelling::Small } else { Travelling::Wide }
    }

    /// Most shares of a packet.
    pub fn max_shares(self) -> usize {
        if self.is_small() { MAX_SMALL } else { MAX_UNPROTECTED }
    }

    /// Header bytes of a share.
    pub fn header(self, index: usize) -> usize {
        match index {
            _ if self.is_small() => SMALL,
            0 => FIRST,
            _ => LATER,
        }
    }

    /// Header bytes of so many shares.
    pub fn headers(self, shares: usize) -> usize {
        match shares {
            0 => 0,
            shares => self.header(0) + (shares - 1) * self.header(1),
        }
    }

    /// Data bytes of a full share after the first.
    pub fn full(self) -> usize {
        self.mtu - self.header(1)
    }

    /// The byte with which a share's data begin.
    pub fn start(self, index: usize) -> usize {
        match index {
            0 => 0,
            index => self.mtu - self.header(0) + (index - 1) * self.full(),
        }
    }

    /// The bytes in a share, of `total` that travel; empty beyond their end.
    pub fn range(self, index: usize, total: usize) -> Range<usize> {
        self.start(index).min(total)..self.start(index + 1).min(total)
    }

    /// Shares of `total` bytes, however many.
    pub fn count(self, total: usize) -> usize {
        1 + total.saturating_sub(self.start(1)).div_ceil(self.full())
    }

    /// Shares of `len` bytes that travel, at most `max`.
    pub fn count_of(self, len: usize, max: usize) -> Result<usize, ModemError> {
        let (largest, mtu) = (self.start(max), self.mtu);
        if len > largest {
            return Err(ModemError::PacketTooLong { len, largest, mtu });
        }
        Ok(self.count(len))
    }
}
