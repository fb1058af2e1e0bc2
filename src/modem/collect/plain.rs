//! Unprotected shares to a packet.

use crate::modem::error::ModemError;
use crate::modem::limits::NUMBERS;
use crate::modem::wire::continuation::{Continuation, binding, tag_of};
use crate::modem::wire::layout::Layout;
use crate::packet::{Extent, valid_len};

use super::collected::CollectorStatistics;
use super::slot::{Form, Plain, Slot, Start, State, Taken};

/// What a continuation is to a packet.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Bond {
    /// It is the packet's, and there now.
    Bound,
    /// It is the packet's, and was there.
    Duplicate,
    /// It is not the packet's, or nothing can tell until the packet's length is known.
    Stranger,
}

/// What a packet's first share is to what the slot holds.
pub enum Arrival {
    /// It begins the packet anew.
    New,
    /// It was there.
    Duplicate,
}

impl Slot {
    /// The state of an unprotected packet.
    fn plain(&self) -> Option<(State, Plain, Start)> {
        let state = self.state()?;
        match (state.form, state.start) {
            (Form::Plain(plain), Some(start)) => Some((state, plain, start)),
            _ => None,
        }
    }

    /// Whether it holds an unprotected packet of this tag.
    pub fn has_tag(&self, tag: usize) -> bool {
        self.plain().is_some_and(|(.., start)| tag_of(start.extent.frame) == tag)
    }

    /// Bytes of the packet that count so far.
    pub fn valid_len(&self) -> usize {
        self.state().map_or(0, |state| state.filled)
    }

    /// Whether the length of an unprotected packet is known.
    pub fn has_length(&self) -> bool {
        self.plain().is_some_and(|(_, plain, _)| plain.count.is_some())
    }

    /// Index of the first share of an unprotected packet that is not there.
    pub fn next(&self) -> Option<usize> {
        self.plain().map(|(_, plain, _)| plain.next)
    }

    /// Takes the first share of an unprotected packet, without padding, that came at `now`. Another packet makes room
    /// for it. `trusted`: all of it counts as valid.
    ///
    /// # Errors
    /// If it contradicts the one that is there, and a continuation vouches for that one. If the packet has protected
    /// shares.
    pub fn begin(
        &mut self,
        now: f64,
        (first, extent): (&[u8], Extent),
        (layout, trusted): (Layout, bool),
        statistics: &mut CollectorStatistics,
    ) -> Result<Arrival, ModemError> {
        if let Some((_, plain, start)) = self.plain() {
            let end = start.extent.total.unwrap_or(usize::MAX);
            if self.bytes[layout.range(0, end)] == *first {
                return Ok(Arrival::Duplicate);
            }
            // Of two first shares, keep the one that continuations vouch for, else the one that came last.
            let same = self.is_of(first, &extent, &start.extent);
            if same && plain.vouched {
                return Err(ModemError::Contradicts(extent.frame));
            }
            if !same {
                self.let_go(statistics);
            }
        }
        match self.state() {
            // Another packet with the same number is under way with protection.
            Some(State { form: Form::Layers { .. }, number, .. }) => {
                return Err(ModemError::OtherShare(number));
            }
            Some(_) => {}
            None => self.since = now,
        }
        self.there.fill(false);
        self.there[0] = true;
        self.bytes[..first.len()].copy_from_slice(first);
        let plain = Plain {
            layout,
            binding: binding(first),
            own: valid_len(first),
            next: 1,
            count: extent.total.map(|total| layout.count(total)),
            vouched: trusted,
            damaged: false,
        };
        let start = Start { extent, at: 0, user: None, complete: false, ended: false };
        let (number, form) = (extent.frame % NUMBERS, Form::Plain(plain));
        let state = State { number, form, arrived: 1, filled: 0, start: Some(start) };
        self.settle(state, plain, start);
        Ok(Arrival::New)
    }

    /// Whether a first share is of the packet that is there. Compares the latent part, or the frame number if the share
    /// does not hold all of it.
    fn is_of(&self, first: &[u8], extent: &Extent, own: &Extent) -> bool {
        match first.get(..extent.latent) {
            Some(latent) => latent == &self.bytes[..extent.latent],
            None => extent.frame == own.frame,
        }
    }

    /// Takes a continuation whose index there is room for.
    pub fn offer(&mut self, later: &Continuation) -> Bond {
        let Some((mut state, mut plain, mut start)) = self.plain() else { return Bond::Stranger };
        let Continuation { index, data, .. } = *later;
        let layout = plain.layout;
        if self.there[index] {
            let held = &self.bytes[layout.range(index, start.extent.total.unwrap_or(usize::MAX))];
            let same = data.starts_with(held) && later.binds(plain.binding, held.len());
            return if same { Bond::Duplicate } else { Bond::Stranger };
        }
        // Put it in its place first, as the packet's length may lie in it. Nobody reads the place
        // until the share counts as there.
        let place = layout.start(index);
        let end = place + data.len();
        self.bytes[place..end].copy_from_slice(data);
        let total = match start.extent.total {
            None if index == plain.next => match Extent::read(&self.bytes[..end]) {
                Ok(extent) => extent.total,
                Err(_) => return Bond::Stranger,
            },
            None => return Bond::Stranger,
            total => total,
        };
        let due = layout.range(index, total.unwrap_or(usize::MAX)).len();
        if due == 0 || !later.binds(plain.binding, due) {
            return Bond::Stranger;
        }
        start.extent.total = total;
        plain.count = total.map(|total| layout.count(total));
        plain.vouched = true;
        state.arrived += 1;
        self.there[index] = true;
        while self.there.get(plain.next) == Some(&true) {
            plain.next += 1;
        }
        self.settle(state, plain, start);
        Bond::Bound
    }

    /// Judges the packet once all shares are there. If its own checks do not match, a share's check has missed damage.
    /// Then forgets the shares after the first.
    fn settle(&mut self, mut state: State, mut plain: Plain, mut start: Start) {
        let all = plain.count.is_some_and(|count| plain.next >= count);
        if let Some(total) = start.extent.total.filter(|_| all) {
            start.complete = valid_len(&self.bytes[..total]) == total;
            start.ended = start.complete;
            plain.vouched = start.complete;
            plain.damaged = !start.complete;
            if plain.damaged {
                self.there[1..].fill(false);
                (state.arrived, plain.next) = (1, 1);
            }
        }
        let end = start.extent.total.unwrap_or(usize::MAX);
        let without_gap = plain.layout.range(plain.next - 1, end).end;
        state.filled = if plain.vouched { without_gap } else { plain.own };
        state.form = Form::Plain(plain);
        state.start = Some(start);
        self.known = state;
    }

    /// What a share of an unprotected packet has brought, which had `before` valid bytes.
    pub fn brought(&self, before: usize) -> Taken {
        let Some((state, plain, start)) = self.plain() else { return Taken::Kept };
        match () {
            () if start.complete => Taken::Complete(start.extent.frame),
            () if plain.damaged && state.arrived == 1 => Taken::Damaged(state.number),
            () if state.filled > before => Taken::Grown(start.extent.frame),
            () => Taken::Kept,
        }
    }
}
