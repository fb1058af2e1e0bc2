//! The encoder's handle.

use std::time::Duration;

use nvsprior::image::Converter;
use nvsprior::residual::Tune;
use nvsprior::tracking::{StartKind, Stop};
use nvsprior::truth::BLOCK;
use nvsprior::{
    Encoded, Encoder, EncoderOptions, Mode, Rate, RenderChecks, Structure, packet_bound,
};
use nvsprior_link::keys::{Authenticator, Content, MAX_TAG_BYTES};

use super::encoding::{Encoding, GivenFrame, nvsp_encoder};
use super::engine::{EngineContent, nvsp_engine};
use super::frame::{self, nvsp_frame_info};
use super::handle::Handle;
use super::image::{self, nvsp_camera, nvsp_image, nvsp_picture, nvsp_pose};
use super::keys::{keys_of, nvsp_keys};
use super::limits::Limits;
use super::prior::nvsp_prior;
use super::slices::Room;
use super::status::*;
use super::structs::{Checked, In, Out, Place, flag, number, versioned, zeroed};

/// Quality 10.
pub const NVSP_RATE_DEFAULT: u32 = 0;
/// Quality of the difference picture, 0 to 100.
pub const NVSP_RATE_QUALITY: u32 = 1;
/// Bytes of the whole packet, never exceeded; 0 to 4,294,967,295.
pub const NVSP_RATE_BYTES: u32 = 2;
/// PSNR to reach with as few bytes as possible, dB; above 0, up to 100.
pub const NVSP_RATE_PSNR: u32 = 3;
/// No difference picture: the pose alone.
pub const NVSP_RATE_NONE: u32 = 4;
/// Bytes of a steady packet, for links: one that also states prior and camera, or has a check of the render, has as
/// many more as these take, so that its difference picture is as fine. If these and the pose alone take more, the
/// packet has them alone. 0 to 4,294,967,295.
pub const NVSP_RATE_STEADY: u32 = 5;

/// All squared errors count alike.
pub const NVSP_TUNE_PSNR: u32 = 0;
/// Texture hides errors: they count less in it. Errors of colour count half. SSIM is higher, and PSNR up to 0.3 dB
/// lower at the same bytes.
pub const NVSP_TUNE_SSIM: u32 = 1;
/// Errors count more in parts of the picture that the prior does not show. So a new thing shows first.
pub const NVSP_TUNE_DETECTION: u32 = 2;

/// For nvsp_encoder_options.mode. Every frame is intra: a lost packet costs its own frame.
pub const NVSP_MODE_INTRA: u32 = 0;
/// A frame is predicted from the one before. Saves most; a lost packet spoils all frames up to the next key frame.
pub const NVSP_MODE_CHAIN: u32 = 1;
/// Layers: every other frame is the reference of none, and every fourth of more. A lost packet spoils fewer frames.
pub const NVSP_MODE_LAYERS: u32 = 2;
/// A frame is predicted from the last key frame. A lost packet costs its own frame, unless it is the key frame.
pub const NVSP_MODE_KEYS: u32 = 3;
/// A frame is predicted from the newest one that nvsp_encoder_acknowledge has told of. A lost packet costs its own
/// frame.
pub const NVSP_MODE_ACKNOWLEDGED: u32 = 4;
/// NVSP_KEY_ONCE.
const KEY_ONCE: u32 = 0xFFFF_FF00;
/// Bits of nvsp_encoder_options.mode below the key interval: see NVSP_KEY_EVERY.
const KEY_SHIFT: u32 = 8;

/// For nvsp_encoder_options.camera_interval: prior and camera are stated with the first frame only.
pub const NVSP_CAMERA_ONCE: u32 = u32::MAX;

