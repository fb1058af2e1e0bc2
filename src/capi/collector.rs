//! The topside's end of a link.

use std::ptr::null_mut;

use crate::keys::Keys;
use crate::modem::{Collected, CollectedPacket, Collector, CollectorOptions};

use super::handle::{Content, Handle, fence};
use super::keys::{keys_of, nvsp_keys};
use super::limits::SMALL;
use super::log::Log;
use super::memory::Grant;
use super::slices::{Room, optional_slice, slice, slice_mut};
use super::status::*;
use super::structs::{In, Out, Place, number, versioned, zeroed};

/// Puts packets together from the shares of an nvsp_sender, protected and unprotected ones. Example:
///
/// ```c
/// nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
/// if (nvsp_collector_push(collector, now, frame, size, &state) == NVSP_OK && state.bytes > 0)
///     status = nvsp_collector_fetch(collector, state.stream, state.frame, packet, sizeof packet, &bytes, NULL);
/// ```
pub type nvsp_collector = Handle<Collector>;

impl Content for Collector {}

/// nvsp_collector_options.flags: the modem hands over no damaged frames. The first share of an unprotected packet then
/// counts as valid to its end.
pub const NVSP_COLLECTOR_MODEM_CHECKS: u32 = 1;

/// How to collect shares.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_collector_options {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Seconds after which a packet is stale, from its first share on. Shares name packets by the frame number modulo
    /// 256: give less time than 128 frames of the camera take. A share that comes later than that looks like one of the
    /// future. Below an MTU of 16 they count packets modulo 8: less time than 4 packets take. 0: 4.
    pub age: f64,
    /// Shares of a packet that there is room for, up to 2048: nvsp_sender_options.shares. An unprotected packet of n
    /// bytes takes 1, and one more for each MTU - 4 bytes beyond MTU - 1; below an MTU of 16 one for each MTU - 1
    /// bytes. Of a longer one the start is kept. 0: 32.
    pub shares: u32,
    /// Packets of a stream that are held: that of the newest frame number, and of those before it. Up to 64, and
    /// rounded up to a power of two; below an MTU of 16 up to 4. 0: 16.
    pub packets: u32,
    /// Streams that are taken, 0 to this less one; up to 4. 0: 1.
    pub streams: u32,
    /// NVSP_COLLECTOR_* flags.
    pub flags: u32,
    /// Only modem frames that a sender has made with one of these keys are taken, and none a second time. Reports get a
    /// tag by the first. Read during the call. NULL: none, and whatever comes is taken.
    pub keys: In<nvsp_keys>,
}
versioned!(nvsp_collector_options, 40);

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
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_collected {
    pub struct_size: u32,
    pub abi_version: u32,
    /// NVSP_EVENT_* from nvsp_collector_push: what the share brought. From other calls 0. With
    /// NVSP_EVENT_COMPLETE and NVSP_EVENT_GROWN all other fields are set. Else they are zero.
    pub event: u32,
    /// Stream of the packet.
    pub stream: u32,
    /// Frame number of the packet, completed from that of the packet before.
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

fn memory_of(options: &CollectorOptions, keys: Option<&Keys>) -> Result<u64, Failure> {
    Ok(match keys {
        Some(keys) => options.memory_with_keys(keys)?,
        None => options.memory()?,
    } as u64)
}

/// Tells how much memory a collector takes for its packets. Any thread may call it.
///
/// Fails with NVSP_ERR_ARGUMENT or NVSP_ERR_MODEM (an MTU without room for keys).
///
/// # Parameters
/// - `mtu`: most bytes of a modem frame, 1 to 65535; with keys from 8 more than they take.
/// - `options`: how; NULL: all defaults.
/// - `bytes`: receives the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_collector_memory(
    mtu: u32,
    options: In<nvsp_collector_options>,
    bytes: Place<u64>,
) -> nvsp_status {
    fence(|| {
        let bytes = bytes.required("bytes")?;
        let given = options.read()?;
        bytes.write(memory_of(&options_of(mtu, &given)?, keys_of(given.keys)?.as_ref())?);
        Ok(NVSP_OK)
    })
}

/// Makes a collector. Takes all its memory here: as much as nvsp_collector_memory tells.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_MODEM (an MTU without room for keys) or NVSP_ERR_MEMORY.
///
/// # Parameters
/// - `mtu`: most bytes of a modem frame, 1 to 65535, as the sender's; packets need 8, with protection 16, and with keys
///   as many more as these take. What lies beyond it is padding.
/// - `options`: how; NULL: all defaults.
/// - `collector`: receives the collector, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_collector_create(
    mtu: u32,
    options: In<nvsp_collector_options>,
    collector: Place<Box<nvsp_collector>>,
) -> nvsp_status {
    fence(|| {
        let collector = collector.required("collector")?;
        let given = options.read()?;
        let (options, keys) = (options_of(mtu, &given)?, keys_of(given.keys)?);
        let memory = memory_of(&options, keys.as_ref())?;
        let _memory = Grant::take("a collector", memory + SMALL, u64::MAX)?;
        let made = match &keys {
            Some(keys) => Collector::with_keys(options, keys)?,
            None => Collector::new(options)?,
        };
        collector.write(Handle::boxed(made, Log::new(None, null_mut())));
        Ok(NVSP_OK)
    })
}

