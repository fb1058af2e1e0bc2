//! The vehicle's end of a link.

use std::ptr::null_mut;

use crate::modem::{
    Division, Loss, MAX_UNPROTECTED, PacketState, ProcessedReport, Protection, RateControlOptions,
    Report, Sender, SenderOptions, share_count,
};

use super::handle::{Content, Handle};
use super::keys::{keys_of, nvsp_keys};
use super::limits::SMALL;
use super::log::Log;
use super::memory::Grant;
use super::slices::{Room, optional_slice, slice};
use super::status::*;
use super::structs::{In, Out, Place, number, versioned, zeroed};

/// Makes the modem frames of packets, within a bit rate. Such a frame is a share. A few shares of a packet, in any
/// combination, yield a picture; each additional one refines it. Without protection (NVSP_SENDER_UNPROTECTED) shares
/// cost fewest bytes, and those behind a lost one are of no use. nvsp_collector puts packets together. Example:
///
/// ```c
/// // For each frame of the camera; `now` is the time in seconds, on any clock that does not go back.
/// status = nvsp_sender_plan(sender, now, &budget);
/// if (status == NVSP_OK && budget > 0) {
///     status = nvsp_encoder_set_rate(encoder, NVSP_RATE_STEADY, (float)budget);
///     // ... nvsp_encode ...
///     status = nvsp_sender_push(sender, later, packet, bytes, NULL, 0, NULL);
/// }
/// // Whenever the modem is free:
/// if (nvsp_sender_next(sender, now, share, sizeof share, &bytes) == NVSP_OK) modem_send(share, bytes);
/// ```
///
/// A packet by itself, without a clock:
///
/// ```c
/// nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
/// options.flags = NVSP_SENDER_UNPROTECTED;
/// status = nvsp_sender_create(64, &options, &sender);
/// status = nvsp_sender_push(sender, 0, packet, bytes, NULL, 0, NULL);
/// while (nvsp_sender_next(sender, 0, share, sizeof share, &bytes) == NVSP_OK) modem_send(share, bytes);
/// ```
pub type nvsp_sender = Handle<Sender>;

impl Content for Sender {}

/// nvsp_sender_options.loss: the link loses nothing.
pub const NVSP_LOSS_NONE: f64 = -1.0;

/// nvsp_sender_options.flags: the topside sends reports, for nvsp_sender_process_report. The sender then remembers the
/// packets of twice the latency.
pub const NVSP_SENDER_EXPECT_REPORTS: u32 = 1;
/// nvsp_sender_options.flags: no protection against losses. The link loses nothing, or the topside asks for what is
/// missing. Needs stream 0 and no user bytes. Below an MTU of 16 a packet has at most 8 shares, and these have no check
/// of their own: the modem must find damage.
pub const NVSP_SENDER_UNPROTECTED: u32 = 2;

/// MTUs of common acoustic modems, bytes. Any from 8 to 65535 will do, with protection from 16.
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_31: u32 = 31;
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_64: u32 = 64;
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_256: u32 = 256;
#[allow(dead_code)] // For C alone.
pub const NVSP_MTU_1024: u32 = 1024;