/// How to encode; all zero: the defaults.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_encoder_options {
    pub struct_size: u32,
    pub abi_version: u32,
    /// NVSP_RATE_*: it sets how fine the difference picture is.
    pub rate: u32,
    /// The number that `rate` takes: quality, bytes or dB; 0 for NVSP_RATE_DEFAULT and NVSP_RATE_NONE, which take none.
    pub rate_value: f32,
    /// NVSP_MODE_*: whether difference pictures are predicted from those of earlier frames. They then take fewer bytes,
    /// and the encoder about 327 more bytes of host memory per pixel. A frame whose reference is missing is shown as
    /// the prior's render alone: nvsp_decoded.damage is then NVSP_ERR_REFERENCE. A key frame, which is intra, ends what
    /// a loss has spoiled: say how often they come by NVSP_MODE_CHAIN | NVSP_KEY_EVERY(8), for example; else after
    /// every 16 frames. If the device is not portable, all frames are intra.
    pub mode: u32,
    /// State prior and camera (29 bytes) again after this many frames, for a topside that missed them; 0: 64. Until the
    /// topside has acknowledged a frame (nvsp_encoder_acknowledge), and always if the device is not portable, a check
    /// of the render (6 bytes) comes with them. It tells the topside whether its render is the same.
    pub camera_interval: u32,
    /// Number of the first frame; packets carry it modulo 2^16.
    pub first_frame: u32,
    /// How long a frame may be searched for: NVSP_BOUND_RENDERS(n) or NVSP_BOUND_MILLISECONDS(n). 0: 96 renders.
    pub search_bound: u32,
    /// Not 0: images come already treated as nvsp_prior_info.white_balance and clahe_tiles say, so they are encoded as
    /// they are. 0: the encoder treats them, whatever their format, after it has brought them to the camera's size.
    pub frames_treated: u32,
    /// Not 0: two frames may be under way at once, see nvsp_encode_begin. While one thread codes the difference picture
    /// of a frame, another searches for the pose of the next. So more frames per second are encoded, and each packet is
    /// the same, byte for byte. Takes about twice the host memory. 0: one frame at a time.
    pub pipelined: u32,
    /// Not 0: packets tell the topside nothing of how far its picture is from what the camera saw. 0: they have a truth
    /// map, of 8 % of the packet or its budget at most, or six bytes: see nvsp_decoder_get_truth. With NVSP_RATE_NONE
    /// there is none.
    pub no_truth: u32,
    /// NVSP_TUNE_*: what counts when bits are given to one part of the difference picture and taken from another. The
    /// topside needs not know.
    pub tune: u32,
    /// Each packet gets a number and a tag by these keys. They take nvsp_keys.tag_bytes and 2 bytes of it; budgets
    /// count them. Read during nvsp_encoder_create. NULL: none, also if an nvsp_vehicle sends the packets: it gets the
    /// keys.
    pub keys: In<nvsp_keys>,
}
versioned!(nvsp_encoder_options, 56);

/// The picture does not confirm the pose. The encoder looks for it again at every frame.
pub const NVSP_FRAME_UNCERTAIN: u32 = 1;
/// The rate was not kept: the budget holds no difference picture, or the best one does not reach
/// the PSNR.
pub const NVSP_FRAME_RATE_MISSED: u32 = 4;

/// The picture does not determine one direction of the pose: see nvsp_frame_stats.pose_covariance.
pub const NVSP_FRAME_UNDETERMINED: u32 = 8;

/// The position is known within position_deviation and rotation_deviation. Navigate by no other: that the picture is
/// confirmed (NVSP_FRAME_UNCERTAIN is not set) does not say where the camera is.
pub const NVSP_FRAME_POSITION_KNOWN: u32 = 128;

/// The frame's time ended its search: see NVSP_BOUND_MILLISECONDS. The search goes on in the next frames.
pub const NVSP_FRAME_OUT_OF_TIME: u32 = 16;

/// A device is not portable: the topside's render, and its picture, may differ from the vehicle's in the last bit of a
/// colour. In nvsp_frame_stats this is the encoder's device. In nvsp_decoded it is one of the two, or the vehicle's by
/// nvsp_decode_header.
pub const NVSP_FRAME_NOT_PORTABLE: u32 = 2;

/// The frame started from the pose given with it.
pub const NVSP_START_HINT: u32 = 0;
/// It started from the pose of the frame before.
pub const NVSP_START_PREVIOUS: u32 = 1;
/// It started from the pose that constant velocity predicts.
pub const NVSP_START_PREDICTED: u32 = 2;
/// No start was near, and no pose was given: it started from the best one at hand.
pub const NVSP_START_UNCERTAIN: u32 = 3;
/// The prior's key frames yielded the start.
pub const NVSP_START_KEY_FRAME: u32 = 4;

