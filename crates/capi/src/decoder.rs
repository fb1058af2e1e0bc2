//! The decoder's handle, and packet headers.

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use nvsprior::packet::{LONGEST_HEAD, PacketError, Parsed};
use nvsprior::parts::{Lost, Queue};
use nvsprior::truth::TruthMap;
use nvsprior::{Decoded, Decoder, Error, Picture, Pose, Trust, packet_bound};
use nvsprior_link::TopsideLink;
use nvsprior_link::keys::{self, Verifier};
use nvsprior_link::parts::Work;

use super::engine::{EngineContent, nvsp_engine};
use super::handle::{Content, Handle, fence, locked};
use super::image::{self, nvsp_camera, nvsp_picture, nvsp_pose};
use super::keys::{keys_of, nvsp_keys, taken_of};
use super::limits::Limits;
use super::prior::{PriorContent, nvsp_prior};
use super::slices::slice;
use super::status::*;
use super::structs::{Checked, In, Out, Place, flag, versioned, zeroed};
use super::thread::{ThreadStart, spawner};

/// Decodes packets, in any order. Example:
///
/// ```c
/// nvsp_picture picture = NVSP_INITIALIZER(nvsp_picture);
/// picture.format = NVSP_FORMAT_RGB8;
/// status = nvsp_decode(decoder, packet, bytes, 0, &picture, NULL); // NVSP_ERR_BUFFER_TOO_SMALL
/// picture.pixels = malloc(picture.needed);
/// picture.size = picture.needed;
/// status = nvsp_decode_finish(decoder, &picture, NULL);
/// ```
pub type nvsp_decoder = Handle<Decoding>;

/// A decoder with the packet under way.
pub(super) struct Decoding {
    core: Arc<Mutex<Core>>,
    queue: Queue<PacketWork, Failure>,
    /// What checks packets first, and as it was before the last one; `None`: any packet is taken.
    verifier: Option<Verifier>,
    before: Option<Verifier>,
    /// A topside's: its packets come by the topside alone.
    pub is_topsides: bool,
}

/// What the packets of a decoder share.
pub(super) struct Core {
    pub decoder: Decoder,
    /// What nvsp_decoder_draw drew last.
    drawn: Picture,
    /// What is known of the picture that was decoded or drawn last; `None`: there was none yet.
    truth: Option<TruthMap>,
    limits: Limits,
}

/// A packet on its way. Buffers are kept from packet to packet.
struct PacketWork {
    bytes: Vec<u8>,
    /// The packet as it was read, or why it cannot be.
    parsed: Result<Parsed, PacketError>,
    trust: Trust,
    /// Draw the prior there in place of decoding; whether it was drawn.
    draw: Option<Pose>,
    is_drawn: bool,
    decoded: Decoded,
}

impl Decoding {
    fn new(
        decoder: Decoder,
        limits: Limits,
        verifier: Option<Verifier>,
        start: ThreadStart,
    ) -> Decoding {
        let core = Core { decoder, drawn: Picture::default(), truth: None, limits };
        let core = Arc::new(Mutex::new(core));
        let work = PacketWork {
            bytes: Vec::new(),
            parsed: Parsed::of(&[]),
            trust: Trust::Whole,
            draw: None,
            is_drawn: false,
            decoded: Decoded::default(),
        };
        let own = core.clone();
        let decode = move |work: &mut PacketWork| match work.draw {
            Some(pose) => draw(&mut *locked(&own)?, &pose, work),
            None => decode(&mut *locked(&own)?, work),
        };
        let spawn = spawner([c"nvsp-decoder"], start);
        // If nobody takes a picture, nothing is lost: no other picture depends on it.
        let queue = Queue::new(vec![Box::new(decode)], vec![work], Lost::default(), spawn);
        Decoding { core, queue, before: verifier.clone(), verifier, is_topsides: false }
    }

