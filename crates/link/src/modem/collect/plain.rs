//! Unprotected shares to a packet.

use crate::modem::error::ModemError;
use crate::modem::wire::layout::Layout;
use crate::modem::wire::plain::{Continuation, First, Small, TAGS};
use nvsprior::packet::{Extent, Latent, PacketError, is_predicted, nearest_frame};

use super::collected::CollectorStatistics;
use super::slot::{Form, Plain, Slot, Start, State, Taken};

/// What a continuation is to a packet.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Bond {
    /// It is the packet's, and there now.
    Bound,
    /// It is the packet's, and was there.
    Duplicate,
    /// It is not the packet's.
    Stranger,
}

/// How unprotected packets are read.
#[derive(Clone, Copy)]
pub struct How {
    pub layout: Layout,
    /// The modem hands over no damaged frames.
    pub trusted: bool,
    /// Frame number of a packet before.
    pub last: Option<u32>,
}

impl How {
    /// What a first share says of its packet; `None`: it does not hold the whole latent part. `room`: for its bytes.
    ///
    /// # Errors
    /// If it is the start of no packet.
    pub fn extent(self, first: &First, room: &mut Vec<u8>) -> Result<Option<Extent>, PacketError> {
        let len = first.data.len();
        room.clear();
        room.extend_from_slice(first.data);
        // As many bytes do not travel, so there is room for them.
        room.resize(len + 2, 0);
        let restored = self.layout.travelling().restore(room, len, first.number, self.last);
        match Extent::read(&room[..restored.unwrap_or(0)]) {
            Ok(extent) => Ok(Some(extent)),
            Err(PacketError::TooShort { .. }) if !first.last => Ok(None),
            Err(error) => Err(error),
        }
    }
}

impl Slot {
    /// The state of an unprotected packet.
    fn plain(&self) -> Option<(State, Plain)> {
        let state = self.state()?;
        match state.form {
            Form::Plain(plain) => Some((state, plain)),
            _ => None,
        }
    }

    /// Whether it holds the first share of an unprotected packet of this tag.
    pub fn has_tag(&self, tag: usize) -> bool {
        self.plain()
            .is_some_and(|(state, plain)| plain.next > 0 && state.number as usize % TAGS == tag)
    }

    /// Bytes of the packet that count so far.
    pub fn valid_len(&self) -> usize {
        self.state().map_or(0, |state| state.filled)
    }

    /// Takes the first share of an unprotected packet that came at `now`, and what it says of its packet. Another
    /// packet makes room for it.
    ///
    /// # Errors
    /// If it contradicts the one that is there, and a continuation vouches for that
    /// one. If the packet has protected shares.
    pub fn begin(
        &mut self,
        now: f64,
        (first, extent): (&First, Option<Extent>),
        how: How,
        statistics: &mut CollectorStatistics,
    ) -> Result<Taken, ModemError> {
        let binding = first.binding();
        let predicted = first.data.first().is_some_and(|first| is_predicted(*first));
        let sure = extent.is_some_and(|extent| !predicted || extent.whole.is_some());
        if let Some((state, plain)) = self.plain() {
            if plain.next > 0 && plain.binding == binding {
                return Ok(Taken::Duplicate);
            }
            // Of two first shares, keep the one that checks vouch for, else the one that came last.
            if plain.vouched && self.is_of(first, how) || plain.sure && !sure {
                return Err(ModemError::Contradicts(state.number));
            }
        }
        match self.state() {
            // Another packet with the same number is under way with protection.
            Some(State { form: Form::Layers { .. }, number, .. }) => {
                return Err(ModemError::OtherShare(number));
            }
            Some(_) if !self.is_of(first, how) => {
                self.let_go(statistics);
                self.since = now;
            }
            Some(_) => {}
            None => self.since = now,
        }
        self.there.fill(false);
        self.there[0] = true;
        self.shares[..first.data.len()].copy_from_slice(first.data);
        let plain = Plain {
            layout: how.layout,
            binding,
            own: extent.map_or(0, |extent| extent.valid),
            sure,
            next: 1,
            end: first.last.then_some((1, first.data.len())),
            vouched: how.trusted,
            damaged: false,
        };
        let form = Form::Plain(plain);
        let state = State { number: first.number, form, arrived: 1, filled: 0, start: None };
        self.settle(state, plain, how);
        Ok(self.brought(0))
    }