/// Takes a modem frame. Shares may come in any order, repeated, padded or damaged, and mixed with other frames.
///
/// Fails with NVSP_ERR_ARGUMENT (the time), or NVSP_ERR_MODEM if it is no share, is damaged or too old, is of a stream
/// that is not taken, or is one of more shares than there is room for. With keys, NVSP_ERR_FOREIGN or
/// NVSP_ERR_REPLAYED: nothing of it is read then. What came before is not lost.
///
/// # Safety
/// - `now`: when it came, seconds, on a clock that does not go back. Without a clock, 0 always: then no packet becomes
///   stale.
/// - `frame`: the modem frame.
/// - `size`: bytes of it.
/// - `state`: receives what it brought. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_push(
    collector: Option<&nvsp_collector>,
    now: f64,
    frame: *const u8,
    size: usize,
    state: Out<nvsp_collected>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        let out = state.optional()?;
        let of = |event| nvsp_collected { event, ..zeroed() };
        // SAFETY: `size` bytes stand at `frame`, see `# Safety`.
        let frame = unsafe { slice(frame, size, "frame")? };
        let state = match content.push(now, frame)? {
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

/// Copies what has come of a packet: the whole packet, or its start. Give it to nvsp_decode with NVSP_DECODE_START,
/// which makes the best possible picture of it. The packet stays until newer packets take its place, or it is stale.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL, or NVSP_ERR_STATE if nothing came of it that makes a
/// picture.
///
/// # Safety
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, as nvsp_collected.frame has it.
/// - `packet`: receives the packet, or its start.
/// - `size`: bytes of `packet`; nvsp_collector_options.shares times the MTU always suffices.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
/// - `state`: receives what is there of the packet. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_fetch(
    collector: Option<&nvsp_collector>,
    stream: u32,
    frame: u32,
    packet: *mut u8,
    size: usize,
    written: Place<usize>,
    state: Out<nvsp_collected>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        let out = state.optional()?;
        // SAFETY: `size` bytes stand at `packet`, see `# Safety`.
        let mut room = unsafe { Room::new(packet, size, written, "packet")? };
        let found = held(content, stream, frame)?;
        room.write(found.bytes)?;
        out.write(&state_of(stream as u8, Some(found)));
        Ok(NVSP_OK)
    })
}

/// Copies the user bytes that came with a packet: as many as nvsp_collected.user_bytes.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL, or NVSP_ERR_STATE if nothing came of the packet that makes
/// a picture, or it has none.
///
/// # Safety
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, as for nvsp_collector_fetch.
/// - `user`: receives the user bytes.
/// - `size`: bytes of `user`; 255 always suffice.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_fetch_user(
    collector: Option<&nvsp_collector>,
    stream: u32,
    frame: u32,
    user: *mut u8,
    size: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        // SAFETY: `size` bytes stand at `user`, see `# Safety`.
        let mut room = unsafe { Room::new(user, size, written, "user")? };
        let none = Failure::at(NVSP_ERR_STATE, "the packet has no user bytes");
        room.write(held(content, stream, frame)?.user.ok_or(none)?)?;
        Ok(NVSP_OK)
    })
}

/// Tells what is there of the packet of the greatest frame number of a stream that yields a picture.
///
/// Fails with NVSP_ERR_ARGUMENT (the stream), or NVSP_ERR_STATE if there is none.
///
/// # Parameters
/// - `stream`: the stream.
/// - `state`: receives what is there.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_collector_newest(
    collector: Option<&nvsp_collector>,
    stream: u32,
    state: Out<nvsp_collected>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        let out = state.required()?;
        let stream = stream_of(content, stream)?;
        let newest = content.newest(stream);
        let newest = newest.ok_or(Failure::at(NVSP_ERR_STATE, "no packet yields a picture"))?;
        out.write(&state_of(stream, Some(newest)));
        Ok(NVSP_OK)
    })
}

/// Tells which shares of a packet have come: bit i modulo 8 of byte i / 8 is set if share i has. Until the packet
/// yields a picture, its frame number counts modulo 256.
///
/// Fails with NVSP_ERR_ARGUMENT (the stream), or NVSP_ERR_BUFFER_TOO_SMALL, which writes `known`: a byte is needed for
/// each eight.
///
/// # Safety
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, as for nvsp_collector_fetch.
/// - `bits`: receives the bits; those beyond `known` are zero.
/// - `size`: bytes of `bits`; an eighth of nvsp_collector_options.shares, rounded up, always suffices.
/// - `known`: receives how many shares are known of: all that the packet was sent in; of an unprotected one whose
///   length has not come those up to the first missing one; 0: none has come.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_arrived(
    collector: Option<&nvsp_collector>,
    stream: u32,
    frame: u32,
    bits: *mut u8,
    size: usize,
    known: Place<u32>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        let known = known.required("known")?;
        // SAFETY: `size` bytes stand at `bits`, see `# Safety`.
        let into = unsafe { slice_mut(bits, size, "bits")? };
        let stream = stream_of(content, stream)?;
        let count = content.known(stream, frame);
        let needed = count.div_ceil(8);
        known.write(number(count));
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