    /// Fails from the beginning of a packet until it is finished or cancelled.
    pub(super) fn core(&self) -> Result<MutexGuard<'_, Core>, Failure> {
        self.queue.check_idle()?;
        locked(&self.core)
    }

    /// Refuses calls that a topside makes itself.
    fn check_own(&self) -> Result<(), Failure> {
        let what = "the decoder is a topside's: give that the modem frames";
        if self.is_topsides { Err(Failure::at(NVSP_ERR_STATE, what)) } else { Ok(()) }
    }

    /// Begins what a topside's end has to do. `false`: its packet is not held any more.
    pub(super) fn begin_work(&mut self, work: &Work, link: &TopsideLink) -> Result<bool, Failure> {
        let Decoding { core, queue, .. } = self;
        let packet = match *work {
            Work::Decode { frame, .. } => match link.packet(frame) {
                Some(packet) => packet.bytes,
                None => return Ok(false),
            },
            Work::Draw { .. } | Work::Ready { .. } => &[],
        };
        queue.begin(|slot| {
            slot.draw = if let Work::Draw { pose, .. } = work { Some(*pose) } else { None };
            if slot.draw.is_none() {
                fill(&*locked(core)?, slot, packet, Trust::Start)?;
                slot.is_drawn = true;
            }
            Ok(())
        })?;
        Ok(true)
    }

    /// Gives `take` what came of it: the picture, and whether there is one. `false`: it has not ended.
    pub(super) fn take_work(
        &mut self,
        take: impl FnOnce(&mut Decoded, bool, &Decoder) -> Result<(), Failure>,
    ) -> Result<bool, Failure> {
        let core = &self.core;
        self.queue.take(|slot| take(&mut slot.decoded, slot.is_drawn, &locked(core)?.decoder))
    }

    /// The picture that was fetched last is that one.
    pub(super) fn set_truth(&mut self, truth: &TruthMap) -> Result<(), Failure> {
        locked(&self.core)?.truth.get_or_insert_default().copy(truth);
        Ok(())
    }

    /// Gives `fetch` what is known of the picture that was decoded or drawn last.
    pub(super) fn with_truth<T>(
        &self,
        fetch: impl FnOnce(&TruthMap) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let core = self.core()?;
        fetch(core.truth.as_ref().ok_or(Failure::at(NVSP_ERR_STATE, "no packet was decoded"))?)
    }

    /// Takes a packet in, by `run` on this thread, else on the decoder's own.
    fn start(&mut self, packet: &[u8], flags: u32, run: bool) -> Result<(), Failure> {
        let trust = match flags {
            0 => Trust::Whole,
            NVSP_DECODE_START => Trust::Start,
            _ => return Err(Failure::argument("flags")),
        };
        self.check_own()?;
        let Decoding { core, queue, verifier, before, .. } = self;
        let fill = |work: &mut PacketWork| {
            before.clone_from(verifier);
            work.draw = None;
            let packet = match verifier {
                Some(verifier) => verifier.verify(packet)?.content,
                None => packet,
            };
            fill(&*locked(core)?, work, packet, trust)
        };
        let started = if run { queue.run(fill) } else { queue.begin(fill) };
        self.forgive(started)
    }

    /// A packet that failed for want of memory, or by its device, may come again.
    fn forgive<T>(&mut self, done: Result<T, Failure>) -> Result<T, Failure> {
        done.inspect_err(|failure| {
            let own = [NVSP_ERR_MEMORY, NVSP_ERR_VULKAN, NVSP_ERR_DEVICE_LOST];
            if own.contains(&failure.status()) {
                self.verifier.clone_from(&self.before);
            }
        })
    }

    fn take(
        &mut self,
        fetch: impl FnOnce(&Decoded, Option<&Verifier>) -> Result<(), Failure>,
    ) -> Result<nvsp_status, Failure> {
        let taken = self.queue.take(|work| fetch(&work.decoded, self.verifier.as_ref()));
        Ok(done_or_pending(self.forgive(taken)?))
    }
}

impl Content for Decoding {
    fn wait(&mut self, timeout: Duration) -> Result<nvsp_status, Failure> {
        Ok(done_or_pending(self.queue.wait(timeout)?))
    }

    fn cancel(&mut self) -> Result<nvsp_status, Failure> {
        self.check_own()?;
        Ok(done_or_pending(self.queue.cancel()))
    }
}

/// For nvsp_decode: the bytes are the undamaged start of a packet, as nvsp_topside_packet copies it. If the
/// difference picture is cut short, the decoder shows what arrived, a coarser picture. Without this flag it shows a
/// difference picture only if it is whole and its check matches.
pub const NVSP_DECODE_START: u32 = 1;

