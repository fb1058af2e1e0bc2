//! The shares of one packet, and what is known of it.

use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_SHARES, NUMBERS};
use crate::modem::memory::filled;
use crate::modem::report::{ArrivedShares, PacketState, ReportedPacket};
use crate::modem::wire::layout::Layout;
use crate::modem::wire::share::PacketHeader;
use nvsprior::packet::Extent;

use super::collected::{CollectedPacket, CollectorStatistics};

/// Room for a packet and its shares.
pub struct Slot {
    /// Bytes of data of a share that there is room for.
    pub(super) room: usize,
    /// Data of shares, each at its place.
    pub(super) shares: Vec<u8>,
    /// By index: the share is there.
    pub(super) there: Vec<bool>,
    /// Protected: the layers so far, one after another. Unprotected: the packet.
    pub(super) bytes: Vec<u8>,
    /// See [`Slot::state`].
    pub(super) known: State,
    /// When the packet's first share came, seconds.
    pub(super) since: f64,
}

/// What is known of the packet.
#[derive(Clone, Copy)]
pub(super) struct State {
    /// The number that shares state.
    pub number: u32,
    pub form: Form,
    /// Shares that are there.
    pub arrived: usize,
    /// Bytes of `bytes` that count.
    pub filled: usize,
    pub start: Option<Start>,
}

/// In which form the packet travels.
#[derive(Clone, Copy)]
pub(super) enum Form {
    /// There is no packet.
    None,
    Layers {
        header: PacketHeader,
        /// Layers that are in `bytes`.
        solved: usize,
    },
    Plain(Plain),
}

/// What is known of an unprotected packet.
#[derive(Clone, Copy)]
pub(super) struct Plain {
    pub layout: Layout,
    /// Names it in the checks of its continuations.
    pub binding: u32,
    /// Bytes of the packet at the start of its first share that its own checks vouch for.
    pub own: usize,
    /// A check has vouched for its first share. One of a predicted pose has none before its end.
    pub sure: bool,
    /// Index of the first share that is not there.
    pub next: usize,
    /// How many shares it has and how many bytes travel, if the last share has come.
    pub end: Option<(usize, usize)>,
    /// All bytes of the shares that are there count as valid: a continuation's check matched, or the modem is trusted.
    pub vouched: bool,
    /// All shares were there and the packet's checks did not match.
    pub damaged: bool,
}

/// What is known once the packet's start is there.
#[derive(Clone, Copy)]
pub(super) struct Start {
    pub extent: Extent,
    /// The frame number, completed.
    pub frame: u32,
    /// Where the packet's bytes begin.
    pub at: usize,
    pub user: Option<(usize, usize)>,
    pub complete: bool,
    /// No share brings more.
    pub ended: bool,
}

/// What a share has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    Kept,
    /// It waits for its packet.
    Waits,
    Duplicate,
    /// The packet was whole before.
    Surplus,
    /// The packet of this frame number has more bytes.
    Grown(u32),
    /// It is whole.
    Complete(u32),
    /// Its checks do not match. The number is the one that shares state.
    Damaged(u32),
}

impl State {
    /// Not an `Option`: all of it is always written, so a memory checker finds nothing that a compiler reads ahead.
    const NO_PACKET: State =
        State { number: 0, form: Form::None, arrived: 0, filled: 0, start: None };

    fn is_small(&self) -> bool {
        matches!(self.form, Form::Plain(plain) if plain.layout.is_small())
    }

    fn is_complete(&self) -> bool {
        self.start.is_some_and(|start| start.complete)
    }

    /// Shares that the packet was sent in.
    fn sent(&self) -> Option<usize> {
        match self.form {
            Form::None => None,
            Form::Layers { header, .. } => Some(header.count),
            Form::Plain(plain) => plain.end.map(|(count, _)| count),
        }
    }

    /// Shares that are known of: without a length, those up to the first missing one.
    fn known(&self) -> usize {
        match self.form {
            Form::None => 0,
            Form::Layers { header, .. } => header.count,
            Form::Plain(plain) => plain.end.map_or(plain.next + 1, |(count, _)| count),
        }
    }

    /// Whether the share of this index must come again, as damage hides in it.
    fn is_damaged(&self, index: usize) -> bool {
        matches!(self.form, Form::Plain(plain) if plain.damaged && index == 0)
    }
}

impl Slot {
    pub fn memory(shares: usize, mtu: usize) -> usize {
        2 * shares * mtu + shares + 2
    }

