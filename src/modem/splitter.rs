//! A packet to frames.

use crate::packet::{Extent, sound_len};

use super::ModemError;
use super::fragment::{binding, header, tag_of};
use super::layout::{HEADER_LEN, Layout, frame_count};

/// Cuts a packet into frames. Gives each frame on demand, any number of times. Allocates nothing.
///
/// ```
/// # fn main() -> Result<(), nvsprior::modem::ModemError> {
/// # let send = |frame: &[u8]| {};
/// # let packet = [
/// #     0xb1, 0x05, 0x04, 0x03, 0x02, 0xed, 0xd0, 0xa5, 0xd4, 0x3f, 0x31, 0x0b, 0x45, 0x13, 0x00,
/// #     0xfc, 0x14, 0xff, 0x6b, 0xe3, 0xf9, 0x94, 0x94, 0x8e, 0x84, 0xa4, 0xa4, 0x24, 0xa8, 0xd9,
/// #     0x61,
/// # ];
/// let splitter = nvsprior::modem::Splitter::new(&packet, 64)?;
/// let mut frame = [0; 64];
/// for index in 0..splitter.count() {
///     let len = splitter.write(index, &mut frame)?;
///     send(&frame[..len]);
/// }
/// # Ok(()) }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Splitter<'a> {
    packet: &'a [u8],
    layout: Layout,
    count: usize,
    tag: usize,
    binding: u32,
}

impl<'a> Splitter<'a> {
    /// Looks at a packet that is to travel in frames of at most `mtu` bytes.
    ///
    /// # Errors
    /// If the MTU is outside 31 to 65,535 bytes. If the bytes are not exactly one packet whose
    /// checks all match. If the packet is longer than [`super::largest_packet`].
    pub fn new(packet: &'a [u8], mtu: usize) -> Result<Splitter<'a>, ModemError> {
        let layout = Layout::new(mtu)?;
        let extent = Extent::read(packet)?;
        // A packet cut before it says its length has one more byte at least.
        let len = packet.len();
        let stated = extent.total.unwrap_or(len + 1);
        if stated != len {
            return Err(ModemError::PacketLength { found: len, stated });
        }
        let sound = sound_len(packet);
        if sound != len {
            return Err(ModemError::Unsound { len, sound });
        }
        let count = frame_count(len, mtu)?;
        let binding = binding(&packet[layout.range(0, len)]);
        Ok(Splitter { packet, layout, count, tag: tag_of(extent.frame), binding })
    }

    /// Number of frames.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Writes the frame of this index to the start of `frame`. Returns its length, bytes, at most
    /// the MTU. The frame may be padded to any length, with any bytes.
    ///
    /// # Errors
    /// If there is no frame of this index, or the buffer is too short for it.
    pub fn write(&self, index: usize, frame: &mut [u8]) -> Result<usize, ModemError> {
        if index >= self.count {
            return Err(ModemError::NoSuchFrame { index, count: self.count });
        }
        let data = &self.packet[self.layout.range(index, self.packet.len())];
        let header_len = if index == 0 { 0 } else { HEADER_LEN };
        let (needed, found) = (header_len + data.len(), frame.len());
        let frame = frame.get_mut(..needed).ok_or(ModemError::Buffer { needed, found })?;
        let (head, body) = frame.split_at_mut(header_len);
        if index > 0 {
            head.copy_from_slice(&header(self.binding, self.tag, index, data));
        }
        body.copy_from_slice(data);
        Ok(needed)
    }
}
