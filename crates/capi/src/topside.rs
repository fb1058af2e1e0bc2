//! The topside's end of a link.

use std::ptr::null_mut;
use std::sync::Arc;
use std::time::Duration;

use nvsprior::{Decoded, Error};
use nvsprior_link::modem::CollectedPacket;
use nvsprior_link::parts::{Done, Screen, Work, number_of};
use nvsprior_link::{
    ClockSource, DuePacket, LinkError, Playout, Region, Shown, Shows, TopsideLink, TopsideOptions,
};

use super::decoder::{
    NVSP_CLOCK_NONE, NVSP_CLOCK_REPORTS, NVSP_CLOCK_VEHICLE, NVSP_DECODED_BETWEEN,
    NVSP_DECODED_RESTARTED, NVSP_DECODED_WHOLE, decoded_of, decoding, nvsp_decoded, nvsp_decoder,
};
use super::engine::nvsp_engine;
use super::event::{
    NVSP_EVENT_REFUSED, NVSP_EVENT_STORE, NVSP_EVENT_USER, NVSP_MAX_DATA, Waiting, nvsp_event,
};
use super::handle::{Content, Handle, fence};
use super::image::{self, nvsp_picture};
use super::keys::{keys_of, nvsp_keys};
use super::limits::SMALL;
use super::log::Log;
use super::memory::Grant;
use super::prior::nvsp_prior;
use super::slices::{Room, optional_slice, slice};
use super::status::*;
use super::structs::{In, Out, Place, flag, number, versioned, zeroed};
use super::vehicle::{
    NVSP_LINK_MODEM_CHECKS, NVSP_LINK_NO_REPORTS, NVSP_LINK_UTC, check_flags, mtu_of, or, stream_of,
};

/// The topside's end of a link: modem frames in, pictures and reports out. It has a decoder, the order of pictures and
/// their age, and keys; it has no thread but the decoder's, no socket, no file and no clock. No call waits. Example:
///
/// ```c
/// while (modem_received(bytes, &size)) status = nvsp_topside_receive(topside, now(), bytes, size);
/// if (nvsp_topside_picture(topside, now(), &picture, &shown) == NVSP_OK) show(&picture, &shown);
/// if (nvsp_topside_report(topside, now(), bytes, 64, &size, NULL) == NVSP_OK) modem_send(bytes, size);
/// while (nvsp_topside_event(topside, &event) == NVSP_OK) heed(&event);
/// ```
pub type nvsp_topside = Handle<TopsideEnd>;

/// How a topside receives. The MTU must be stated.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_topside_options {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Most bytes of a modem frame, 8 to 65535: the vehicle's. What lies beyond it is padding.
    pub mtu: u32,
    /// NVSP_LINK_* flags.
    pub flags: u32,
    /// 0: the newest picture, as it comes and as it gets better. Else each frame once, in order, as soon as its packet
    /// is whole, and so many seconds after its exposure at the latest; between frames that came the prior is drawn at
    /// poses between.
    pub latency: f64,
    /// In order: the camera's frames per second. 0: not known; frames have the time at which they began to come.
    pub frame_rate: f64,
    /// Seconds after which a packet is stale. Less than 128 of the camera's frames take; below an MTU of 16 less than
    /// 4. 0: 4; in order 2 more than the latency, and no more than 60 frames take.
    pub age: f64,
    /// Seconds between two reports. 0: 1.
    pub report_every: f64,
    /// Modem frames of a packet that there is room for, up to 2048. Of a longer unprotected packet the start is kept.
    /// 0: as many as 65536 bytes take, 16 or more.
    pub max_shares: u32,
    /// Packets that are held, up to 64; below an MTU of 16 up to 4. 0: 64.
    pub packets: u32,
    /// The stream that is taken, 0 to 3.
    pub stream: u32,
    /// Bytes of `state`.
    pub state_size: u32,
    /// Only modem frames that a vehicle has made with one of these keys are taken, and none a second time. Reports get
    /// a tag by the first. Read during the call. NULL: none, and whatever comes is taken.
    pub keys: In<nvsp_keys>,
    /// What this end had you store last (NVSP_EVENT_STORE), before it started again. Read during the call. NULL: it
    /// begins anew.
    pub state: *const u8,
}
versioned!(nvsp_topside_options, 80);

