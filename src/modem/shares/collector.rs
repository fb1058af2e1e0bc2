//! Shares to packets.

mod slot;

use std::iter;

use super::super::ModemError;
use super::super::error::filled;
use super::super::report::{MOST_TOLD, Report, ToldPacket};
use super::header::{MAX_SHARES, NUMBERS, STREAMS, read};
use slot::{Slot, Taken};

/// How to collect shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CollectorOptions {
    /// The largest modem frame that comes, bytes. What lies beyond it is padding.
    pub mtu: usize,
    /// Shares of a packet that there is room for, 1 to 256.
    pub shares: usize,
    /// Packets of a stream that are held: that of the newest frame number, and of those before it. 1 to 64, and rounded
    /// up to a power of two.
    pub packets: usize,
    /// Streams that are taken, 1 to 4.
    pub streams: usize,
    /// Seconds after which a packet is stale, from its first share on. Shares name packets by the frame number modulo 128:
    /// give less time than 64 frames take. A share that comes later than that looks like one of the future.
    pub age: f64,
}

/// Most packets of a stream.
const MOST_PACKETS: usize = 64;
/// So many shares in a row of numbers that are long past mean that the sender counts anew.
const RESTART: u32 = 6;

impl CollectorOptions {
    /// Sixteen packets of a stream, each of up to 32 shares, stale after four seconds.
    pub fn new(mtu: usize) -> CollectorOptions {
        CollectorOptions { mtu, shares: 32, packets: 16, streams: 1, age: 4.0 }
    }

    fn check(&self) -> Result<(), ModemError> {
        let within = |field, value, most| match value {
            0 => Err(ModemError::Collector { field, value, most }),
            value if value > most => Err(ModemError::Collector { field, value, most }),
            _ => Ok(()),
        };
        within("mtu", self.mtu, super::super::layout::LARGEST_MTU)?;
        within("shares", self.shares, MAX_SHARES)?;
        within("packets", self.packets, MOST_PACKETS)?;
        within("streams", self.streams, usize::from(STREAMS))?;
        if self.age > 0.0 { Ok(()) } else { Err(ModemError::CollectorAge(self.age)) }
    }

    /// Memory that a [`Collector`] takes, all of it when it is made, bytes.
    ///
    /// # Errors
    /// If an option is outside its range.
    pub fn memory(&self) -> Result<usize, ModemError> {
        self.check()?;
        Ok(self.streams * self.slots() * Slot::memory(self.shares, self.mtu))
    }

    /// Packets of a stream. A divisor of [`NUMBERS`], so that numbers find their places where they begin anew.
    fn slots(&self) -> usize {
        self.packets.next_power_of_two()
    }
}

/// What a share has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Collected {
    /// The packet of this stream and frame number is complete. The number is modulo 2²⁴, as
    /// [`CollectedPacket::frame`].
    Complete(u8, u32),
    /// It has more bytes than before.
    Grown(u8, u32),
    /// The share is kept. It is of use once more come.
    Kept,
    /// The share was there before.
    Duplicate,
    /// The share's packet was complete before.
    Surplus,
    /// The packet's own checks do not match what its shares hold. All its shares are dropped. The number is modulo 128.
    Damaged(u8, u32),
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShareStatistics {
    /// Shares that were not there before.
    pub accepted: u64,
    /// Shares that were there before.
    pub duplicates: u64,
    /// Frames that were no shares, damaged ones, and such of packets long past.
    pub rejected: u64,
    /// Shares that packets gone by had, of those accepted.
    pub arrived: u64,
    /// Shares that packets gone by were sent in. With `arrived` it tells the loss. Packets of which no share came do not
    /// count: a frame that was left out looks the same. So the loss is a little more, by as much as whole packets are lost.
    pub sent: u64,
    /// Packets that became complete.
    pub completed: u64,
    /// Packets gone by that were complete although shares of them were missing.
    pub repaired: u64,
    /// Packets gone by that gave a picture, but not all of it.
    pub partial: u64,
    /// Packets gone by that gave no picture, and frames of which nothing came.
    pub lost: u64,
    /// Packets whose own checks did not match what their shares held.
    pub damaged: u64,
}

