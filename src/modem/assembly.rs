//! A packet whose first frame has come, and its frames.

use crate::packet::{Extent, sound_len};

use super::ModemError;
use super::error::filled;
use super::fragment::{Fragment, binding};
use super::layout::Layout;

/// One packet at a time, and room for it.
pub(super) struct Assembly {
    layout: Layout,
    /// The packet's bytes. Those of frames that have come are in their places.
    bytes: Vec<u8>,
    /// By index: the frame is there.
    there: Vec<bool>,
    packet: Option<State>,
}

/// What is known of the packet.
#[derive(Clone, Copy)]
pub(super) struct State {
    pub(super) extent: Extent,
    /// Tells it from other packets. Made from the part of its latent part that is in its first frame.
    pub(super) key: u32,
    binding: u32,
    /// Bytes of frame 0 that the packet's own checks vouch for.
    own: usize,
    /// Frames there.
    pub(super) frames: usize,
    /// Index of the first frame that is not there.
    next: usize,
    /// All bytes of the frames that are there count as sound: a later frame's check matched, or the modem is trusted.
    pub(super) vouched: bool,
    /// All frames are there and the packet's checks match.
    pub(super) complete: bool,
    /// All frames were there and the packet's checks did not match.
    pub(super) damaged: bool,
}

/// What a later frame is to the packet.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Bond {
    /// It is the packet's, and there now.
    Bound,
    /// It is the packet's, and was there.
    Duplicate,
    /// It is not the packet's, or nothing can tell until the packet's length is known.
    Stranger,
}

impl Assembly {
    /// Bytes of memory for `frames` frames of a packet, the first one counted.
    pub(super) fn memory(layout: Layout, frames: usize) -> usize {
        layout.start(frames) + frames * size_of::<bool>()
    }

    pub(super) fn new(layout: Layout, frames: usize) -> Result<Assembly, ModemError> {
        let (bytes, there) = (filled(layout.start(frames), 0)?, filled(frames, false)?);
        Ok(Assembly { layout, bytes, there, packet: None })
    }

    pub(super) fn state(&self) -> Option<&State> {
        self.packet.as_ref()
    }

    /// Length of the packet, if it is known.
    pub(super) fn total(&self) -> Option<usize> {
        self.packet?.extent.total
    }

    /// The packet's first bytes: without gap, and vouched for by a check.
    pub(super) fn sound(&self) -> &[u8] {
        let Some(state) = self.packet else { return &[] };
        let without_gap = self.layout.range(state.next - 1, state.end()).end;
        &self.bytes[..if state.vouched { without_gap } else { state.own }]
    }

    /// Whether `first` is the packet's first frame.
    pub(super) fn begins_with(&self, first: &[u8]) -> bool {
        let own = self.packet.map(|state| &self.bytes[self.layout.range(0, state.end())]);
        own == Some(first)
    }

    /// Whether a first frame is of this packet. Compares the latent part, or the frame number if
    /// the frame does not hold all of the latent part.
    pub(super) fn is_of(&self, first: &[u8], extent: &Extent) -> bool {
        let Some(state) = self.packet else { return false };
        match first.get(..extent.latent) {
            Some(latent) => latent == &self.bytes[..extent.latent],
            None => extent.frame == state.extent.frame,
        }
    }

    /// Index of the first frame that is not there; `None` before frame 0.
    pub(super) fn next(&self) -> Option<usize> {
        Some(self.packet?.next)
    }

    /// Starts a packet by its first frame, without padding. `trusted`: all of the frame counts as
    /// sound.
    pub(super) fn begin(&mut self, first: &[u8], extent: Extent, key: u32, trusted: bool) {
        self.there.fill(false);
        self.there[0] = true;
        self.bytes[..first.len()].copy_from_slice(first);
        self.packet = Some(State {
            extent,
            key,
            binding: binding(first),
            own: sound_len(first),
            frames: 1,
            next: 1,
            vouched: trusted,
            complete: false,
            damaged: false,
        });
        self.settle();
    }

    /// Takes a frame whose index there is room for.
    pub(super) fn offer(&mut self, later: &Fragment) -> Bond {
        let Some(state) = &mut self.packet else { return Bond::Stranger };
        let Fragment { index, data, .. } = *later;
        if self.there[index] {
            let held = &self.bytes[self.layout.range(index, state.end())];
            let same = data.starts_with(held) && later.binds(state.binding, held.len());
            return if same { Bond::Duplicate } else { Bond::Stranger };
        }
        // Put it in its place first, as the packet's length may lie in it. Nobody reads the place
        // until the frame counts as there.
        let start = self.layout.start(index);
        let end = start + data.len();
        self.bytes[start..end].copy_from_slice(data);
        let total = match state.extent.total {
            None if index == state.next => match Extent::read(&self.bytes[..end]) {
                Ok(extent) => extent.total,
                Err(_) => return Bond::Stranger,
            },
            None => return Bond::Stranger,
            total => total,
        };
        let due = self.layout.range(index, total.unwrap_or(usize::MAX)).len();
        if due == 0 || !later.binds(state.binding, due) {
            return Bond::Stranger;
        }
        state.extent.total = total;
        state.vouched = true;
        state.frames += 1;
        self.there[index] = true;
        while self.there.get(state.next) == Some(&true) {
            state.next += 1;
        }
        self.settle();
        Bond::Bound
    }

    /// Judges the packet once all frames are there. If its own checks do not match, a frame's check
    /// has missed damage. Then forgets the frames after the first.
    fn settle(&mut self) {
        let Some(state) = &mut self.packet else { return };
        let Some(total) = state.extent.total else { return };
        if state.next < self.layout.count(total) {
            return;
        }
        state.complete = sound_len(&self.bytes[..total]) == total;
        state.vouched = state.complete;
        state.damaged = !state.complete;
        if state.damaged {
            self.there[1..].fill(false);
            (state.frames, state.next) = (1, 1);
        }
    }

    /// Indices of frames known to be missing: all of them if the packet's length is known, else the
    /// next one. If the packet came damaged, frame 0 is among them.
    pub(super) fn missing(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        let known = self.packet.map_or(0, |state| match state.extent.total {
            Some(total) => self.layout.count(total),
            None => state.next + 1,
        });
        let damaged = self.packet.is_some_and(|state| state.damaged);
        let frames = self.there.iter().take(known).enumerate();
        frames.filter(move |(index, there)| !**there || *index == 0 && damaged).map(|(i, _)| i)
    }

    /// Frames of the packet, if its length is known.
    pub(super) fn expected(&self) -> Option<usize> {
        Some(self.layout.count(self.total()?))
    }

    #[cfg(test)]
    pub(super) fn capacity(&self) -> usize {
        self.bytes.capacity() + self.there.capacity()
    }
}

impl State {
    /// The packet's length; beyond every frame if it is not known.
    fn end(&self) -> usize {
        self.extent.total.unwrap_or(usize::MAX)
    }
}
