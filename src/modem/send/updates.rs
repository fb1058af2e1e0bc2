//! The updates of a dive at the vehicle: which piece goes next, and which update the topside holds.

use crate::modem::error::ModemError;
use crate::modem::limits::MAX_PIECES;
use crate::modem::memory::room;
use crate::modem::reported_updates::ReportedUpdates;
use crate::modem::wire::code::Known;
use crate::modem::wire::piece::{Cut, PieceHeader, UpdateName, put_sources, write};
use crate::prior::{StateId, Update};

use super::cutting::{AIM, AIM_WITH_REPORTS, cut, pieces_for};
use super::loss::Loss;
use super::rate_control::RateControlOptions;
use super::update_options::UpdateOptions;

/// Most updates that are kept.
const MAX_UPDATES: usize = 256;
/// Frames by which a report may be older than the one before it. If it is further behind, the topside counts anew.
const OVERTAKEN: u16 = 64;

/// The link, as it is now.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// Bits per second; 0: pieces go as they come, and none is repeated.
    pub bit_rate: f64,
    pub mtu: usize,
    pub overhead: usize,
    pub loss: Loss,
    pub stream: u8,
}

impl Link {
    pub fn of(options: &RateControlOptions, stream: u8) -> Link {
        let RateControlOptions { bit_rate, mtu, overhead, loss, .. } = *options;
        Link { bit_rate, mtu, overhead, loss, stream }
    }
}

/// The updates of a dive, in memory that is taken when it is made.
pub struct Updates {
    options: UpdateOptions,
    expect_reports: bool,
    sent: Vec<SentUpdate>,
    /// The sources of all of them.
    sources: Vec<u8>,
    /// Updates that the topside is known to hold; without reports, those that were sent.
    held: usize,
    /// The update that is repeated, and how many of its pieces are still to come.
    repeated: (usize, usize),
    /// When the next piece may go, seconds.
    due: f64,
    piece: Vec<u8>,
    /// The frame number in the last report, modulo 2¹⁶.
    reported: Option<u16>,
}

/// An update that is kept.
#[derive(Clone, Copy)]
struct SentUpdate {
    name: UpdateName,
    number: u16,
    /// The state that it stands on, and the one after it.
    before: StateId,
    state: StateId,
    cut: Cut,
    /// Where its sources begin.
    from: usize,
    /// Pieces given out so far.
    given: usize,
    /// Pieces that are to be given out.
    left: usize,
    /// When the last piece went, seconds.
    last: f64,
    /// Its pieces go, or went; else it waits for those before it.
    begun: bool,
    /// The topside has all of it.
    whole: bool,
}

impl Updates {
    /// Memory that it takes, bytes.
    pub fn memory(options: &UpdateOptions, mtu: usize) -> usize {
        let list = MAX_UPDATES * size_of::<SentUpdate>();
        options.memory.saturating_add(mtu).saturating_add(list)
    }

    pub fn new(
        options: UpdateOptions,
        mtu: usize,
        expect_reports: bool,
    ) -> Result<Updates, ModemError> {
        options.check()?;
        Ok(Updates {
            options,
            expect_reports,
            sent: room(MAX_UPDATES)?,
            sources: room(options.memory)?,
            held: 0,
            repeated: (0, 0),
            due: f64::NEG_INFINITY,
            piece: room(mtu)?,
            reported: None,
        })
    }

    /// The loss of pieces: they are further apart than shares, so they share fewer bursts.
    fn loss(&self, link: &Link) -> Loss {
        link.loss.spaced(1.0 / self.options.share)
    }

    fn aim(&self) -> f64 {
        if self.expect_reports { AIM_WITH_REPORTS } else { AIM }
    }

    /// Bytes on the link that an update of `len` bytes takes.
    pub fn cost(&self, len: usize, link: &Link) -> Result<usize, ModemError> {
        let loss = self.loss(link);
        let cut = cut(len, link.mtu, link.overhead, loss, self.aim())?;
        Ok(pieces_for(cut.sources, loss, self.aim()) * (cut.piece_len() + link.overhead))
    }

    /// Takes an update that stands on a state of the chain; those after that state go. Its pieces go from `now` on,
    /// seconds.
    pub fn push(&mut self, now: f64, bytes: &[u8], link: &Link) -> Result<(), ModemError> {
        self.add(bytes, link)?;
        self.begin_next(now, link);
        Ok(())
    }