    pub fn new(shares: usize, mtu: usize) -> Result<Slot, ModemError> {
        Ok(Slot {
            room: mtu,
            shares: filled(shares * mtu, 0)?,
            there: filled(shares, false)?,
            // The frame number does not travel.
            bytes: filled(shares * mtu + 2, 0)?,
            known: State::NO_PACKET,
            since: 0.0,
        })
    }

    pub fn clear(&mut self) {
        self.known = State::NO_PACKET;
        self.there.fill(false);
    }

    /// What is known of the packet; `None`: there is no packet.
    pub(super) fn state(&self) -> Option<State> {
        (!matches!(self.known.form, Form::None)).then_some(self.known)
    }

    /// When the packet's first share came; `None`: there is no packet.
    pub fn since(&self) -> Option<f64> {
        self.state().map(|_| self.since)
    }

    /// Counts the packet, if there is one, and drops it.
    pub fn let_go(&mut self, statistics: &mut CollectorStatistics) {
        if let Some(state) = self.state() {
            if let Some(sent) = state.sent() {
                statistics.arrived += state.arrived as u64;
                statistics.sent += sent as u64;
            }
            let repaired = state.sent().is_some_and(|sent| state.arrived < sent);
            match state.start {
                Some(start) if start.complete => statistics.repaired += u64::from(repaired),
                Some(_) if state.filled > 0 => statistics.partial += 1,
                _ => statistics.lost += 1,
            }
        }
        self.clear();
    }

    /// What is known of the packet, if it may be that of a frame number.
    fn state_of(&self, frame: u32) -> Option<State> {
        self.state().filter(|state| match state.start {
            Some(start) if state.filled > 0 => start.frame as u16 == frame as u16,
            // A small share tells nothing of the frame number.
            _ => !state.is_small() && state.number == frame % NUMBERS,
        })
    }

    /// Whether it holds a packet that may be that of a frame number.
    pub fn may_be(&self, frame: u32) -> bool {
        self.state_of(frame).is_some()
    }

    /// What has come of the packet of a frame number.
    pub fn packet(&self, frame: u32) -> Option<CollectedPacket<'_>> {
        self.collected(self.state_of(frame)?)
    }

    /// What has come of the packet whose shares state a number.
    pub fn numbered(&self, number: u32) -> Option<CollectedPacket<'_>> {
        self.collected(self.state().filter(|state| state.number == number)?)
    }

    fn collected(&self, state: State) -> Option<CollectedPacket<'_>> {
        let start = state.start?;
        let whole = start.extent.whole.filter(|_| start.complete);
        let end = whole.map_or(state.filled, |whole| start.at + whole);
        let bytes = self.bytes.get(start.at..end)?;
        (!bytes.is_empty()).then_some(CollectedPacket {
            frame: start.frame,
            bytes,
            complete: start.complete,
            ended: start.ended,
            user: start.user.map(|(from, to)| &self.bytes[from..to]),
            arrived: state.arrived,
            sent: state.sent(),
        })
    }

    /// Shares that are known of the packet of a frame number; 0 if none of them came.
    pub fn known(&self, frame: u32) -> usize {
        self.state_of(frame).map_or(0, |state| state.known().min(self.there.len()))
    }

    /// Indices of shares that are there.
    pub fn arrived(&self, frame: u32) -> impl Iterator<Item = usize> + '_ {
        (0..self.known(frame)).filter(|index| self.there[*index])
    }

    /// Indices of shares that are not there, unless the packet is complete.
    pub fn missing(&self, frame: u32) -> impl Iterator<Item = usize> + '_ {
        let state = self.state_of(frame).filter(|state| !state.is_complete());
        let known = state.map_or(0, |state| state.known().min(self.there.len()));
        let damaged = move |index| state.is_some_and(|state| state.is_damaged(index));
        (0..known).filter(move |index| !self.there[*index] || damaged(*index))
    }

    /// What a report says of the packet of a frame number.
    pub fn report(&self, frame: u32, kept: impl Fn(u32) -> bool) -> ReportedPacket {
        let Some(state) = self.state_of(frame) else { return ReportedPacket::default() };
        let (complete, arrived) = (state.is_complete(), state.arrived);
        let shares = match complete {
            true => ArrivedShares::default(),
            false => ArrivedShares::new(self.known(frame).min(MAX_SHARES), self.arrived(frame)),
        };
        let state = match complete {
            true if kept(frame) => PacketState::Kept,
            true => PacketState::Whole,
            false => PacketState::Part,
        };
        ReportedPacket { state, arrived, shares }
    }

    #[cfg(test)]
    pub fn capacity(&self) -> usize {
        let Slot { shares, there, bytes, .. } = self;
        shares.capacity() + there.capacity() + bytes.capacity()
    }
}
