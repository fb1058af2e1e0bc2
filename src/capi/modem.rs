//! Packets in modem frames.

use std::ffi::c_char;
use std::ptr::null_mut;

use crate::modem::{
    ModemError, Pushed, Reassembler, ReassemblerOptions, Received, Splitter, frame_count,
};

use super::handle::{Handle, Opaque, fence};
use super::log::Log;
use super::slices::{slice, slice_mut};
use super::status::*;
use super::structs::{Out, number, read, versioned};

/// Puts packets together from modem frames. One thread at a time may use it. Example:
///
/// ```c
/// nvsp_reassembly state = NVSP_INITIALIZER(nvsp_reassembly);
/// if (nvsp_reassembler_push(reassembler, frame, size, &state) == NVSP_OK && state.event == NVSP_EVENT_COMPLETE)
///     status = nvsp_reassembler_fetch(reassembler, packet, sizeof packet, &bytes, NULL);
/// ```
#[allow(non_camel_case_types)]
pub struct nvsp_reassembler {
    _opaque: [u8; 0],
}

impl Opaque for nvsp_reassembler {
    type Content = Reassembler;
}

/// MTUs of common acoustic modems, bytes. Any from 31 to 65535 will do.
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_31: u32 = 31;
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_64: u32 = 64;
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_256: u32 = 256;
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_1024: u32 = 1024;

/// The modem hands over no damaged frames: a packet's first frame then counts as sound to its end.
pub const NVSP_MODEM_CHECKS: u32 = 1024;

/// How to put packets together.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_reassembler_options {
    /// Set by NVSP_INIT.
    pub struct_size: u32,
    /// Set by NVSP_INIT.
    pub abi_version: u32,
    /// Packets of up to this many bytes can become complete. Of a longer packet, this many bytes from its start are
    /// kept. 0: 65536.
    pub max_packet_bytes: u32,
    /// NVSP_MODEM_CHECKS, or 0.
    pub flags: u32,
}
versioned!(nvsp_reassembler_options, 16);

/// The packet is complete.
pub const NVSP_EVENT_COMPLETE: u32 = 1;
/// The packet has more bytes at its start than before: nvsp_reassembler_fetch gives a better picture.
pub const NVSP_EVENT_GROWN: u32 = 2;
/// The modem frame is kept until others come: an earlier one is missing.
pub const NVSP_EVENT_KEPT: u32 = 3;
/// The modem frame was there already.
pub const NVSP_EVENT_DUPLICATE: u32 = 4;
/// All modem frames of the packet are there, but its own checks do not match. All frames but the
/// first were forgotten; they may come again.
pub const NVSP_EVENT_DAMAGED: u32 = 5;

/// What has come of a packet.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_reassembly {
    /// Set by NVSP_INIT.
    pub struct_size: u32,
    /// Set by NVSP_INIT.
    pub abi_version: u32,
    /// Frame number of the packet, modulo 2^24.
    pub frame: u32,
    /// Bytes of its start that are there without a gap. A check vouches for each of them.
    pub bytes: u32,
    /// 1: these are the whole packet; else 0.
    pub complete: u32,
    /// Modem frames that are known to belong to it. Until its length is known: those without a gap.
    pub frames: u32,
    /// Modem frames that it has in all; 0: not known yet.
    pub expected: u32,
    /// NVSP_EVENT_* from nvsp_reassembler_push: what the modem frame brought. From other calls 0.
    /// If it is NVSP_EVENT_KEPT or NVSP_EVENT_DUPLICATE, the other fields are about the newest
    /// packet, or zero if there is none.
    pub event: u32,
}
versioned!(nvsp_reassembly, 32);