fn options_of(given: In<nvsp_topside_options>) -> Result<TopsideOptions, Failure> {
    let given = given.required()?;
    let is_set = |flag: u32| given.flags & flag != 0;
    let all = NVSP_LINK_UTC | NVSP_LINK_NO_REPORTS | NVSP_LINK_MODEM_CHECKS;
    check_flags(given.flags, all, "NVSP_LINK_* flags of a topside")?;
    let usual = TopsideOptions::new(mtu_of(given.mtu, 8, "8 to 65535")?);
    let some = |value: f64| (value != 0.0).then_some(value);
    let some_count = |value: u32| (value != 0).then_some(value as usize);
    let playout = match some(given.latency) {
        Some(latency) => Playout::InOrder { latency, frame_rate: some(given.frame_rate) },
        None if given.frame_rate != 0.0 => {
            let (found, allowed) = (given.frame_rate.to_string(), "0 without a latency");
            return Err(Failure::Options(LinkError::Option {
                option: "frame_rate",
                found,
                allowed,
            }));
        }
        None => Playout::Newest,
    };
    // SAFETY: so many bytes stand there, as the field's comment asks.
    let state = unsafe { optional_slice(given.state, given.state_size as usize, "state")? };
    Ok(TopsideOptions {
        stream: stream_of(given.stream)?,
        playout,
        max_shares: some_count(given.max_shares),
        packets: some_count(given.packets).unwrap_or(usual.packets),
        age: some(given.age),
        modem_checks: is_set(NVSP_LINK_MODEM_CHECKS),
        report_every: (!is_set(NVSP_LINK_NO_REPORTS)).then(|| or(given.report_every, 1.0)),
        is_utc: is_set(NVSP_LINK_UTC),
        keys: keys_of(given.keys)?,
        state: state.unwrap_or_default().to_vec(),
        ..usual
    })
}

/// What a topside's handle holds.
pub(super) struct TopsideEnd {
    pub link: TopsideLink,
    mtu: usize,
    /// `None`: packets go elsewhere.
    pictures: Option<Pictures>,
    /// A packet that there was no room for.
    held: Option<DuePacket>,
    /// Frames whose user bytes were told, and the place of the next one.
    told: [Option<u32>; TOLD],
    next_told: usize,
    events: Waiting,
    state: Vec<u8>,
}

const TOLD: usize = 64;
/// Seconds after which to come again for a report while a packet is decoded.
const SOON: f64 = 0.01;

/// What makes pictures.
struct Pictures {
    decoder: Arc<nvsp_decoder>,
    screen: Screen,
    /// What is to be done, and whether the decoder is at it.
    work: Option<(Work, bool)>,
    /// The picture that was made last, and whether it was not fetched.
    decoded: Decoded,
    shown: Option<Shown>,
    is_new: bool,
    /// Why packets are not shown.
    refusal: nvsp_status,
}

impl TopsideEnd {
    fn new(options: &TopsideOptions) -> Result<TopsideEnd, Failure> {
        Ok(TopsideEnd {
            link: TopsideLink::new(options).map_err(Failure::Options)?,
            mtu: options.mtu,
            pictures: None,
            held: None,
            told: [None; TOLD],
            next_told: 0,
            events: Waiting::new(),
            state: Vec::with_capacity(NVSP_MAX_DATA),
        })
    }

    /// Tells the user bytes of a frame's packet, once.
    fn tell_user(&mut self, frame: u32) {
        let Some(packet) = self.link.packet(frame) else { return };
        let user = self.link.user_of(&packet);
        if user.is_empty() || self.told.contains(&Some(frame)) {
            return;
        }
        let event = nvsp_event { frame, ..nvsp_event::of(NVSP_EVENT_USER) };
        self.events.tell(event.with(user));
        self.told[self.next_told] = Some(frame);
        self.next_told = (self.next_told + 1) % TOLD;
    }

    fn refused(&mut self, status: nvsp_status) {
        let Some(pictures) = &mut self.pictures else { return };
        if std::mem::replace(&mut pictures.refusal, status) != status {
            self.events.tell(nvsp_event { status, ..nvsp_event::of(NVSP_EVENT_REFUSED) });
        }
    }