/// The gradient became small enough.
pub const NVSP_STOP_GRADIENT: u32 = 0;
/// The steps became small enough.
pub const NVSP_STOP_PROGRESS: u32 = 1;
/// No step made the error smaller.
pub const NVSP_STOP_NO_DESCENT: u32 = 2;
/// No iterations were left.
pub const NVSP_STOP_ITERATIONS: u32 = 3;

/// What encoding a frame took and yielded.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_frame_stats {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Number of the frame.
    pub frame: u32,
    /// Bytes of the packet, number and tag counted.
    pub bytes: u32,
    /// Bytes of its latent part, which makes a picture by itself.
    pub latent_bytes: u32,
    /// Bytes of the packet that its truth map takes; 0: it has none, or one that takes none.
    pub truth_bytes: u32,
    /// Renders of the prior at full resolution that the frame took.
    pub full_renders: u32,
    /// NVSP_START_*.
    pub start: u32,
    /// NVSP_STOP_*: why the refinement ended.
    pub stop: u32,
    /// NVSP_FRAME_UNCERTAIN, NVSP_FRAME_RATE_MISSED, NVSP_FRAME_UNDETERMINED, NVSP_FRAME_NOT_PORTABLE,
    /// NVSP_FRAME_POSITION_KNOWN and NVSP_FRAME_OUT_OF_TIME bits.
    pub flags: u32,
    /// PSNR of the prior's render against the frame, dB. If the prior has a preprocessing, the frame is the treated
    /// one, here and below: figures of priors of different preprocessing cannot be compared.
    pub render_psnr: f64,
    /// PSNR of what the topside will show against the frame, dB.
    pub psnr: f64,
    /// Time that the frame took, milliseconds, without scaling and conversion.
    pub milliseconds: f64,
    /// The pose as the packet holds it.
    pub pose: nvsp_pose,
    /// How far the pose may be off: its covariance, as nvsp_frame_info.hint_covariance states one (6 × 6, row by row:
    /// translation along the camera's axes in the prior's unit, then turns about them in radians). The root of a value
    /// on the diagonal is the standard deviation along an axis. An axis that is open has an infinite variance, and 0
    /// beside it; so have all with NVSP_FRAME_UNCERTAIN.
    pub pose_covariance: [f64; 36],
    /// With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of the position along an axis (the prior's
    /// unit), as the packet states it; else infinite.
    pub position_deviation: f64,
    /// With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of a turn about an axis (radians); else
    /// infinite.
    pub rotation_deviation: f64,
    /// The largest eigenvalue of the normal equations divided by the smallest: the best determined
    /// direction of the pose against the least determined. Infinite if the picture does not
    /// determine one direction at all.
    pub pose_condition: f64,
    /// Frames since the last certain one, or since the encoder was made or reset. This frame counts; 0 if it is
    /// certain.
    pub frames_since_certain: u32,
    /// How many frames before this one the frame came that its difference picture is predicted from; 0: it is intra.
    pub reference_distance: u32,
    /// With keys: the number of the next packet. Else 0. See nvsp_keys.number.
    pub next_number: u64,
}
versioned!(nvsp_frame_stats, 456);

/// Makes an encoder for frames of `camera`. Allocates what every frame takes, on host and device. The first frame still
/// allocates on the host what depends on its content and options, and has the driver compile; so encode one at the
/// quay. With NVSP_BOUND_MILLISECONDS the driver compiles here, and one render and one coding are measured.
/// Later frames allocate nothing, unless a view of the prior needs more room on the device than any before it.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST; the text is the engine's.
///
/// # Parameters
/// - `prior`: a live prior that was opened with `engine`.
/// - `camera`: size, focal lengths and principal point, pixels.
/// - `options`: how; NULL: all defaults.
/// - `encoder`: receives the encoder, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_create(
    engine: Option<&nvsp_engine>,
    prior: Option<&nvsp_prior>,
    camera: In<nvsp_camera>,
    options: In<nvsp_encoder_options>,
    encoder: Place<Box<nvsp_encoder>>,
) -> nvsp_status {
    nvsp_engine::share(engine, |handle, engine| {
        let encoder = encoder.required("encoder")?;
        let options = options.read()?;
        let made = encoding(&engine, prior, camera, &options, |_| {})?;
        encoder.write(Handle::boxed(made, handle.log()));
        Ok(NVSP_OK)
    })
}

