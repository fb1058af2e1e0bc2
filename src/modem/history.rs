//! What a sender remembers of its packets, to learn from reports.

use super::error::{filled, room};
use super::{ModemError, PacketState, RateControlOptions, Report, Sharer, Sharing};

/// Most packets that are remembered.
const MOST: usize = 64;
/// Fewest shares that tell of a loss.
const LEAST_COUNTED: usize = 16;

/// The last packets, in memory that is taken when it is made.
pub(super) struct History {
    packets: Vec<Sent>,
    /// Room for the shares of all packets, `most · mtu` bytes for each.
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
    share_len: usize,
    /// Shares that give a picture.
    picture: usize,
    resent: bool,
    /// Its shares count in a loss that was measured.
    counted: bool,
}

/// Shares of a packet to send again.
pub(super) struct Again<'a> {
    pub shares: &'a [u8],
    pub share_len: usize,
    pub missing: [bool; super::MAX_SHARES],
}

impl History {
    /// Packets that are remembered: those of twice the latency.
    fn count(control: &RateControlOptions) -> usize {
        ((2.0 * control.latency * control.frame_rate) as usize).clamp(4, MOST)
    }

    /// Memory that it takes, bytes.
    pub fn memory(control: &RateControlOptions) -> usize {
        let shares = control.most_shares.saturating_mul(control.mtu);
        Self::count(control).saturating_mul(shares.saturating_add(size_of::<Sent>()))
    }

    pub fn new(control: &RateControlOptions) -> Result<History, ModemError> {
        let count = Self::count(control);
        let room_of_one = control.most_shares.saturating_mul(control.mtu);
        let shares = filled(count.saturating_mul(room_of_one), 0)?;
        Ok(History { packets: room(count)?, shares, room: room_of_one, next: 0 })
    }

    /// Remembers a packet in place of the oldest. `exposed`, `ready`: of its frame and its shares, seconds; `spread`: from
    /// the first share to the last one.
    pub fn add(
        &mut self,
        frame: u32,
        [exposed, ready, spread]: [f64; 3],
        sharing: &Sharing,
        sharer: &Sharer,
    ) {
        let sent = Sent {
            frame,
            exposed,
            first_due: ready,
            last_due: ready + spread,
            count: sharer.count(),
            share_len: sharing.share_len(),
            picture: sharing.layers()[0].threshold,
            resent: false,
            counted: false,
        };
        if self.packets.len() < self.packets.capacity() {
            self.packets.push(sent);
        } else {
            self.packets[self.next] = sent;
        }
        let place = &mut self.shares[self.next * self.room..][..self.room];
        for index in 0..sharer.count() {
            place[index * sent.share_len..][..sent.share_len].copy_from_slice(sharer.get(index));
        }
        self.next = (self.next + 1) % self.packets.capacity();
    }

    /// The packets that the topside could have all of when it wrote a report: those whose last share was due before the
    /// first one of the newest packet that it tells of.
    fn settled(&self, report: &Report) -> f64 {
        let newest = self.packets.iter().rev().find(|sent| same(sent.frame, report.newest()));
        newest.map_or(f64::NEG_INFINITY, |sent| sent.first_due)
    }

    /// Shares that were lost, as a part of those that no report told of before; `None`: too few to tell.
    pub fn loss(&mut self, report: &Report) -> Option<f64> {
        let until = self.settled(report);
        let told = |sent: &Sent| {
            let new = !sent.counted && sent.last_due < until;
            report.packet(sent.frame).filter(|_| new).map(|told| told.arrived.min(sent.count))
        };
        let new = self.packets.iter().filter_map(|sent| Some((sent.count, told(sent)?)));
        let (sent, arrived) = new.fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        if sent < LEAST_COUNTED {
            return None;
        }
        for packet in &mut self.packets {
            packet.counted |= told(packet).is_some();
        }
        Some(1.0 - arrived as f64 / sent as f64)
    }

    /// A packet that gives no picture yet, and the shares to send again. `in_time`: tells from their number, the bytes of
    /// each, and the exposure whether they are worth it.
    pub fn next_to_resend(
        &mut self,
        report: &Report,
        in_time: impl Fn(usize, usize, f64) -> bool,
    ) -> Option<Again<'_>> {
        let until = self.settled(report);
        for place in 0..self.packets.len() {
            let packet = &mut self.packets[place];
            if packet.resent || packet.last_due >= until {
                continue;
            }
            let Some(told) = report.packet(packet.frame) else { continue };
            let short = match told.state {
                PacketState::Nothing => packet.picture,
                PacketState::Part => packet.picture.saturating_sub(told.shares.arrived()),
                PacketState::Whole | PacketState::Kept => 0,
            };
            if short == 0 || !in_time(short, packet.share_len, packet.exposed) {
                continue;
            }
            packet.resent = true;
            let mut missing = [false; super::MAX_SHARES];
            let absent = (0..packet.count).filter(|index| !told.shares.contains(*index));
            absent.take(short).for_each(|index| missing[index] = true);
            let share_len = packet.share_len;
            let shares = &self.shares[place * self.room..][..packet.count * share_len];
            return Some(Again { shares, share_len, missing });
        }
        None
    }
}

/// Whether two frame numbers are the same modulo 2¹⁶.
fn same(a: u32, b: u32) -> bool {
    a as u16 == b as u16
}