/// What has come of a packet.
#[derive(Clone, Copy, Debug)]
pub struct CollectedPacket<'a> {
    /// Frame number, modulo 2²⁴. A short packet's number is completed to the one that is nearest to the packet's before it.
    pub frame: u32,
    /// The packet's first bytes. Checks vouch for them: decode them with
    /// [`Trust::Start`](crate::Trust::Start).
    pub bytes: &'a [u8],
    /// The bytes are the whole packet, and its checks match.
    pub complete: bool,
    /// No share brings more: the packet is complete, or its end was not sent.
    pub ended: bool,
    /// User bytes that came with it.
    pub user: Option<&'a [u8]>,
    /// Shares that came.
    pub arrived: usize,
    /// Shares that it was sent in.
    pub sent: usize,
}

/// Collects shares of any number of packets at once, and makes of them what can be made.
///
/// It holds the packets of the newest frame number of a stream and of those before it, [`CollectorOptions::packets`] in
/// all. Shares of older ones are refused. A complete packet stays until it is too old; no newer one takes its place.
/// Stale packets, [`CollectorOptions::age`], make room for those that have the same number.
pub struct Collector {
    options: CollectorOptions,
    streams: Vec<Stream>,
    statistics: ShareStatistics,
}

/// The packets of a stream.
struct Stream {
    /// The packet of number k is at place k modulo their count.
    slots: Vec<Slot>,
    newest: Option<u32>,
    /// Frame number of the last packet that gave a picture.
    last: Option<u32>,
    /// When the last share came, seconds.
    heard: f64,
    /// Shares in a row that were too old.
    late: u32,
}

impl Collector {
    /// Allocates [`CollectorOptions::memory`].
    ///
    /// # Errors
    /// If an option is outside its range, or the system does not have the memory.
    pub fn new(options: CollectorOptions) -> Result<Collector, ModemError> {
        options.check()?;
        let mut streams = Vec::new();
        for _ in 0..options.streams {
            let slots = (0..options.slots()).map(|_| Slot::new(options.shares, options.mtu));
            let slots = slots.collect::<Result<_, _>>()?;
            streams.push(Stream { slots, newest: None, last: None, heard: 0.0, late: 0 });
        }
        Ok(Collector { options, streams, statistics: ShareStatistics::default() })
    }

    /// Takes a modem frame that came at `now`, seconds on a clock that does not go back.
    ///
    /// # Errors
    /// If it is no share, damaged, or too old, or if there is no room for its packet. All packets stay as they are. Also if
    /// the time is not finite.
    pub fn push(&mut self, now: f64, frame: &[u8]) -> Result<Collected, ModemError> {
        if !now.is_finite() {
            return Err(ModemError::Time(now));
        }
        let taken = self.take(now, frame);
        match &taken {
            Err(_) => self.statistics.rejected += 1,
            Ok(Collected::Duplicate) => self.statistics.duplicates += 1,
            Ok(_) => self.statistics.accepted += 1,
        }
        taken
    }

    fn take(&mut self, now: f64, frame: &[u8]) -> Result<Collected, ModemError> {
        let frame = &frame[..frame.len().min(self.options.mtu)];
        let (header, data) = read(frame)?;
        let packet = header.packet;
        if packet.count > self.options.shares {
            return Err(ModemError::NoRoom { index: packet.count - 1, room: self.options.shares });
        }
        let stream = usize::from(packet.stream);
        let stream = self.streams.get_mut(stream).ok_or(ModemError::Stream(packet.stream))?;
        stream.forget(now, self.options.age, &mut self.statistics);
        stream.advance(packet.number, &mut self.statistics)?;
        let place = stream.place(packet.number);
        let (id, number) = (packet.stream, packet.number);
        let taken = stream.slots[place].take(now, &header, data, stream.last)?;
        if let Taken::Grown(frame) | Taken::Complete(frame) = taken {
            stream.last = Some(frame);
        }
        Ok(match taken {
            Taken::Kept => Collected::Kept,
            Taken::Duplicate => Collected::Duplicate,
            Taken::Surplus => Collected::Surplus,
            Taken::Grown(frame) => Collected::Grown(id, frame),
            Taken::Complete(frame) => {
                self.statistics.completed += 1;
                Collected::Complete(id, frame)
            }
            Taken::Damaged => {
                self.statistics.damaged += 1;
                Collected::Damaged(id, number)
            }
        })
    }