/// Makes an encoder; `change` has the last word on its options.
pub(super) fn encoding(
    engine: &EngineContent,
    prior: Option<&nvsp_prior>,
    camera: In<nvsp_camera>,
    options: &nvsp_encoder_options,
    change: impl FnOnce(&mut EncoderOptions),
) -> Result<Encoding, Failure> {
    let scene = nvsp_prior::of(prior, "prior")?.scene_of(engine)?;
    let camera = image::camera(camera)?;
    let (pipelined, rate) = (options.pipelined != 0, options.rate);
    let keys = keys_of(options.keys)?;
    let authenticator = keys.map(|keys| Authenticator::new(&keys, Content::Packet));
    let overhead = authenticator.as_ref().map_or(0, Authenticator::overhead);
    let mut options = encoder_options(options, overhead)?;
    change(&mut options);
    let stream = options.mode != Mode::Intra;
    let key_frames = scene.key_frames().poses().len();
    let limits = Limits { stream, key_frames, ..engine.how.limits };
    let _memory = if pipelined { limits.pipelined(&camera)? } else { limits.encoder(&camera)? };
    let wanted = options.rate;
    let mut made = Encoder::new(&engine.engine, &scene, &camera, options)?;
    set_rate(&mut made, rate, wanted);
    let converter = Converter::new(camera.width, camera.height)?;
    let threads = engine.how.threads;
    Ok(Encoding::new(made, converter, limits, pipelined, authenticator, threads))
}

fn encoder_options(
    options: &nvsp_encoder_options,
    overhead: usize,
) -> Result<EncoderOptions, Failure> {
    let mut made = EncoderOptions {
        rate: rate(options.rate, options.rate_value, overhead, RATE)?,
        mode: mode(options.mode)?,
        render_checks: RenderChecks::AsNeeded,
        first_frame: options.first_frame,
        frames_treated: options.frames_treated != 0,
        truth: options.no_truth == 0,
        ..EncoderOptions::default()
    };
    made.tune = match options.tune {
        NVSP_TUNE_PSNR => Tune::Psnr,
        NVSP_TUNE_SSIM => Tune::Ssim,
        NVSP_TUNE_DETECTION => Tune::Detection,
        _ => return Err(Failure::argument("nvsp_encoder_options.tune")),
    };
    match options.camera_interval {
        0 => {}
        NVSP_CAMERA_ONCE => made.camera_interval = 0,
        interval => made.camera_interval = interval,
    }
    match options.search_bound {
        0 => {}
        renders @ ..MILLISECONDS => made.refine.lost_renders = renders,
        MILLISECONDS => return Err(Failure::argument("nvsp_encoder_options.search_bound")),
        time => made.frame_time = Some(Duration::from_millis((time & !MILLISECONDS).into())),
    }
    Ok(made)
}

/// The bit of nvsp_encoder_options.search_bound by which it is a time: see NVSP_BOUND_MILLISECONDS.
const MILLISECONDS: u32 = 1 << 31;

fn mode(mode: u32) -> Result<Mode, Failure> {
    let interval = mode >> KEY_SHIFT;
    let key_every = match interval {
        0 => 16,
        _ if mode >= KEY_ONCE => 0,
        frames => frames,
    };
    Ok(match mode & !KEY_ONCE {
        NVSP_MODE_CHAIN => Mode::Stream(Structure::Chain { key_every }),
        NVSP_MODE_LAYERS => Mode::Stream(Structure::Layers { key_every }),
        NVSP_MODE_KEYS => Mode::Stream(Structure::Keys { key_every }),
        NVSP_MODE_INTRA if interval == 0 => Mode::Intra,
        NVSP_MODE_ACKNOWLEDGED if interval == 0 => Mode::Stream(Structure::Acknowledged),
        _ => return Err(Failure::argument("nvsp_encoder_options.mode")),
    })
}

