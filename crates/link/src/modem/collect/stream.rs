//! The packets of a stream: the newest one, and those before it.

use crate::modem::error::ModemError;
use crate::modem::memory::room;

use super::collected::CollectorStatistics;
use super::slot::{Slot, Taken};

/// So many shares in a row of numbers that are long past mean that the sender counts anew.
const RESTART: u32 = 6;

/// The packets of a stream.
pub struct Stream {
    /// Shares state numbers modulo this.
    numbers: u32,
    /// The packet of number k is at place k modulo their count.
    slots: Vec<Slot>,
    pub newest: Option<u32>,
    /// Frame number of the last packet that yielded a picture.
    pub last: Option<u32>,
    /// When the last share came, seconds.
    last_pushed: f64,
    /// Shares in a row that were too old.
    late: u32,
}

impl Stream {
    /// Room for `packets` packets, a power of two, each of so many shares. Shares state numbers modulo `numbers`.
    pub fn new(
        numbers: u32,
        packets: usize,
        shares: usize,
        mtu: usize,
    ) -> Result<Stream, ModemError> {
        let mut slots = room(packets)?;
        for _ in 0..packets {
            slots.push(Slot::new(shares, mtu)?);
        }
        Ok(Stream { numbers, slots, newest: None, last: None, last_pushed: 0.0, late: 0 })
    }

    /// Where the packet of a frame number is kept, if one may be that.
    pub fn find(&self, frame: u32) -> Option<&Slot> {
        self.slots.iter().find(|slot| slot.may_be(frame))
    }

    /// Where a packet of a number is kept.
    pub fn slot(&self, number: u32) -> &Slot {
        &self.slots[self.place(number)]
    }

    pub fn slot_mut(&mut self, number: u32) -> &mut Slot {
        let place = self.place(number);
        &mut self.slots[place]
    }

    fn place(&self, number: u32) -> usize {
        (number % self.numbers) as usize % self.slots.len()
    }

    /// How far a number lies before another one.
    fn behind(&self, number: u32, newest: u32) -> u32 {
        newest.wrapping_sub(number) % self.numbers
    }

    /// Numbers of the packets that may be there, newest first.
    pub fn numbers(&self) -> impl Iterator<Item = u32> + use<> {
        let held = self.newest.map_or(0, |_| self.slots.len() as u32);
        let (newest, numbers) = (self.newest.unwrap_or(0), self.numbers);
        (0..held).map(move |behind| newest.wrapping_sub(behind) % numbers)
    }

    /// Empties the places of stale packets. If no share came for as long, counts from the next one, and says so.
    pub fn forget(&mut self, now: f64, age: f64, statistics: &mut CollectorStatistics) -> bool {
        for slot in &mut self.slots {
            if slot.since().is_some_and(|since| since + age < now) {
                slot.let_go(statistics);
            }
        }
        let silent = self.last_pushed + age < now;
        if silent {
            self.newest = None;
        }
        self.last_pushed = now;
        silent
    }

    /// Makes a number the newest if it is, and lets those go that are too old then.
    pub fn advance(
        &mut self,
        number: u32,
        statistics: &mut CollectorStatistics,
    ) -> Result<(), ModemError> {
        let Some(newest) = self.newest else {
            self.newest = Some(number);
            return Ok(());
        };
        let held = self.slots.len() as u32;
        let (behind, ahead) = (self.behind(number, newest), self.behind(newest, number));
        if behind < held {
            self.late = 0;
            return Ok(());
        }
        // Numbers further behind than half of all are ahead.
        if behind <= self.numbers / 2 {
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
    fn let_go(&mut self, number: u32, statistics: &mut CollectorStatistics) {
        let slot = self.slot_mut(number);
        statistics.lost += u64::from(slot.since().is_none());
        slot.let_go(statistics);
    }

    /// Remembers the frame number of a packet that yields a picture.
    pub fn note(&mut self, taken: Taken) {
        if let Taken::Grown(frame) | Taken::Complete(frame) = taken {
            self.last = Some(frame);
        }
    }

    #[cfg(test)]
    pub fn capacity(&self) -> usize {
        self.slots.iter().map(Slot::capacity).sum()
    }
}
