//! Which bytes of a packet lie in which frame.

use std::ops::Range;

use super::ModemError;

/// Header bytes of each frame after the first.
pub(super) const HEADER_LEN: usize = 4;
/// Largest index of a frame: twelve bits.
pub(super) const MAX_INDEX: usize = 0xFFF;
/// The smallest MTU, bytes: that of the smallest modems, and the compact latent part's length.
pub(super) const SMALLEST_MTU: usize = 31;
/// The largest MTU, bytes.
pub(super) const LARGEST_MTU: usize = 65_535;

/// Frames that a packet of `packet_len` bytes takes at an MTU of `mtu` bytes.
///
/// # Errors
/// If the MTU is outside 31 to 65,535 bytes or the packet longer than [`largest_packet`].
pub fn frame_count(packet_len: usize, mtu: usize) -> Result<usize, ModemError> {
    let layout = Layout::new(mtu)?;
    let largest = layout.start(MAX_INDEX + 1);
    if packet_len > largest {
        return Err(ModemError::PacketTooLong { len: packet_len, largest, mtu });
    }
    Ok(layout.count(packet_len))
}

/// The longest packet that can be split at an MTU of `mtu` bytes, bytes.
///
/// # Errors
/// If the MTU is outside 31 to 65,535 bytes.
pub fn largest_packet(mtu: usize) -> Result<usize, ModemError> {
    Ok(Layout::new(mtu)?.start(MAX_INDEX + 1))
}

/// Where a packet's bytes lie in frames of one MTU.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) mtu: usize,
}

impl Layout {
    pub(super) fn new(mtu: usize) -> Result<Layout, ModemError> {
        if (SMALLEST_MTU..=LARGEST_MTU).contains(&mtu) {
            Ok(Layout { mtu })
        } else {
            Err(ModemError::Mtu(mtu))
        }
    }

    /// Data bytes of a full frame after the first.
    pub(super) fn full(self) -> usize {
        self.mtu - HEADER_LEN
    }

    /// The packet's byte with which a frame's data begin.
    pub(super) fn start(self, index: usize) -> usize {
        if index == 0 { 0 } else { self.mtu + (index - 1) * self.full() }
    }

    /// The packet's bytes in a frame, of a packet of `total` bytes; empty beyond its end.
    pub(super) fn range(self, index: usize, total: usize) -> Range<usize> {
        self.start(index).min(total)..self.start(index + 1).min(total)
    }

    /// Frames of a packet of `total` bytes, however many.
    pub(super) fn count(self, total: usize) -> usize {
        1 + total.saturating_sub(self.mtu).div_ceil(self.full())
    }
}
