//! The vehicle's end of a link.

use std::collections::VecDeque;
use std::ptr::null_mut;
use std::sync::Arc;
use std::time::Duration;

use nvsprior_link::modem::{Loss, Protection};
use nvsprior_link::{LinkError, Pacing, PlannedFrame, VehicleLink, VehicleOptions};

use super::encoder::{NVSP_RATE_DEFAULT, encoding, given, nvsp_encoder_options};
use super::encoding::{Encoding, nvsp_encoder};
use super::engine::nvsp_engine;
use super::event::{NVSP_EVENT_FRAME, NVSP_EVENT_STORE, NVSP_EVENT_USER, Waiting, nvsp_event};
use super::frame::nvsp_frame_info;
use super::handle::{Content, Handle, fence};
use super::image::{nvsp_camera, nvsp_image};
use super::keys::{keys_of, nvsp_keys};
use super::limits::SMALL;
use super::log::Log;
use super::memory::Grant;
use super::prior::nvsp_prior;
use super::slices::{Room, optional_slice, slice};
use super::status::*;
use super::structs::{In, Out, Place, number, versioned};

/// The vehicle's end of a link: camera frames in, modem frames out, and reports of the topside in. It has an encoder,
/// protection against losses, keys, and the order of it all; it has no thread but the encoder's, no socket, no file and
/// no clock. No call waits. Example, which a control loop turns as often as it likes:
///
/// ```c
/// if (camera_has(&image)) status = nvsp_vehicle_frame(vehicle, now(), &image, NULL, NULL, 0);
/// if (modem_received(bytes, &size)) status = nvsp_vehicle_receive(vehicle, now(), bytes, size);
/// while (modem_is_free() && nvsp_vehicle_transmit(vehicle, now(), 64, bytes, &size, NULL) == NVSP_OK)
///     modem_send(bytes, size);
/// while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK) heed(&event);
/// ```
pub type nvsp_vehicle = Handle<VehicleEnd>;

/// For the flags of both ends' options: times of calls are UTC in seconds. A picture's age is then known before a
/// report came, if the clocks are right. Without it times are on any clock of that side.
pub const NVSP_LINK_UTC: u32 = 1;
/// There are no reports: the link has no way back. Give both ends the same.
pub const NVSP_LINK_NO_REPORTS: u32 = 2;
/// Of a vehicle: the modem asks for modem frames when it has room, as it also carries other traffic. `bit_rate` is 0.
pub const NVSP_LINK_PULL: u32 = 4;
/// Of a vehicle: packets go as they come, with NVSP_LINK_UNPROTECTED. `bit_rate` is 0, and the encoder keeps its rate.
pub const NVSP_LINK_AS_THEY_COME: u32 = 8;
/// Of a vehicle: no protection against losses: the link loses nothing, or what a report misses is sent again. Needs
/// stream 0, and no user bytes travel. Below an MTU of 16 a packet has at most 8 modem frames, and the modem must find
/// damage.
pub const NVSP_LINK_UNPROTECTED: u32 = 16;
/// Of a vehicle: packets do not tell when their frame was exposed, which takes two bytes. No user bytes travel then.
pub const NVSP_LINK_NO_STAMPS: u32 = 32;
/// Of a vehicle: poses are stated in full, even if the topside holds others that they could be predicted from.
pub const NVSP_LINK_STATE_POSES: u32 = 64;
/// Of a topside: the modem hands over no damaged frames. What comes then counts as valid.
pub const NVSP_LINK_MODEM_CHECKS: u32 = 128;

/// For fields of both ends' options that have another default than 0: none, 0.
pub const NVSP_NONE: f64 = -1.0;

