//! Modem frames to packets.

use std::iter;

use crate::keys::{Authenticator, Content, Keys, Refusal, Seen, Verifier};
use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_MTU, MAX_UNPROTECTED, MIN_MTU, NUMBERS, SMALL_NUMBERS, STREAMS};
use crate::modem::memory::room;
use crate::modem::report::{MAX_REPORTED, Report, ReportedPacket};
use crate::modem::wire::layout::Layout;
use crate::modem::wire::plain::{CONTINUATION, Continuation, First, SMALL, START, Small, TAGS};
use crate::modem::wire::share::{self, SHARE};

use super::collected::{Collected, CollectedPacket, CollectorStatistics};
use super::plain::{Bond, How};
use super::slot::{Slot, Taken};
use super::stream::Stream;
use super::waiting::{Insertion, Waiting};

/// How to collect shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CollectorOptions {
    /// The MTU of the sender, bytes: the largest modem frame that comes. What lies beyond it is padding.
    pub mtu: usize,
    /// Shares of a packet that there is room for, 1 to 2048. A protected packet has at most 256. Of a longer
    /// unprotected one, as many are kept from its start on: see [`share_count`](crate::modem::share_count).
    pub shares: usize,
    /// Packets of a stream that are held: that of the newest frame number, and of those before it. 1 to 64, and rounded
    /// up to a power of two.
    pub packets: usize,
    /// Streams that are taken, 1 to 4.
    pub streams: usize,
    /// Seconds after which a packet is stale, from its first share on. Shares name packets by the frame number modulo
    /// 256: give less time than 128 frames take. A share that comes later than that looks like one of the future.
    pub age: f64,
    /// The modem hands over no damaged frames. If set, an unprotected packet's first share counts as valid to its end.
    /// Else only what its packet's own checks cover does, until a continuation vouches for the rest.
    pub modem_checks: bool,
}

/// Most packets of a stream.
const MAX_PACKETS: usize = 64;

impl CollectorOptions {
    /// Sixteen packets of a stream, each of up to 32 shares, stale after four seconds, from a modem that is not known
    /// to check its frames.
    pub fn new(mtu: usize) -> CollectorOptions {
        CollectorOptions { mtu, shares: 32, packets: 16, streams: 1, age: 4.0, modem_checks: false }
    }

    fn check(&self) -> Result<(), ModemError> {
        let within = |field, value, max| match value {
            0 => Err(ModemError::Collector { field, value, max }),
            value if value > max => Err(ModemError::Collector { field, value, max }),
            _ => Ok(()),
        };
        within("mtu", self.mtu, MAX_MTU)?;
        within("shares", self.shares, MAX_UNPROTECTED)?;
        within("packets", self.packets, MAX_PACKETS)?;
        within("streams", self.streams, usize::from(STREAMS))?;
        if self.age > 0.0 { Ok(()) } else { Err(ModemError::CollectorAge(self.age)) }
    }

    /// Memory that a [`Collector`] takes, all of it when it is made, bytes: for each packet twice as much as its
    /// shares, and once more for each of four whose continuations come first.
    ///
    /// # Errors
    /// If an option is outside its range.
    pub fn memory(&self) -> Result<usize, ModemError> {
        self.check()?;
        let packets = self.streams * self.slots() * Slot::memory(self.shares, self.mtu);
        let waiting = self.layout().map_or(0, |layout| Waiting::memory(layout, self.shares));
        let first = self.layout().map_or(0, |layout| layout.mtu);
        Ok(packets + first + TAGS * waiting)
    }

    /// The memory of a collector [with keys](Collector::with_keys), bytes.
    ///
    /// # Errors
    /// As [`CollectorOptions::memory`], or if the MTU has no room for tags and the smallest modem frames.
    pub fn memory_with_keys(&self, keys: &Keys) -> Result<usize, ModemError> {
        self.keyed(keys)?.memory()
    }

    /// For what stands behind the tags of modem frames.
    fn keyed(mut self, keys: &Keys) -> Result<CollectorOptions, ModemError> {
        let (mtu, needed) = (self.mtu, MIN_MTU + keys.overhead());
        if mtu < needed {
            return Err(ModemError::KeyedMtu { mtu, needed });
        }
        self.mtu -= keys.overhead();
        Ok(self)
    }

