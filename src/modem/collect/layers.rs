//! Protected shares to a packet.

use crate::modem::error::ModemError;
use crate::modem::limits::NUMBERS;
use crate::modem::wire::code::Known;
use crate::modem::wire::contents::{End, Layer, take_contents};
use crate::modem::wire::share::{Header, PacketHeader};
use crate::packet::{Extent, is_predicted, mark_whole, valid_len};

use super::slot::{Form, Slot, Start, State, Taken};

impl Slot {
    /// Takes a protected share that came at `now`. `last`: the frame number of a packet before, to complete a short
    /// one's.
    pub fn take_share(
        &mut self,
        now: f64,
        header: &Header,
        data: &[u8],
        last: Option<u32>,
    ) -> Result<Taken, ModemError> {
        if data.len() > self.room {
            return Err(ModemError::NoRoom { index: header.index, room: self.there.len() });
        }
        let fresh = State {
            number: header.packet.number,
            form: Form::Layers { header: header.packet, solved: 0 },
            arrived: 0,
            filled: 0,
            start: None,
        };
        let mut state = self.state().unwrap_or_else(|| {
            self.since = now;
            fresh
        });
        match state.form {
            Form::Layers { header: own, .. } if own == header.packet => {}
            _ => return Err(ModemError::OtherShare(header.packet.number)),
        }
        if self.there[header.index] {
            return Ok(Taken::Duplicate);
        }
        self.there[header.index] = true;
        state.arrived += 1;
        if state.start.is_some_and(|start| start.complete) {
            self.known = state;
            return Ok(Taken::Surplus);
        }
        self.shares[header.index * self.room..][..data.len()].copy_from_slice(data);
        let before = state.filled;
        let valid = self.grow(&mut state, last);
        self.known = state;
        if valid.is_none() {
            self.clear();
            return Ok(Taken::Damaged(header.packet.number));
        }
        let Some(start) = state.start else { return Ok(Taken::Kept) };
        let frame = start.extent.frame;
        Ok(match () {
            () if start.complete => Taken::Complete(frame),
            () if state.filled > before => Taken::Grown(frame),
            () => Taken::Kept,
        })
    }

    /// Solves the layers whose threshold is reached. `None` if what they hold is not what a sender writes.
    fn grow(&mut self, state: &mut State, last: Option<u32>) -> Option<()> {
        let Form::Layers { header, mut solved } = state.form else { return None };
        let first = Layer { threshold: header.threshold, chunk: header.chunk };
        if solved == 0 && state.arrived >= first.threshold {
            self.solve(first, 0, header.count, state);
            solved = 1;
            state.start = Some(self.read_start(first, &header, last, state)?);
        }
        let (Some(mut start), 1..) = (state.start, solved) else { return Some(()) };
        let layer = &self.bytes[..first.len()];
        let (contents, _) = take_contents(layer, first, header.count, header.data_len())?;
        let (layers, others, contents_end) = (contents.layers, contents.others, contents.end);
        let mut at = first.chunk;
        for (k, layer) in layers[..others].iter().enumerate() {
            if solved == k + 1 && state.arrived >= layer.threshold {
                self.solve(*layer, at, header.count, state);
                solved += 1;
            }
            at += layer.chunk;
        }
        state.form = Form::Layers { header, solved };
        start.ended = solved > others;
        if start.ended && start.extent.is_open && !start.complete {
            start.extent.total = self.end_of(&start, contents_end, state)?;
        }
        self.judge(start, state)
    }

    /// Appends a layer, whose chunk lies at `at` in each of `count` shares.
    fn solve(&mut self, layer: Layer, at: usize, count: usize, state: &mut State) {
        let there = || (0..count).filter(|index| self.there[*index]);
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
    }

    fn read_start(
        &mut self,
        first: Layer,
        header: &PacketHeader,
        last: Option<u32>,
        state: &mut State,
    ) -> Option<Start> {
        let layer = &self.bytes[..first.len()];
        let (_, packet) = take_contents(layer, first, header.count, header.data_len())?;
        let at = first.len() - packet.len();
        if is_predicted(packet) {
            // Its frame number did not travel.
            self.bytes.copy_within(at + 1..state.filled, at + 2);
            self.bytes[at + 1] = header.number as u8;
            state.filled += 1;
        }
        let layer = &self.bytes[..first.len()];
        let (contents, _) = take_contents(layer, first, header.count, header.data_len())?;
        let packet = &self.bytes[at..state.filled];
        let extent = Extent::read(packet).ok()?.near(last);
        if contents.end != End::Layers && !extent.is_open {
            return None;
        }
        let user = contents.user.map(|user| (at - user.len(), at));
        let named = extent.frame % NUMBERS == header.number;
        (named && packet.len() >= extent.latent).then_some(Start {
            extent,
            at,
            user,
            complete: false,
            ended: false,
        })
    }

    /// Length of an open packet whose layers are all there; `None` within: its end is not sent. `None`: it is none that
    /// a sender writes.
    fn end_of(&self, start: &Start, end: End, state: &State) -> Option<Option<usize>> {
        let there = state.filled - start.at;
        match end {
            End::Layers => Some(Some(there)),
            End::Cut => Some(None),
            End::Padded => {
                let padding = usize::from(self.bytes[state.filled - 1]);
                let len = there.checked_sub(padding).filter(|len| *len > start.extent.latent);
                (padding > 0).then_some(Some(len?))
            }
        }
    }

    /// Looks at what there is of the packet. `None` if it is whole and its checks do not match.
    fn judge(&mut self, mut start: Start, state: &mut State) -> Option<()> {
        if start.extent.total.is_none() {
            let bytes = &self.bytes[start.at..state.filled];
            start.extent.total = Extent::read(bytes).ok()?.total;
        }
        if start.extent.told_by_shares > 0 && start.extent.total.is_some() {
            mark_whole(&mut self.bytes[start.at..]);
        }
        let whole = start.extent.total.and_then(|total| {
            self.bytes[..state.filled].get(start.at..start.at.saturating_add(total))
        });
        if let Some(whole) = whole {
            start.complete = valid_len(whole) == whole.len();
            if !start.complete {
                return None;
            }
        }
        state.start = Some(start);
        Some(())
    }
}