/// A link, and what its pictures should be.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_sender_options {
    pub struct_size: u32,
    pub abi_version: u32,
    /// What the link carries, bit/s, above 0. Without protection 0 means that packets go as they come: no frame is
    /// planned, and no other option than `spread`, `overhead`, `shares` and `flags` counts.
    pub bit_rate: f64,
    /// Most pictures per second, above 0. There is no default. If a camera's frames come at uneven times, give a little
    /// more than its rate: a frame that comes early is else left out.
    pub frame_rate: f64,
    /// Longest time from the exposure of a frame to the end of its packet's last share, seconds. 0: 1.5.
    pub latency: f64,
    /// What of it is no transmission: search, coding, propagation; seconds.
    pub delay: f64,
    /// Time from a packet's first share to its last one, seconds, a part of the latency. Shares of other packets lie
    /// between them, so a burst of losses takes few of each. 0: they follow each other.
    pub spread: f64,
    /// Chance that a modem frame is lost, below 1. 0: 0.1, a fair guess if it is not known. NVSP_LOSS_NONE: none is
    /// lost.
    pub loss: f64,
    /// Mean number of modem frames that are lost in a row, 1 or more. 0: 1.
    pub burst: f64,
    /// What each modem frame costs on the link beside its bytes (preamble, the modem's own header), as bytes.
    pub overhead: u32,
    /// Fewest bytes for a picture, all counted. Few: quality falls before the frame rate does. As many as a good
    /// picture takes: the frame rate falls first. 0: 40.
    pub min_bytes: u32,
    /// Most shares of a packet, up to 64; without protection up to 2048, below an MTU of 16 up to 8, and more count as
    /// so many. nvsp_collector_options.shares must be as many. 0: 16; without protection as many as 65536 bytes take.
    pub shares: u32,
    /// User bytes that travel with each packet, up to 255; with it they come or are lost.
    pub user_bytes: u32,
    /// The stream that the packets are of, 0 to 3: up to four encoders may share a link, each with a sender.
    pub stream: u32,
    /// NVSP_SENDER_* flags.
    pub flags: u32,
    /// Each modem frame gets a number and a tag by these keys, and reports need one, too. They take nvsp_keys.tag_bytes
    /// and 2 bytes of each modem frame. Read during nvsp_sender_create. NULL: none.
    pub keys: In<nvsp_keys>,
}
versioned!(nvsp_sender_options, 96);

/// How a packet was divided.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_division {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Shares.
    pub shares: u32,
    /// Bytes of each; the last one of an unprotected packet may have fewer.
    pub share_bytes: u32,
    /// Any so many shares yield a picture; of an unprotected packet the first so many.
    pub picture_shares: u32,
    /// Any so many yield all that is sent.
    pub whole_shares: u32,
    /// Bytes of the packet that are sent. If they are fewer than it has, its end is not: it is longer than planned.
    pub packet_bytes: u32,
    /// Bytes on the link, the overhead of each share counted.
    pub link_bytes: u32,
}
versioned!(nvsp_division, 32);

/// Most frames in a report.
pub const NVSP_REPORT_FRAMES: usize = 32;

/// What a report says, and what the sender made of it.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_processed_report {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Shares that were lost, as a part of those that no report told of before; -1: too few to tell.
    pub loss: f64,
    /// Shares that are sent again.
    pub resent_shares: u32,
    /// Bytes of them on the link.
    pub resent_bytes: u32,
    /// The newest frame number of which a share came, modulo 65536.
    pub newest: u32,
    /// How many packets the report tells of: that of `newest`, and those before it.
    pub reported: u32,
    /// Place of the topside's user bytes in the report.
    pub user_offset: u32,
    /// How many they are.
    pub user_bytes: u32,
    /// Frames that the topside decoded in full: tell each to nvsp_encoder_acknowledge.
    pub kept_count: u32,
    /// Their numbers modulo 65536, newest first.
    pub kept: [u32; NVSP_REPORT_FRAMES],
    /// Zero.
    pub reserved: u32,
}
versioned!(nvsp_processed_report, 176);

/// Most shares of a protected packet: the time that a division takes grows with the cube of their number.
const MAX_SHARES: u32 = 64;
/// Bytes of an unprotected packet that there is room for, unless the caller says how many shares.
const UNPROTECTED_BYTES: usize = 1 << 16;