    /// Whether a first share is of the packet that is there: it has the same latent part, or is as long as that.
    fn is_of(&self, first: &First, how: How) -> bool {
        let latent =
            self.state().and_then(|state| state.start).map_or(0, |start| start.extent.latent);
        let latent = latent.saturating_sub(how.layout.travelling().least());
        let own = &self.shares[..how.layout.start(1)];
        match (latent, first.data.get(..latent)) {
            (1.., Some(data)) => own.starts_with(data),
            _ => true,
        }
    }

    /// Takes a continuation whose index there is room for.
    pub fn offer(&mut self, later: &Continuation, how: How) -> Bond {
        let Some((mut state, mut plain)) = self.plain() else { return Bond::Stranger };
        if !later.binds(plain.binding) {
            return Bond::Stranger;
        }
        if self.there[later.index] {
            return Bond::Duplicate;
        }
        (plain.vouched, plain.sure) = (true, true);
        self.put(&mut state, &mut plain, (later.index, later.last, later.data));
        self.settle(state, plain, how);
        Bond::Bound
    }

    /// Takes a small share that came at `now`.
    pub fn take_small(&mut self, now: f64, small: &Small, how: How) -> Taken {
        let (mut state, mut plain) = self.plain().unwrap_or_else(|| {
            self.since = now;
            let plain = Plain {
                layout: how.layout,
                binding: 0,
                own: 0,
                sure: false,
                next: 0,
                end: None,
                vouched: true,
                damaged: false,
            };
            let form = Form::Plain(plain);
            (State { number: small.number, form, arrived: 0, filled: 0, start: None }, plain)
        });
        if self.there[small.index] {
            return Taken::Duplicate;
        }
        let before = state.filled;
        self.put(&mut state, &mut plain, (small.index, small.last, small.data));
        self.settle(state, plain, how);
        self.brought(before)
    }

    /// Puts a share's data in their place.
    fn put(&mut self, state: &mut State, plain: &mut Plain, share: (usize, bool, &[u8])) {
        let (index, last, data) = share;
        let place = plain.layout.start(index);
        self.shares[place..place + data.len()].copy_from_slice(data);
        self.there[index] = true;
        state.arrived += 1;
        if last {
            plain.end = Some((index + 1, place + data.len()));
        }
        while self.there.get(plain.next) == Some(&true) {
            plain.next += 1;
        }
    }

    /// Judges what is there without a gap. If all shares are there and the packet's own checks do not match, a share's
    /// check has missed damage. Then forgets the shares after the first.
    fn settle(&mut self, mut state: State, mut plain: Plain, how: How) {
        let all = plain.end.filter(|(count, _)| plain.next >= *count);
        let travelled = all.map_or(plain.layout.start(plain.next), |(_, end)| end);
        let len = self.restore(travelled, state.number, how);
        let extent = Extent::read(&self.bytes[..len]);
        let is_whole = extent.as_ref().is_ok_and(|extent| extent.whole.is_some());
        if all.is_some() && !is_whole {
            (plain.damaged, plain.vouched) = (true, false);
            self.there[1..].fill(false);
            (state.arrived, plain.next, plain.end) =
                (1, 1, plain.end.filter(|(count, _)| *count > 1));
        } else if plain.next > 1 {
            plain.damaged = false;
        }
        let complete = all.is_some() && is_whole;
        state.start = extent.ok().map(|extent| Start {
            frame: nearest_frame(extent.frame, Latent::FRAMES, how.last),
            extent,
            at: 0,
            user: None,
            complete,
            ended: complete,
        });
        let whole = state.start.and_then(|start| start.extent.whole).filter(|_| complete);
        state.filled = match () {
            () if plain.vouched || complete => whole.unwrap_or(len),
            () => plain.own.min(len),
        };
        state.form = Form::Plain(plain);
        self.known = state;
    }

    /// Writes the packet of which so many bytes have travelled. Returns its length.
    fn restore(&mut self, travelled: usize, number: u32, how: How) -> usize {
        self.bytes[..travelled].copy_from_slice(&self.shares[..travelled]);
        let travelling = how.layout.travelling();
        travelling.restore(&mut self.bytes, travelled, number, how.last).unwrap_or(0)
    }

    /// What a share of an unprotected packet has brought, which had `before` valid bytes.
    pub fn brought(&self, before: usize) -> Taken {
        let Some((state, plain)) = self.plain() else { return Taken::Kept };
        let Some(start) = state.start else { return Taken::Kept };
        match () {
            () if start.complete => Taken::Complete(start.frame),
            () if plain.damaged => Taken::Damaged(state.number),
            () if state.filled > before => Taken::Grown(start.frame),
            () => Taken::Kept,
        }
    }
}
