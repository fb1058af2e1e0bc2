//! The topside's end of a link.

use std::ffi::c_char;
use std::ptr::null_mut;

use crate::modem::{Collected, CollectedPacket, Collector, CollectorOptions};

use super::handle::{Handle, Opaque, fence};
use super::limits::SMALL;
use super::log::Log;
use super::memory::Grant;
use super::slices::{slice, slice_mut};
use super::status::*;
use super::structs::{Out, number, read, versioned};

/// Puts packets together from the shares of an nvsp_sender, protected and unprotected ones. One thread at a time may
/// use it. Example:
///
/// ```c
/// nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
/// if (nvsp_collector_push(collector, now, frame, size, &state) == NVSP_OK && state.bytes > 0)
///     status = nvsp_collector_fetch(collector, state.stream, state.frame, packet, sizeof packet, &bytes, NULL);
/// ```
#[allow(non_camel_case_types)]
pub struct nvsp_collector {
    _opaque: [u8; 0],
}

impl Opaque for nvsp_collector {
    type Content = Collector;
}

/// nvsp_collector_options.flags: the modem hands over no damaged frames. The first share of an unprotected packet then
/// counts as valid to its end.
pub const NVSP_COLLECTOR_MODEM_CHECKS: u32 = 1;

/// How to collect shares.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_collector_options {
    /// Set by NVSP_INIT.
    pub struct_size: u32,
    /// Set by NVSP_INIT.
    pub abi_version: u32,
    /// Seconds after which a packet is stale, from its first share on. Shares name packets by the frame number modulo
    /// 128: give less time than 64 frames of the camera take. A share that comes later than that looks like one of the
    /// future. 0: 4.
    pub age: f64,
    /// Shares of a packet that there is room for, up to 4096: nvsp_sender_options.shares. An unprotected packet of n
    /// bytes takes 1, and one more for each MTU - 4 bytes beyond the MTU; of a longer one the start is kept. 0: 32.
    pub shares: u32,
    /// Packets of a stream that are held: that of the newest frame number, and of those before it. Up to 64, and
    /// rounded up to a power of two. 0: 16.
    pub packets: u32,
    /// Streams that are taken, 0 to this less one; up to 4. 0: 1.
    pub streams: u32,
    /// NVSP_COLLECTOR_* flags.
    pub flags: u32,
}
versioned!(nvsp_collector_options, 32);

/// The packet is complete.
pub const NVSP_EVENT_COMPLETE: u32 = 1;
/// The packet has more bytes at its start than before: nvsp_collector_fetch yields a better picture.
pub const NVSP_EVENT_GROWN: u32 = 2;
/// The share is kept. It is of use once more come.
pub const NVSP_EVENT_KEPT: u32 = 3;
/// The share was there already.
pub const NVSP_EVENT_DUPLICATE: u32 = 4;
/// The packet's own checks do not match what its shares hold. They are dropped, and may come again. Of an unprotected
/// packet the first one stays, as far as it is valid.
pub const NVSP_EVENT_DAMAGED: u32 = 5;
/// The share's packet was complete before.
pub const NVSP_EVENT_SURPLUS: u32 = 6;

/// What has come of a packet.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_collected {
    /// Set by NVSP_INIT.
    pub struct_size: u32,
    /// Set by NVSP_INIT.
    pub abi_version: u32,
    /// NVSP_EVENT_* from nvsp_collector_push: what the share brought. From other calls 0. The other fields are zero
    /// unless it is NVSP_EVENT_COMPLETE or NVSP_EVENT_GROWN.
    pub event: u32,
    /// Stream of the packet.
    pub stream: u32,
    /// Frame number of the packet, modulo 2^24.
    pub frame: u32,
    /// Bytes of its start that are there. Checks vouch for them.
    pub bytes: u32,
    /// 1: these are the whole packet; else 0.
    pub complete: u32,
    /// Shares of it that came.
    pub arrived: u32,
    /// Shares that it was sent in; 0: the length of an unprotected packet has not come.
    pub sent: u32,
    /// User bytes that came with it.
    pub user_bytes: u32,
    /// 1: no share brings more, as the packet is complete, or its end was not sent; else 0.
    pub ended: u32,
    /// Zero.
    pub reserved: u32,
}
versioned!(nvsp_collected, 48);

