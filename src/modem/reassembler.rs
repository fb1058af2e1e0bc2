//! Frames to packets.

use crate::packet::{Extent, Latent};

use super::ModemError;
use super::assembly::Assembly;
use super::fragment::{FIRST, Fragment, LATER, TAGS, binding, tag_of};
use super::layout::{Layout, MAX_INDEX};
use super::packet_slot::PacketSlot;
use super::statistics::{Pushed, Statistics};

/// Displaced packets that are remembered, so that their late repeats are known.
const GONE: usize = 16;

/// How to put packets together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReassemblerOptions {
    /// The MTU that the packets are split for, bytes.
    pub mtu: usize,
    /// Packets of up to this many bytes can become complete; of longer ones, so much of the start
    /// is kept.
    pub max_packet_bytes: usize,
    /// The modem hands over no damaged frames. Then a first frame counts as sound to its end; else
    /// only as far as its packet's own checks go, until a later frame vouches for the rest.
    pub modem_checks: bool,
}

impl ReassemblerOptions {
    /// Packets of up to 64 KiB, from a modem that is not known to check its frames.
    pub fn new(mtu: usize) -> ReassemblerOptions {
        ReassemblerOptions { mtu, max_packet_bytes: 1 << 16, modem_checks: false }
    }

    /// Memory that a [`Reassembler`] takes, all at once and for good, bytes: four times twice
    /// `max_packet_bytes`, which is rounded up to whole frames and counts no further than
    /// [`super::largest_packet`], and seven bytes per frame; 593,000 for
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
    /// Frame number, modulo 2²⁴; of a short packet the one nearest to that of the newest packet when it
    /// came; its 16 bits if that was the first.
    pub frame: u32,
    /// The packet's first bytes, without gap and without padding, each vouched for by a check. A
    /// decoder makes the best picture of them that there is, if they hold the latent part; empty
    /// where that part is longer than frame 0 and frame 1 has not come.
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
    /// Indices of frames to ask the sender for again, in order: all that are missing, once it is
    /// known how many there are; the first one before that. Frame 0 is among them where the packet
    /// came damaged.
    pub fn missing(&self) -> impl Iterator<Item = usize> + Clone + 'a {
        self.packet.missing()
    }
}

/// Puts packets together from frames that come in any order, more than once, or not at all, padded
/// or not, among anything else.
///
/// It holds four packets, one for each value of the frame number's low two bits, and as much room
/// for frames that come before the first of their packet. A packet stays until the first frame of
/// another with the same low bits comes: a newer one, or one of a vehicle that counts anew. Only the
/// packet itself, late and for a second time, is refused. Nothing is allocated after [`new`].
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
    /// Keys of the packets displaced last, the one to be forgotten next at `oldest_gone`.
    gone: [Option<u32>; GONE],
    oldest_gone: usize,
    statistics: Statistics,
}

impl Reassembler {
    /// Allocates [`ReassemblerOptions::memory`].
    ///
    /// # Errors
    /// If the MTU is outside 31 to 65,535 bytes.
    pub fn new(options: ReassemblerOptions) -> Result<Reassembler, ModemError> {
        let layout = Layout::new(options.mtu)?;
        let room = options.frames(layout);
        Ok(Reassembler {
            layout,
            modem_checks: options.modem_checks,
            room,
            slots: std::array::from_fn(|tag| PacketSlot::new(layout, tag, room)),
            newest: None,
            gone: [None; GONE],
            oldest_gone: 0,
            statistics: Statistics::default(),
        })
    }

    /// Takes a frame as the modem gives it. What lies beyond the MTU is padding.
    ///
    /// # Errors
    /// If it is no frame, or refused. The other packets, and what was there of its own, stay as
    /// they are.
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

    /// The packet whose first frame came last, not counting such as are only up to three frame
    /// numbers behind another: they came late.
    pub fn newest(&self) -> Option<Received<'_>> {
        self.packet(self.newest?)
    }

    /// The packet of a frame number, modulo 2²⁴, if it is held and its first frame has come. Of a
    /// short packet, the low 16 bits count.
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
                // Of two, the one that later frames have vouched for; else the one that came last.
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

/// Whether a frame number is one of the few before the newest: then another slot holds the newest.
/// Any other is newer, or of a vehicle that counts anew.
fn is_late(frame: u32, newest: u32) -> bool {
    let behind = newest.wrapping_sub(frame) % Latent::FRAMES;
    (1..TAGS as u32).contains(&behind)
}