/// Counts since the reassembler was made.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_reassembler_statistics {
    /// Set by NVSP_INIT.
    pub struct_size: u32,
    /// Set by NVSP_INIT.
    pub abi_version: u32,
    /// Modem frames that became part of a packet.
    pub accepted: u64,
    /// Modem frames that were there already.
    pub duplicates: u64,
    /// Modem frames refused.
    pub rejected: u64,
    /// Modem frames that now wait for the first frame of their packet.
    pub waiting: u64,
    /// Packets completed.
    pub completed: u64,
    /// How often a packet was all there, but its own checks did not match.
    pub damaged: u64,
    /// Packets displaced by newer ones before they were complete.
    pub incomplete: u64,
}
versioned!(nvsp_reassembler_statistics, 64);

/// Tells how many modem frames a packet takes. The first one costs no bytes, each other one costs
/// four. Allocates nothing; any thread may call it.
///
/// Fails with NVSP_ERR_NULL, or with NVSP_ERR_MODEM if the MTU is out of range or the packet is too
/// long for 4096 frames.
///
/// # Safety
/// - `packet_size`: bytes of the packet.
/// - `mtu`: most bytes of a modem frame, 31 to 65535.
/// - `count`: receives the number of modem frames. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_modem_frame_count(
    packet_size: usize,
    mtu: u32,
    count: *mut u32,
) -> nvsp_status {
    fence(|| {
        if count.is_null() {
            return Err(Failure::null("count"));
        }
        let frames = frame_count(packet_size, mtu as usize)?;
        // SAFETY: not null, and valid as the caller promises.
        unsafe { *count = frames as u32 };
        Ok(NVSP_OK)
    })
}

/// Writes modem frame `index` of a packet, 0 first, into `frame`: at most `mtu` bytes. It may be padded to any length.
/// Frame 0 holds the latent part, which makes a picture by itself. Send it first. If you repeat one frame only, repeat
/// this one. Allocates nothing; any thread may call it.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL, or NVSP_ERR_MODEM if the
/// bytes are no sound packet, or the MTU or the index is out of range.
///
/// # Safety
/// - `packet`: the packet. Read during the call. Not NULL.
/// - `packet_size`: bytes of it.
/// - `mtu`: most bytes of a modem frame, 31 to 65535.
/// - `index`: which modem frame, from 0.
/// - `frame`: receives the modem frame. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `frame`; `mtu` always suffices.
/// - `written`: receives the modem frame's length, bytes, also with NVSP_ERR_BUFFER_TOO_SMALL. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_modem_frame(
    packet: *const u8,
    packet_size: usize,
    mtu: u32,
    index: u32,
    frame: *mut u8,
    size: usize,
    written: *mut usize,
) -> nvsp_status {
    fence(|| {
        if packet.is_null() || frame.is_null() || written.is_null() {
            return Err(Failure::null("packet, frame or written"));
        }
        // SAFETY: as the caller promises.
        let (packet, frame) =
            unsafe { (slice(packet, packet_size, "packet")?, slice_mut(frame, size, "frame")?) };
        let splitter = Splitter::new(packet, mtu as usize)?;
        let len = splitter.write(index as usize, frame).map_err(|error| {
            if let ModemError::Buffer { needed, .. } = error {
                // SAFETY: not null, and valid as the caller promises.
                unsafe { *written = needed };
            }
            Failure::from_buffer(error)
        })?;
        // SAFETY: not null, and valid as the caller promises.
        unsafe { *written = len };
        Ok(NVSP_OK)
    })
}