/// Counts since the collector was made. A packet has gone by once a newer one took its place, or it is stale.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_collector_statistics {
    /// Set by NVSP_INIT.
    pub struct_size: u32,
    /// Set by NVSP_INIT.
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
}
versioned!(nvsp_collector_statistics, 96);

fn options_of(mtu: u32, given: &nvsp_collector_options) -> Result<CollectorOptions, Failure> {
    if given.flags & !NVSP_COLLECTOR_MODEM_CHECKS != 0 {
        return Err(Failure::argument("nvsp_collector_options.flags: unknown"));
    }
    let defaults = CollectorOptions::new(mtu as usize);
    let or = |value: u32, default: usize| if value == 0 { default } else { value as usize };
    Ok(CollectorOptions {
        mtu: defaults.mtu,
        shares: or(given.shares, defaults.shares),
        packets: or(given.packets, defaults.packets),
        streams: or(given.streams, defaults.streams),
        age: if given.age == 0.0 { defaults.age } else { given.age },
        modem_checks: given.flags & NVSP_COLLECTOR_MODEM_CHECKS != 0,
    })
}

/// Tells how much memory a collector takes for its packets. Allocates nothing; any thread may call it.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION or NVSP_ERR_ARGUMENT.
///
/// # Safety
/// - `mtu`: most bytes of a modem frame, 1 to 65535.
/// - `options`: set up by NVSP_INIT. Read during the call. NULL: all defaults.
/// - `bytes`: receives the bytes. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_memory(
    mtu: u32,
    options: *const nvsp_collector_options,
    bytes: *mut u64,
) -> nvsp_status {
    fence(|| {
        if bytes.is_null() {
            return Err(Failure::null("bytes"));
        }
        // SAFETY: as the caller promises.
        let options = options_of(mtu, &unsafe { read(options)? })?;
        let memory = options.memory()?;
        // SAFETY: not null, and valid as the caller promises.
        unsafe { *bytes = memory as u64 };
        Ok(NVSP_OK)
    })
}

/// Makes a collector. Takes all its memory here: as much as nvsp_collector_memory tells.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_ARGUMENT or NVSP_ERR_MEMORY.
///
/// # Safety
/// - `mtu`: most bytes of a modem frame, 1 to 65535, as the sender's; unprotected packets need 31. What lies beyond it
///   is padding.
/// - `options`: set up by NVSP_INIT. Read during the call. NULL: all defaults.
/// - `collector`: receives the collector, which nvsp_collector_destroy ends. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_create(
    mtu: u32,
    options: *const nvsp_collector_options,
    collector: *mut *mut nvsp_collector,
) -> nvsp_status {
    fence(|| {
        if collector.is_null() {
            return Err(Failure::null("collector"));
        }
        // SAFETY: as the caller promises.
        let options = options_of(mtu, &unsafe { read(options)? })?;
        let _memory = Grant::take("a collector", options.memory()? as u64 + SMALL, u64::MAX)?;
        let made = Handle::boxed(Collector::new(options)?, Log::new(None, null_mut()));
        // SAFETY: not null, and valid as the caller promises.
        unsafe { *collector = nvsp_collector::address(made) };
        Ok(NVSP_OK)
    })
}

