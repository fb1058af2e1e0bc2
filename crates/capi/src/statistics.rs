//! Counts of both ends of a link.

use super::status::*;
use super::structs::{Out, versioned, zeroed};
use super::topside::nvsp_topside;
use super::vehicle::nvsp_vehicle;

/// Counts since the vehicle was made.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_vehicle_statistics {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Frames for which the link had no bytes.
    pub left_out: u64,
    /// Packets taken.
    pub packets: u64,
    /// Packets of them whose end was not sent.
    pub cut: u64,
    /// Modem frames of them.
    pub shares: u64,
    /// Bytes of them on the link, the overhead of each counted.
    pub bytes: u64,
    /// Modem frames that wait now.
    pub waiting: u64,
    /// Modem frames that were sent again.
    pub resent: u64,
    /// With keys: reports that no key has made.
    pub foreign: u64,
    /// With keys: reports that came a second time.
    pub replayed: u64,
    /// The loss that packets are protected against now.
    pub loss: f64,
    /// And the mean length of its bursts, modem frames.
    pub burst: f64,
    /// The bit rate now, bit/s.
    pub bit_rate: f64,
}
versioned!(nvsp_vehicle_statistics, 104);

/// Copies the counts of a vehicle.
///
/// # Parameters
/// - `statistics`: receives the counts.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_get_statistics(
    vehicle: Option<&nvsp_vehicle>,
    statistics: Out<nvsp_vehicle_statistics>,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        let (counts, sender) = (content.link.statistics(), content.link.sender());
        let control = sender.options();
        statistics.required()?.write(&nvsp_vehicle_statistics {
            left_out: counts.left_out,
            packets: counts.packets,
            cut: counts.cut,
            shares: counts.shares,
            bytes: counts.bytes,
            waiting: sender.waiting() as u64,
            resent: counts.resent,
            foreign: counts.foreign,
            replayed: counts.replayed,
            loss: control.loss.chance,
            burst: control.loss.burst,
            bit_rate: control.bit_rate,
            ..zeroed()
        });
        Ok(NVSP_OK)
    })
}

/// Counts since the topside was made. A packet has gone by once a newer one took its place, or it is stale.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_topside_statistics {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Modem frames that were not there before.
    pub accepted: u64,
    /// Modem frames that were.
    pub duplicates: u64,
    /// Those that were none of a packet, damaged, of packets long past, and those of unprotected packets whose first
    /// one did not come.
    pub rejected: u64,
    /// Those that packets gone by had.
    pub arrived: u64,
    /// Those that they were sent in: 1 - arrived / sent is the loss. Packets of which nothing came do not count, as a
    /// frame that was left out looks the same; nor unprotected ones whose length did not come.
    pub sent: u64,
    /// Packets that became complete.
    pub completed: u64,
    /// Packets gone by that were complete although modem frames of them were missing.
    pub repaired: u64,
    /// Packets gone by that yielded a picture, but not all of it.
    pub partial: u64,
    /// Packets gone by that yielded no picture, and frame numbers of which nothing came.
    pub lost: u64,
    /// Packets whose own checks did not match what their modem frames held.
    pub damaged: u64,
    /// Modem frames of unprotected packets that now wait for the first one of their packet.
    pub waiting: u64,
    /// With keys: modem frames that no key has made. They count nowhere else.
    pub foreign: u64,
    /// With keys: modem frames that came a second time. They count nowhere else.
    pub replayed: u64,
}
versioned!(nvsp_topside_statistics, 112);

/// Copies the counts of a topside.
///
/// # Parameters
/// - `statistics`: receives the counts.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_topside_get_statistics(
    topside: Option<&nvsp_topside>,
    statistics: Out<nvsp_topside_statistics>,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        let counts = content.link.statistics();
        statistics.required()?.write(&nvsp_topside_statistics {
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
            ..zeroed()
        });
        Ok(NVSP_OK)
    })
}