/// How a vehicle sends. MTU, bit rate and frame rate must be stated; NVSP_LINK_PULL and NVSP_LINK_AS_THEY_COME do
/// without a bit rate, and the latter without a frame rate.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_vehicle_options {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Most bytes of a modem frame, 8 to 65535; with protection from 16, with keys from as many more as they take. The
    /// topside needs the same.
    pub mtu: u32,
    /// NVSP_LINK_* flags.
    pub flags: u32,
    /// What the link carries, or the part of it that is for pictures, bit/s.
    pub bit_rate: f64,
    /// Camera frames per second: numbers count all of them, also those that never come here.
    pub frame_rate: f64,
    /// Most pictures per second. 0: as many as frames.
    pub picture_rate: f64,
    /// Longest time from the exposure of a frame to the end of its packet's last modem frame, seconds. 0: 1.5.
    pub latency: f64,
    /// What of it is no transmission: search, coding, propagation; seconds. 0: 0.3. NVSP_NONE: none.
    pub delay: f64,
    /// Seconds from a packet's first modem frame to its last one. Those of other packets lie between them, so a burst
    /// of losses takes few of each. 0: a quarter of what the delay leaves. NVSP_NONE: they follow each other.
    pub spread: f64,
    /// Chance that a modem frame is lost, below 1; reports tell how it is. 0: 0.1. NVSP_NONE: none is lost.
    pub loss: f64,
    /// Mean number of modem frames that are lost in a row, 1 or more. 0: 1.
    pub burst: f64,
    /// What each modem frame costs on the link beside its bytes (preamble, the modem's own header), as bytes.
    pub overhead: u32,
    /// Fewest bytes for a picture, all counted: below it frames are left out. 0: 40.
    pub min_bytes: u32,
    /// Most modem frames of a packet: up to 64, without protection up to 2048. 0: as many as MTU and rate take.
    pub max_shares: u32,
    /// User bytes that travel with each packet, up to 253; with it they come or are lost.
    pub user_bytes: u32,
    /// The stream, 0 to 3: up to four cameras share a link, each with a vehicle.
    pub stream: u32,
    /// Bytes of `state`.
    pub state_size: u32,
    /// Each modem frame gets a number and a tag by these keys, and reports need one, too. They take
    /// nvsp_keys.tag_bytes and 2 bytes of each modem frame. Read during the call. NULL: none.
    pub keys: In<nvsp_keys>,
    /// What this end had you store last (NVSP_EVENT_STORE), before it started again. Read during the call. NULL: it
    /// begins anew.
    pub state: *const u8,
}
versioned!(nvsp_vehicle_options, 120);

/// The given value; 0 is the default, and NVSP_NONE 0.
pub(super) fn or(value: f64, default: f64) -> f64 {
    match value {
        0.0 => default,
        NVSP_NONE => 0.0,
        value => value,
    }
}

/// Refuses flags that an end does not know.
pub(super) fn check_flags(flags: u32, known: u32, allowed: &'static str) -> Result<(), Failure> {
    let found = format!("{flags:#x}");
    let wrong = LinkError::Option { option: "flags", found, allowed };
    if flags & !known == 0 { Ok(()) } else { Err(Failure::Options(wrong)) }
}

/// A stream's number.
pub(super) fn stream_of(stream: u32) -> Result<u8, Failure> {
    let wrong =
        LinkError::Option { option: "stream", found: stream.to_string(), allowed: "0 to 3" };
    if stream <= 3 { Ok(stream as u8) } else { Err(Failure::Options(wrong)) }
}

/// The MTU.
pub(super) fn mtu_of(mtu: u32, least: u32, allowed: &'static str) -> Result<usize, Failure> {
    let wrong = LinkError::Option { option: "mtu", found: mtu.to_string(), allowed };
    if (least..=65535).contains(&mtu) { Ok(mtu as usize) } else { Err(Failure::Options(wrong)) }
}