fn options_of(mtu: u32, options: &nvsp_sender_options) -> Result<SenderOptions, Failure> {
    let nvsp_sender_options { bit_rate, frame_rate, delay, spread, user_bytes, .. } = *options;
    let is_set = |flag: u32| options.flags & flag != 0;
    let unprotected = is_set(NVSP_SENDER_UNPROTECTED);
    if !unprotected && options.shares > MAX_SHARES {
        return Err(Failure::argument("nvsp_sender_options.shares: above 64"));
    }
    if options.stream > 3 {
        return Err(Failure::argument("nvsp_sender_options.stream: above 3"));
    }
    if is_set(!(NVSP_SENDER_EXPECT_REPORTS | NVSP_SENDER_UNPROTECTED)) {
        return Err(Failure::argument("nvsp_sender_options.flags: unknown"));
    }
    let or = |value: f64, default: f64| if value == 0.0 { default } else { value };
    let or_count = |value: u32, default: usize| if value == 0 { default } else { value as usize };
    let shares = match unprotected {
        true => share_count(UNPROTECTED_BYTES, mtu as usize).unwrap_or(MAX_UNPROTECTED),
        false => 16,
    };
    let control = RateControlOptions {
        bit_rate,
        mtu: mtu as usize,
        overhead: options.overhead as usize,
        latency: or(options.latency, 1.5),
        delay,
        spread,
        frame_rate,
        min_bytes: or_count(options.min_bytes, 40),
        max_shares: or_count(options.shares, shares),
        loss: loss_of(or(options.loss, 0.1), options.burst),
        user: (user_bytes > 0).then_some(user_bytes as usize),
    };
    Ok(SenderOptions {
        control,
        stream: options.stream as u8,
        protection: if unprotected { Protection::None } else { Protection::Layers },
        expect_reports: is_set(NVSP_SENDER_EXPECT_REPORTS),
    })
}

fn loss_of(chance: f64, burst: f64) -> Loss {
    let chance = if chance == NVSP_LOSS_NONE { 0.0 } else { chance };
    Loss { chance, burst: if burst == 0.0 { 1.0 } else { burst } }
}

/// Makes a sender. Takes all its memory here: room for the shares that wait, at most those of the packets that come
/// within the latency.
///
/// Fails with NVSP_ERR_ARGUMENT (an option, which the status text does not name), NVSP_ERR_MODEM (the MTU) or
/// NVSP_ERR_MEMORY.
///
/// # Parameters
/// - `mtu`: most bytes of a modem frame, 16 to 65535; without protection from 8; with keys from as many more as they
///   take. Both sides need the same.
/// - `options`: what the link carries, and what its pictures should be.
/// - `sender`: receives the sender, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_create(
    mtu: u32,
    options: In<nvsp_sender_options>,
    sender: Place<Box<nvsp_sender>>,
) -> nvsp_status {
    super::handle::fence(|| {
        let sender = sender.required("sender")?;
        let given = options.required()?;
        let (options, keys) = (options_of(mtu, &given)?, keys_of(given.keys)?);
        let memory = match &keys {
            Some(keys) => options.memory_with_keys(keys)?,
            None => options.memory()?,
        };
        let _memory = Grant::take("a sender", memory as u64 + SMALL, u64::MAX)?;
        let made = match &keys {
            Some(keys) => Sender::with_keys(options, keys)?,
            None => Sender::new(options)?,
        };
        sender.write(Handle::boxed(made, Log::new(None, null_mut())));
        Ok(NVSP_OK)
    })
}

/// Tells how many bytes the packet of a frame may have: encode it with NVSP_RATE_STEADY and as many. 0: leave the frame
/// out (nvsp_frame_info.left_out of the next one), as the link has no bytes for it. Ask for each frame of the camera,
/// or as often as you like: if no packet follows, no bytes are spent. A sender without a bit rate tells the longest
/// packet that it takes.
///
/// Fails with NVSP_ERR_ARGUMENT (the time).
///
/// # Parameters
/// - `now`: when the frame was exposed, seconds, on a clock that does not go back. All times of a sender are on it.
/// - `bytes`: receives the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_plan(
    sender: Option<&nvsp_sender>,
    now: f64,
    bytes: Place<u32>,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        let bytes = bytes.required("bytes")?;
        let planned = content.plan(now)?;
        bytes.write(planned.map_or(0, number));
        Ok(NVSP_OK)
    })
}