/// Makes a reassembler for packets that were split for the same MTU. Takes all its memory here: room for at most eight
/// packets, each of max_packet_bytes and 16 bytes per modem frame.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_ARGUMENT or
/// NVSP_ERR_MODEM (the MTU).
///
/// # Safety
/// - `mtu`: most bytes of a modem frame, 31 to 65535, as the packets were split for.
/// - `options`: set up by NVSP_INIT. Read during the call. NULL: all defaults.
/// - `reassembler`: receives the reassembler, which nvsp_reassembler_destroy ends. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_reassembler_create(
    mtu: u32,
    options: *const nvsp_reassembler_options,
    reassembler: *mut *mut nvsp_reassembler,
) -> nvsp_status {
    fence(|| {
        if reassembler.is_null() {
            return Err(Failure::null("reassembler"));
        }
        // SAFETY: as the caller promises.
        let options = unsafe { read(options)? };
        if options.flags & !NVSP_MODEM_CHECKS != 0 {
            return Err(Failure::argument("nvsp_reassembler_options.flags: unknown bits"));
        }
        let mut how = ReassemblerOptions::new(mtu as usize);
        how.modem_checks = options.flags & NVSP_MODEM_CHECKS != 0;
        if options.max_packet_bytes > 0 {
            how.max_packet_bytes = options.max_packet_bytes as usize;
        }
        let made = Handle::boxed(Reassembler::new(how)?, Log::new(None, null_mut()));
        // SAFETY: not null, and valid as the caller promises.
        unsafe { *reassembler = nvsp_reassembler::address(made) };
        Ok(NVSP_OK)
    })
}

/// Takes a modem frame. Frames may come in any order, repeated, padded or damaged. Allocates
/// nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_ARGUMENT, NVSP_ERR_BUSY,
/// NVSP_ERR_POISONED, or NVSP_ERR_MODEM if it is no frame of a packet, or is damaged. What came before is not lost
/// then.
///
/// # Safety
/// - `reassembler`: a live reassembler. Not NULL.
/// - `frame`: the modem frame. Read during the call. Not NULL.
/// - `size`: bytes of it.
/// - `state`: receives what it brought, set up by NVSP_INIT. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_reassembler_push(
    reassembler: *mut nvsp_reassembler,
    frame: *const u8,
    size: usize,
    state: *mut nvsp_reassembly,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_reassembler::handle(reassembler), |content| {
            let out = Out::new(state)?;
            if frame.is_null() {
                return Err(Failure::null("frame"));
            }
            let pushed = content.push(slice(frame, size, "frame")?)?;
            let (event, packet) = match pushed {
                Pushed::Complete(frame) => (NVSP_EVENT_COMPLETE, content.packet(frame)),
                Pushed::Grown(frame) => (NVSP_EVENT_GROWN, content.packet(frame)),
                Pushed::Kept => (NVSP_EVENT_KEPT, content.newest()),
                Pushed::Duplicate => (NVSP_EVENT_DUPLICATE, content.newest()),
                Pushed::Damaged(frame) => (NVSP_EVENT_DAMAGED, content.packet(frame)),
            };
            out.write(&state_of(packet.as_ref(), event));
            Ok(NVSP_OK)
        })
    }
}

/// Copies what has come of the newest packet into `packet`: the whole packet, or its start. Give it
/// to nvsp_decode with NVSP_DECODE_START, which makes the best possible picture of it. The packet
/// stays until newer packets take its place. Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_ARGUMENT, NVSP_ERR_BUSY,
/// NVSP_ERR_POISONED, NVSP_ERR_BUFFER_TOO_SMALL, or NVSP_ERR_STATE if nothing came that makes a picture.
///
/// # Safety
/// - `reassembler`: a live reassembler. Not NULL.
/// - `packet`: receives the packet, or its start. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `packet`; nvsp_reassembler_options.max_packet_bytes always suffices.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL. Not NULL.
/// - `state`: receives what is there of the packet, set up by NVSP_INIT. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_reassembler_fetch(
    reassembler: *mut nvsp_reassembler,
    packet: *mut u8,
    size: usize,
    written: *mut usize,
    state: *mut nvsp_reassembly,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_reassembler::handle(reassembler), |content| {
            let out = Out::new(state)?;
            if packet.is_null() || written.is_null() {
                return Err(Failure::null("packet or written"));
            }
            let nothing = Failure::at(NVSP_ERR_STATE, "no first frame of a packet came");
            let newest = content.newest().filter(|newest| !newest.bytes.is_empty());
            let newest = newest.ok_or(nothing)?;
            let needed = newest.bytes.len();
            if size < needed {
                *written = needed;
                return Err(Failure::Room { needed, found: size });
            }
            packet.copy_from_nonoverlapping(newest.bytes.as_ptr(), needed);
            *written = needed;
            out.write(&state_of(Some(&newest), 0));
            Ok(NVSP_OK)
        })
    }
}