fn options_of(given: In<nvsp_vehicle_options>) -> Result<VehicleOptions, Failure> {
    let given = given.required()?;
    let is_set = |flag: u32| given.flags & flag != 0;
    let all = NVSP_LINK_UTC
        | NVSP_LINK_NO_REPORTS
        | NVSP_LINK_PULL
        | NVSP_LINK_AS_THEY_COME
        | NVSP_LINK_UNPROTECTED
        | NVSP_LINK_NO_STAMPS
        | NVSP_LINK_STATE_POSES;
    check_flags(given.flags, all, "NVSP_LINK_* flags of a vehicle")?;
    let unprotected = is_set(NVSP_LINK_UNPROTECTED);
    let mtu = match unprotected {
        true => mtu_of(given.mtu, 8, "8 to 65535")?,
        false => mtu_of(given.mtu, 16, "16 to 65535, and without protection from 8")?,
    };
    let wrong = |option, found: &dyn ToString, allowed| {
        Err(Failure::Options(LinkError::Option { option, found: found.to_string(), allowed }))
    };
    let pacing = match (is_set(NVSP_LINK_PULL), is_set(NVSP_LINK_AS_THEY_COME)) {
        (false, false) => Pacing::Rate(given.bit_rate),
        _ if given.bit_rate != 0.0 => {
            return wrong(
                "bit_rate",
                &given.bit_rate,
                "0 if packets go as they come or are pulled",
            );
        }
        (true, false) => Pacing::Pull,
        (false, true) => Pacing::AsTheyCome,
        (true, true) => return wrong("flags", &given.flags, "one of PULL and AS_THEY_COME"),
    };
    if !unprotected && given.max_shares > 64 {
        return wrong("max_shares", &given.max_shares, "0 to 64, and more without protection");
    }
    let some = |value: f64| (value != 0.0).then_some(value);
    let usual = VehicleOptions::new(mtu, given.bit_rate, given.frame_rate);
    // SAFETY: so many bytes stand there, as the field's comment asks.
    let state = unsafe { optional_slice(given.state, given.state_size as usize, "state")? };
    Ok(VehicleOptions {
        pacing,
        frame_rate: some(given.frame_rate),
        picture_rate: some(given.picture_rate),
        latency: or(given.latency, usual.latency),
        delay: or(given.delay, usual.delay),
        spread: some(given.spread).map(|spread| or(spread, 0.0)),
        protection: if unprotected { Protection::None } else { Protection::Layers },
        loss: Loss { chance: or(given.loss, usual.loss.chance), burst: or(given.burst, 1.0) },
        overhead: given.overhead as usize,
        min_bytes: if given.min_bytes == 0 { usual.min_bytes } else { given.min_bytes as usize },
        max_shares: (given.max_shares != 0).then_some(given.max_shares as usize),
        stream: stream_of(given.stream)?,
        // What comes as it comes without a rate has nothing to send again.
        expect_reports: !is_set(NVSP_LINK_NO_REPORTS) && pacing != Pacing::AsTheyCome,
        state_poses: is_set(NVSP_LINK_STATE_POSES),
        has_stamps: !is_set(NVSP_LINK_NO_STAMPS),
        user_bytes: given.user_bytes as usize,
        is_utc: is_set(NVSP_LINK_UTC),
        keys: keys_of(given.keys)?,
        state: state.unwrap_or_default().to_vec(),
        ..usual
    })
}

/// What a vehicle's handle holds.
pub(super) struct VehicleEnd {
    pub link: VehicleLink,
    /// `None`: packets come from elsewhere.
    encoder: Option<Arc<nvsp_encoder>>,
    keeps_rate: bool,
    user_bytes: usize,
    /// What is coded, the earlier one first.
    coding: VecDeque<Coded>,
    /// Exposure of the last frame whose time the encoder has.
    last: f64,
    frames: Waiting,
    state: Vec<u8>,
}

/// A frame that is coded.
struct Coded {
    frame: u32,
    /// It could not be begun while the one before was coded.
    failed: Option<nvsp_status>,
    user: [u8; 255],
    user_size: usize,
}

/// Frames that are coded at once.
const CODED: usize = 2;
/// Seconds after which to come again while a frame is coded.
const SOON: f64 = 0.01;

impl VehicleEnd {
    fn new(options: &VehicleOptions) -> Result<VehicleEnd, Failure> {
        Ok(VehicleEnd {
            link: VehicleLink::new(options).map_err(Failure::Options)?,
            encoder: None,
            keeps_rate: options.pacing == Pacing::AsTheyCome,
            user_bytes: options.user_bytes,
            coding: VecDeque::with_capacity(CODED + 1),
            last: f64::NEG_INFINITY,
            frames: Waiting::new(),
            state: Vec::with_capacity(super::event::NVSP_MAX_DATA),
        })
    }

    /// Hands over what the encoder has finished.
    fn collect(&mut self, now: f64) -> Result<(), Failure> {
        let Some(handle) = &self.encoder else { return Ok(()) };
        while let Some(coded) = self.coding.front() {
            let (mut frame, mut sent) = (nvsp_event::of(NVSP_EVENT_FRAME), None);
            frame.frame = coded.frame;
            if let Some(status) = coded.failed {
                self.link.drop_plan();
                frame.status = status;
            } else {
                let link = &mut self.link;
                let taken = handle.enter()?.take(|encoded, _| {
                    let user = &coded.user[..coded.user_size];
                    sent = Some(link.push(now, &encoded.packet, user));
                    frame.bytes = number(encoded.packet.len());
                    frame.certain = u32::from(encoded.stats.frames_since_certain == 0);
                    frame.value = encoded.stats.psnr;
                    Ok(())
                });
                let failure = match (taken, sent) {
                    (Ok(NVSP_PENDING), _) => return Ok(()),
                    (Ok(_), Some(Err(error))) => Some(Failure::Link(error)),
                    (Ok(_), _) => None,
                    (Err(failure), _) => {
                        self.link.drop_plan();
                        Some(failure)
                    }
                };
                if let Some(failure) = failure {
                    frame.status = failure.status();
                    handle.note(&failure);
                }
            }
            self.frames.tell(frame);
            self.coding.pop_front();
        }
        Ok(())
    }