/// Takes the packet of the frame that was planned last, and makes shares of it. A packet that also tells the camera may
/// be longer than planned: it takes more of the link for once. A sender without a bit rate takes any packet whole,
/// without a plan.
///
/// Fails with NVSP_ERR_ARGUMENT (the time, or not as many user bytes as nvsp_sender_options.user_bytes), NVSP_ERR_MODEM
/// (the bytes are not exactly one valid packet, or longer than the shares), NVSP_ERR_STATE (no frame was planned, or
/// its packet was taken), NVSP_ERR_BUDGET (all shares together do not hold a picture: the MTU or
/// nvsp_sender_options.shares is too small) or NVSP_ERR_UNFINISHED (too many shares wait: nobody takes them). The plan
/// stays then.
///
/// # Safety
/// - `now`: when the packet is ready, seconds.
/// - `packet`: the packet.
/// - `size`: bytes of `packet`.
/// - `user`: the user bytes. NULL only if `user_size` is 0.
/// - `user_size`: bytes of `user`; nvsp_sender_options.user_bytes.
/// - `division`: receives how the packet was divided. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_sender_push(
    sender: Option<&nvsp_sender>,
    now: f64,
    packet: *const u8,
    size: usize,
    user: *const u8,
    user_size: usize,
    division: Out<nvsp_division>,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        let out = division.optional()?;
        // SAFETY: `size` bytes stand at `packet`, and `user_size` at `user`, see `# Safety`.
        let (packet, user) =
            unsafe { (slice(packet, size, "packet")?, optional_slice(user, user_size, "user")?) };
        let user = user.filter(|user| !user.is_empty());
        let division = content.push(now, packet, user)?;
        out.write(&division_of(&division));
        Ok(NVSP_OK)
    })
}

/// Writes the next share, if one is due, and takes it off the list. Returns NVSP_PENDING if none is due at `now`, and
/// writes nothing then. Call it when the modem is free: shares that it had no time for are due still.
///
/// Fails with NVSP_ERR_ARGUMENT (the time) or NVSP_ERR_BUFFER_TOO_SMALL. The share stays then.
///
/// # Safety
/// - `now`: seconds.
/// - `share`: receives the share, which is a modem frame. It may be filled up with zeros.
/// - `size`: bytes of `share`; the MTU always suffices.
/// - `written`: receives the share's length, bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_sender_next(
    sender: Option<&nvsp_sender>,
    now: f64,
    share: *mut u8,
    size: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        // SAFETY: `size` bytes stand at `share`, see `# Safety`.
        let mut room = unsafe { Room::new(share, size, written, "share")? };
        if !now.is_finite() {
            return Err(Failure::argument("now: not finite"));
        }
        let Some(needed) = content.next_len(now) else { return Ok(NVSP_PENDING) };
        // A share leaves the list only if there is room for it.
        room.check(needed)?;
        content.next(now).map_or(Ok(()), |(_, share)| room.write(share))?;
        Ok(NVSP_OK)
    })
}

/// Takes a report of the topside, which nvsp_collector_report wrote. The protection follows the loss that it tells,
/// step by step. Shares that a picture still lacks, without protection all that are missing, are sent again, once, if
/// they come within the latency: nvsp_sender_next writes them at once. Padding may follow the report. Example:
///
/// ```c
/// nvsp_processed_report processed = NVSP_INITIALIZER(nvsp_processed_report);
/// if (nvsp_sender_process_report(sender, now, bytes, size, &processed) == NVSP_OK) {
///     for (uint32_t i = 0; i < processed.kept_count; i++) {
///         status = nvsp_encoder_acknowledge(encoder, processed.kept[i]);
///     }
/// }
/// ```
///
/// Fails with NVSP_ERR_ARGUMENT (the time), NVSP_ERR_MODEM (no report, damaged, or of another stream) or NVSP_ERR_STATE
/// (the sender was made without NVSP_SENDER_EXPECT_REPORTS); with keys NVSP_ERR_FOREIGN or NVSP_ERR_REPLAYED. Nothing
/// changes then.
///
/// # Safety
/// - `now`: when the report came, seconds.
/// - `report`: its bytes.
/// - `size`: bytes of `report`.
/// - `processed`: receives what it says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_sender_process_report(
    sender: Option<&nvsp_sender>,
    now: f64,
    report: *const u8,
    size: usize,
    processed: Out<nvsp_processed_report>,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        let out = processed.required()?;
        // SAFETY: `size` bytes stand at `report`, see `# Safety`.
        let bytes = unsafe { slice(report, size, "report")? };
        let (report, user) = content.read_report(bytes)?;
        let processed = content.process_report(now, &report)?;
        out.write(&processed_of(&report, &processed, bytes, user));
        Ok(NVSP_OK)
    })
}

