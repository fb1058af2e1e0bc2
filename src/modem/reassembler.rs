//! Frames to packets.

use crate::packet::{Extent, Latent};

use super::ModemError;
use super::assembly::Assembly;
use super::fragment::{FIRST, Fragment, LATER, TAGS, binding, tag_of};
use super::layout::{Layout, MAX_INDEX};
use super::packet_slot::PacketSlot;
use super::statistics::{Pushed, Statistics};

/// How many displaced packets are remembered, so that their late repeats are known.
const GONE: usize = 16;

/// How to put packets together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReassemblerOptions {
    /// The MTU that the packets are split for, bytes.
    pub mtu: usize,
    /// Packets of up to this many bytes can become complete. Of a longer packet, this many bytes
    /// from its start are kept.
    pub max_packet_bytes: usize,
    /// The modem hands over no damaged frames. If set, a first frame counts as sound to its end.
    /// Else only what its packet's own checks cover counts as sound, until a later frame vouches
    /// for the rest.
    pub modem_checks: bool,
}

impl ReassemblerOptions {
    /// Packets of up to 64 KiB, from a modem that is not known to check its frames.
    pub fn new(mtu: usize) -> ReassemblerOptions {
        ReassemblerOptions { mtu, max_packet_bytes: 1 << 16, modem_checks: false }
    }

    /// Memory that a [`Reassembler`] takes, all of it when it is made, bytes. For each of four
    /// packets this is twice `max_packet_bytes` and seven bytes per frame. `max_packet_bytes` is
    /// rounded up to whole frames, and limited to [`super::largest_packet`]. Example: 593,000 for
    /// [`ReassemblerOptions::new`] at an MTU of 31.
    ///
    /// # Errors
    /// If the MTU is outside 31 to 65,535 bytes.
    pub fn memory(&self) -> Result<usize, ModemError> {
        let layout = Layout::new(self.mtu)?;
        Ok(TAGS * PacketSlot::memory(layout, self.frames(layout)) + size_of::<Reassembler>())
    }

    /// Frames of a packet to make room for.
    fn frames(&self, layout: Layout) -> usize {
        layout.count(self.max_packet_bytes).min(MAX_INDEX + 1)
    }
}

/// What has come of a packet.
#[derive(Clone, Copy)]
pub struct Received<'a> {
    /// Frame number, modulo 2²⁴. For a short packet: the number nearest to the newest packet's when it came, or its 16
    /// bits if it was the first.
    pub frame: u32,
    /// The packet's first bytes, without gap and without padding. A check vouches for each of them.
    /// If they hold the latent part, a decoder makes the best possible picture of them. Empty if
    /// the latent part is longer than frame 0 and frame 1 has not come.
    pub bytes: &'a [u8],
    /// The bytes are the whole packet.
    pub complete: bool,
    /// Frames known to be the packet's, also such as come after a gap.
    pub frames: usize,
    /// Frames that the packet has; `None` before enough of it has come to tell.
    pub expected: Option<usize>,
    packet: &'a Assembly,
}

impl<'a> Received<'a> {
    /// Indices of frames to ask the sender for again, in order: all missing ones if the packet's
    /// length is known, else the first missing one. If the packet came damaged, frame 0 is among
    /// them.
    pub fn missing(&self) -> impl Iterator<Item = usize> + Clone + 'a {
        self.packet.missing()
    }
}

/// Puts packets together from frames. Frames may come in any order, more than once or not at all,
/// padded, and mixed with other bytes.
///
/// It holds four packets, one for each value of the frame number's low two bits. It has the same room again for frames
/// that come before the first frame of their packet. A packet stays until the first frame of another packet with the
/// same low bits comes: a newer one, or one of a vehicle that starts to count again. A displaced packet that comes
/// again is refused. Nothing is allocated after [`new`].
///
/// [`new`]: Reassembler::new
pub struct Reassembler {
    layout: Layout,
    modem_checks: bool,
    /// Frames of a packet that there is room for.
    room: usize,
    /// By the frame number's low two bits.
    slots: [PacketSlot; TAGS],
    newest: Option<u32>,
    /// Keys of the packets displaced last. The next one to forget is at `oldest_gone`.
    gone: [Option<u32>; GONE],
    oldest_gone: usize,
    statistics: Statistics,
}