/// The rate that `mode` and `value` state, without the bytes of a tag; `fields` names both in errors.
fn rate(
    mode: u32,
    value: f32,
    overhead: usize,
    fields: [&'static str; 2],
) -> Result<Option<Rate>, Failure> {
    let whole = 0.0..=u32::MAX as f32;
    match mode {
        NVSP_RATE_DEFAULT if value == 0.0 => Ok(EncoderOptions::default().rate),
        NVSP_RATE_NONE if value == 0.0 => Ok(None),
        NVSP_RATE_QUALITY if (0.0..=100.0).contains(&value) => Ok(Some(Rate::Quality(value))),
        NVSP_RATE_BYTES | NVSP_RATE_STEADY if whole.contains(&value) => {
            Ok(Some(Rate::Bytes((value as usize).saturating_sub(overhead))))
        }
        NVSP_RATE_PSNR if value > 0.0 && value <= 100.0 => Ok(Some(Rate::Psnr(value.into()))),
        ..=NVSP_RATE_STEADY => Err(Failure::argument(fields[1])),
        _ => Err(Failure::argument(fields[0])),
    }
}

/// The fields of nvsp_encoder_options that state the rate.
const RATE: [&str; 2] = [
    "nvsp_encoder_options.rate: no rate of this library",
    "nvsp_encoder_options.rate_value: out of the range of `rate`, or stated for one that takes none",
];

/// Sets the rate of all frames from here on.
///
/// Fails with NVSP_ERR_ARGUMENT.
///
/// # Parameters
/// - `mode`: NVSP_RATE_*.
/// - `value`: the number that the mode takes: quality 0 to 100, bytes, or dB. NVSP_RATE_DEFAULT and NVSP_RATE_NONE take
///   none: 0.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_set_rate(
    encoder: Option<&nvsp_encoder>,
    mode: u32,
    value: f32,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let fields = ["mode", "value: out of the range of `mode`, or not 0"];
        content.check_own()?;
        let rate = rate(mode, value, content.overhead(), fields)?;
        set_rate(&mut content.core()?.encoder, mode, rate);
        Ok(NVSP_OK)
    })
}

fn set_rate(encoder: &mut Encoder, mode: u32, rate: Option<Rate>) {
    match (mode, rate) {
        (NVSP_RATE_STEADY, Some(Rate::Bytes(bytes))) => encoder.set_steady_bytes(bytes),
        _ => encoder.set_rate(rate),
    }
}

/// Has the next packet state prior and camera. In a stream its frame is intra. Call it if a topside asks what the
/// packets are about, or if a packet was not sent.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_announce(encoder: Option<&nvsp_encoder>) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        content.core()?.encoder.announce();
        Ok(NVSP_OK)
    })
}

/// Tells the encoder that the topside has decoded a frame in full: nvsp_decoded.flags had NVSP_DECODED_KEPT. With
/// NVSP_MODE_ACKNOWLEDGED later frames are predicted from it; else nothing changes. Nor does anything if the frame
/// is unknown or too old: the last 32 can be reference frames.
///
/// # Parameters
/// - `frame`: nvsp_decoded.frame.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_acknowledge(
    encoder: Option<&nvsp_encoder>,
    frame: u32,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        content.core()?.encoder.acknowledge(frame);
        Ok(NVSP_OK)
    })
}

/// Sets another camera, or another size, for all frames from here on; the next packet carries it. Lens and mask stay.
/// Allocates as nvsp_encoder_create and nvsp_encoder_set_lens do. If it fails, the old camera stays.
///
/// Fails with NVSP_ERR_ARGUMENT (the camera, or lens or mask do not fit it), NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or
/// NVSP_ERR_DEVICE_LOST.
///
/// # Parameters
/// - `camera`: size, focal lengths and principal point, pixels.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_set_camera(
    encoder: Option<&nvsp_encoder>,
    camera: In<nvsp_camera>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let camera = image::camera(camera)?;
        let mut core = content.core()?;
        let optics = core.optics.clone();
        core.look(optics, camera)?;
        Ok(NVSP_OK)
    })
}