    /// As [`push`](Self::push), for an update that the topside is taken to hold. If it lacks one before it,
    /// this one goes as others do.
    pub fn push_held(&mut self, now: f64, bytes: &[u8], link: &Link) -> Result<(), ModemError> {
        self.add(bytes, link)?;
        match self.sent.split_last_mut() {
            Some((last, before)) if before.len() == self.held => {
                (last.begun, last.whole) = (true, true);
                self.held += 1;
                // It is repeated from now on.
                self.due = self.due.max(now);
            }
            _ => self.begin_next(now, link),
        }
        Ok(())
    }

    /// Adds an update to the chain.
    fn add(&mut self, bytes: &[u8], link: &Link) -> Result<(), ModemError> {
        let update = Update::read(bytes).map_err(|error| ModemError::Update(error.to_string()))?;
        let (number, before, state) = (update.number, update.before, update.state());
        let stays = self.standing_on(number, before)?;
        let name = UpdateName::of(bytes).unwrap_or_default();
        let cut = cut(bytes.len(), link.mtu, link.overhead, self.loss(link), self.aim())?;
        let from = self.sent.get(stays).map_or(self.sources.len(), |gone| gone.from);
        let is_full = stays == MAX_UPDATES || cut.len() > self.options.memory - from;
        if is_full {
            let (len, held, room) = (cut.len(), from, self.options.memory);
            return Err(ModemError::UpdatesFull { len, held, room });
        }
        self.keep(stays, from);
        put_sources(bytes, cut, &mut self.sources);
        self.sent.push(SentUpdate {
            name,
            number,
            before,
            state,
            cut,
            from,
            given: 0,
            left: 0,
            last: f64::NEG_INFINITY,
            begun: false,
            whole: false,
        });
        Ok(())
    }

    /// How many updates come before one of this number on this state.
    fn standing_on(&self, number: u16, before: StateId) -> Result<usize, ModemError> {
        let Some(last) = self.sent.last() else { return Ok(0) };
        let follows =
            |sent: &SentUpdate| sent.number.checked_add(1) == Some(number) && sent.state == before;
        let is_first = (self.sent[0].number, self.sent[0].before) == (number, before);
        let place = self.sent.iter().rposition(follows).map(|index| index + 1);
        place.or(is_first.then_some(0)).ok_or(ModemError::UpdateOrder {
            number,
            before,
            last: last.number,
            state: last.state,
        })
    }

    /// Keeps the first updates, whose sources end at `end`.
    fn keep(&mut self, count: usize, end: usize) {
        self.sent.truncate(count);
        self.sources.truncate(end);
        self.held = self.held.min(count);
        if self.repeated.0 >= count {
            self.repeated = (0, 0);
        }
    }

    /// Lets the pieces of the next update go that the topside lacks, if none are on their way.
    fn begin_next(&mut self, now: f64, link: &Link) {
        let Some(next) = (self.held..self.sent.len()).find(|index| !self.sent[*index].whole) else {
            return;
        };
        if !self.sent[next].begun {
            self.give(next, self.sent[next].cut.sources, now, link);
        }
    }

    /// Lets so many pieces of an update go that `needed` of them arrive.
    fn give(&mut self, index: usize, needed: usize, now: f64, link: &Link) {
        let count = pieces_for(needed, self.loss(link), self.aim());
        (self.sent[index].left, self.sent[index].begun) = (count, true);
        self.due = self.due.max(now);
    }

    /// The update whose piece is next, and the part of the bit rate that it gets.
    fn next(&self, link: &Link) -> Option<(usize, f64)> {
        let UpdateOptions { share, repeat, .. } = self.options;
        if let Some(index) = self.sent.iter().position(|sent| sent.left > 0) {
            return Some((index, share));
        }
        let repeats = !self.expect_reports && link.bit_rate > 0.0 && repeat > 0.0;
        (repeats && !self.sent.is_empty()).then_some((self.repeated.0, repeat))
    }

    /// The part of the bit rate that pieces take now.
    pub fn part(&self, link: &Link) -> f64 {
        self.next(link).map_or(0.0, |(_, part)| part)
    }

    /// When the next piece is due, and its bytes.
    pub fn due(&self, link: &Link) -> Option<(f64, usize)> {
        let (index, _) = self.next(link)?;
        Some((self.due, self.sent[index].cut.piece_len()))
    }

    /// The next piece, if it is due at `now`: the time at which it was, and the piece.
    pub fn give_piece(&mut self, now: f64, link: &Link) -> Option<(f64, &[u8])> {
        let (index, part) = self.next(link)?;
        let due = self.due;
        if due > now {
            return None;
        }
        self.write(index, link.stream);
        let bytes = self.piece.len().saturating_add(link.overhead) as f64;
        let apart = if link.bit_rate > 0.0 { bytes * 8.0 / (part * link.bit_rate) } else { 0.0 };
        // One that went late does not draw others after it.
        self.due = due.max(now - apart) + apart;
        self.count(index, now, link);
        Some((due, &self.piece))
    }