/// Lists the modem frames of the newest packet to ask its sender for again. Until the packet's length is known, the
/// list holds only the first missing frame. Allocates nothing.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_BUSY, NVSP_ERR_POISONED, or NVSP_ERR_STATE if no first frame
/// of a packet came.
///
/// # Safety
/// - `reassembler`: a live reassembler. Not NULL.
/// - `indices`: receives the first indices, as many as there is room for. Yours, of `room` numbers. NULL only if `room`
///   is 0.
/// - `room`: most indices to write.
/// - `count`: receives how many are missing in all, which may be more than `room`. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_reassembler_missing(
    reassembler: *mut nvsp_reassembler,
    indices: *mut u32,
    room: u32,
    count: *mut u32,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_reassembler::handle(reassembler), |content| {
            if (indices.is_null() && room > 0) || count.is_null() {
                return Err(Failure::null("indices or count"));
            }
            let nothing = Failure::at(NVSP_ERR_STATE, "no first frame of a packet came");
            let newest = content.newest().ok_or(nothing)?;
            let mut missing = 0;
            for index in newest.missing() {
                if missing < room as usize {
                    *indices.add(missing) = index as u32;
                }
                missing += 1;
            }
            *count = missing as u32;
            Ok(NVSP_OK)
        })
    }
}

/// Copies the counts.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE, NVSP_ERR_ABI_VERSION, NVSP_ERR_BUSY or
/// NVSP_ERR_POISONED.
///
/// # Safety
/// - `reassembler`: a live reassembler. Not NULL.
/// - `statistics`: receives the counts, set up by NVSP_INIT. Not NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_reassembler_get_statistics(
    reassembler: *mut nvsp_reassembler,
    statistics: *mut nvsp_reassembler_statistics,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe {
        Handle::call(nvsp_reassembler::handle(reassembler), |content| {
            let counts = content.statistics();
            Out::required(statistics)?.write(&nvsp_reassembler_statistics {
                struct_size: 0,
                abi_version: 0,
                accepted: counts.accepted,
                duplicates: counts.duplicates,
                rejected: counts.rejected,
                waiting: counts.waiting,
                completed: counts.completed,
                damaged: counts.damaged,
                incomplete: counts.incomplete,
            });
            Ok(NVSP_OK)
        })
    }
}

/// Copies the text of the last failed call on the reassembler, as nvsp_engine_last_error does.
///
/// # Safety
/// - `reassembler`: a live reassembler. Not NULL.
/// - `text`: receives the text, ending in NUL. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of `text`, 1 or more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_reassembler_last_error(
    reassembler: *const nvsp_reassembler,
    text: *mut c_char,
    size: usize,
) -> nvsp_status {
    // SAFETY: as the caller promises.
    unsafe { Handle::last_error(nvsp_reassembler::handle(reassembler), text, size) }
}

/// Ends a reassembler; NULL is allowed.
///
/// # Safety
/// - `reassembler`: a live reassembler that no other thread uses. Do not use it afterwards. NULL is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_reassembler_destroy(reassembler: *mut nvsp_reassembler) {
    // SAFETY: as the caller promises.
    unsafe { Handle::destroy(nvsp_reassembler::handle(reassembler).cast_mut()) }
}

fn state_of(packet: Option<&Received>, event: u32) -> nvsp_reassembly {
    nvsp_reassembly {
        struct_size: 0,
        abi_version: 0,
        frame: packet.map_or(0, |p| p.frame),
        bytes: packet.map_or(0, |p| number(p.bytes.len())),
        complete: packet.is_some_and(|p| p.complete).into(),
        frames: packet.map_or(0, |p| number(p.frames)),
        expected: packet.and_then(|p| p.expected).map_or(0, number),
        event,
    }
}