/// Takes a modem frame. Shares may come in any order, repeated, padded or damaged, and mixed with other frames.
/// Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_ARGUMENT (the time), NVSP_ERR_BUSY,
/// NVSP_ERR_POISONED, or NVSP_ERR_MODEM if it is no share, is damaged or too old, is of a stream that is not taken, or
/// is one of more shares than there is room for. What came before is not lost then.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `now`: when it came, seconds, on a clock that does not go back. Without a clock, 0 always: then no packet becomes
///   stale.
/// - `frame`: the modem frame. Read during the call. Not NULL.
/// - `size`: bytes of it.
/// - `state`: receives what it brought, set up by NVSP_INIT. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_push(
    collector: *mut nvsp_collector,
    now: f64,
    frame: *const u8,
    size: usize,
    state: *mut nvsp_collected,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            let out = Out::new(state)?;
            if frame.is_null() {
                return Err(Failure::null("frame"));
            }
            let of = |event| nvsp_collected { event, ..NOTHING };
            let state = match content.push(now, slice(frame, size, "frame")?)? {
                Collected::Complete(stream, frame) => nvsp_collected {
                    event: NVSP_EVENT_COMPLETE,
                    ..state_of(stream, content.packet(stream, frame))
                },
                Collected::Grown(stream, frame) => nvsp_collected {
                    event: NVSP_EVENT_GROWN,
                    ..state_of(stream, content.packet(stream, frame))
                },
                Collected::Kept => of(NVSP_EVENT_KEPT),
                Collected::Duplicate => of(NVSP_EVENT_DUPLICATE),
                Collected::Surplus => of(NVSP_EVENT_SURPLUS),
                Collected::Damaged(..) => of(NVSP_EVENT_DAMAGED),
            };
            out.write(&state);
            Ok(NVSP_OK)
        })
    }
}

/// Copies what has come of a packet: the whole packet, or its start. Give it to nvsp_decode with NVSP_DECODE_START,
/// which makes the best possible picture of it. The packet stays until newer packets take its place, or it is stale.
/// Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_ARGUMENT, NVSP_ERR_BUSY,
/// NVSP_ERR_POISONED, NVSP_ERR_BUFFER_TOO_SMALL, or NVSP_ERR_STATE if nothing came of it that makes a picture.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, modulo 2^24. Of a short packet only the low 16 bits count.
/// - `packet`: receives the packet, or its start. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `packet`; nvsp_collector_options.shares times the MTU always suffices.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL. Not NULL.
/// - `state`: receives what is there of the packet, set up by NVSP_INIT. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_fetch(
    collector: *mut nvsp_collector,
    stream: u32,
    frame: u32,
    packet: *mut u8,
    size: usize,
    written: *mut usize,
    state: *mut nvsp_collected,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            let out = Out::new(state)?;
            let found = held(content, stream, frame)?;
            copy(found.bytes, (packet, size, "packet"), written)?;
            out.write(&state_of(stream as u8, Some(found)));
            Ok(NVSP_OK)
        })
    }
}

/// Copies the user bytes that came with a packet: as many as nvsp_collected.user_bytes. Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_ARGUMENT, NVSP_ERR_BUSY, NVSP_ERR_POISONED, NVSP_ERR_BUFFER_TOO_SMALL, or
/// NVSP_ERR_STATE if nothing came of the packet that makes a picture, or it has none.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, as for nvsp_collector_fetch.
/// - `user`: receives the user bytes. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `user`; 255 always suffice.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_fetch_user(
    collector: *mut nvsp_collector,
    stream: u32,
    frame: u32,
    user: *mut u8,
    size: usize,
    written: *mut usize,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            let none = Failure::at(NVSP_ERR_STATE, "the packet has no user bytes");
            let bytes = held(content, stream, frame)?.user.ok_or(none)?;
            copy(bytes, (user, size, "user"), written)?;
            Ok(NVSP_OK)
        })
    }
}

/// Tells what is there of the packet of the greatest frame number of a stream that yields a picture. Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_ARGUMENT (the stream), NVSP_ERR_BUSY,
/// NVSP_ERR_POISONED, or NVSP_ERR_STATE if there is none.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `stream`: the stream.
/// - `state`: receives what is there, set up by NVSP_INIT. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_newest(
    collector: *mut nvsp_collector,
    stream: u32,
    state: *mut nvsp_collected,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            let out = Out::required(state)?;
            let stream = stream_of(content, stream)?;
            let newest = content.newest(stream);
            let newest = newest.ok_or(Failure::at(NVSP_ERR_STATE, "no packet yields a picture"))?;
            out.write(&state_of(stream, Some(newest)));
            Ok(NVSP_OK)
        })
    }
}