/// Tells when the next share is due. Returns NVSP_PENDING if none waits, and writes nothing then.
///
/// # Parameters
/// - `time`: receives the time, seconds. It may have passed.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_due(sender: Option<&nvsp_sender>, time: Place<f64>) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        let time = time.required("time")?;
        let Some(due) = content.due() else { return Ok(NVSP_PENDING) };
        time.write(due);
        Ok(NVSP_OK)
    })
}

/// Counts bytes that you give to the link besides, for example telemetry: pictures get the fewer.
///
/// Fails with NVSP_ERR_ARGUMENT (the time).
///
/// # Parameters
/// - `now`: seconds.
/// - `bytes`: their number, with what they cost beside themselves.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_count(
    sender: Option<&nvsp_sender>,
    now: f64,
    bytes: u32,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        content.count(now, bytes as usize)?;
        Ok(NVSP_OK)
    })
}

/// Sets what the link carries from `now` on. The next frame's bytes are those of the new rate.
///
/// Fails with NVSP_ERR_ARGUMENT, or NVSP_ERR_STATE if the sender was made without a bit rate. The rate before stays
/// then.
///
/// # Parameters
/// - `now`: seconds.
/// - `bit_rate`: bit/s, above 0.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_set_bit_rate(
    sender: Option<&nvsp_sender>,
    now: f64,
    bit_rate: f64,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        content.set_bit_rate(now, bit_rate)?;
        Ok(NVSP_OK)
    })
}

/// Sets what the next packets are protected against, for example as the topside has measured it
/// (nvsp_collector_statistics).
///
/// Fails with NVSP_ERR_ARGUMENT, or NVSP_ERR_STATE if the sender was made without a bit rate. The loss before stays
/// then.
///
/// # Parameters
/// - `loss`: chance that a modem frame is lost, 0 up to but not 1. Here 0 means that none is.
/// - `burst`: mean number of modem frames that are lost in a row, 1 or more. 0: 1.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_sender_set_loss(
    sender: Option<&nvsp_sender>,
    loss: f64,
    burst: f64,
) -> nvsp_status {
    nvsp_sender::call(sender, |content| {
        content.set_loss(loss_of(loss, burst))?;
        Ok(NVSP_OK)
    })
}

fn processed_of(
    report: &Report,
    processed: &ProcessedReport,
    bytes: &[u8],
    user: Option<&[u8]>,
) -> nvsp_processed_report {
    let mut kept = [0; NVSP_REPORT_FRAMES];
    let frames = report.packets().filter(|(_, packet)| packet.state == PacketState::Kept);
    let kept_count = kept.iter_mut().zip(frames).map(|(to, (frame, _))| *to = frame).count();
    let offset = |user: &[u8]| user.as_ptr().addr() - bytes.as_ptr().addr();
    nvsp_processed_report {
        loss: processed.loss.unwrap_or(-1.0),
        resent_shares: number(processed.shares),
        resent_bytes: number(processed.bytes),
        newest: report.newest(),
        reported: number(report.packets().count()),
        user_offset: number(user.map_or(0, offset)),
        user_bytes: number(user.map_or(0, <[u8]>::len)),
        kept_count: number(kept_count),
        kept,
        ..zeroed()
    }
}

fn division_of(division: &Division) -> nvsp_division {
    nvsp_division {
        shares: number(division.shares),
        share_bytes: number(division.share_bytes),
        picture_shares: number(division.picture_shares),
        whole_shares: number(division.whole_shares),
        packet_bytes: number(division.packet_bytes),
        link_bytes: number(division.link_bytes),
        ..zeroed()
    }
}