    /// Goes on with what there is to decode. `false`: there is no picture yet.
    fn advance(&mut self, now: f64) -> Result<bool, Failure> {
        loop {
            let none = Failure::at(NVSP_ERR_STATE, "the topside has no decoder");
            let TopsideEnd { link, pictures, .. } = self;
            let pictures = pictures.as_mut().ok_or(none)?;
            if pictures.is_new {
                return Ok(true);
            }
            let done = match pictures.step(now, link)? {
                Advance::Rests => return Ok(false),
                Advance::Begun => continue,
                Advance::Done(done) => done,
            };
            match done {
                Ok(Done::Nothing) => self.refused(NVSP_OK),
                Ok(Done::Picture(mut shown)) => {
                    shown.time = link.told(shown.time);
                    link.set_camera(&shown.camera);
                    pictures.shown = Some(shown);
                    pictures.is_new = true;
                    self.refused(NVSP_OK);
                }
                Err(failure) => {
                    pictures.decoder.note(&failure);
                    let status = failure.status();
                    if matches!(failure, Failure::Library(Error::Vulkan(_))) {
                        return Err(failure);
                    }
                    self.refused(status);
                }
            }
        }
    }
}

/// How far it went.
enum Advance {
    /// There is nothing to do, or the decoder is at it.
    Rests,
    Begun,
    Done(Result<Done, Failure>),
}

impl Pictures {
    fn step(&mut self, now: f64, link: &mut TopsideLink) -> Result<Advance, Failure> {
        let now = link.at(now).map_err(LinkError::from)?;
        let mut decoder = self.decoder.enter()?;
        let Some((work, is_begun)) = self.work.take() else {
            // A camera or a truth map may be asked for on another thread's handle: that is short.
            let mut core = decoder.core()?;
            self.screen.hold(link, &mut core.decoder);
            self.work = self.screen.next(now, link, &core.decoder).map(|work| (work, false));
            return Ok(if self.work.is_some() { Advance::Begun } else { Advance::Rests });
        };
        let Pictures { screen, decoded, .. } = self;
        if matches!(work, Work::Ready { .. }) {
            let core = decoder.core()?;
            let done = screen.done(now, work, Ok(true), decoded, link, &core.decoder);
            return Ok(Advance::Done(done.map_err(Failure::from)));
        }
        if !is_begun {
            let begun = decoder.begin_work(&work, link);
            if !matches!(begun, Ok(false)) {
                self.work = Some((work, begun.is_ok()));
            }
            return begun.map(|_| Advance::Begun);
        }
        let mut done = None;
        let mut given = Some(work);
        let taken = decoder.take_work(|made, is_drawn, decoder| {
            let Some(work) = given.take() else { return Ok(()) };
            let outcome = screen.done(now, work, Ok(is_drawn), made, link, decoder);
            if matches!(outcome, Ok(Done::Picture(_))) {
                std::mem::swap(made, decoded);
            }
            done = Some(outcome.map_err(Failure::from));
            Ok(())
        });
        match (taken, done, given) {
            (Ok(true), Some(done), _) => Ok(Advance::Done(done)),
            (Ok(_), _, given) => {
                self.work = given.map(|work| (work, true));
                Ok(Advance::Rests)
            }
            (Err(Failure::Library(error)), _, Some(work)) => {
                let core = decoder.core()?;
                let done = screen.done(now, work, Err(error), decoded, link, &core.decoder);
                Ok(Advance::Done(done.map_err(Failure::from)))
            }
            (Err(failure), ..) => Ok(Advance::Done(Err(failure))),
        }
    }
}

impl Content for TopsideEnd {
    fn wait(&mut self, timeout: Duration) -> Result<nvsp_status, Failure> {
        let none = Failure::at(NVSP_ERR_STATE, "nothing is decoded");
        let pictures = self.pictures.as_ref().ok_or(none)?;
        match &pictures.work {
            Some((_, true)) => pictures.decoder.enter()?.wait(timeout),
            _ => Err(Failure::at(NVSP_ERR_STATE, "nothing is decoded")),
        }
    }
}