/// Renders up to `most` of the prior's key frames that are not rendered yet, and waits for them. With them the encoder
/// finds a camera that it has lost. Without this call they are rendered while a frame is lost, as many as
/// nvsp_encoder_options.search_bound allows. After nvsp_encoder_set_camera or nvsp_encoder_reopen they are rendered
/// again.
///
/// Fails with NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
///
/// # Parameters
/// - `most`: key frames to render at most; 0: only count those that are left.
/// - `left`: receives how many are not rendered yet. NULL: not wanted.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_prepare(
    encoder: Option<&nvsp_encoder>,
    most: u32,
    left: Place<u32>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let mut core = content.core()?;
        let _memory = core.memory()?;
        let remaining = core.encoder.prepare(most as usize)?;
        left.write(number(remaining));
        Ok(NVSP_OK)
    })
}

/// Goes on with `prior`, opened again after its device was lost, or opened on another engine. It
/// must have the same identity. Frame numbers and poses carry over. If it fails, nothing changes.
/// See nvsp_engine_reopen.
///
/// Fails with NVSP_ERR_OTHER_PRIOR, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
///
/// # Parameters
/// - `prior`: a live prior that was opened with `engine`.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_reopen(
    encoder: Option<&nvsp_encoder>,
    engine: Option<&nvsp_engine>,
    prior: Option<&nvsp_prior>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let engine = nvsp_engine::of(engine, "engine")?;
        let scene = nvsp_prior::of(prior, "prior")?.scene_of(&engine)?;
        let mut core = content.core()?;
        core.chill();
        let _memory = core.memory()?;
        core.encoder.move_to(&engine.engine, &scene)?;
        Ok(NVSP_OK)
    })
}

/// Forgets all earlier frames: the next one is searched for as the first was, and may have any
/// time. Frame numbers go on. Call it if somebody carried the camera elsewhere, for example.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_reset(encoder: Option<&nvsp_encoder>) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        content.core()?.encoder.reset();
        Ok(NVSP_OK)
    })
}

/// For nvsp_size_bound: a packet, with number and tag by any keys. With NVSP_RATE_BYTES the budget's size is enough,
/// too.
pub const NVSP_SIZE_PACKET: u32 = 0;
/// A truth map: a byte for each block.
pub const NVSP_SIZE_TRUTH: u32 = 1;

/// Tells how many bytes always suffice for a packet or a truth map of a picture of this size; 0 if no camera can have
/// it.
///
/// # Parameters
/// - `of`: NVSP_SIZE_*.
/// - `width`, `height`: the camera's size, pixels.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_size_bound(of: u32, width: u32, height: u32) -> usize {
    const KEYS: usize = 2 + MAX_TAG_BYTES;
    let sides = 1..=nvsprior::Camera::MAX_SIDE;
    match of {
        _ if !sides.contains(&width) || !sides.contains(&height) => 0,
        NVSP_SIZE_PACKET => packet_bound(width, height) + KEYS,
        NVSP_SIZE_TRUTH => width.div_ceil(BLOCK) as usize * height.div_ceil(BLOCK) as usize,
        _ => 0,
    }
}

/// Encodes a frame into `packet`. First the frame is treated as the prior's preprocessing says, unless
/// nvsp_encoder_options.frames_treated says that it is. Waits for a lock of the device's queue, and for the device.
/// Uses the hint in `info` if the frame before yields no good start. Without a hint, the prior's key frames find the
/// first frame. Allocates nothing from the second frame on, unless a view of the prior needs more room on the device
/// than any before it.
///
/// The text of NVSP_ERR_ARGUMENT names the field of `info`. The same frames, poses and calls yield the same packets,
/// byte for byte, on the same device and driver.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_IMAGE, NVSP_ERR_UNSUPPORTED, NVSP_ERR_NO_START, NVSP_ERR_BUDGET,
/// NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST: the encoder then acts as if it had not seen the frame.
/// Fails also with NVSP_ERR_BUFFER_TOO_SMALL: the packet is then kept until the next frame is encoded, and
/// nvsp_encode_finish fetches it.
///
/// # Safety
/// - `image`: the frame.
/// - `info`: what is known of the frame. NULL: nothing is known.
/// - `packet`: receives the packet.
/// - `size`: bytes of `packet`; nvsp_size_bound always suffices.
/// - `written`: receives the packet's length, bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
/// - `stats`: receives what the frame took. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_encode(
    encoder: Option<&nvsp_encoder>,
    image: In<nvsp_image>,
    info: In<nvsp_frame_info>,
    packet: *mut u8,
    size: usize,
    written: Place<usize>,
    stats: Out<nvsp_frame_stats>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        // SAFETY: `size` bytes stand at `packet`, see `# Safety`.
        let room = unsafe { Room::new(packet, size, written, "packet")? };
        let stats = stats.optional()?;
        content.check_own()?;
        // SAFETY: the planes are the image's during this call, see `# Safety`.
        content.run(&unsafe { given(image, info)? })?;
        content.take(|encoded, keys| write(encoded, keys, room, &stats))
    })
}