    /// Packets of a stream. A divisor of what numbers are counted by, so that they find their places where they begin
    /// anew.
    fn slots(&self) -> usize {
        let most = if self.is_small() { SMALL_NUMBERS as usize / 2 } else { MAX_PACKETS };
        self.packets.next_power_of_two().min(most)
    }

    /// Whether modem frames are small.
    fn is_small(&self) -> bool {
        self.layout().is_some_and(Layout::is_small)
    }

    /// Where unprotected packets lie, if the MTU is one that they can have.
    fn layout(&self) -> Option<Layout> {
        Layout::new(self.mtu).ok()
    }
}

/// Collects shares of any number of packets at once, protected and unprotected ones, and makes of them what can be
/// made.
///
/// It holds the packets of the newest frame number of a stream and of those before it, [`CollectorOptions::packets`] in
/// all. Shares of older ones are refused. A complete packet stays until it is too old; no newer one takes its place.
/// Stale packets, [`CollectorOptions::age`], make room for those that have the same number. Who has no clock gives the
/// same time always: then no packet becomes stale. Nothing is allocated after [`Collector::new`].
pub struct Collector {
    options: CollectorOptions,
    streams: Vec<Stream>,
    /// `None`: the MTU is too small for unprotected packets.
    unprotected: Option<Unprotected>,
    keyed: Option<Keyed>,
    statistics: CollectorStatistics,
}

/// Checks the tags of modem frames, and makes those of reports.
struct Keyed {
    verifier: Verifier,
    authenticator: Authenticator,
}

/// What unprotected packets need besides.
struct Unprotected {
    layout: Layout,
    /// Room for a first share.
    room: Vec<u8>,
    /// By tag: continuations of no packet at hand.
    waiting: [Waiting; TAGS],
}

impl Unprotected {
    fn new(layout: Layout, shares: usize) -> Result<Unprotected, ModemError> {
        let waiting = |tag| Waiting::new(layout, tag, shares);
        Ok(Unprotected {
            layout,
            room: room(layout.mtu)?,
            waiting: [waiting(0)?, waiting(1)?, waiting(2)?, waiting(3)?],
        })
    }
}

impl Collector {
    /// Allocates [`CollectorOptions::memory`].
    ///
    /// # Errors
    /// If an option is outside its range, or the system does not have the memory.
    pub fn new(options: CollectorOptions) -> Result<Collector, ModemError> {
        options.check()?;
        let CollectorOptions { mtu, shares, .. } = options;
        let numbers = if options.is_small() { SMALL_NUMBERS } else { NUMBERS };
        let stream = |_| Stream::new(numbers, options.slots(), shares, mtu);
        let streams = (0..options.streams).map(stream).collect::<Result<_, _>>()?;
        let unprotected = |layout| Unprotected::new(layout, shares);
        let unprotected = options.layout().map(unprotected).transpose()?;
        let statistics = CollectorStatistics::default();
        Ok(Collector { options, streams, unprotected, keyed: None, statistics })
    }

    /// As [`Collector::new`]. Only modem frames that a [sender](crate::modem::Sender::with_keys) has made with one of
    /// these keys are taken, and none a second time. Write reports with [`Collector::write_report`]. Allocates
    /// [`CollectorOptions::memory_with_keys`].
    ///
    /// # Errors
    /// As [`Collector::new`], or if the MTU has no room for tags and the smallest modem frames.
    pub fn with_keys(options: CollectorOptions, keys: &Keys) -> Result<Collector, ModemError> {
        options.check()?;
        let verifier = Verifier::new(keys, Content::Frame);
        let authenticator = Authenticator::new(keys, Content::Report);
        let keyed = Some(Keyed { verifier, authenticator });
        Ok(Collector { keyed, ..Collector::new(options.keyed(keys)?)? })
    }