/// Makes a topside's end. Takes its memory here, as nvsp_topside_memory tells; the decoder takes its own as
/// nvsp_decode does. In order, a stream's pictures that came before their turn take more.
///
/// Fails with NVSP_ERR_ARGUMENT: the text names the option and what it allows. It is the engine's, and that of
/// nvsp_last_error(NULL). Fails also with NVSP_ERR_MEMORY.
///
/// # Parameters
/// - `engine`: NULL, with `prior`: there is no decoder. Take packets: nvsp_topside_packet.
/// - `prior`: a live prior that was opened with `engine`.
/// - `options`: how to receive.
/// - `topside`: receives the topside, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_topside_create(
    engine: Option<&nvsp_engine>,
    prior: Option<&nvsp_prior>,
    options: In<nvsp_topside_options>,
    topside: Place<Box<nvsp_topside>>,
) -> nvsp_status {
    if engine.is_none() {
        return fence(|| {
            let topside = topside.required("topside")?;
            if prior.is_some() {
                return Err(Failure::null("engine, with a prior,"));
            }
            let made = link_of(options)?.0;
            topside.write(Handle::boxed(made, Log::new(None, null_mut())));
            Ok(NVSP_OK)
        });
    }
    nvsp_engine::share(engine, |handle, engine| {
        let topside = topside.required("topside")?;
        let (mut made, how) = link_of(options)?;
        let mut decoding = decoding(&engine, prior, In::none())?;
        if let Some(camera) = made.link.camera() {
            // If it cannot be, the vehicle is asked for it.
            let _ = decoding.core()?.decoder.add_camera(camera);
        }
        decoding.is_topsides = true;
        let screen = Screen::new(&how, &made.link);
        made.pictures = Some(Pictures {
            decoder: Handle::lent(decoding, handle.log()),
            screen,
            work: None,
            decoded: Decoded::default(),
            shown: None,
            is_new: false,
            refusal: NVSP_OK,
        });
        topside.write(Handle::boxed(made, handle.log()));
        Ok(NVSP_OK)
    })
}

/// Makes the end without a decoder.
fn link_of(options: In<nvsp_topside_options>) -> Result<(TopsideEnd, TopsideOptions), Failure> {
    let options = options_of(options)?;
    let memory = TopsideLink::memory(&options).map_err(Failure::Options)?;
    let _memory = Grant::take("a topside", memory as u64 + SMALL, u64::MAX)?;
    Ok((TopsideEnd::new(&options)?, options))
}

/// Tells how much memory a topside takes besides its decoder. Any thread may call it.
///
/// Fails with NVSP_ERR_ARGUMENT, as nvsp_topside_create.
///
/// # Parameters
/// - `options`: how to receive.
/// - `bytes`: receives the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_topside_memory(
    options: In<nvsp_topside_options>,
    bytes: Place<u64>,
) -> nvsp_status {
    fence(|| {
        let bytes = bytes.required("bytes")?;
        let memory = TopsideLink::memory(&options_of(options)?).map_err(Failure::Options)?;
        bytes.write(memory as u64);
        Ok(NVSP_OK)
    })
}

/// Gives the topside's decoder, for its filter, cameras and truth map (nvsp_decoder_get_truth: of the picture that was
/// fetched last). It is the topside's: packets come by the topside alone, and nvsp_destroy on it does nothing. NULL:
/// there is none, or the topside is in use.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_topside_decoder(topside: Option<&nvsp_topside>) -> *mut nvsp_decoder {
    let mut found = null_mut();
    let status = nvsp_topside::call(topside, |content| {
        if let Some(pictures) = &content.pictures {
            found = Arc::as_ptr(&pictures.decoder).cast_mut();
        }
        Ok(NVSP_OK)
    });
    if status == NVSP_OK { found } else { null_mut() }
}

/// Takes what the modem received. Modem frames may come in any order, repeated, padded or damaged, and mixed with
/// others.
///
/// Fails with NVSP_ERR_PACKET or NVSP_ERR_NEWER if it is none of the vehicle's,
/// damaged, too late, of another stream, or of more than there is room for; with keys NVSP_ERR_FOREIGN or
/// NVSP_ERR_REPLAYED. That is no failure of the link, and what came before is not lost.
///
/// # Safety
/// - `bytes`: what was received.
/// - `size`: how many bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_topside_receive(
    topside: Option<&nvsp_topside>,
    now: f64,
    bytes: *const u8,
    size: usize,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        // SAFETY: `size` bytes stand at `bytes`, see `# Safety`.
        let (_, grown) = content.link.receive(now, unsafe { slice(bytes, size, "bytes")? })?;
        if let Some(pictures) = &mut content.pictures {
            pictures.screen.note(content.link.last(), grown, &content.link);
        }
        if let Some((frame, _)) = grown {
            content.tell_user(frame);
        }
        Ok(NVSP_OK)
    })
}