    /// The packet of a stream and frame number, modulo 2²⁴, if enough of it came for a picture. For a short packet only the
    /// low 16 bits count.
    pub fn packet(&self, stream: u8, frame: u32) -> Option<CollectedPacket<'_>> {
        self.slot(stream, frame)?.packet(frame)
    }

    /// The packet of the greatest frame number of a stream that gives a picture.
    pub fn newest(&self, stream: u8) -> Option<CollectedPacket<'_>> {
        let newest = self.streams.get(usize::from(stream))?.newest?;
        (0..self.options.slots() as u32).find_map(|back| {
            let number = newest.wrapping_sub(back) % NUMBERS;
            self.slot(stream, number)?.numbered(number)
        })
    }

    /// Indices of a packet's shares that have not come; none if it is complete, or if nothing of it came. To make the
    /// packet complete, as many of them are needed as [`CollectedPacket::sent`] less those that came, at most. Until there is
    /// a picture of the packet, the frame number counts modulo 128.
    pub fn missing(&self, stream: u8, frame: u32) -> impl Iterator<Item = usize> + '_ {
        let slot = self.slot(stream, frame).into_iter();
        slot.flat_map(move |slot| slot.missing(frame))
    }

    /// Shares that a packet was sent in; 0 if none of them came. The frame number counts as for [`Collector::missing`].
    pub fn sent(&self, stream: u8, frame: u32) -> usize {
        self.slot(stream, frame).map_or(0, |slot| slot.sent(frame))
    }

    /// Indices of a packet's shares that have come. The frame number counts as for [`Collector::missing`].
    pub fn arrived(&self, stream: u8, frame: u32) -> impl Iterator<Item = usize> + '_ {
        let slot = self.slot(stream, frame).into_iter();
        slot.flat_map(move |slot| slot.arrived(frame))
    }

    /// What there is of a stream's newest packets, for its vehicle. `kept` tells whether a frame was decoded in full. `None`:
    /// no packet has given its frame number yet.
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
        // The packet whose number is known lies at or before the newest one.
        let newest = known.frame.wrapping_add(newest.wrapping_sub(known.frame) % NUMBERS);
        let held = self.options.slots().min(MOST_TOLD) as u32;
        let packets = (0..held).map(|behind| {
            let frame = newest.wrapping_sub(behind);
            let slot = self.slot(stream, frame);
            slot.map_or_else(ToldPacket::default, |slot| slot.told(frame, &kept))
        });
        Report::new(stream, newest, packets).map(Some)
    }

    /// The newest number of a stream, modulo 128.
    fn newest_number(&self, stream: u8) -> Option<u32> {
        self.streams.get(usize::from(stream))?.newest
    }

    /// Where a packet of a frame number is kept.
    fn slot(&self, stream: u8, frame: u32) -> Option<&Slot> {
        let stream = self.streams.get(usize::from(stream))?;
        Some(&stream.slots[stream.place(frame % NUMBERS)])
    }

    /// How it was made.
    pub fn options(&self) -> &CollectorOptions {
        &self.options
    }

    /// What has come so far.
    pub fn statistics(&self) -> ShareStatistics {
        self.statistics
    }
}

impl Stream {
    fn place(&self, number: u32) -> usize {
        number as usize % self.slots.len()
    }

    /// Empties the places of stale packets. If no share came for as long, counts from the next one.
    fn forget(&mut self, now: f64, age: f64, statistics: &mut ShareStatistics) {
        for slot in &mut self.slots {
            if slot.since().is_some_and(|since| since + age < now) {
                slot.let_go(statistics);
            }
        }
        if self.heard + age < now {
            self.newest = None;
        }
        self.heard = now;
    }

    /// Makes a number the newest if it is, and lets those go that are too old then.
    fn advance(&mut self, number: u32, statistics: &mut ShareStatistics) -> Result<(), ModemError> {
        let Some(newest) = self.newest else {
            self.newest = Some(number);
            return Ok(());
        };
        let held = self.slots.len() as u32;
        let behind = newest.wrapping_sub(number) % NUMBERS;
        let ahead = number.wrapping_sub(newest) % NUMBERS;
        if behind < held {
            self.late = 0;
            return Ok(());
        }
        // Numbers further behind than half of all are ahead.
        if behind <= NUMBERS / 2 {
            self.late += 1;
            if self.late < RESTART {
                return Err(ModemError::Late(number));
            }
            self.slots.iter_mut().for_each(Slot::clear);
        } else {
            for step in 1..=ahead {
                self.let_go(newest.wrapping_add(step), statistics);
            }
        }
        self.late = 0;
        self.newest = Some(number);
        Ok(())
    }

    /// Empties the place of a new number. If the number before it there has no packet, nothing of that one came.
    fn let_go(&mut self, number: u32, statistics: &mut ShareStatistics) {
        let place = self.place(number % NUMBERS);
        let slot = &mut self.slots[place];
        statistics.lost += u64::from(slot.since().is_none());
        slot.let_go(statistics);
    }
}