    /// Plans a frame, and readies the encoder for it: also tells how many frames were left out before. `None`: so is
    /// this one.
    fn prepare(
        &mut self,
        now: f64,
        exposed: f64,
        encoder: &Encoding,
    ) -> Result<Option<(PlannedFrame, u32)>, Failure> {
        let under_way = self.coding.len();
        let core = match encoder.core() {
            Ok(core) => Some(core),
            Err(failure) if failure.status() == NVSP_ERR_UNFINISHED => None,
            Err(failure) => return Err(failure),
        };
        let Some(mut core) = core.filter(|_| under_way < encoder.room()) else {
            self.link.leave_out(now, exposed)?;
            return Ok(None);
        };
        let planned = match under_way {
            0 => self.link.plan(now, exposed)?,
            _ => self.link.plan_another(now, exposed)?,
        };
        let Some(planned) = planned else { return Ok(None) };
        self.link.instruct(&mut core.encoder).map_err(nvsprior::Error::from)?;
        if !self.keeps_rate {
            core.encoder.set_steady_bytes(planned.bytes);
        }
        let left_out = planned.number.wrapping_sub(core.encoder.frame_number());
        Ok(Some((planned, left_out)))
    }

    fn is_own(&self) -> Result<(), Failure> {
        match &self.encoder {
            None => Ok(()),
            Some(_) => Err(Failure::at(NVSP_ERR_STATE, "the vehicle has an encoder of its own")),
        }
    }

    fn check_user(&self, user: &[u8]) -> Result<(), Failure> {
        let what = "user_size: not nvsp_vehicle_options.user_bytes";
        if user.len() == self.user_bytes { Ok(()) } else { Err(Failure::argument(what)) }
    }

    /// When to come again, for the caller.
    fn next(&self, now: f64) -> f64 {
        let due = self.link.due().unwrap_or(f64::INFINITY);
        if self.coding.is_empty() { due } else { due.min(now + SOON) }
    }
}

impl Content for VehicleEnd {
    fn wait(&mut self, timeout: Duration) -> Result<nvsp_status, Failure> {
        let none = Failure::at(NVSP_ERR_STATE, "no frame is coded");
        let handle = self.encoder.as_ref().filter(|_| !self.coding.is_empty()).ok_or(none)?;
        if self.coding.front().is_some_and(|coded| coded.failed.is_some()) {
            return Ok(NVSP_OK);
        }
        handle.enter()?.wait(timeout)
    }

    fn cancel(&mut self) -> Result<nvsp_status, Failure> {
        let Some(handle) = &self.encoder else { return Ok(NVSP_OK) };
        while self.coding.pop_front().is_some() {
            self.link.drop_plan();
        }
        Ok(done_or_pending(handle.enter()?.drop_all()))
    }
}