/// Fetches the next picture to show. If none is there, begins to decode what came on the decoder's own thread, and
/// returns NVSP_PENDING: call it again, at once or after nvsp_wait. Packets that cannot be shown are no failure:
/// NVSP_EVENT_REFUSED tells.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL (the picture is kept), NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or
/// NVSP_ERR_DEVICE_LOST, and with NVSP_ERR_STATE if there is no decoder.
///
/// # Parameters
/// - `picture`: receives the picture. Its pixels are yours.
/// - `shown`: receives what is known of it. NULL: not wanted.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_topside_picture(
    topside: Option<&nvsp_topside>,
    now: f64,
    picture: Out<nvsp_picture>,
    shown: Out<nvsp_decoded>,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        let out = shown.optional()?;
        picture.required()?;
        if !content.advance(now)? {
            return Ok(NVSP_PENDING);
        }
        let Some(pictures) = &mut content.pictures else { return Ok(NVSP_PENDING) };
        let Some(known) = &pictures.shown else { return Ok(NVSP_PENDING) };
        image::write(&pictures.decoded.picture, picture)?;
        pictures.decoder.enter()?.set_truth(&pictures.decoded.truth)?;
        pictures.is_new = false;
        out.write(&shown_of(known, &pictures.decoded));
        Ok(NVSP_OK)
    })
}

fn clock_of(clock: Option<ClockSource>) -> u32 {
    match clock {
        None => NVSP_CLOCK_NONE,
        Some(ClockSource::Reports) => NVSP_CLOCK_REPORTS,
        Some(ClockSource::Vehicle) => NVSP_CLOCK_VEHICLE,
    }
}

fn shown_of(shown: &Shown, decoded: &Decoded) -> nvsp_decoded {
    let known = decoded_of(decoded);
    nvsp_decoded {
        frame: shown.frame as u32,
        time: shown.time,
        age: shown.age,
        old: shown.old,
        clock: clock_of(shown.clock),
        flags: known.flags
            | flag(shown.complete, NVSP_DECODED_WHOLE)
            | flag(shown.shows == Shows::Between, NVSP_DECODED_BETWEEN)
            | flag(shown.restarted, NVSP_DECODED_RESTARTED),
        arrived: number(shown.shares.0),
        sent: number(shown.shares.1.unwrap_or(0)),
        bytes: number(shown.bytes),
        ..known
    }
}

/// For who decodes elsewhere: fetches the next packet, or the start of one that came. Give it to nvsp_decode with
/// NVSP_DECODE_START. Returns NVSP_PENDING if there is none now.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL (the packet is kept until newer ones take its place), or
/// NVSP_ERR_STATE (the topside has a decoder).
///
/// # Safety
/// - `packet`: receives the packet.
/// - `size`: bytes of `packet`; nvsp_topside_options.max_shares times the MTU always suffices.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
/// - `shown`: receives what is known of it without decoding. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_topside_packet(
    topside: Option<&nvsp_topside>,
    now: f64,
    packet: *mut u8,
    size: usize,
    written: Place<usize>,
    shown: Out<nvsp_decoded>,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        let out = shown.optional()?;
        // SAFETY: `size` bytes stand at `packet`, see `# Safety`.
        let mut room = unsafe { Room::new(packet, size, written, "packet")? };
        let TopsideEnd { link, held, pictures, .. } = content;
        if pictures.is_some() {
            return Err(Failure::at(NVSP_ERR_STATE, "the topside has a decoder"));
        }
        if held.is_none_or(|due| link.packet(number_of(due.frame)).is_none()) {
            *held = link.next_packet(now)?.map(|(due, _)| due);
        }
        let found = held.and_then(|due| Some((due, link.packet(number_of(due.frame))?)));
        let Some((due, packet)) = found else { return Ok(NVSP_PENDING) };
        room.write(packet.bytes)?;
        out.write(&packet_of(&due, &packet, link));
        *held = None;
        Ok(NVSP_OK)
    })
}

fn packet_of(due: &DuePacket, packet: &CollectedPacket, link: &TopsideLink) -> nvsp_decoded {
    let told = link.age(packet);
    nvsp_decoded {
        frame: due.frame as u32,
        time: due.time,
        age: told.map_or(0.0, |(age, _)| age),
        old: link.age_limit(packet),
        clock: clock_of(told.map(|(_, clock)| clock)),
        flags: flag(packet.complete, NVSP_DECODED_WHOLE)
            | flag(due.restarted, NVSP_DECODED_RESTARTED),
        arrived: number(packet.arrived),
        sent: number(packet.sent.unwrap_or(0)),
        bytes: number(packet.bytes.len()),
        pose: image::NO_POSE,
        ..zeroed()
    }
}