    /// Takes a modem frame that came at `now`, seconds on a clock that does not go back.
    ///
    /// # Errors
    /// If it is no share, damaged, or too old, or if there is no room for its packet. With keys, if it is not the
    /// vehicle's or came before: nothing of it is read then. All packets stay as they are. Also if the time is not
    /// finite.
    pub fn push(&mut self, now: f64, frame: &[u8]) -> Result<Collected, ModemError> {
        if !now.is_finite() {
            return Err(ModemError::Time(now));
        }
        let frame = self.verify(frame)?;
        let taken = self.take(now, &frame[..frame.len().min(self.options.mtu)]);
        match &taken {
            Err(_) => self.statistics.rejected += 1,
            Ok((_, Taken::Waits)) => {}
            Ok((_, Taken::Duplicate)) => self.statistics.duplicates += 1,
            Ok(_) => self.statistics.accepted += 1,
        }
        let (stream, taken) = taken?;
        Ok(match taken {
            Taken::Kept | Taken::Waits => Collected::Kept,
            Taken::Duplicate => Collected::Duplicate,
            Taken::Surplus => Collected::Surplus,
            Taken::Grown(frame) => Collected::Grown(stream, frame),
            Taken::Complete(frame) => {
                self.statistics.completed += 1;
                Collected::Complete(stream, frame)
            }
            Taken::Damaged(number) => {
                self.statistics.damaged += 1;
                Collected::Damaged(stream, number)
            }
        })
    }