/// Tells which shares of a packet have come: bit i modulo 8 of byte i / 8 is set if share i has. Until the packet
/// yields a picture, its frame number counts modulo 128. Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_ARGUMENT (the stream), NVSP_ERR_BUSY, NVSP_ERR_POISONED or
/// NVSP_ERR_BUFFER_TOO_SMALL, which writes `known`: a byte is needed for each eight.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, as for nvsp_collector_fetch.
/// - `bits`: receives the bits; those beyond `known` are zero. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `bits`; an eighth of nvsp_collector_options.shares, rounded up, always suffices.
/// - `known`: receives how many shares are known of: all that the packet was sent in; of an unprotected one whose
///   length has not come those up to the first missing one; 0: none has come. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_arrived(
    collector: *mut nvsp_collector,
    stream: u32,
    frame: u32,
    bits: *mut u8,
    size: usize,
    known: *mut u32,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            if bits.is_null() || known.is_null() {
                return Err(Failure::null("bits or known"));
            }
            let stream = stream_of(content, stream)?;
            let into = slice_mut(bits, size, "bits")?;
            let count = content.known(stream, frame);
            let needed = count.div_ceil(8);
            *known = number(count);
            if size < needed {
                return Err(Failure::Room { needed, found: size });
            }
            into.fill(0);
            for index in content.arrived(stream, frame) {
                into[index / 8] |= 1 << (index % 8);
            }
            Ok(NVSP_OK)
        })
    }
}

/// Lists the shares of a packet that have not come; none if it is complete, or if nothing of it came. Until the length
/// of an unprotected packet has come, that is the first missing one. Until the packet yields a picture, its frame
/// number counts modulo 128. Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_ARGUMENT (the stream), NVSP_ERR_BUSY or NVSP_ERR_POISONED.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, as for nvsp_collector_fetch.
/// - `indices`: receives the first indices, as many as there is room for. Yours, of `room` numbers. NULL only if `room`
///   is 0.
/// - `room`: most indices to write.
/// - `count`: receives how many are missing in all, which may be more than `room`. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_missing(
    collector: *mut nvsp_collector,
    stream: u32,
    frame: u32,
    indices: *mut u32,
    room: u32,
    count: *mut u32,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            if (indices.is_null() && room > 0) || count.is_null() {
                return Err(Failure::null("indices or count"));
            }
            let stream = stream_of(content, stream)?;
            let mut missing = 0;
            for index in content.missing(stream, frame) {
                if missing < room as usize {
                    *indices.add(missing) = number(index);
                }
                missing += 1;
            }
            *count = number(missing);
            Ok(NVSP_OK)
        })
    }
}

/// Writes what has come of a stream's newest packets, for the vehicle: a modem frame for the return channel, which
/// nvsp_sender_process_report reads. Send one now and then, for example each second. If not all packets fit, it tells
/// of the newest ones. Returns NVSP_PENDING if no packet has yielded a picture yet, and writes nothing then. Allocates
/// nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_ARGUMENT (the stream, or more than 255 user bytes), NVSP_ERR_BUSY,
/// NVSP_ERR_POISONED or NVSP_ERR_MODEM (`size` is too small for any report).
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `stream`: the stream.
/// - `kept`: numbers of the frames that were decoded in full (NVSP_DECODED_KEPT), of which the low 16 bits count. Read
///   during the call. NULL only if `kept_count` is 0.
/// - `kept_count`: how many. Frames that the report does not tell of are ignored.
/// - `user`: bytes of yours that go with the report. Read during the call. NULL: none.
/// - `user_size`: bytes of `user`, at most 255.
/// - `report`: receives the report. Yours, of `size` bytes. Not NULL.
/// - `size`: most bytes of a modem frame.
/// - `written`: receives the report's length, bytes. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_report(
    collector: *mut nvsp_collector,
    stream: u32,
    kept: *const u32,
    kept_count: u32,
    user: *const u8,
    user_size: usize,
    report: *mut u8,
    size: usize,
    written: *mut usize,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            if report.is_null() || written.is_null() || (kept.is_null() && kept_count > 0) {
                return Err(Failure::null("kept, report or written"));
            }
            let stream = stream_of(content, stream)?;
            let into = slice_mut(report, size, "report")?;
            let user = match user.is_null() {
                true if user_size > 0 => return Err(Failure::null("user")),
                true => None,
                false => Some(slice(user, user_size, "user")?),
            };
            let is_kept =
                |frame: u32| (0..kept_count as usize).any(|k| *kept.add(k) as u16 == frame as u16);
            let Some(found) = content.report(stream, is_kept)? else { return Ok(NVSP_PENDING) };
            *written = found.write(user, into)?;
            Ok(NVSP_OK)
        })
    }
}