    /// Counts a piece of an update.
    fn count(&mut self, index: usize, now: f64, link: &Link) {
        let sent = &mut self.sent[index];
        sent.given += 1;
        sent.last = now;
        if sent.left > 0 {
            sent.left -= 1;
            if sent.left == 0 && !self.expect_reports {
                sent.whole = true;
                self.held = self.held.max(index + 1);
                self.begin_next(now, link);
            }
            return;
        }
        let (again, left) = self.repeated;
        let left = match left {
            0 => pieces_for(self.sent[index].cut.sources, self.loss(link), self.aim()),
            left => left,
        };
        let next = (again + 1) % self.sent.len();
        self.repeated = if left == 1 { (next, 0) } else { (again, left - 1) };
    }

    /// Writes the next piece of an update.
    fn write(&mut self, index: usize, stream: u8) {
        let SentUpdate { name: update, cut, from, given, .. } = self.sent[index];
        let sources = &self.sources[from..from + cut.len()];
        let chunk = |index: usize| &sources[index * cut.chunk..][..cut.chunk];
        let index = given % MAX_PIECES;
        let header = PieceHeader { stream, update, cut, index };
        write(&header, &mut self.piece, |into| match index < cut.sources {
            true => into.copy_from_slice(chunk(index)),
            false => Known::new(0..cut.sources).write(index, chunk, into),
        });
    }

    /// Number of the newest update that the topside holds, as far as is known.
    pub fn held(&self) -> Option<u16> {
        Some(self.sent[self.held.checked_sub(1)?].number)
    }

    /// Takes what a report tells of updates. `settled`: what was sent before that time had come when it was written.
    pub fn report(
        &mut self,
        (now, settled): (f64, f64),
        newest: u16,
        report: &ReportedUpdates,
        link: &Link,
    ) {
        // A report that comes after a newer one tells of the past.
        let behind = self.reported.map_or(0, |last| last.wrapping_sub(newest));
        if (1..=OVERTAKEN).contains(&behind) || self.sent.is_empty() {
            return;
        }
        self.reported = Some(newest);
        self.set_held(self.held_by(report));
        self.look_at_last(report);
        let next = (self.held..self.sent.len()).find(|index| !self.sent[*index].whole);
        match next {
            Some(index) => self.send_more(index, (now, settled), report, link),
            // All came, and yet the topside does not hold them: it needs others before them.
            None => {
                if self.sent.last().is_some_and(|last| last.last < settled) {
                    self.sent[self.held..].iter_mut().for_each(SentUpdate::forget);
                }
            }
        }
        self.begin_next(now, link);
    }

    /// How many updates the topside holds, by the newest state of this chain that it tells of.
    fn held_by(&self, report: &ReportedUpdates) -> usize {
        let is_held = |sent: &SentUpdate| report.holds(sent.number, sent.state);
        self.sent.iter().rposition(is_held).map_or(0, |index| index + 1)
    }

    fn set_held(&mut self, held: usize) {
        // Those that it has no more come again.
        if held < self.held {
            self.sent[held..self.held].iter_mut().for_each(SentUpdate::forget);
        }
        for sent in &mut self.sent[..held] {
            (sent.whole, sent.left) = (true, 0);
        }
        self.held = held;
    }

    /// Notes that the update whose piece came last is whole.
    fn look_at_last(&mut self, report: &ReportedUpdates) {
        let Some(last) = report.last.filter(|last| last.is_whole()) else { return };
        for sent in self.sent[self.held..].iter_mut().filter(|sent| sent.name == last.name) {
            (sent.whole, sent.left) = (true, 0);
        }
    }

    /// Lets more pieces of an update go, if all that went had come when the report was written, and they are too few.
    fn send_more(
        &mut self,
        index: usize,
        (now, settled): (f64, f64),
        report: &ReportedUpdates,
        link: &Link,
    ) {
        let sent = &self.sent[index];
        if !sent.begun || sent.left > 0 || sent.last >= settled {
            return;
        }
        let last = report.last.filter(|last| last.name == sent.name);
        let came = last.map_or(0, |last| usize::from(last.came));
        self.give(index, sent.cut.sources.saturating_sub(came).max(1), now, link);
    }
}

impl SentUpdate {
    /// As if it had not been sent. Its next pieces are other ones.
    fn forget(&mut self) {
        (self.begun, self.whole, self.left) = (false, false, 0);
    }
}