/// Makes a vehicle's end. Takes all its memory here, as nvsp_vehicle_memory tells, and what nvsp_encoder_create takes.
///
/// Fails with NVSP_ERR_ARGUMENT: the text names the option and what it allows. It is the engine's, and that of
/// nvsp_last_error(NULL). Fails also with NVSP_ERR_MEMORY, and as nvsp_encoder_create.
///
/// # Parameters
/// - `engine`: NULL, with `prior` and `camera`: there is no encoder. Give packets: nvsp_vehicle_packet.
/// - `prior`: a live prior that was opened with `engine`.
/// - `camera`: size, focal lengths and principal point, pixels.
/// - `encoder_options`: how to encode. The vehicle sets the rate (but for NVSP_LINK_AS_THEY_COME), the first frame's
///   number and the keys: leave them at 0. NULL: all defaults.
/// - `options`: how to send.
/// - `vehicle`: receives the vehicle, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_create(
    engine: Option<&nvsp_engine>,
    prior: Option<&nvsp_prior>,
    camera: In<nvsp_camera>,
    encoder_options: In<nvsp_encoder_options>,
    options: In<nvsp_vehicle_options>,
    vehicle: Place<Box<nvsp_vehicle>>,
) -> nvsp_status {
    if engine.is_none() {
        return fence(|| {
            let vehicle = vehicle.required("vehicle")?;
            if prior.is_some() || !camera.is_null() || !encoder_options.is_null() {
                return Err(Failure::null("engine, with a prior, a camera or encoder options,"));
            }
            let (made, _) = link_of(options)?;
            vehicle.write(Handle::boxed(made, Log::new(None, null_mut())));
            Ok(NVSP_OK)
        });
    }
    nvsp_engine::share(engine, |handle, engine| {
        let vehicle = vehicle.required("vehicle")?;
        let (mut made, how) = link_of(options)?;
        let given = encoder_options.read()?;
        if given.rate != NVSP_RATE_DEFAULT && !made.keeps_rate {
            return Err(Failure::argument("nvsp_encoder_options.rate: the vehicle sets it"));
        }
        if given.first_frame != 0 || !given.keys.is_null() {
            let what = "nvsp_encoder_options.first_frame, keys: the vehicle has them";
            return Err(Failure::argument(what));
        }
        let first_frame = made.link.next_frame();
        let mut encoding = encoding(&engine, prior, camera, &given, |encoder| {
            encoder.predict_poses = how.expect_reports && !how.state_poses;
            encoder.first_frame = first_frame;
        })?;
        encoding.is_vehicles = true;
        made.encoder = Some(Handle::lent(encoding, handle.log()));
        vehicle.write(Handle::boxed(made, handle.log()));
        Ok(NVSP_OK)
    })
}

/// Makes the end without an encoder.
fn link_of(options: In<nvsp_vehicle_options>) -> Result<(VehicleEnd, VehicleOptions), Failure> {
    let options = options_of(options)?;
    let memory = VehicleLink::memory(&options).map_err(Failure::Options)?;
    let _memory = Grant::take("a vehicle", memory as u64 + SMALL, u64::MAX)?;
    Ok((VehicleEnd::new(&options)?, options))
}

/// Tells how much memory a vehicle takes besides its encoder. Any thread may call it.
///
/// Fails with NVSP_ERR_ARGUMENT, as nvsp_vehicle_create.
///
/// # Parameters
/// - `options`: how to send.
/// - `bytes`: receives the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_memory(
    options: In<nvsp_vehicle_options>,
    bytes: Place<u64>,
) -> nvsp_status {
    fence(|| {
        let bytes = bytes.required("bytes")?;
        let memory = VehicleLink::memory(&options_of(options)?).map_err(Failure::Options)?;
        bytes.write(memory as u64);
        Ok(NVSP_OK)
    })
}

/// Gives the vehicle's encoder, for its lens, mask, camera, reset and key frames (nvsp_encoder_prepare), and its
/// pictures. It is the vehicle's: frames and rates come by the vehicle alone, and nvsp_destroy on it does nothing.
/// NULL: there is none, or the vehicle is in use.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_encoder(vehicle: Option<&nvsp_vehicle>) -> *mut nvsp_encoder {
    let mut found = null_mut();
    let status = nvsp_vehicle::call(vehicle, |content| {
        if let Some(encoder) = &content.encoder {
            found = Arc::as_ptr(encoder).cast_mut();
        }
        Ok(NVSP_OK)
    });
    if status == NVSP_OK { found } else { null_mut() }
}

