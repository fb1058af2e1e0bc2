//! The shares of one packet.

use crate::packet::{Extent, sound_len};

use super::super::super::report::{ArrivedShares, PacketState, ToldPacket};
use super::super::code::Known;
use super::super::header::{Header, PacketHeader};
use super::super::packet::take_contents;
use super::super::sharing::Layer;
use super::{CollectedPacket, ModemError, ShareStatistics, filled};

/// Room for a packet and its shares.
pub(super) struct Slot {
    /// Bytes of data of a share that there is room for.
    room: usize,
    /// Data of the shares, each at its index.
    shares: Vec<u8>,
    there: Vec<bool>,
    /// The layers so far, one after another.
    bytes: Vec<u8>,
    state: Option<State>,
    /// When the packet's first share came, seconds.
    since: f64,
}

/// What is known of the packet.
#[derive(Clone, Copy)]
struct State {
    header: PacketHeader,
    arrived: usize,
    /// Layers that are in `bytes`.
    layers: usize,
    /// Bytes of `bytes` that hold them.
    filled: usize,
    packet: Option<Start>,
}

/// What is known once the first layer is there.
#[derive(Clone, Copy)]
struct Start {
    extent: Extent,
    /// Where the packet's bytes begin.
    at: usize,
    user: Option<(usize, usize)>,
    complete: bool,
    /// All layers are there.
    ended: bool,
}

/// What a share has brought.
pub(super) enum Taken {
    Kept,
    Duplicate,
    /// The packet was whole before.
    Surplus,
    /// The packet of this frame number has more bytes.
    Grown(u32),
    /// It is whole.
    Complete(u32),
    /// Its checks do not match.
    Damaged,
}

impl Slot {
    /// Bytes of memory.
    pub(super) fn memory(shares: usize, mtu: usize) -> usize {
        2 * shares * mtu + shares
    }

    pub(super) fn new(shares: usize, mtu: usize) -> Result<Slot, ModemError> {
        Ok(Slot {
            room: mtu,
            shares: filled(shares * mtu, 0)?,
            there: filled(shares, false)?,
            bytes: filled(shares * mtu, 0)?,
            state: None,
            since: 0.0,
        })
    }

    pub(super) fn clear(&mut self) {
        self.state = None;
        self.there.fill(false);
    }

    /// When the packet's first share came; `None`: there is no packet.
    pub(super) fn since(&self) -> Option<f64> {
        self.state.map(|_| self.since)
    }

    /// Counts the packet, if there is one, and drops it.
    pub(super) fn let_go(&mut self, statistics: &mut ShareStatistics) {
        if let Some(state) = self.state {
            statistics.arrived += state.arrived as u64;
            statistics.sent += state.header.count as u64;
            match state.packet {
                Some(start) if start.complete => {
                    statistics.repaired += u64::from(state.arrived < state.header.count);
                }
                Some(_) => statistics.partial += 1,
                None => statistics.lost += 1,
            }
        }
        self.clear();
    }

    /// What is known of the packet, if it may be that of a frame number.
    fn state_of(&self, frame: u32) -> Option<State> {
        self.state.filter(|state| {
            let is_of = |start: Start| start.extent.may_be(frame);
            state.header.number == frame % super::NUMBERS && state.packet.is_none_or(is_of)
        })
    }