/// The render is the vehicle's, byte for byte. If neither this bit nor NVSP_DECODED_OTHER_RENDER is set, the packet
/// does not tell.
pub const NVSP_DECODED_SAME_RENDER: u32 = 4;
/// The render is not the vehicle's: the vehicle's device, or its driver, rounds differently.
pub const NVSP_DECODED_OTHER_RENDER: u32 = 8;

/// The frame is one of a stream, and its difference picture is predicted from that of nvsp_decoded.reference.
pub const NVSP_DECODED_INTER: u32 = 16;
/// The frame is one of a stream and came in full: later ones may be predicted from it. If there is a return channel,
/// tell the vehicle: nvsp_encoder_acknowledge.
pub const NVSP_DECODED_KEPT: u32 = 32;
/// The picture went through the display filter: see nvsp_decoder_set_filter.
pub const NVSP_DECODED_FILTERED: u32 = 64;

/// For nvsp_decoded.flags, of a topside: all of the frame's packet came.
pub const NVSP_DECODED_WHOLE: u32 = 256;
/// The frame did not come: the prior is drawn at a pose between those of frames that did.
pub const NVSP_DECODED_BETWEEN: u32 = 512;
/// It does not follow the one before: the vehicle has begun anew.
pub const NVSP_DECODED_RESTARTED: u32 = 1024;
/// Of nvsp_decode_header: `pose` is given.
pub const NVSP_DECODED_POSE: u32 = 2048;
/// Of nvsp_decode_header: the packet states prior and camera; else they are those of an earlier packet.
pub const NVSP_DECODED_SESSION: u32 = 4096;

/// For nvsp_decoded.clock: `age` is since the frame's packet began to come. It is older by what the link took.
pub const NVSP_CLOCK_NONE: u32 = 0;
/// The vehicle counts from the reports that it got: `age` is never too small.
pub const NVSP_CLOCK_REPORTS: u32 = 1;
/// The vehicle's own UTC.
pub const NVSP_CLOCK_VEHICLE: u32 = 2;

/// What decoding a packet yielded besides the picture; or, by nvsp_decode_header, what it says first.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_decoded {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Number of the frame, completed from that of the packet before. Of nvsp_decode_header modulo 2^16.
    pub frame: u32,
    /// Pixels. Of nvsp_decode_header 0 without NVSP_DECODED_SESSION, as the height.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Bits: NVSP_FRAME_UNCERTAIN, NVSP_FRAME_NOT_PORTABLE, NVSP_FRAME_POSITION_KNOWN, NVSP_DECODED_*.
    pub flags: u32,
    /// Rows that the difference picture reached: all, or 0 if the picture is the prior's render alone.
    pub rows: u32,
    /// NVSP_OK, or what was wrong with a part of the packet that the picture does without:
    /// NVSP_ERR_RESIDUAL (the difference picture), NVSP_ERR_NEWER (its coder is not known), NVSP_ERR_REFERENCE (its
    /// reference frame is missing) or NVSP_ERR_PACKET (prior and camera).
    pub damage: nvsp_status,
    /// The pose.
    pub pose: nvsp_pose,
    /// With NVSP_DECODED_INTER: number of the reference frame, completed from that of the packet before; else 0.
    pub reference: u32,
    /// NVSP_CLOCK_*. This and the fields from `time` to `bytes` are a topside's; else they are zero.
    pub clock: u32,
    /// With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of the position along an axis of the camera (the
    /// prior's unit); else infinite.
    pub position_deviation: f64,
    /// With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of a turn about an axis of the camera (radians);
    /// else infinite.
    pub rotation_deviation: f64,
    /// With keys: the number above all of the packets that came. Else 0. See nvsp_keys.taken.
    pub taken: u64,
    /// In order the frame's time, else when it was fetched; seconds.
    pub time: f64,
    /// How old the frame was at that call, seconds: see `clock`.
    pub age: f64,
    /// From which age on the picture is old, as the vehicle tells, seconds. Say so to who looks at it.
    pub old: f64,
    /// Modem frames of its packet that came.
    pub arrived: u32,
    /// Modem frames that it was sent in. 0: not known.
    pub sent: u32,
    /// Bytes of its packet that came.
    pub bytes: u32,
    /// With NVSP_DECODED_SESSION: identity of the prior that the packet is about, see nvsp_prior_info. This and the
    /// fields behind are of nvsp_decode_header; else they are zero.
    pub prior_id: u32,
    /// Bytes of the latent part, which makes a picture by itself.
    pub latent_bytes: u32,
    /// The tag, of 16 bits, that names prior and camera.
    pub tag: u32,
}
versioned!(nvsp_decoded, 176);