/// Counts a camera frame, and begins to code it on the encoder's own thread, as nvsp_encode_begin does. Give all frames
/// of the camera. Returns NVSP_PENDING if it is left out: the link has no bytes for it, or the encoder is busy.
/// NVSP_EVENT_FRAME tells what came of it; nvsp_vehicle_transmit sends it.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_IMAGE, NVSP_ERR_UNSUPPORTED or NVSP_ERR_MEMORY (no thread), and with
/// NVSP_ERR_STATE if there is no encoder.
///
/// # Safety
/// - `image`: the frame.
/// - `info`: what is known of the frame. Its `time` is the exposure, seconds on the clock of `now`; it has no
///   `left_out`. NULL: nothing is known, and it was exposed now.
/// - `user`: user bytes that travel with it. NULL only if `user_size` is 0.
/// - `user_size`: bytes of `user`: nvsp_vehicle_options.user_bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_vehicle_frame(
    vehicle: Option<&nvsp_vehicle>,
    now: f64,
    image: In<nvsp_image>,
    info: In<nvsp_frame_info>,
    user: *const u8,
    user_size: usize,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        // SAFETY: `user_size` bytes stand at `user`, see `# Safety`.
        let user = unsafe { optional_slice(user, user_size, "user")? }.unwrap_or_default();
        content.check_user(user)?;
        // SAFETY: the planes are the image's during this call, see `# Safety`.
        let mut given = unsafe { given(image, info)? };
        if given.known.left_out != 0 {
            return Err(Failure::argument("nvsp_frame_info.left_out: the vehicle counts itself"));
        }
        let none = Failure::at(NVSP_ERR_STATE, "the vehicle has no encoder");
        let handle = content.encoder.clone().ok_or(none)?;
        content.collect(now)?;
        let exposed = given.known.frame.time.unwrap_or(now);
        let mut encoder = handle.enter()?;
        let under_way = content.coding.len();
        let planned = content.prepare(now, exposed, &encoder)?;
        let Some((planned, left_out)) = planned else { return Ok(NVSP_PENDING) };
        given.known.left_out = left_out;
        // A clock that was set back tells the encoder no time.
        if given.known.frame.time.is_none() && exposed > content.last {
            given.known.frame.time = Some(exposed);
            content.last = exposed;
        }
        let begun = encoder.begin(&given);
        if begun.is_err() && under_way == 0 {
            content.link.drop_plan();
        } else {
            let mut coded = Coded {
                frame: planned.number,
                failed: begun.as_ref().err().map(Failure::status),
                user: [0; 255],
                user_size,
            };
            coded.user[..user_size].copy_from_slice(user);
            content.coding.push_back(coded);
        }
        begun.map(|()| NVSP_OK)
    })
}

/// Counts a camera frame that you encode yourself, and tells how: with NVSP_RATE_STEADY and as many bytes. Returns
/// NVSP_PENDING if it is left out, as the link has no bytes for it, and writes nothing then. With
/// NVSP_LINK_AS_THEY_COME no frame needs a plan.
///
/// Fails with NVSP_ERR_STATE (the vehicle has an encoder).
///
/// # Parameters
/// - `exposed`: when it was exposed, seconds.
/// - `number`: receives its number: nvsp_frame_info.left_out makes it the encoder's. NULL: not wanted.
/// - `bytes`: receives the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_plan(
    vehicle: Option<&nvsp_vehicle>,
    now: f64,
    exposed: f64,
    number: Place<u32>,
    bytes: Place<u32>,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        let bytes = bytes.required("bytes")?;
        content.is_own()?;
        let Some(planned) = content.link.plan(now, exposed)? else { return Ok(NVSP_PENDING) };
        number.write(planned.number);
        bytes.write(super::structs::number(planned.bytes));
        Ok(NVSP_OK)
    })
}

/// Takes the packet of the frame that was planned last. One that also tells the camera may be longer than planned: it
/// takes more of the link for once.
///
/// Fails with NVSP_ERR_ARGUMENT (the time, or `user_size`), NVSP_ERR_PACKET (not exactly one packet, or without
/// protection longer than its modem frames hold), NVSP_ERR_STATE (no frame was planned, or the vehicle has an encoder),
/// NVSP_ERR_BUDGET (all its modem frames do not hold a picture) or NVSP_ERR_UNFINISHED (too many modem frames wait:
/// nobody takes them). Nothing of it is sent then.
///
/// # Safety
/// - `now`: when it is ready, seconds.
/// - `packet`: the packet.
/// - `size`: bytes of `packet`.
/// - `user`: user bytes that travel with it. NULL only if `user_size` is 0.
/// - `user_size`: bytes of `user`: nvsp_vehicle_options.user_bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_vehicle_packet(
    vehicle: Option<&nvsp_vehicle>,
    now: f64,
    packet: *const u8,
    size: usize,
    user: *const u8,
    user_size: usize,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        // SAFETY: `size` bytes stand at `packet`, and `user_size` at `user`, see `# Safety`.
        let (packet, user) =
            unsafe { (slice(packet, size, "packet")?, optional_slice(user, user_size, "user")?) };
        let user = user.unwrap_or_default();
        content.check_user(user)?;
        content.is_own()?;
        content.link.push(now, packet, user)?;
        Ok(NVSP_OK)
    })
}