/// Writes the report that is due, as a modem frame for the way back. Returns NVSP_PENDING if none is; while a packet is
/// decoded it waits for that. Reports are made only while the vehicle is heard.
///
/// Fails with NVSP_ERR_BUFFER_TOO_SMALL: the MTU is needed.
///
/// # Safety
/// - `report`: receives the report.
/// - `size`: bytes of `report`.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
/// - `next`: receives when to call again at the latest, seconds, for a report or a picture in order. Infinite: nothing
///   waits. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_topside_report(
    topside: Option<&nvsp_topside>,
    now: f64,
    report: *mut u8,
    size: usize,
    written: Place<usize>,
    next: Place<f64>,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        // SAFETY: `size` bytes stand at `report`, see `# Safety`.
        let mut room = unsafe { Room::new(report, size, written, "report")? };
        let TopsideEnd { link, pictures, .. } = content;
        // A report that was made is the vehicle's.
        room.check(content.mtu)?;
        let made = match pictures {
            None => link.report_packets(now)?,
            Some(pictures) if pictures.work.as_ref().is_some_and(|(_, is_begun)| *is_begun) => {
                next.write(now + SOON);
                return Ok(NVSP_PENDING);
            }
            Some(pictures) => {
                let decoder = pictures.decoder.enter()?;
                let mut core = decoder.core()?;
                let screen = &mut pictures.screen;
                screen.hold(link, &mut core.decoder);
                let holds = |frame| core.decoder.holds_pose(frame);
                link.report(now, |frame| screen.kept(frame), Some(holds), screen.lacks_start())?
            }
        };
        let status = if made.is_some() { NVSP_OK } else { NVSP_PENDING };
        if let Some(made) = made {
            room.write(made)?;
        }
        next.write(link.due().unwrap_or(f64::INFINITY));
        Ok(status)
    })
}

/// Fetches the next event. Returns NVSP_PENDING if there is none. If nobody fetches them, the first ones go.
///
/// # Parameters
/// - `event`: receives it.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_topside_event(
    topside: Option<&nvsp_topside>,
    event: Out<nvsp_event>,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        let out = event.required()?;
        let told = content.events.take().or_else(|| content.link.event().map(nvsp_event::from));
        let Some(told) = told else { return Ok(NVSP_PENDING) };
        out.write(&match told.kind {
            NVSP_EVENT_STORE => {
                content.link.state(&mut content.state);
                told.with(&content.state)
            }
            _ => told,
        });
        Ok(NVSP_OK)
    })
}

/// Has what the pilot looks at get more of the bytes, from the next report on, which is due at once.
///
/// Fails with NVSP_ERR_ARGUMENT: the rectangle is empty, or not in the picture.
///
/// # Parameters
/// - `left`, `top`, `right`, `bottom`: parts of the picture, 0 to 1.
/// - `weight`: how much more an error in it counts, up to 255. 0: there is no region, and the others do not count.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_topside_set_region(
    topside: Option<&nvsp_topside>,
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
    weight: u32,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        let wrong = Failure::argument("region: empty, outside of 0 to 1, or a weight above 255");
        content.link.set_region(match u8::try_from(weight) {
            Ok(0) => None,
            Ok(weight) => Some(Region::new([left, top, right, bottom], weight).ok_or(wrong)?),
            Err(_) => return Err(wrong),
        });
        Ok(NVSP_OK)
    })
}

/// Sets the user bytes of all reports from here on. A report that has no room for them goes without.
///
/// Fails with NVSP_ERR_ARGUMENT: more than 247.
///
/// # Safety
/// - `user`: the user bytes. NULL only if `size` is 0.
/// - `size`: bytes of `user`, up to 247.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_topside_set_user(
    topside: Option<&nvsp_topside>,
    user: *const u8,
    size: usize,
) -> nvsp_status {
    nvsp_topside::call(topside, |content| {
        // SAFETY: `size` bytes stand at `user`, see `# Safety`.
        let user = unsafe { optional_slice(user, size, "user")? };
        content.link.set_user(user.unwrap_or_default())?;
        Ok(NVSP_OK)
    })
}