/// Makes a decoder for packets about a prior. The first packet of a camera takes the device memory
/// for its pictures.
///
/// Fails with NVSP_ERR_ARGUMENT or NVSP_ERR_MEMORY; the text is the engine's.
///
/// # Parameters
/// - `prior`: a live prior that was opened with `engine`.
/// - `keys`: only whole packets that an encoder has made with one of these keys are taken, and none a second time.
///   NULL: none, and whatever comes is taken.
/// - `decoder`: receives the decoder, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_decoder_create(
    engine: Option<&nvsp_engine>,
    prior: Option<&nvsp_prior>,
    keys: In<nvsp_keys>,
    decoder: Place<Box<nvsp_decoder>>,
) -> nvsp_status {
    nvsp_engine::share(engine, |handle, engine| {
        let decoder = decoder.required("decoder")?;
        decoder.write(Handle::boxed(decoding(&engine, prior, keys)?, handle.log()));
        Ok(NVSP_OK)
    })
}

/// Makes a decoder.
pub(super) fn decoding(
    engine: &EngineContent,
    prior: Option<&nvsp_prior>,
    keys: In<nvsp_keys>,
) -> Result<Decoding, Failure> {
    let scene = nvsp_prior::of(prior, "prior")?.scene_of(engine)?;
    let mut decoder = Decoder::new(&engine.engine, &scene);
    decoder.set_pixel_limit(engine.how.limits.frame_pixels);
    let verifier = keys_of(keys)?.map(|keys| Verifier::new(&keys, keys::Content::Packet));
    Ok(Decoding::new(decoder, engine.how.limits, verifier, engine.how.threads))
}

/// Tells the decoder about a camera that packets only name. So a topside that joins late need not
/// wait until the camera is sent again. The decoder knows the last 256 cameras.
///
/// Fails with NVSP_ERR_ARGUMENT, or NVSP_ERR_MEMORY (more pixels than the engine allows).
///
/// # Parameters
/// - `camera`: size, focal lengths and principal point, pixels.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_decoder_add_camera(
    decoder: Option<&nvsp_decoder>,
    camera: In<nvsp_camera>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        let camera = image::camera(camera)?;
        content.core()?.decoder.add_camera(&camera)?;
        Ok(NVSP_OK)
    })
}

/// Has a small network filter decoded pictures from the next packet on, or not. A filtered picture looks more like what
/// the camera saw, if the network knows the scene. Its weights are the prior's (which `nvsprior
/// prior filter` trains), or the library's. At first it is off, as it takes time on the device. Nothing is
/// predicted from a filtered picture: packets and their truth maps stay as they are. Pictures without a difference
/// picture, and those of other coders than the wavelet coder, are not filtered; NVSP_DECODED_FILTERED tells.
///
/// Builds a pipeline, and takes 20 bytes of device memory per pixel with the next packet of a camera. Fails with
/// NVSP_ERR_ARGUMENT, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST; it is then off.
///
/// # Parameters
/// - `on`: 1: filter pictures. 0: do not.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_decoder_set_filter(decoder: Option<&nvsp_decoder>, on: u32) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        if on > 1 {
            return Err(Failure::at(NVSP_ERR_ARGUMENT, "`on` is 0 or 1"));
        }
        content.core()?.decoder.set_filter(on == 1)?;
        Ok(NVSP_OK)
    })
}

/// Goes on with `prior`, opened again after its device was lost, or opened on another engine. It
/// must have the same identity. The known cameras carry over. See nvsp_engine_reopen.
///
/// Fails with NVSP_ERR_OTHER_PRIOR.
///
/// # Parameters
/// - `prior`: a live prior that was opened with `engine`.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_decoder_reopen(
    decoder: Option<&nvsp_decoder>,
    engine: Option<&nvsp_engine>,
    prior: Option<&nvsp_prior>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        let engine = nvsp_engine::of(engine, "engine")?;
        let scene = nvsp_prior::of(prior, "prior")?.scene_of(&engine)?;
        content.core()?.decoder.move_to(&engine.engine, &scene)?;
        Ok(NVSP_OK)
    })
}