impl Reassembler {
    /// Allocates [`ReassemblerOptions::memory`].
    ///
    /// # Errors
    /// If the MTU is outside 31 to 65,535 bytes, or the system does not have the memory.
    pub fn new(options: ReassemblerOptions) -> Result<Reassembler, ModemError> {
        let layout = Layout::new(options.mtu)?;
        let room = options.frames(layout);
        let slot = |tag| PacketSlot::new(layout, tag, room);
        let slots = [slot(0)?, slot(1)?, slot(2)?, slot(3)?];
        Ok(Reassembler {
            layout,
            modem_checks: options.modem_checks,
            room,
            slots,
            newest: None,
            gone: [None; GONE],
            oldest_gone: 0,
            statistics: Statistics::default(),
        })
    }

    /// Takes a frame as the modem gives it. What lies beyond the MTU is padding.
    ///
    /// # Errors
    /// If it is no frame, or is refused. All packets, its own too, stay as they are.
    pub fn push(&mut self, frame: &[u8]) -> Result<Pushed, ModemError> {
        let pushed = match frame.first() {
            Some(first) if first >> 6 == FIRST => self.push_first(frame),
            Some(first) if first >> 6 == LATER => self.push_later(frame),
            Some(first) => Err(ModemError::NotAFrame(*first)),
            None => Err(ModemError::Cut { found: 0, needed: 1 }),
        };
        self.statistics.rejected += u64::from(pushed.is_err());
        pushed
    }

    /// The packet whose first frame came last. Packets that are one to three frame numbers behind
    /// another do not count: they came late.
    pub fn newest(&self) -> Option<Received<'_>> {
        self.packet(self.newest?)
    }

    /// The packet of a frame number, modulo 2²⁴, if it is held and its first frame has come. For a
    /// short packet only the low 16 bits count.
    pub fn packet(&self, frame: u32) -> Option<Received<'_>> {
        let packet = &self.slots[tag_of(frame)].packet;
        let state = packet.state().filter(|state| state.extent.may_be(frame))?;
        Some(Received {
            frame: state.extent.frame,
            bytes: packet.sound(),
            complete: state.complete,
            frames: state.frames,
            expected: packet.expected(),
            packet,
        })
    }

    /// What has come so far.
    pub fn statistics(&self) -> Statistics {
        let waiting = self.slots.iter().map(|slot| slot.waiting.count() as u64).sum();
        Statistics { waiting, ..self.statistics }
    }

    fn push_later(&mut self, frame: &[u8]) -> Result<Pushed, ModemError> {
        let later = Fragment::read(frame, self.layout)?;
        if later.index >= self.room {
            return Err(ModemError::NoRoom { index: later.index, room: self.room });
        }
        Ok(self.slots[later.tag].push(&later, &mut self.statistics))
    }

    fn push_first(&mut self, frame: &[u8]) -> Result<Pushed, ModemError> {
        let padded = &frame[..frame.len().min(self.layout.mtu)];
        let extent = Extent::read(padded)?.near(self.newest);
        let needed = self.layout.range(0, extent.total.unwrap_or(usize::MAX)).len();
        let cut = ModemError::Cut { found: frame.len(), needed };
        let first = padded.get(..needed).ok_or(cut)?;
        let slot = &mut self.slots[tag_of(extent.frame)];
        if slot.packet.begins_with(first) {
            self.statistics.duplicates += 1;
            return Ok(Pushed::Duplicate);
        }
        let key = binding(&first[..extent.latent.min(first.len())]);
        if let Some(held) = slot.packet.state() {
            if slot.packet.is_of(first, &extent) {
                // Of two first frames, keep the one that later frames vouch for, else the one that came last.
                if held.vouched {
                    return Err(ModemError::Contradicts(extent.frame));
                }
            } else if self.gone.contains(&Some(key)) {
                return Err(ModemError::Late(extent.frame));
            } else {
                self.statistics.incomplete += u64::from(!held.complete);
                self.gone[self.oldest_gone] = Some(held.key);
                self.oldest_gone = (self.oldest_gone + 1) % GONE;
            }
        }
        slot.packet.begin(first, extent, key, self.modem_checks);
        self.statistics.accepted += 1;
        slot.adopt(&mut self.statistics);
        let pushed = slot.pushed(0, &mut self.statistics);
        if !self.newest.is_some_and(|newest| is_late(extent.frame, newest)) {
            self.newest = Some(extent.frame);
        }
        Ok(pushed)
    }

    /// Bytes that the buffers have room for.
    #[cfg(test)]
    pub(super) fn capacity(&self) -> usize {
        let slots = self.slots.iter();
        slots.map(|slot| slot.packet.capacity() + slot.waiting.capacity()).sum()
    }
}

/// Whether a frame number is one of the three before the newest. Any other number is newer, or of a
/// vehicle that starts to count again.
fn is_late(frame: u32, newest: u32) -> bool {
    let behind = newest.wrapping_sub(frame) % Latent::FRAMES;
    (1..TAGS as u32).contains(&behind)
}