/// Begins to encode a frame on the encoder's own thread. Before it returns, on the calling thread, it checks all that
/// it was given and reads the image: it converts it to RGB and scales it to the camera's size. The first such call
/// starts the thread, which blocks all signals. The prior's preprocessing, the search and the coding are the other
/// thread's work. The call neither waits for the device nor allocates, except for the thread. Afterwards the image is
/// yours again.
///
/// Until nvsp_encode_finish or nvsp_cancel ends the frame, other calls on the encoder fail with
/// NVSP_ERR_UNFINISHED, except nvsp_wait and nvsp_destroy. So no packet is dropped unless you say so.
/// Only a packet that nvsp_encode or nvsp_encode_finish had no room for is dropped by the next frame.
///
/// With nvsp_encoder_options.pipelined a second frame may be begun at any time while one is under way or not fetched.
/// No packet is dropped then: a third frame fails with NVSP_ERR_UNFINISHED. Frames end in the order in which they were
/// begun; nvsp_wait and nvsp_encode_finish are about the first. Other calls may be made while no frame is
/// searched for, and are about the frames begun later; nvsp_encoder_get_picture is about the frame finished last. If
/// coding a frame fails, it counts as one whose packet was lost on the way. Host memory is taken up to the third frame.
/// Example, which is always one packet behind:
///
/// ```c
/// while (next_image(&image)) {
///     status = nvsp_encode_begin(encoder, &image, NULL); /* the first with a hint in place of NULL */
///     if (status == NVSP_OK && ++begun == 2) {
///         while (nvsp_wait(encoder, 20) == NVSP_PENDING) steer();
///         status = nvsp_encode_finish(encoder, packet, sizeof packet, &bytes, &stats);
///         begun--;
///     }
/// }
/// ```
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_IMAGE, NVSP_ERR_UNSUPPORTED or NVSP_ERR_MEMORY (no thread). If the frame
/// itself fails, nvsp_encode_finish returns its status.
///
/// # Safety
/// - `image`: the frame.
/// - `info`: as for nvsp_encode.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_encode_begin(
    encoder: Option<&nvsp_encoder>,
    image: In<nvsp_image>,
    info: In<nvsp_frame_info>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        content.check_own()?;
        // SAFETY: the planes are the image's during this call, see `# Safety`.
        content.begin(&unsafe { given(image, info)? })?;
        Ok(NVSP_OK)
    })
}

/// Fetches the packet of the frame that was begun, or the packet that nvsp_encode had no room for. Returns NVSP_PENDING
/// if the frame has not ended.
///
/// Fails with NVSP_ERR_STATE if there is none, and as nvsp_encode does. After NVSP_ERR_BUFFER_TOO_SMALL the packet is
/// still there.
///
/// # Safety
/// - `packet`: receives the packet.
/// - `size`: bytes of `packet`; nvsp_size_bound always suffices.
/// - `written`: receives the packet's length, bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
/// - `stats`: receives what the frame took. NULL: not wanted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_encode_finish(
    encoder: Option<&nvsp_encoder>,
    packet: *mut u8,
    size: usize,
    written: Place<usize>,
    stats: Out<nvsp_frame_stats>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        // SAFETY: `size` bytes stand at `packet`, see `# Safety`.
        let room = unsafe { Room::new(packet, size, written, "packet")? };
        let stats = stats.optional()?;
        content.check_own()?;
        content.take(|encoded, keys| write(encoded, keys, room, &stats))
    })
}

/// What the topside will show of the last frame.
pub const NVSP_PICTURE_SHOWN: u32 = 0;
/// The prior's render alone.
pub const NVSP_PICTURE_RENDER: u32 = 1;