/// Decodes a packet. Waits for a lock of the device's queue, and for the device. Whatever the bytes are, the call
/// yields a picture or an error. Allocates nothing from the second valid packet of a camera on, unless a view of the
/// prior needs more room on the device than any before it. It holds at most 2 MiB and 136 bytes per pixel on the host,
/// and from the first packet of a stream on 272 more per pixel. The pixels are those of the packet's picture, with
/// sides rounded up to multiples of 16.
///
/// The same packet yields the same picture, byte for byte, as the encoder predicted, on the same
/// device and driver. nvsp_decoder_get_truth tells what of it is as the camera saw it.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_PACKET, NVSP_ERR_OTHER_PRIOR, NVSP_ERR_CAMERA_UNKNOWN, NVSP_ERR_MEMORY,
/// NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST. With keys, fails with NVSP_ERR_FOREIGN or NVSP_ERR_REPLAYED: nothing of it
/// is read then. Fails also with NVSP_ERR_BUFFER_TOO_SMALL: the picture is then kept until the next packet is decoded,
/// and nvsp_decode_finish fetches it.
///
/// # Safety
/// - `packet`: the packet.
/// - `size`: bytes of `packet`.
/// - `flags`: NVSP_DECODE_START, or 0.
/// - `picture`: receives the picture. Its pixels are yours. NULL: not wanted.
/// - `info`: receives what the packet yielded. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_decode(
    decoder: Option<&nvsp_decoder>,
    packet: *const u8,
    size: usize,
    flags: u32,
    picture: Out<nvsp_picture>,
    info: Out<nvsp_decoded>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        let out = info.optional()?;
        // SAFETY: `size` bytes stand at `packet`, see `# Safety`.
        let packet = unsafe { slice(packet, size, "packet")? };
        content.start(packet, flags, true)?;
        content.take(|decoded, keys| fetch(decoded, keys, picture, &out))
    })
}

/// Begins to decode a packet on the decoder's own thread. Before it returns, it checks what it was given and copies the
/// packet; it does not wait. The first such call starts the thread. Until nvsp_decode_finish or nvsp_cancel ends
/// the packet, other calls on the decoder fail with NVSP_ERR_UNFINISHED, except nvsp_wait and
/// nvsp_destroy. A picture that nvsp_decode or nvsp_decode_finish had no room for is dropped by the next
/// packet.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_MEMORY (no thread, or no copy of the packet), or, with keys, NVSP_ERR_FOREIGN
/// or NVSP_ERR_REPLAYED. If the packet itself fails, nvsp_decode_finish returns its status.
///
/// # Safety
/// - `packet`: the packet.
/// - `size`: bytes of `packet`.
/// - `flags`: NVSP_DECODE_START, or 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_decode_begin(
    decoder: Option<&nvsp_decoder>,
    packet: *const u8,
    size: usize,
    flags: u32,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        // SAFETY: `size` bytes stand at `packet`, see `# Safety`.
        let packet = unsafe { slice(packet, size, "packet")? };
        content.start(packet, flags, false)?;
        Ok(NVSP_OK)
    })
}

/// Fetches the picture of the packet that was begun, or the picture that nvsp_decode had no room for. Returns
/// NVSP_PENDING if the packet has not ended.
///
/// Fails with NVSP_ERR_STATE if there is none, and as nvsp_decode does. After NVSP_ERR_BUFFER_TOO_SMALL the picture is
/// still there.
///
/// # Parameters
/// - `picture`: receives the picture. Its pixels are yours. NULL: not wanted.
/// - `info`: receives what the packet yielded. NULL: not wanted.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_decode_finish(
    decoder: Option<&nvsp_decoder>,
    picture: Out<nvsp_picture>,
    info: Out<nvsp_decoded>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        let out = info.optional()?;
        content.check_own()?;
        content.take(|decoded, keys| fetch(decoded, keys, picture, &out))
    })
}