    /// What stands behind the tag of a modem frame; without keys all of it.
    fn verify<'a>(&mut self, frame: &'a [u8]) -> Result<&'a [u8], ModemError> {
        let Some(keyed) = &mut self.keyed else { return Ok(frame) };
        let mtu = self.options.mtu + keyed.verifier.overhead();
        match keyed.verifier.verify(&frame[..frame.len().min(mtu)]) {
            Ok(verified) => Ok(verified.content),
            Err(refusal) => {
                match refusal {
                    Refusal::Foreign => self.statistics.foreign += 1,
                    Refusal::Replayed => self.statistics.replayed += 1,
                }
                Err(refusal.into())
            }
        }
    }

    fn take(&mut self, now: f64, frame: &[u8]) -> Result<(u8, Taken), ModemError> {
        let first = *frame.first().ok_or(ModemError::Cut { found: 0, needed: 1 })?;
        match first >> 6 {
            _ if self.options.is_small() => Ok((0, self.take_small(now, frame)?)),
            SHARE => self.take_share(now, frame),
            START => Ok((0, self.take_start(now, frame)?)),
            CONTINUATION => Ok((0, self.take_continuation(now, frame)?)),
            _ => Err(ModemError::NotAFrame(first)),
        }
    }

    fn take_share(&mut self, now: f64, frame: &[u8]) -> Result<(u8, Taken), ModemError> {
        let (header, data) = share::read(frame)?;
        let packet = header.packet;
        if packet.count > self.options.shares {
            return Err(ModemError::NoRoom { index: packet.count - 1, room: self.options.shares });
        }
        let stream = usize::from(packet.stream);
        let stream = self.streams.get_mut(stream).ok_or(ModemError::Stream(packet.stream))?;
        stream.forget(now, self.options.age, &mut self.statistics);
        stream.advance(packet.number, &mut self.statistics)?;
        let last = stream.last;
        let taken = stream.slot_mut(packet.number).take_share(now, &header, data, last)?;
        stream.note(taken);
        Ok((packet.stream, taken))
    }

    fn take_start(&mut self, now: f64, frame: &[u8]) -> Result<Taken, ModemError> {
        let mtu = ModemError::Mtu(self.options.mtu);
        let Unprotected { layout, room, waiting } = self.unprotected.as_mut().ok_or(mtu)?;
        let stream = &mut self.streams[0];
        let first = First::read(frame, *layout)?;
        let how = How { layout: *layout, trusted: self.options.modem_checks, last: stream.last };
        let extent = how.extent(&first, room)?;
        let statistics = &mut self.statistics;
        if stream.forget(now, self.options.age, statistics) {
            statistics.rejected += waiting.iter_mut().map(Waiting::clear).sum::<u64>();
        }
        stream.advance(first.number, statistics)?;
        let slot = stream.slot_mut(first.number);
        let taken = slot.begin(now, (&first, extent), how, statistics)?;
        if taken == Taken::Duplicate {
            return Ok(taken);
        }
        let adopted = adopt(slot, how, &mut waiting[first.number as usize % TAGS], statistics);
        let taken = if adopted { slot.brought(0) } else { taken };
        stream.note(taken);
        Ok(taken)
    }

    fn take_continuation(&mut self, now: f64, frame: &[u8]) -> Result<Taken, ModemError> {
        let mtu = ModemError::Mtu(self.options.mtu);
        let Unprotected { layout, waiting, .. } = self.unprotected.as_mut().ok_or(mtu)?;
        let later = Continuation::read(frame, *layout)?;
        if later.index >= self.options.shares {
            return Err(ModemError::NoRoom { index: later.index, room: self.options.shares });
        }
        let (stream, statistics) = (&mut self.streams[0], &mut self.statistics);
        if stream.forget(now, self.options.age, statistics) {
            statistics.rejected += waiting.iter_mut().map(Waiting::clear).sum::<u64>();
        }
        let how = How { layout: *layout, trusted: self.options.modem_checks, last: stream.last };
        for number in stream.numbers() {
            let slot = stream.slot_mut(number);
            if !slot.has_tag(later.tag) {
                continue;
            }
            let before = slot.valid_len();
            match slot.offer(&later, how) {
                Bond::Stranger => continue,
                Bond::Duplicate => return Ok(Taken::Duplicate),
                Bond::Bound => {}
            }
            let taken = slot.brought(before);
            stream.note(taken);
            return Ok(taken);
        }
        Ok(match waiting[later.tag].keep(&later) {
            Insertion::New => Taken::Waits,
            Insertion::InsteadOf => {
                statistics.rejected += 1;
                Taken::Waits
            }
            Insertion::Duplicate => Taken::Duplicate,
        })
    }

    fn take_small(&mut self, now: f64, frame: &[u8]) -> Result<Taken, ModemError> {
        let mtu = ModemError::Mtu(self.options.mtu);
        let layout = self.unprotected.as_ref().ok_or(mtu)?.layout;
        if frame[0] & SMALL == 0 {
            return Err(ModemError::NotAFrame(frame[0]));
        }
        let small = Small::read(frame, layout)?;
        if small.index >= self.options.shares {
            return Err(ModemError::NoRoom { index: small.index, room: self.options.shares });
        }
        let (stream, statistics) = (&mut self.streams[0], &mut self.statistics);
        stream.forget(now, self.options.age, statistics);
        stream.advance(small.number, statistics)?;
        let how = How { layout, trusted: true, last: stream.last };
        let taken = stream.slot_mut(small.number).take_small(now, &small, how);
        stream.note(taken);
        Ok(taken)
    }

    /// The packet of a stream and frame number, of which the low 16 bits count, if enough of it came for a picture.
    pub fn packet(&self, stream: u8, frame: u32) -> Option<CollectedPacket<'_>> {
        self.slot(stream, frame)?.packet(frame)
    }

    /// The packet of the greatest frame number of a stream that yields a picture.
    pub fn newest(&self, stream: u8) -> Option<CollectedPacket<'_>> {
        let stream = self.streams.get(usize::from(stream))?;
        stream.numbers().find_map(|number| stream.slot(number).numbered(number))
    }

    /// Indices of a packet's shares that have not come; none if it is complete, or if nothing of it came. A protected
    /// packet needs at most as many of them as [`CollectedPacket::sent`] less those that came, an unprotected one all.
    /// Until its length has come, that is the first missing one; if its checks do not match, the first share is among
    /// them. Until there is a picture of the packet, the frame number counts modulo 256.
    pub fn missing(&self, stream: u8, frame: u32) -> impl Iterator<Item = usize> + '_ {
        let slot = self.slot(stream, frame).into_iter();
        slot.flat_map(move |slot| slot.missing(frame))
    }

    /// Shares of a packet that are known of: all that it was sent in, and there is room for. Until an unprotected
    /// packet's length has come, those up to the first missing one. 0 if none of them came. The frame number counts as
    /// for [`Collector::missing`].
    pub fn known(&self, stream: u8, frame: u32) -> usize {
        self.slot(stream, frame).map_or(0, |slot| slot.known(frame))
    }

    /// Indices of a packet's shares that have come. The frame number counts as for [`Collector::missing`].
    pub fn arrived(&self, stream: u8, frame: u32) -> impl Iterator<Item = usize> + '_ {
        let slot = self.slot(stream, frame).into_iter();
        slot.flat_map(move |slot| slot.arrived(frame))
    }

    /// What there is of a stream's newest packets, for its vehicle. `kept` tells whether a frame was decoded in full.
    /// `None`: no packet has told its frame number yet.
    ///
    /// # Errors
    /// If the stream is not 0 to 3.
    pub fn report(
        &self,
        stream: u8,
        kept: impl Fn(u32) -> bool,
    ) -> Result<Option<Report>, ModemError> {
        let Some((newest, known)) = self.newest_number(stream).zip(self.newest(stream)) else {
            return Report::new(stream, 0, iter::empty()).map(|_| None);
        };
        // The packet whose frame number is known lies at or before the newest one.
        let newest = match self.options.is_small() {
            true => known.frame,
            false => known.frame.wrapping_add(newest.wrapping_sub(known.frame) % NUMBERS),
        };
        let held = self.options.slots().min(MAX_REPORTED) as u32;
        let packets = (0..held).map(|behind| {
            let frame = newest.wrapping_sub(behind);
            let slot = self.slot(stream, frame);
            slot.map_or_else(ReportedPacket::default, |slot| slot.report(frame, &kept))
        });
        Report::new(stream, newest, packets).map(Some)
    }

    /// Writes a report, as [`Report::write`] does, and puts a tag in front if there are keys. Returns its length.
    /// `into` has as many bytes as a modem frame may have.
    ///
    /// # Errors
    /// As [`Report::write`].
    pub fn write_report(
        &mut self,
        report: &Report,
        user: Option<&[u8]>,
        into: &mut [u8],
    ) -> Result<usize, ModemError> {
        let Some(Keyed { authenticator, .. }) = &mut self.keyed else {
            return report.write(user, into);
        };
        let (mtu, overhead) = (into.len(), authenticator.overhead());
        let content = into.get_mut(overhead..).unwrap_or_default();
        let len = overhead
            + report.write(user, content).map_err(|error| match error {
                ModemError::ReportMtu { needed, .. } => {
                    ModemError::ReportMtu { mtu, needed: needed + overhead }
                }
                other => other,
            })?;
        authenticator.seal(report.stream(), &mut into[..len]);
        Ok(len)
    }

    /// Number of the next report; `None`: there are no keys. See [`Keys::with_number`].
    pub fn next_number(&self) -> Option<u64> {
        Some(self.keyed.as_ref()?.authenticator.next_number())
    }

    /// The modem frames that were taken so far, with keys. See [`Keys::with_seen`].
    pub fn seen(&self) -> impl Iterator<Item = Seen> + '_ {
        self.keyed.iter().flat_map(|keyed| keyed.verifier.seen())
    }

    /// The newest number of a stream, as its shares state it.
    fn newest_number(&self, stream: u8) -> Option<u32> {
        self.streams.get(usize::from(stream))?.newest
    }

    /// Where a packet of a frame number is kept.
    fn slot(&self, stream: u8, frame: u32) -> Option<&Slot> {
        self.streams.get(usize::from(stream))?.find(frame)
    }

    /// Bytes that the buffers have room for.
    #[cfg(test)]
    pub fn capacity(&self) -> usize {
        let waiting = self.unprotected.iter().flat_map(|unprotected| &unprotected.waiting);
        self.streams.iter().map(Stream::capacity).sum::<usize>()
            + waiting.map(Waiting::capacity).sum::<usize>()
            + self.unprotected.as_ref().map_or(0, |unprotected| unprotected.room.capacity())
    }

    /// How it was made. With keys, the MTU is that of what stands behind a tag.
    pub fn options(&self) -> &CollectorOptions {
        &self.options
    }

    /// What has come so far.
    pub fn statistics(&self) -> CollectorStatistics {
        let waiting = self.unprotected.iter().flat_map(|unprotected| &unprotected.waiting);
        let waiting = waiting.map(|waiting| waiting.count() as u64).sum();
        CollectorStatistics { waiting, ..self.statistics }
    }
}

/// Gives a packet whose first share has come the continuations that have waited for it. Whether there were any.
fn adopt(
    slot: &mut Slot,
    how: How,
    waiting: &mut Waiting,
    statistics: &mut CollectorStatistics,
) -> bool {
    let (mut from, mut adopted) = (1, false);
    while let Some(index) = waiting.next(from) {
        from = index + 1;
        match waiting.get(index).map(|later| slot.offer(&later, how)) {
            Some(Bond::Bound) => statistics.accepted += 1,
            Some(Bond::Duplicate) => statistics.duplicates += 1,
            // It waits for another packet.
            _ => continue,
        }
        adopted = true;
        waiting.remove(index);
    }
    adopted
}
