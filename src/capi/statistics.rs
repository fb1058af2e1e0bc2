//! Counts of both ends of a link.

use super::collector::nvsp_collector;
use super::keys::taken_of;
use super::sender::nvsp_sender;
use super::status::*;
use super::structs::{Out, versioned, zeroed};

/// Counts since the sender was made.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_sender_statistics {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Frames left out: nvsp_sender_plan had no bytes for them.
    pub left_out: u64,
    /// Packets taken.
    pub packets: u64,
    /// Packets of them whose end was not sent.
    pub cut: u64,
    /// Shares of them.
    pub shares: u64,
    /// Bytes of them on the link, the overhead of each share counted.
    pub bytes: u64,
    /// Shares that wait now.
    pub waiting: u64,
    /// The loss that packets are protected against now.
    pub loss: f64,
    /// And the mean length of its bursts, modem frames.
    pub burst: f64,
    /// The bit rate now, bit/s.
    pub bit_rate: f64,
    /// Shares that were sent again.
    pub resent: u64,
    /// With keys: reports that no key has made.
    pub foreign: u64,
    /// With keys: reports that came a second time.
    pub replayed: u64,
    /// With keys: the number of the next modem frame. Else 0. See nvsp_keys.number.
    pub next_number: u64,
    /// With keys: of each stream, the number above all of the reports that came. See nvsp_keys.taken.
    pub taken: [u64; 4],
}
versioned!(nvsp_sender_statistics, 144);

/// Copies the counts of a sender.
///
/// # Parameters
/// - `statistics`: receives the counts.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_get_statistics(
    sender: Option<&nvsp_sender>,
    statistics: Out<nvsp_sender_statistics>,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        let (counts, control) = (content.statistics(), content.options());
        statistics.required()?.write(&nvsp_sender_statistics {
            left_out: counts.left_out,
            packets: counts.packets,
            cut: counts.cut,
            shares: counts.shares,
            bytes: counts.bytes,
            waiting: content.waiting() as u64,
            loss: control.loss.chance,
            burst: control.loss.burst,
            bit_rate: control.bit_rate,
            resent: counts.resent,
            foreign: counts.foreign,
            replayed: counts.replayed,
            next_number: content.next_number().unwrap_or(0),
            taken: taken_of(content.seen()),
            ..zeroed()
        });
        Ok(NVSP_OK)
    })
}

/// Counts since the collector was made. A packet has gone by once a newer one took its place, or it is stale.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_collector_statistics {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Shares that were not there before.
    pub accepted: u64,
    /// Shares that were there before.
    pub duplicates: u64,
    /// Modem frames that were no shares, damaged ones, such of packets long past, and shares of unprotected packets
    /// whose first one did not come.
    pub rejected: u64,
    /// Shares that packets gone by had.
    pub arrived: u64,
    /// Shares that they were sent in. 1 - arrived / sent is the loss, for nvsp_sender_set_loss. Packets of which no
    /// share came do not count, as a frame that was left out looks the same; nor unprotected ones whose length did not
    /// come.
    pub sent: u64,
    /// Packets that became complete.
    pub completed: u64,
    /// Packets gone by that were complete although shares of them were missing.
    pub repaired: u64,
    /// Packets gone by that yielded a picture, but not all of it.
    pub partial: u64,
    /// Packets gone by that yielded no picture, and frame numbers of which nothing came.
    pub lost: u64,
    /// Packets whose own checks did not match what their shares held.
    pub damaged: u64,
    /// Shares of unprotected packets that now wait for the first one of their packet.
    pub waiting: u64,
    /// With keys: modem frames that no key has made. They count nowhere else.
    pub foreign: u64,
    /// With keys: modem frames that came a second time. They count nowhere else.
    pub replayed: u64,
    /// With keys: the number of the next report. Else 0. See nvsp_keys.number.
    pub next_number: u64,
    /// With keys: of each stream, the number above all of the modem frames that came. See nvsp_keys.taken.
    pub taken: [u64; 4],
}
versioned!(nvsp_collector_statistics, 152);

/// Copies the counts of a collector.
///
/// # Parameters
/// - `statistics`: receives the counts.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_collector_get_statistics(
    collector: Option<&nvsp_collector>,
    statistics: Out<nvsp_collector_statistics>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        let counts = content.statistics();
        statistics.required()?.write(&nvsp_collector_statistics {
            accepted: counts.accepted,
            duplicates: counts.duplicates,
            rejected: counts.rejected,
            arrived: counts.arrived,
            sent: counts.sent,
            completed: counts.completed,
            repaired: counts.repaired,
            partial: counts.partial,
            lost: counts.lost,
            damaged: counts.damaged,
            waiting: counts.waiting,
            foreign: counts.foreign,
            replayed: counts.replayed,
            next_number: content.next_number().unwrap_or(0),
            taken: taken_of(content.seen()),
            ..zeroed()
        });
        Ok(NVSP_OK)
    })
}