/// Draws the prior at a pose, as the camera of the packet decoded last sees it: for frames of which nothing came, at a
/// pose between those of frames that did (nvsp_pose_between). Waits for a lock of the device's queue, and for the
/// device. Memory as for nvsp_decode: nothing from the second call on.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_STATE (no packet was decoded), NVSP_ERR_BUFFER_TOO_SMALL, NVSP_ERR_MEMORY,
/// NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
///
/// # Parameters
/// - `pose`: the pose, from world to camera.
/// - `picture`: receives the picture. Its pixels are yours.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_decoder_draw(
    decoder: Option<&nvsp_decoder>,
    pose: In<nvsp_pose>,
    picture: Out<nvsp_picture>,
) -> nvsp_status {
    nvsp_decoder::call(decoder, |content| {
        picture.required()?;
        let pose = image::pose(pose)?.ok_or(Failure::null("pose"))?;
        let mut core = content.core()?;
        let none = Failure::at(NVSP_ERR_STATE, "no packet was decoded");
        let camera = *core.decoder.camera().ok_or(none)?;
        let same = (core.drawn.width, core.drawn.height) == (camera.width, camera.height);
        let size = (camera.width, camera.height);
        let _memory = (!same).then(|| core.limits.decoder(size)).transpose()?;
        core.drawn.resize(camera.width, camera.height);
        image::check_place(&core.drawn, picture)?;
        let Core { decoder, drawn, truth, .. } = &mut *core;
        decoder.draw(&pose, drawn)?;
        truth.get_or_insert_default().reset(camera.width, camera.height);
        image::write(drawn, picture)?;
        Ok(NVSP_OK)
    })
}

/// Reads a packet's header without a device. Needs the latent part: the first 20 bytes of the packet, 24 if it states
/// prior and camera. Of a packet with a tag give what is behind it. Gives the pose only if
/// the packet is about `prior`. A packet that does not state its prior counts as about `prior`. Any thread may call it.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_PACKET (also if the pose is predicted from those of earlier packets), or
/// NVSP_ERR_NEWER.
///
/// # Safety
/// - `packet`: the packet, or its start.
/// - `size`: bytes of it that are there, 64 or more if it has as many.
/// - `prior`: a live prior. NULL: the pose is not wanted.
/// - `header`: receives what the packet says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_decode_header(
    packet: *const u8,
    size: usize,
    prior: Option<&nvsp_prior>,
    header: Out<nvsp_decoded>,
) -> nvsp_status {
    fence(|| {
        let out = header.required()?;
        // SAFETY: `size` bytes stand at `packet`, see `# Safety`.
        let parsed = match Parsed::of(unsafe { slice(packet, size, "packet")? }) {
            Err(PacketError::Version) => return Ok(NVSP_ERR_NEWER),
            parsed => parsed.map_err(|error| Failure::Library(error.into()))?,
        };
        out.write(&header_of(&parsed, prior.map(Handle::get)));
        Ok(NVSP_OK)
    })
}

fn header_of(parsed: &Parsed, prior: Option<PriorContent>) -> nvsp_decoded {
    let latent = parsed.latent();
    let session = parsed.session().as_ref().ok().copied().flatten();
    let is_own = |id| session.is_none_or(|session| session.prior == id);
    let scene = prior.map(|prior| prior.scene).filter(|scene| is_own(scene.id()));
    let unit = scene.as_ref().map(|scene| scene.coordinate_frame().unit());
    let in_world = |scene: Arc<nvsprior::render::Scene>| {
        let pose = latent.pose.dequantise(&scene.coordinate_frame());
        pose.absolute_from(scene.origin())
    };
    let pose = scene.map(in_world);
    let known = unit.and_then(|unit| latent.known.map(|bound| bound.of_unit(unit)));
    let size = session.map_or((0, 0), |session| (session.camera.width, session.camera.height));
    nvsp_decoded {
        prior_id: session.map_or(0, |session| session.prior.0),
        frame: latent.frame,
        width: size.0,
        height: size.1,
        flags: flag(latent.uncertain, super::encoder::NVSP_FRAME_UNCERTAIN)
            | flag(!latent.portable, super::encoder::NVSP_FRAME_NOT_PORTABLE)
            | flag(latent.known.is_some(), super::encoder::NVSP_FRAME_POSITION_KNOWN)
            | flag(pose.is_some(), NVSP_DECODED_POSE)
            | flag(session.is_some(), NVSP_DECODED_SESSION),
        latent_bytes: parsed.latent_len() as u32,
        tag: latent.tag.into(),
        pose: pose.map_or(image::NO_POSE, |pose| image::pose_out(&pose)),
        position_deviation: known.map_or(f64::INFINITY, |known| known.position),
        rotation_deviation: known.map_or(f64::INFINITY, |known| known.rotation),
        ..zeroed()
    }
}

