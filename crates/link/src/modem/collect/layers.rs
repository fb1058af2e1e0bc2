//! Protected shares to a packet.

use crate::modem::error::ModemError;
use crate::modem::wire::code::Known;
use crate::modem::wire::contents::{Layer, take_contents};
use crate::modem::wire::share::{Header, PacketHeader};
use crate::modem::wire::travelling::Travelling;
use nvsprior::packet::{Extent, Latent, nearest_frame};

use super::slot::{Form, Slot, Start, State, Taken};

impl Slot {
    /// Takes a protected share that came at `now`. `last`: the frame number of a packet before, to complete this one's.
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
        let frame = start.frame;
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
        let (layers, others, is_cut) = (contents.layers, contents.others, contents.cut);
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
        start.extent = Extent::read(&self.bytes[start.at..state.filled]).ok()?;
        start.complete = start.ended && start.extent.whole.is_some();
        if start.ended && !start.complete && !is_cut {
            return None;
        }
        state.start = Some(start);
        Some(())
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
        let (contents, packet) = take_contents(layer, first, header.count, header.data_len())?;
        let at = first.len() - packet.len();
        let user = contents.user.map(|user| (at - user.len(), at));
        let there = state.filled - at;
        let bytes = &mut self.bytes[at..];
        let restored = Travelling::Wide.restore(bytes, there, header.number, last)?;
        state.filled = at + restored;
        let extent = Extent::read(&self.bytes[at..state.filled]).ok()?;
        let frame = nearest_frame(extent.frame, Latent::FRAMES, last);
        Some(Start { extent, frame, at, user, complete: false, ended: false })
    }
}