/// Copies the counts.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_BUSY or NVSP_ERR_POISONED.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `statistics`: receives the counts, set up by NVSP_INIT. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_get_statistics(
    collector: *mut nvsp_collector,
    statistics: *mut nvsp_collector_statistics,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_collector::handle(collector), |content| {
            let counts = content.statistics();
            Out::required(statistics)?.write(&nvsp_collector_statistics {
                struct_size: 0,
                abi_version: 0,
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
            });
            Ok(NVSP_OK)
        })
    }
}

/// Copies the text of the last failed call on the collector, as nvsp_engine_last_error does.
///
/// # Safety
/// - `collector`: a live collector. Not NULL.
/// - `text`: receives the text, ending in NUL. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `text`, 1 or more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_last_error(
    collector: *const nvsp_collector,
    text: *mut c_char,
    size: usize,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe { Handle::last_error(nvsp_collector::handle(collector), text, size) }
}

/// Ends a collector; NULL is allowed.
///
/// # Safety
/// - `collector`: a live collector that no other thread uses. Do not use it afterwards. NULL is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_destroy(collector: *mut nvsp_collector) {
    // SAFETY: as the caller promises.
    unsafe { Handle::destroy(nvsp_collector::handle(collector).cast_mut()) }
}

fn stream_of(collector: &Collector, stream: u32) -> Result<u8, Failure> {
    let known = (stream as usize) < collector.options().streams;
    known.then_some(stream as u8).ok_or(Failure::argument("stream: the collector has not so many"))
}

fn held(collector: &Collector, stream: u32, frame: u32) -> Result<CollectedPacket<'_>, Failure> {
    let found = collector.packet(stream_of(collector, stream)?, frame);
    found.ok_or(Failure::at(NVSP_ERR_STATE, "nothing of this packet makes a picture"))
}

/// Copies all bytes, or only tells how many are needed.
///
/// # Safety
/// `place` is null or has as many bytes as given; `written` is null or valid.
unsafe fn copy(
    bytes: &[u8],
    (place, size, name): (*mut u8, usize, &'static str),
    written: *mut usize,
) -> Result<(), Failure> {
    if place.is_null() || written.is_null() {
        return Err(Failure::null(name));
    }
    // SAFETY: as the caller promises.
    let place = unsafe { slice_mut(place, size, name)? };
    let needed = bytes.len();
    // SAFETY: not null, and valid as the caller promises.
    unsafe { *written = needed };
    let place = place.get_mut(..needed).ok_or(Failure::Room { needed, found: size })?;
    place.copy_from_slice(bytes);
    Ok(())
}

const NOTHING: nvsp_collected = nvsp_collected {
    struct_size: 0,
    abi_version: 0,
    event: 0,
    stream: 0,
    frame: 0,
    bytes: 0,
    complete: 0,
    arrived: 0,
    sent: 0,
    user_bytes: 0,
    ended: 0,
    reserved: 0,
};

fn state_of(stream: u8, packet: Option<CollectedPacket>) -> nvsp_collected {
    let Some(packet) = packet else { return NOTHING };
    nvsp_collected {
        stream: stream.into(),
        frame: packet.frame,
        bytes: number(packet.bytes.len()),
        complete: packet.complete.into(),
        arrived: number(packet.arrived),
        sent: packet.sent.map_or(0, number),
        user_bytes: packet.user.map_or(0, |user| number(user.len())),
        ended: packet.ended.into(),
        ..NOTHING
    }
}
