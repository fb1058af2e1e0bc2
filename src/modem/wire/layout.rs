//! Which bytes of an unprotected packet lie in which share.

use std::ops::Range;

use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_MTU, MAX_UNPROTECTED, MIN_MTU};

/// Header bytes of each share after the first.
pub const HEADER_LEN: usize = 4;

/// Shares that an unprotected packet of `packet_len` bytes takes at an MTU of `mtu` bytes.
///
/// # Errors
/// If the MTU is outside 31 to 65,535 bytes or the packet longer than [`largest_packet`].
pub fn share_count(packet_len: usize, mtu: usize) -> Result<usize, ModemError> {
    Layout::new(mtu)?.count_of(packet_len, MAX_UNPROTECTED)
}

/// The longest packet that travels unprotected at an MTU of `mtu` bytes, bytes.
///
/// # Errors
/// If the MTU is outside 31 to 65,535 bytes.
pub fn largest_packet(mtu: usize) -> Result<usize, ModemError> {
    Ok(Layout::new(mtu)?.start(MAX_UNPROTECTED))
}

/// Where a packet's bytes lie in shares of one MTU.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub mtu: usize,
}

impl Layout {
    pub fn new(mtu: usize) -> Result<Layout, ModemError> {
        if (MIN_MTU..=MAX_MTU).contains(&mtu) {
            Ok(Layout { mtu })
        } else {
            Err(ModemError::Mtu(mtu))
        }
    }

    /// Data bytes of a full share after the first.
    pub fn full(self) -> usize {
        self.mtu - HEADER_LEN
    }

    /// The packet's byte with which a share's data begin.
    pub fn start(self, index: usize) -> usize {
        if index == 0 { 0 } else { self.mtu + (index - 1) * self.full() }
    }

    /// The packet's bytes in a share, of a packet of `total` bytes; empty beyond its end.
    pub fn range(self, index: usize, total: usize) -> Range<usize> {
        self.start(index).min(total)..self.start(index + 1).min(total)
    }

    /// Shares of a packet of `total` bytes, however many.
    pub fn count(self, total: usize) -> usize {
        1 + total.saturating_sub(self.mtu).div_ceil(self.full())
    }

    /// Shares of a packet of `len` bytes, at most `max`.
    pub fn count_of(self, len: usize, max: usize) -> Result<usize, ModemError> {
        let (largest, mtu) = (self.start(max), self.mtu);
        if len > largest {
            return Err(ModemError::PacketTooLong { len, largest, mtu });
        }
        Ok(self.count(len))
    }
}