/// Lists the shares of a packet that have not come; none if it is complete, or if nothing of it came. Until the length
/// of an unprotected packet has come, that is the first missing one. Until the packet yields a picture, its frame
/// number counts modulo 256.
///
/// Fails with NVSP_ERR_ARGUMENT (the stream).
///
/// # Safety
/// - `stream`: the packet's stream.
/// - `frame`: its frame number, as for nvsp_collector_fetch.
/// - `indices`: receives the first indices, as many as there is room for. NULL only if `room` is 0.
/// - `room`: most indices to write.
/// - `count`: receives how many are missing in all, which may be more than `room`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_missing(
    collector: Option<&nvsp_collector>,
    stream: u32,
    frame: u32,
    indices: *mut u32,
    room: u32,
    count: Place<u32>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        let count = count.required("count")?;
        if indices.is_null() && room > 0 {
            return Err(Failure::null("indices"));
        }
        let stream = stream_of(content, stream)?;
        let mut missing = 0;
        for index in content.missing(stream, frame) {
            if missing < room as usize {
                // SAFETY: `room` numbers stand at `indices`, see `# Safety`.
                unsafe { *indices.add(missing) = number(index) };
            }
            missing += 1;
        }
        count.write(number(missing));
        Ok(NVSP_OK)
    })
}

/// Writes what has come of a stream's newest packets, for the vehicle: a modem frame for the return channel, which
/// nvsp_sender_process_report reads. Send one now and then, for example each second. If not all packets fit, it tells
/// of the newest ones. Returns NVSP_PENDING if no packet has yielded a picture yet, and writes nothing then.
///
/// Fails with NVSP_ERR_ARGUMENT (the stream, or more than 255 user bytes) or NVSP_ERR_MODEM (`size` is too small for
/// any report).
///
/// # Safety
/// - `stream`: the stream.
/// - `kept`: numbers of the frames that were decoded in full (NVSP_DECODED_KEPT), of which the low 16 bits count. NULL
///   only if `kept_count` is 0.
/// - `kept_count`: how many. Frames that the report does not tell of are ignored.
/// - `user`: bytes of yours that go with the report. NULL: none.
/// - `user_size`: bytes of `user`, at most 255.
/// - `report`: receives the report.
/// - `size`: most bytes of a modem frame.
/// - `written`: receives the report's length, bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_collector_report(
    collector: Option<&nvsp_collector>,
    stream: u32,
    kept: *const u32,
    kept_count: u32,
    user: *const u8,
    user_size: usize,
    report: *mut u8,
    size: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_collector::call(collector, |content| {
        let written = written.required("written")?;
        if kept.is_null() && kept_count > 0 {
            return Err(Failure::null("kept"));
        }
        if report.is_null() {
            return Err(Failure::null("report"));
        }
        // SAFETY: `size` bytes stand at `report`, and `user_size` at `user`, see `# Safety`.
        let (into, user) = unsafe {
            (slice_mut(report, size, "report")?, optional_slice(user, user_size, "user")?)
        };
        let stream = stream_of(content, stream)?;
        // SAFETY: `kept_count` numbers stand at `kept`, see `# Safety`.
        let number_of = |k: u32| unsafe { *kept.add(k as usize) };
        let is_kept = |frame: u32| (0..kept_count).any(|k| number_of(k) as u16 == frame as u16);
        let Some(found) = content.report(stream, is_kept)? else { return Ok(NVSP_PENDING) };
        written.write(content.write_report(&found, user, into)?);
        Ok(NVSP_OK)
    })
}

fn stream_of(collector: &Collector, stream: u32) -> Result<u8, Failure> {
    let known = (stream as usize) < collector.options().streams;
    known.then_some(stream as u8).ok_or(Failure::argument("stream: the collector has not so many"))
}

fn held(collector: &Collector, stream: u32, frame: u32) -> Result<CollectedPacket<'_>, Failure> {
    let found = collector.packet(stream_of(collector, stream)?, frame);
    found.ok_or(Failure::at(NVSP_ERR_STATE, "nothing of this packet makes a picture"))
}

fn state_of(stream: u8, packet: Option<CollectedPacket>) -> nvsp_collected {
    let Some(packet) = packet else { return zeroed() };
    nvsp_collected {
        stream: stream.into(),
        frame: packet.frame,
        bytes: number(packet.bytes.len()),
        complete: packet.complete.into(),
        arrived: number(packet.arrived),
        sent: packet.sent.map_or(0, number),
        user_bytes: packet.user.map_or(0, |user| number(user.len())),
        ended: packet.ended.into(),
        ..zeroed()
    }
}
