//! A packet slot: what is held of packets whose frame numbers end in the same two bits.

use super::ModemError;
use super::assembly::{Assembly, Bond};
use super::fragment::Fragment;
use super::layout::Layout;
use super::statistics::{Pushed, Statistics};
use super::waiting::{Kept, Waiting};

/// One packet, and later frames that are not known to be of it.
pub(super) struct PacketSlot {
    pub(super) packet: Assembly,
    pub(super) waiting: Waiting,
}

impl PacketSlot {
    /// Bytes of memory for `frames` frames of a packet.
    pub(super) fn memory(layout: Layout, frames: usize) -> usize {
        Assembly::memory(layout, frames) + Waiting::memory(layout, frames)
    }

    pub(super) fn new(layout: Layout, tag: usize, frames: usize) -> Result<PacketSlot, ModemError> {
        let packet = Assembly::new(layout, frames)?;
        Ok(PacketSlot { packet, waiting: Waiting::new(layout, tag, frames)? })
    }

    /// Takes a later frame of this tag.
    pub(super) fn push(&mut self, later: &Fragment, statistics: &mut Statistics) -> Pushed {
        let before = self.packet.sound().len();
        let length_known = self.packet.total().is_some();
        match self.packet.offer(later) {
            Bond::Bound => {
                statistics.accepted += 1;
                if !length_known {
                    self.adopt(statistics);
                }
                self.pushed(before, statistics)
            }
            Bond::Duplicate => {
                statistics.duplicates += 1;
                Pushed::Duplicate
            }
            Bond::Stranger => match self.waiting.keep(later) {
                Kept::New => Pushed::Kept,
                Kept::InsteadOf => {
                    statistics.rejected += 1;
                    Pushed::Kept
                }
                Kept::Duplicate => {
                    statistics.duplicates += 1;
                    Pushed::Duplicate
                }
            },
        }
    }

    /// Gives the packet what waits for it, after its first frame and when its length is known. While
    /// its length is not known, only the next frame can be told to be its; once it is, frames that are
    /// not are dropped.
    pub(super) fn adopt(&mut self, statistics: &mut Statistics) {
        while self.packet.total().is_none() {
            let next = self.packet.next().and_then(|next| self.waiting.get(next));
            let Some(later) = next else { return };
            if self.packet.offer(&later) != Bond::Bound {
                return;
            }
            statistics.accepted += 1;
            let index = later.index;
            self.waiting.remove(index);
        }
        let mut from = 1;
        while let Some(index) = self.waiting.next(from) {
            let bond = self.waiting.get(index).map(|later| self.packet.offer(&later));
            self.waiting.remove(index);
            from = index + 1;
            match bond {
                Some(Bond::Bound) => statistics.accepted += 1,
                Some(Bond::Duplicate) => statistics.duplicates += 1,
                _ => statistics.rejected += 1,
            }
        }
    }

    /// What a frame of the packet has brought, which had `before` sound bytes.
    pub(super) fn pushed(&self, before: usize, statistics: &mut Statistics) -> Pushed {
        let Some(state) = self.packet.state() else { return Pushed::Kept };
        let frame = state.extent.frame;
        if state.complete {
            statistics.completed += 1;
            Pushed::Complete(frame)
        } else if state.damaged && state.frames == 1 {
            statistics.damaged += 1;
            Pushed::Damaged(frame)
        } else if self.packet.sound().len() > before {
            Pushed::Grown(frame)
        } else {
            Pushed::Kept
        }
    }
}