/// Takes what the modem received. Of a report the vehicle learns what the topside holds, which modem frames to send
/// again, and what the link loses.
///
/// Fails with NVSP_ERR_PACKET, NVSP_ERR_STATE, NVSP_ERR_FOREIGN or NVSP_ERR_REPLAYED
/// if it is no report for this vehicle: that is no failure of the link.
///
/// # Safety
/// - `bytes`: what was received.
/// - `size`: how many bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_vehicle_receive(
    vehicle: Option<&nvsp_vehicle>,
    now: f64,
    bytes: *const u8,
    size: usize,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        // SAFETY: `size` bytes stand at `bytes`, see `# Safety`.
        content.link.receive(now, unsafe { slice(bytes, size, "bytes")? })?;
        Ok(NVSP_OK)
    })
}

/// Takes what the encoder has finished, then writes the next modem frame that is due. Call it when the modem is free,
/// or with NVSP_LINK_PULL when it asks. Returns NVSP_PENDING if none is due, or none of so few bytes waits.
///
/// # Safety
/// - `most`: bytes of `bytes`: the MTU, or what the modem has room for.
/// - `bytes`: receives the modem frame.
/// - `written`: receives its length, bytes.
/// - `next`: receives when to call again at the latest, seconds, also with NVSP_PENDING. It may have passed. Infinite:
///   nothing waits. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_vehicle_transmit(
    vehicle: Option<&nvsp_vehicle>,
    now: f64,
    most: usize,
    bytes: *mut u8,
    written: Place<usize>,
    next: Place<f64>,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        // SAFETY: `most` bytes stand at `bytes`, see `# Safety`.
        let mut room = unsafe { Room::new(bytes, most, written, "bytes")? };
        content.collect(now)?;
        let status = match content.link.transmit(now, most)? {
            Some(frame) => {
                room.write(frame)?;
                NVSP_OK
            }
            None => NVSP_PENDING,
        };
        next.write(content.next(now));
        Ok(status)
    })
}

/// Fetches the next event. Returns NVSP_PENDING if there is none. If nobody fetches them, the first ones go.
///
/// # Parameters
/// - `event`: receives it.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_event(
    vehicle: Option<&nvsp_vehicle>,
    event: Out<nvsp_event>,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        let out = event.required()?;
        let told = content.frames.take().or_else(|| content.link.event().map(nvsp_event::from));
        let Some(told) = told else { return Ok(NVSP_PENDING) };
        out.write(&match told.kind {
            NVSP_EVENT_STORE => {
                content.link.state(&mut content.state);
                told.with(&content.state)
            }
            NVSP_EVENT_USER => told.with(content.link.user()),
            _ => told,
        });
        Ok(NVSP_OK)
    })
}

/// Counts bytes that you give to the link besides, for example telemetry: pictures get the fewer.
///
/// # Parameters
/// - `bytes`: their number, with what they cost beside themselves.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_count(
    vehicle: Option<&nvsp_vehicle>,
    now: f64,
    bytes: u32,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        content.link.count_others(now, bytes as usize)?;
        Ok(NVSP_OK)
    })
}

/// Sets what the link is like from `now` on. Reports tell the loss by themselves.
///
/// Fails with NVSP_ERR_ARGUMENT, or NVSP_ERR_STATE if the vehicle goes by no bit rate. Nothing changes then.
///
/// # Parameters
/// - `bit_rate`: bit/s. Negative: it stays.
/// - `loss`: chance that a modem frame is lost, below 1; here 0 means that none is. Negative: it stays.
/// - `burst`: mean number of modem frames that are lost in a row, 1 or more. Negative: it stays.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_vehicle_set_link(
    vehicle: Option<&nvsp_vehicle>,
    now: f64,
    bit_rate: f64,
    loss: f64,
    burst: f64,
) -> nvsp_status {
    nvsp_vehicle::call(vehicle, |content| {
        let stays = |value: f64| value < 0.0;
        let before = content.link.sender().options().loss;
        if !(stays(loss) && stays(burst)) {
            let chance = if stays(loss) { before.chance } else { loss };
            let burst = if stays(burst) { before.burst } else { burst };
            content.link.set_loss(Loss { chance, burst })?;
        }
        if !stays(bit_rate) {
            let set = content.link.set_bit_rate(now, bit_rate);
            if let Err(error) = set {
                content.link.set_loss(before)?;
                return Err(error.into());
            }
        }
        Ok(NVSP_OK)
    })
}