/// The worker of the queue.
fn decode(core: &mut Core, work: &mut PacketWork) -> Result<(), Failure> {
    let Core { decoder, limits, truth, .. } = core;
    let PacketWork { bytes, parsed, trust, decoded, .. } = work;
    let parsed = parsed.as_ref().map_err(|error| {
        decoder.refuse(bytes, error);
        Error::from(error.clone())
    })?;
    // A topside keeps pictures until their turn: then the buffer is another one.
    let is_new = decoded.picture.data.is_empty();
    let size = decoder.size_to_prepare(parsed);
    let size = size.or_else(|| decoder.size_told(parsed).filter(|_| is_new));
    let _memory = size.map(|size| limits.decoder(size)).transpose()?;
    let size = decoder.stream_to_prepare(parsed);
    let _stream = size.map(|size| limits.stream(size)).transpose()?;
    decoder.decode_parsed(parsed, bytes, *trust, decoded)?;
    truth.get_or_insert_default().copy(&decoded.truth);
    Ok(())
}

/// Draws the prior at a pose.
fn draw(core: &mut Core, pose: &Pose, work: &mut PacketWork) -> Result<(), Failure> {
    let picture = &mut work.decoded.picture;
    let size = core.decoder.camera().map(|camera| (camera.width, camera.height));
    let other = size.filter(|size| *size != (picture.width, picture.height));
    let _memory = other.map(|size| core.limits.decoder(size)).transpose()?;
    work.is_drawn = core.decoder.draw(pose, picture)?;
    Ok(())
}

/// Reads a packet and copies it to its slot.
fn fill(core: &Core, work: &mut PacketWork, packet: &[u8], trust: Trust) -> Result<(), Failure> {
    work.trust = trust;
    // No packet of its size is longer than this; what follows it is padding.
    work.parsed = core.decoder.parse(packet);
    let size = work.parsed.as_ref().ok().and_then(|parsed| core.decoder.size_told(parsed));
    let longest = size.map_or(0, |(width, height)| packet_bound(width, height));
    let longest = longest.max(LONGEST_HEAD);
    work.bytes.clear();
    let refused = |_| Failure::at(NVSP_ERR_MEMORY, "a copy of the packet");
    work.bytes.try_reserve(longest).map_err(refused)?;
    work.bytes.extend_from_slice(&packet[..packet.len().min(longest)]);
    Ok(())
}

/// Writes all of it, or nothing.
fn fetch(
    decoded: &Decoded,
    keys: Option<&Verifier>,
    picture: Out<nvsp_picture>,
    out: &Checked<nvsp_decoded>,
) -> Result<(), Failure> {
    if !picture.is_null() {
        image::write(&decoded.picture, picture)?;
    }
    let taken = keys.map_or(0, |keys| taken_of(keys.seen()));
    out.write(&nvsp_decoded { taken, ..decoded_of(decoded) });
    Ok(())
}

/// What a packet yielded.
pub(super) fn decoded_of(decoded: &Decoded) -> nvsp_decoded {
    nvsp_decoded {
        frame: decoded.frame,
        width: decoded.picture.width,
        height: decoded.picture.height,
        flags: flags_of(decoded),
        rows: decoded.rows,
        position_deviation: decoded.known.map_or(f64::INFINITY, |known| known.position),
        rotation_deviation: decoded.known.map_or(f64::INFINITY, |known| known.rotation),
        damage: decoded.damage.as_ref().map_or(NVSP_OK, of_library),
        pose: image::pose_out(&decoded.pose),
        reference: decoded.reference.unwrap_or(0),
        ..zeroed()
    }
}

/// As nvsp_decoded.flags has them.
fn flags_of(decoded: &Decoded) -> u32 {
    flag(decoded.uncertain, super::encoder::NVSP_FRAME_UNCERTAIN)
        | flag(decoded.known.is_some(), super::encoder::NVSP_FRAME_POSITION_KNOWN)
        | flag(!decoded.portable, super::encoder::NVSP_FRAME_NOT_PORTABLE)
        | flag(decoded.reference.is_some(), NVSP_DECODED_INTER)
        | flag(decoded.kept, NVSP_DECODED_KEPT)
        | flag(decoded.filtered, NVSP_DECODED_FILTERED)
        | flag(decoded.same_render == Some(true), NVSP_DECODED_SAME_RENDER)
        | flag(decoded.same_render == Some(false), NVSP_DECODED_OTHER_RENDER)
}