/// Copies a picture of the last frame encoded.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL, or NVSP_ERR_STATE if there is none.
///
/// # Parameters
/// - `which`: NVSP_PICTURE_*.
/// - `picture`: receives the picture. Its pixels are yours.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_encoder_get_picture(
    encoder: Option<&nvsp_encoder>,
    which: u32,
    picture: Out<nvsp_picture>,
) -> nvsp_status {
    nvsp_encoder::call(encoder, |content| {
        let encoded = content.last()?;
        let from = match which {
            NVSP_PICTURE_SHOWN => &encoded.picture,
            NVSP_PICTURE_RENDER => &encoded.render,
            _ => return Err(Failure::argument("which picture")),
        };
        image::write(from, picture)?;
        Ok(NVSP_OK)
    })
}

/// Reads what a caller hands over of a frame.
///
/// # Safety
/// As for [`image::view`].
pub(super) unsafe fn given<'a>(
    image: In<nvsp_image>,
    info: In<nvsp_frame_info>,
) -> Result<GivenFrame<'a>, Failure> {
    // SAFETY: the planes are as the image says, see `# Safety`.
    let (image, _readings) = unsafe { image::view(image)? };
    Ok(GivenFrame { image, _readings, known: frame::known(info)? })
}

/// Writes all of a packet and its figures, or nothing. A packet that does not fit uses no number.
fn write(
    encoded: &Encoded,
    mut keys: Option<&mut Authenticator>,
    mut room: Room,
    place: &Checked<nvsp_frame_stats>,
) -> Result<(), Failure> {
    let Encoded { packet, stats, pose, .. } = encoded;
    let overhead = keys.as_ref().map_or(0, |keys| keys.overhead());
    room.fill(overhead + packet.len(), |into| {
        into[overhead..].copy_from_slice(packet);
        if let Some(keys) = &mut keys {
            keys.seal(0, into);
        }
    })?;
    let loose = stats.observability.undetermined().next().is_some();
    let mut covariance = [0.0; 36];
    covariance.copy_from_slice(stats.covariance.as_flattened());
    place.write(&nvsp_frame_stats {
        frame: stats.frame,
        bytes: (overhead + stats.bytes) as u32,
        latent_bytes: stats.latent_bytes as u32,
        full_renders: stats.full_renders,
        start: match stats.start {
            StartKind::External => NVSP_START_HINT,
            StartKind::Previous => NVSP_START_PREVIOUS,
            StartKind::Predicted => NVSP_START_PREDICTED,
            StartKind::BestOfBad => NVSP_START_UNCERTAIN,
            StartKind::KeyFrame => NVSP_START_KEY_FRAME,
        },
        stop: match stats.stop {
            Stop::Gradient => NVSP_STOP_GRADIENT,
            Stop::Progress => NVSP_STOP_PROGRESS,
            Stop::NoDescent => NVSP_STOP_NO_DESCENT,
            Stop::Iterations => NVSP_STOP_ITERATIONS,
        },
        flags: flag(!stats.certain, NVSP_FRAME_UNCERTAIN)
            | flag(!stats.rate_kept, NVSP_FRAME_RATE_MISSED)
            | flag(loose, NVSP_FRAME_UNDETERMINED)
            | flag(stats.known.is_some(), NVSP_FRAME_POSITION_KNOWN)
            | flag(stats.out_of_time, NVSP_FRAME_OUT_OF_TIME)
            | flag(!stats.portable, NVSP_FRAME_NOT_PORTABLE),
        render_psnr: stats.render_psnr,
        psnr: stats.psnr,
        milliseconds: stats.milliseconds,
        pose: image::pose_out(pose),
        pose_covariance: covariance,
        position_deviation: stats.known.map_or(f64::INFINITY, |known| known.position),
        rotation_deviation: stats.known.map_or(f64::INFINITY, |known| known.rotation),
        pose_condition: stats.observability.condition,
        frames_since_certain: stats.frames_since_certain,
        reference_distance: stats
            .reference
            .map_or(0, |reference| stats.frame.wrapping_sub(reference)),
        truth_bytes: stats.truth_bytes as u32,
        next_number: keys.map_or(0, |keys| keys.next_number()),
        ..zeroed()
    });
    Ok(())
}
