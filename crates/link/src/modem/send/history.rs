//! What a sender remembers of its packets, to learn from reports.

use crate::modem::error::ModemError;
use crate::modem::limits::MAX_SHARES;
use crate::modem::memory::{filled, room};
use crate::modem::report::{MAX_ARRIVED, PacketState, Report};

use super::rate_control::RateControlOptions;
use super::sharer::Sharer;

/// Most packets that are remembered.
const MAX_PACKETS: usize = 64;
/// Fewest shares that tell of a loss.
const MIN_COUNTED: usize = 16;

/// The last packets, in memory that is taken when it is made.
pub struct History {
    packets: Vec<Sent>,
    /// Room for the shares of all packets, `max_shares · mtu` bytes for each.
    shares: Vec<u8>,
    room: usize,
    /// The place of the next packet.
    next: usize,
}

/// A packet that was sent.
#[derive(Clone, Copy, Default)]
struct Sent {
    /// Frame number, as the packet states it.
    frame: u32,
    /// When its frame was exposed, and when its first and its last share are due, seconds.
    exposed: f64,
    first_due: f64,
    last_due: f64,
    count: usize,
    /// Bytes of each share; the last one of an unprotected packet may have fewer.
    share_len: usize,
    bytes: usize,
    /// Shares that the topside must have: those of a picture, of an unprotected packet all.
    wanted: usize,
    resent: bool,
    /// Its shares count in a loss that was measured.
    counted: bool,
}

impl History {
    /// Packets that are remembered: those of twice the latency.
    fn count(control: &RateControlOptions) -> usize {
        ((2.0 * control.latency * control.frame_rate) as usize).clamp(4, MAX_PACKETS)
    }

    /// Memory that it takes, bytes.
    pub fn memory(control: &RateControlOptions) -> usize {
        let shares = control.max_shares.saturating_mul(control.mtu);
        Self::count(control).saturating_mul(shares.saturating_add(size_of::<Sent>()))
    }

    pub fn new(control: &RateControlOptions) -> Result<History, ModemError> {
        let count = Self::count(control);
        let room_of_one = control.max_shares.saturating_mul(control.mtu);
        let shares = filled(count.saturating_mul(room_of_one), 0)?;
        Ok(History { packets: room(count)?, shares, room: room_of_one, next: 0 })
    }

    /// Remembers a packet in place of the oldest. `exposed`, `ready`: of its frame and its shares, seconds; `spread`:
    /// from the first share to the last one. `wanted`: how many shares the topside must have.
    pub fn add(
        &mut self,
        frame: u32,
        [exposed, ready, spread]: [f64; 3],
        wanted: usize,
        sharer: &Sharer,
    ) {
        let share_len = sharer.shares().map(<[u8]>::len).max().unwrap_or(1);
        let sent = Sent {
            frame,
            exposed,
            first_due: ready,
            last_due: ready + spread,
            count: sharer.count(),
            share_len,
            bytes: sharer.shares().map(<[u8]>::len).sum(),
            wanted,
            resent: false,
            counted: false,
        };
        if self.packets.len() < self.packets.capacity() {
            self.packets.push(sent);
        } else {
            self.packets[self.next] = sent;
        }
        let place = &mut self.shares[self.next * self.room..][..self.room];
        for (share, place) in sharer.shares().zip(place.chunks_mut(share_len)) {
            place[..share.len()].copy_from_slice(share);
        }
        self.next = (self.next + 1) % self.packets.capacity();
    }

    /// When the first share of the newest packet that a report tells of was due: the topside could have all that went
    /// before when it wrote the report.
    pub fn settled(&self, report: &Report) -> f64 {
        let newest = self.packets.iter().rev().find(|sent| same(sent.frame, report.newest()));
        newest.map_or(f64::NEG_INFINITY, |sent| sent.first_due)
    }

    /// Shares that were lost, as a part of those that no report told of before; `None`: too few to tell.
    pub fn loss(&mut self, report: &Report) -> Option<f64> {
        let until = self.settled(report);
        let is_new = |sent: &Sent| !sent.counted && sent.last_due < until;
        let counts = |sent: &Sent| is_new(sent).then(|| sent.arrived(report)).flatten();
        let new = self.packets.iter().filter_map(counts);
        let (sent, arrived) = new.fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        if sent < MIN_COUNTED {
            return None;
        }
        for packet in &mut self.packets {
            packet.counted |= counts(packet).is_some();
        }
        Some(1.0 - arrived as f64 / sent as f64)
    }

    /// The shares of a packet to send again, if one lacks some and they are worth it. `in_time` tells that from their
    /// number, the bytes of each, and the exposure.
    pub fn next_to_resend(
        &mut self,
        report: &Report,
        in_time: impl Fn(usize, usize, f64) -> bool,
    ) -> Option<impl Iterator<Item = &[u8]>> {
        let until = self.settled(report);
        let place = self.packets.iter().position(|sent| {
            let settled = !sent.resent && sent.last_due < until;
            let short = if settled { sent.short(report) } else { 0 };
            short > 0 && in_time(short, sent.share_len, sent.exposed)
        })?;
        let sent = &mut self.packets[place];
        sent.resent = true;
        let packet = *report.packet(sent.frame)?;
        let shares = self.shares[place * self.room..][..sent.bytes].chunks(sent.share_len);
        let listed = if packet.state == PacketState::Part { MAX_SHARES } else { usize::MAX };
        let absent = shares.enumerate().take(listed);
        let absent = absent.filter(move |(index, _)| !packet.shares.contains(*index));
        Some(absent.map(|(_, share)| share).take(sent.short(report)))
    }
}

impl Sent {
    /// Shares that a report tells of, and those of them that arrived. A report lists [`MAX_SHARES`] at most.
    fn arrived(&self, report: &Report) -> Option<(usize, usize)> {
        let packet = report.packet(self.frame)?;
        let arrived = packet.arrived.min(self.count);
        Some(match packet.state {
            PacketState::Nothing => (self.count, 0),
            PacketState::Part => (self.count.min(MAX_SHARES), packet.shares.arrived()),
            _ if arrived == usize::from(MAX_ARRIVED) => (self.count, self.count),
            _ => (self.count, arrived),
        })
    }

    /// Shares that the topside lacks, of those that it must have, as a report says.
    fn short(&self, report: &Report) -> usize {
        let Some(packet) = report.packet(self.frame) else { return 0 };
        match packet.state {
            PacketState::Nothing => self.wanted,
            PacketState::Part => {
                self.wanted.min(MAX_SHARES).saturating_sub(packet.shares.arrived())
            }
            PacketState::Whole | PacketState::Kept => 0,
        }
    }
}

/// Whether two frame numbers are the same modulo 2¹⁶.
fn same(a: u32, b: u32) -> bool {
    a as u16 == b as u16
}