    /// What has come of the packet of a frame number.
    pub(super) fn packet(&self, frame: u32) -> Option<CollectedPacket<'_>> {
        self.collected(self.state_of(frame)?)
    }

    /// What has come of the packet of a frame number modulo [`NUMBERS`](super::NUMBERS).
    pub(super) fn numbered(&self, number: u32) -> Option<CollectedPacket<'_>> {
        self.collected(self.state.filter(|state| state.header.number == number)?)
    }

    fn collected(&self, state: State) -> Option<CollectedPacket<'_>> {
        let start = state.packet?;
        Some(CollectedPacket {
            frame: start.extent.frame,
            bytes: self.packet_bytes(&state)?,
            complete: start.complete,
            ended: start.ended,
            user: start.user.map(|(from, to)| &self.bytes[from..to]),
            arrived: state.arrived,
            sent: state.header.count,
        })
    }

    fn packet_bytes(&self, state: &State) -> Option<&[u8]> {
        let start = state.packet?;
        let end = start.at.saturating_add(start.extent.total.unwrap_or(usize::MAX));
        self.bytes.get(start.at..end.min(state.filled))
    }

    /// Shares that the packet of a frame number was sent in; 0 if none of them came.
    pub(super) fn sent(&self, frame: u32) -> usize {
        self.state_of(frame).map_or(0, |state| state.header.count)
    }

    /// Indices of shares that are there.
    pub(super) fn arrived(&self, frame: u32) -> impl Iterator<Item = usize> + '_ {
        (0..self.sent(frame)).filter(|index| self.there[*index])
    }

    /// Indices of shares that are not there, unless the packet is complete.
    pub(super) fn missing(&self, frame: u32) -> impl Iterator<Item = usize> + '_ {
        let whole = |state: &State| state.packet.is_some_and(|start| start.complete);
        let state = self.state_of(frame).filter(|state| !whole(state));
        let count = state.map_or(0, |state| state.header.count);
        (0..count).filter(|index| !self.there[*index])
    }

    /// What came of the packet of a frame number.
    pub(super) fn told(&self, frame: u32, kept: impl Fn(u32) -> bool) -> ToldPacket {
        let Some(state) = self.state_of(frame) else { return ToldPacket::default() };
        let whole = state.packet.is_some_and(|start| start.complete);
        let told = |state_of| ToldPacket {
            state: state_of,
            arrived: state.arrived,
            shares: ArrivedShares::default(),
        };
        match whole {
            true if kept(frame) => told(PacketState::Kept),
            true => told(PacketState::Whole),
            false => ToldPacket {
                shares: ArrivedShares::new(state.header.count, self.arrived(frame)),
                ..told(PacketState::Part)
            },
        }
    }

    /// Takes a share that came at `now`. `last`: the frame number of a packet before, to complete a short one's.
    pub(super) fn take(
        &mut self,
        now: f64,
        header: &Header,
        data: &[u8],
        last: Option<u32>,
    ) -> Result<Taken, ModemError> {
        if data.len() > self.room {
            return Err(ModemError::NoRoom { index: header.index, room: self.there.len() });
        }
        if self.state.is_none() {
            self.since = now;
        }
        let fresh = State { header: header.packet, arrived: 0, layers: 0, filled: 0, packet: None };
        let mut state = *self.state.get_or_insert(fresh);
        if state.header != header.packet {
            return Err(ModemError::OtherShare(header.packet.number));
        }
        if self.there[header.index] {
            return Ok(Taken::Duplicate);
        }
        self.there[header.index] = true;
        state.arrived += 1;
        if state.packet.is_some_and(|start| start.complete) {
            self.state = Some(state);
            return Ok(Taken::Surplus);
        }
        self.shares[header.index * self.room..][..data.len()].copy_from_slice(data);
        let before = state.filled;
        let sound = self.grow(&mut state, last);
        self.state = Some(state);
        if sound.is_none() {
            self.clear();
            return Ok(Taken::Damaged);
        }
        let Some(start) = state.packet else { return Ok(Taken::Kept) };
        let frame = start.extent.frame;
        Ok(match () {
            () if start.complete => Taken::Complete(frame),
            () if state.filled > before => Taken::Grown(frame),
            () => Taken::Kept,
        })
    }

    /// Solves the layers whose threshold is reached. `None` if what they hold is not what a sender writes.
    fn grow(&mut self, state: &mut State, last: Option<u32>) -> Option<()> {
        let header = state.header;
        let first = Layer { threshold: header.threshold, chunk: header.chunk };
        if state.layers == 0 && state.arrived >= first.threshold {
            self.solve(first, 0, state);
            state.packet = Some(self.start(first, &header, last)?);
        }
        let (Some(mut start), 1..) = (state.packet, state.layers) else { return Some(()) };
        let layer = &self.bytes[..first.len()];
        let (contents, _) = take_contents(layer, first, header.count, header.data_len())?;
        let (layers, others) = (contents.layers, contents.others);
        let mut at = first.chunk;
        for (k, layer) in layers[..others].iter().enumerate() {
            if state.layers == k + 1 && state.arrived >= layer.threshold {
                self.solve(*layer, at, state);
            }
            at += layer.chunk;
        }
        start.ended = state.layers > others;
        self.judge(start, state)
    }

    /// Appends a layer, whose chunk lies at `at` in each share.
    fn solve(&mut self, layer: Layer, at: usize, state: &mut State) {
        let there = || (0..state.header.count).filter(|index| self.there[*index]);
        let chunk = |index: usize| &self.shares[index * self.room + at..][..layer.chunk];
        let known = Known::new(there().take(layer.threshold));
        let bytes = self.bytes[state.filled..].chunks_exact_mut(layer.chunk);
        for (index, bytes) in bytes.take(layer.threshold).enumerate() {
            match self.there[index] {
                true => bytes.copy_from_slice(chunk(index)),
                false => known.write(index, chunk, bytes),
            }
        }
        state.filled += layer.len();
        state.layers += 1;
    }

    /// Reads the first layer.
    fn start(&self, first: Layer, header: &PacketHeader, last: Option<u32>) -> Option<Start> {
        let layer = &self.bytes[..first.len()];
        let (contents, packet) = take_contents(layer, first, header.count, header.data_len())?;
        let extent = Extent::read(packet).ok()?.near(last);
        let at = first.len() - packet.len();
        let user = contents.user.map(|user| (at - user.len(), at));
        let named = extent.frame % super::NUMBERS == header.number;
        (named && packet.len() >= extent.latent).then_some(Start {
            extent,
            at,
            user,
            complete: false,
            ended: false,
        })
    }

    /// Looks at what there is of the packet. `None` if it is whole and its checks do not match.
    fn judge(&self, mut start: Start, state: &mut State) -> Option<()> {
        if start.extent.total.is_none() {
            let bytes = &self.bytes[start.at..state.filled];
            start.extent.total = Extent::read(bytes).ok()?.total;
        }
        let whole = start.extent.total.and_then(|total| {
            self.bytes[..state.filled].get(start.at..start.at.saturating_add(total))
        });
        if let Some(whole) = whole {
            start.complete = sound_len(whole) == whole.len();
            if !start.complete {
                return None;
            }
        }
        state.packet = Some(start);
        Some(())
    }
}
