//! The prior's handle.

use std::ffi::{OsStr, c_char};
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::sync::Arc;

use nvsprior::image::{Preprocessing, WhiteBalance};
use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::prior::{CoordinateFrame, PriorClaims, extras_file};
use nvsprior::render::{BlockReader, Scene};
use nvsprior::{Camera, Prior, RenderOptions, RenderOverrides};

use super::engine::{EngineContent, nvsp_engine};
use super::handle::{Content, Handle};
use super::image::nvsp_camera;
use super::limits::{self, Limits};
use super::log::{NVSP_LOG_INFO, NVSP_LOG_WARNING};
use super::memory::Grant;
use super::slices::{optional_slice, text};
use super::status::*;
use super::structs::{In, Out, Place, number, versioned, zeroed};
use super::thread::Thread;

/// A trained scene on the device. Example:
///
/// ```c
/// nvsp_prior *prior = NULL;
/// if (nvsp_prior_open(engine, "reef.nvsg", NULL, &prior) != NVSP_OK) {
///     char text[512];
///     nvsp_last_error(engine, text, sizeof text);
///     fputs(text, stderr);
/// }
/// ```
pub type nvsp_prior = Handle<PriorContent>;

impl Content for PriorContent {}

/// What a prior's handle holds.
#[derive(Clone)]
pub(super) struct PriorContent {
    pub scene: Arc<Scene>,
    info: nvsp_prior_info,
}

/// `near_plane` is given.
pub const NVSP_PRIOR_NEAR: u32 = 1;
/// `alpha_max` is given.
pub const NVSP_PRIOR_ALPHA_MAX: u32 = 2;
/// `antialiased` is given.
pub const NVSP_PRIOR_ANTIALIASED: u32 = 4;
/// `background` is given.
pub const NVSP_PRIOR_BACKGROUND: u32 = 8;
/// `trained_focal` is given.
pub const NVSP_PRIOR_TRAINED_FOCAL: u32 = 16;

impl PriorContent {
    /// The prior on the engine's device.
    pub(super) fn scene_of(self, engine: &EngineContent) -> Result<Arc<Scene>, Failure> {
        let what = "prior: opened with another engine, or before nvsp_engine_reopen";
        let here = self.scene.is_on(engine.engine.vulkan());
        here.then_some(self.scene).ok_or(Failure::argument(what))
    }
}

/// Where a prior is, and render options that replace those of its file. These are part of the prior's identity: both
/// sides of a link must give the same.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_prior_options {
    pub struct_size: u32,
    pub abi_version: u32,
    /// NVSP_PRIOR_* bits: which of the fields below count.
    pub given: u32,
    /// Splats whose camera z is not above this are culled, in the prior's unit; above 0.
    pub near_plane: f32,
    /// Alpha is clamped to this; between 0 and 1.
    pub alpha_max: f32,
    /// Not 0: gsplat's anti-aliased mode.
    pub antialiased: u32,
    /// Linear RGB behind everything, 0 to 1.
    pub background: [f32; 3],
    /// Most memory for the splats of a prior in blocks (.nvsb), host and device together, MiB; 0: it is loaded whole.
    /// See nvsp_prior_open.
    pub blocks_memory: u32,
    /// Focal length of the pictures that the prior was trained on, pixels, 1 to 1,000,000. With it a prior that does
    /// not state its own serves pictures of other sizes, too.
    pub trained_focal: f32,
    /// Zero.
    pub reserved: u32,
    /// A file's content, in place of its path. Read during nvsp_prior_open. NULL: a file is read.
    pub content: *const u8,
    /// Bytes of it.
    pub content_size: usize,
}
versioned!(nvsp_prior_options, 64);

/// Colours were left as they were.
pub const NVSP_WHITE_BALANCE_NONE: u32 = 0;
/// The means of red, green and blue were brought together, by gains up to 4.
pub const NVSP_WHITE_BALANCE_GRAY_WORLD: u32 = 1;

/// What a prior is.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_prior_info {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Identity of splats, render options and coder tables; packets carry it.
    pub id: u32,
    /// Splats in use.
    pub splats: u32,
    /// Invalid splats of the file, which were left out.
    pub dropped: u32,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
    /// Near plane in use, the prior's unit.
    pub near_plane: f32,
    /// Clamp of alpha in use, between 0 and 1.
    pub alpha_max: f32,
    /// 1: the anti-aliased mode is in use; else 0.
    pub antialiased: u32,
    /// Background in use, linear RGB, 0 to 1.
    pub background: [f32; 3],
    /// Median position of the splats, the prior's unit.
    pub centre: [f32; 3],
    /// Spread of the positions around it, the prior's unit.
    pub spread: f32,
    /// Key frames: poses at which a lost camera is looked for.
    pub key_frames: u32,
    /// NVSP_WHITE_BALANCE_*: how the colours of the pictures that it was trained on were balanced. Encoders do the same
    /// with their frames: see nvsp_encoder_options.frames_treated.
    pub white_balance: u32,
    /// Tiles along a side for CLAHE, by which the contrast of those pictures was equalised, after the white balance; 0:
    /// it was not.
    pub clahe_tiles: u32,
    /// Its clip limit, 1 to 256; 0: none.
    pub clahe_clip_limit: f32,
    /// Trained focal length in use, pixels; 0: none is stated.
    pub trained_focal: f32,
    /// Of a prior in blocks (nvsp_prior_options.blocks_memory), now: blocks on the device; here and below 0 if the
    /// prior is loaded whole.
    pub loaded_blocks: u32,
    /// Splats on the device.
    pub loaded_splats: u32,
    /// Splats that there is room for on the device.
    pub splat_room: u32,
    /// Bytes of splats in host memory.
    pub host_bytes: u64,
    /// How often the blocks on the device changed.
    pub block_changes: u64,
    /// Blocks that a frame waited for: they were not read ahead.
    pub block_waits: u64,
    /// Searches that were done again, since they went further than blocks had been brought.
    pub repeated_searches: u64,
    /// Searches that lacked blocks, since there was no room for all. Their pose may be worse; their picture is whole.
    pub incomplete_searches: u64,
}
versioned!(nvsp_prior_info, 136);

/// What a prior, and an encoder and a decoder of it, may take at most, bytes. A view that shows more of the prior than
/// the device memory was made for makes a frame take more.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_memory_estimate {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Splats that the file claims.
    pub splats: u64,
    /// Host memory while the prior is opened.
    pub prior_host: u64,
    /// Device memory of the prior; while it is opened, as much again if the device has a memory of its own.
    pub prior_device: u64,
    /// Host memory of an encoder; 0 without a camera. The points that it knows key frames by come besides: half a MiB,
    /// and 9.6 KB for each key frame.
    pub encoder_host: u64,
    /// Device memory of an encoder; 0 without a camera.
    pub encoder_device: u64,
    /// Host memory of a decoder; 0 without a camera.
    pub decoder_host: u64,
    /// Device memory of a decoder; 0 without a camera.
    pub decoder_device: u64,
}
versioned!(nvsp_memory_estimate, 64);

/// Reads a prior from a file, checks it and copies it to the device. The content tells the format: a .ply as Inria's
/// trainer and nerfstudio write it, a compact prior (.nvsg) or a prior in blocks (.nvsb); with the feature "formats"
/// also an .spz, .glb, .sog or .compressed.ply. Invalid splats are left out and logged as a warning. The file is not
/// needed afterwards, and no copy of it stays in host memory. While the call runs, host and device together take at
/// most four times the size of a binary .ply, or eight times the size of a text .ply. A file of another format takes
/// more, by the factor by which it is packed.
///
/// Key frames, the poses at which a lost camera is looked for, are read too: from the prior's own file, or, if that is
/// of a foreign format, from the file PATH.nvsx beside it if there is one. They are no part of its identity; `nvsprior
/// key-frames` writes them. If PATH.nvsx is not valid, or about another prior, the call fails with NVSP_ERR_PRIOR.
///
/// Scene coder tables are read from an .nvsg or .nvsb. With them difference pictures take fewer bytes. They are part of
/// the prior's identity: both sides of a link need them. `nvsprior prior tables` writes them.
///
/// A prior may state a preprocessing: how the pictures that it was trained on were treated. Its encoders treat their
/// frames in the same way. It is no part of the identity, and decoding does not depend on it: the topside shows the
/// treated picture.
///
/// With `options.blocks_memory` a prior in blocks (.nvsb, by `nvsprior prior blocks`) stays in its file. Only what
/// cameras see is loaded, within that memory. Pictures and packets are the same. The file must stay as it is as long as
/// the prior is in use. A thread of the library reads blocks ahead. A frame that needs a block which is not there waits
/// for it: see nvsp_prior_info. A frame that sees more than there is room for fails with NVSP_ERR_MEMORY. Render
/// options cannot be given with it. Encoders and decoders that share such a prior work in turn.
///
/// With `options.content` the file's content is in memory. It is not needed afterwards. No file is read: key frames
/// come from that content, and a prior in blocks is loaded whole.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_FILE, NVSP_ERR_PRIOR, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or
/// NVSP_ERR_DEVICE_LOST; the text is the engine's.
///
/// # Safety
/// - `path`: the file's name, ending in NUL. NULL: `options.content` is given.
/// - `options`: how; NULL: all as the file says.
/// - `prior`: receives the prior, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_prior_open(
    engine: Option<&nvsp_engine>,
    path: *const c_char,
    options: In<nvsp_prior_options>,
    prior: Place<Box<nvsp_prior>>,
) -> nvsp_status {
    nvsp_engine::share(engine, |handle, content| {
        let prior = prior.required("prior")?;
        let options = options.read()?;
        let overrides = overrides(&options)?;
        let (bytes, size) = (options.content, options.content_size);
        // SAFETY: so many bytes stand there, as the header asks of these fields.
        let source = match unsafe { optional_slice(bytes, size, "nvsp_prior_options.content")? } {
            // SAFETY: a text stands at `path`, see `# Safety`.
            None => Source::File(unsafe { path_of(path)? }),
            Some(bytes) if path.is_null() => Source::Memory(bytes),
            Some(_) => return Err(Failure::argument("path and nvsp_prior_options.content")),
        };
        if options.blocks_memory != 0 {
            let content = open_blocked(handle, &content, &options, source)?;
            prior.write(Handle::boxed(content, handle.log()));
            return Ok(NVSP_OK);
        }
        let (loaded, _memory) = source.read(&overrides, &content.how.limits)?;
        log_load(handle, &loaded);
        let scene = content.engine.upload(&loaded)?;
        let content = PriorContent { scene, info: info_of(&loaded) };
        prior.write(Handle::boxed(content, handle.log()));
        Ok(NVSP_OK)
    })
}

/// The path that a text is.
///
/// # Safety
/// As for [`text`].
unsafe fn path_of<'a>(path: *const c_char) -> Result<&'a Path, Failure> {
    // SAFETY: as for `text`.
    let path = unsafe { text(path) }.ok_or(Failure::null("path"))?;
    Ok(Path::new(OsStr::from_bytes(path.to_bytes())))
}

/// Where a prior's content is.
enum Source<'a> {
    File(&'a Path),
    Memory(&'a [u8]),
}

impl Source<'_> {
    /// Sets memory aside, then reads the prior. The memory is needed until the prior is on the device.
    fn read(self, overrides: &RenderOverrides, limits: &Limits) -> Result<(Prior, Grant), Failure> {
        match self {
            Source::Memory(bytes) => {
                let grant = limits.prior(bytes, 0)?;
                let prior = Prior::from_bytes(bytes, "memory", overrides);
                Ok((prior.map_err(nvsprior::Error::from)?, grant))
            }
            Source::File(path) => {
                let size = std::fs::metadata(path).map_or(0, |file| file.len());
                let bytes = {
                    let _memory = limits.file(size)?;
                    Prior::read_file(path).map_err(nvsprior::Error::from)?
                };
                let beside = extras_file::path_beside(path);
                let beside = std::fs::metadata(beside).map_or(0, |file| file.len());
                let grant = limits.prior(&bytes, beside)?;
                let prior = Prior::from_file(path, bytes, overrides);
                Ok((prior.map_err(nvsprior::Error::from)?, grant))
            }
        }
    }
}

/// Opens a prior in blocks.
fn open_blocked(
    handle: &Handle<EngineContent>,
    content: &EngineContent,
    options: &nvsp_prior_options,
    source: Source,
) -> Result<PriorContent, Failure> {
    let Source::File(path) = source else {
        let what = "nvsp_prior_options.blocks_memory: blocks are read from a file, not from memory";
        return Err(Failure::argument(what));
    };
    if options.given != 0 {
        let what = "nvsp_prior_options.given: not with blocks_memory";
        return Err(Failure::argument(what));
    }
    let limit = u64::from(options.blocks_memory) << 20;
    let host_bytes = content.how.limits.host_bytes;
    let size = std::fs::metadata(path).map_or(0, |file| file.len());
    // What is known of each block comes to less than its entry in the head.
    let _memory = content.how.limits.blocks_head(size)?;
    let blocked = Arc::new(BlockedPrior::open(path).map_err(nvsprior::Error::from)?);
    let start = content.how.threads;
    let reader = BlockReader {
        spawn: Box::new(move |body| {
            let thread = Thread::spawn(c"nvsp-blocks", start, body).ok()?;
            Some(Box::new(thread))
        }),
        set_aside: Box::new(move |bytes| {
            let grant = Grant::take("a block of a prior", bytes, host_bytes).ok()?;
            Some(Box::new(grant))
        }),
    };
    let text = format!(
        "prior {} of {} splats in {} blocks, {} key frames",
        blocked.id(),
        blocked.len(),
        blocked.blocks().len(),
        blocked.extras().key_frames.len()
    );
    handle.log().write(NVSP_LOG_INFO, &text);
    let scene = content.engine.open_blocked(&blocked, limit, reader)?;
    Ok(PriorContent { scene, info: info_of_blocked(&blocked) })
}

fn info_of_blocked(blocked: &BlockedPrior) -> nvsp_prior_info {
    nvsp_prior_info {
        id: blocked.id().0,
        splats: number(blocked.len()),
        sh_degree: blocked.sh_degree(),
        key_frames: number(blocked.extras().key_frames.len()),
        ..drawn_so(blocked.options(), &blocked.coordinate_frame(), &blocked.extras().preprocessing)
    }
}

fn overrides(options: &nvsp_prior_options) -> Result<RenderOverrides, Failure> {
    let nvsp_prior_options { given, near_plane, alpha_max, antialiased, background, .. } = *options;
    let trained_focal = options.trained_focal;
    let known = NVSP_PRIOR_NEAR
        | NVSP_PRIOR_ALPHA_MAX
        | NVSP_PRIOR_ANTIALIASED
        | NVSP_PRIOR_BACKGROUND
        | NVSP_PRIOR_TRAINED_FOCAL;
    if given & !known != 0 {
        return Err(Failure::argument("nvsp_prior_options.given"));
    }
    if options.reserved != 0 {
        return Err(Failure::argument("nvsp_prior_options.reserved: not zero"));
    }
    let stated = [
        (
            near_plane != 0.0,
            NVSP_PRIOR_NEAR,
            "nvsp_prior_options.near_plane: its bit is not in `given`",
        ),
        (
            alpha_max != 0.0,
            NVSP_PRIOR_ALPHA_MAX,
            "nvsp_prior_options.alpha_max: its bit is not in `given`",
        ),
        (
            antialiased != 0,
            NVSP_PRIOR_ANTIALIASED,
            "nvsp_prior_options.antialiased: its bit is not in `given`",
        ),
        (
            background != [0.0; 3],
            NVSP_PRIOR_BACKGROUND,
            "nvsp_prior_options.background: its bit is not in `given`",
        ),
        (
            trained_focal != 0.0,
            NVSP_PRIOR_TRAINED_FOCAL,
            "nvsp_prior_options.trained_focal: its bit is not in `given`",
        ),
    ];
    // A NaN differs from 0, so it is stated.
    if let Some((_, _, what)) = stated.into_iter().find(|(set, bit, _)| *set && given & bit == 0) {
        return Err(Failure::argument(what));
    }
    Ok(RenderOverrides {
        near: (given & NVSP_PRIOR_NEAR != 0).then_some(near_plane),
        alpha_max: (given & NVSP_PRIOR_ALPHA_MAX != 0).then_some(alpha_max),
        antialiased: (given & NVSP_PRIOR_ANTIALIASED != 0).then_some(antialiased != 0),
        background: (given & NVSP_PRIOR_BACKGROUND != 0).then_some(background),
        trained_focal: (given & NVSP_PRIOR_TRAINED_FOCAL != 0).then_some(trained_focal),
    })
}

fn log_load(handle: &Handle<EngineContent>, prior: &Prior) {
    let log = handle.log();
    for note in prior.report().notes() {
        log.write(NVSP_LOG_WARNING, &format!("prior: {note}"));
    }
    let (splats, key_frames) = (prior.len(), prior.key_frames().len());
    let text = format!("prior {} of {splats} splats, {key_frames} key frames", prior.id());
    log.write(NVSP_LOG_INFO, &text);
}

fn info_of(prior: &Prior) -> nvsp_prior_info {
    let report = prior.report();
    nvsp_prior_info {
        id: prior.id().0,
        splats: number(prior.len()),
        dropped: number(report.read - report.kept),
        sh_degree: prior.splats().sh_degree,
        key_frames: number(prior.key_frames().len()),
        ..drawn_so(prior.options(), &prior.coordinate_frame(), prior.preprocessing())
    }
}

/// Render options, place and preprocessing of a prior; all else is zero.
fn drawn_so(
    options: &RenderOptions,
    frame: &CoordinateFrame,
    preprocessing: &Preprocessing,
) -> nvsp_prior_info {
    let Preprocessing { white_balance, clahe } = *preprocessing;
    nvsp_prior_info {
        near_plane: options.near,
        alpha_max: options.alpha_max,
        antialiased: options.antialiased.into(),
        background: options.background,
        trained_focal: options.trained_focal.unwrap_or(0.0),
        centre: frame.centre,
        spread: frame.spread,
        white_balance: match white_balance {
            WhiteBalance::None => NVSP_WHITE_BALANCE_NONE,
            WhiteBalance::GrayWorld => NVSP_WHITE_BALANCE_GRAY_WORLD,
        },
        clahe_tiles: clahe.map_or(0, |clahe| clahe.tiles().into()),
        clahe_clip_limit: clahe.map_or(0.0, |clahe| clahe.clip_limit()),
        ..zeroed()
    }
}

/// Estimates the memory that a prior takes, before it is loaded, from the first 64 KiB of its file: what
/// nvsp_engine_options.host_memory_limit is compared with. The file may claim what is not true: then opening it fails.
/// Opens no device. Allocates; any thread may call it.
///
/// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_FILE, or NVSP_ERR_PRIOR if the file is of another format.
///
/// # Safety
/// - `path`: the file's name, ending in NUL.
/// - `camera`: the camera of encoders and decoders. NULL: their memory is not wanted.
/// - `estimate`: receives the estimate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_prior_estimate(
    path: *const c_char,
    camera: In<nvsp_camera>,
    estimate: Out<nvsp_memory_estimate>,
) -> nvsp_status {
    super::handle::fence(|| {
        let out = estimate.required()?;
        let camera = (!camera.is_null()).then(|| super::image::camera(camera)).transpose()?;
        // SAFETY: a text stands at `path`, see `# Safety`.
        let path = unsafe { path_of(path)? };
        let unread = |error| nvsprior::Error::from(nvsprior::prior::PriorError::Read(error));
        let mut start = [0; 1 << 16];
        let mut file = std::fs::File::open(path).map_err(unread)?;
        let size = file.metadata().map_err(unread)?.len();
        let mut read = 0;
        while read < start.len() {
            match file.read(&mut start[read..]).map_err(unread)? {
                0 => break,
                more => read += more,
            }
        }
        let unknown =
            Failure::at(NVSP_ERR_PRIOR, "no PLY file, no compact prior, no prior in blocks");
        let claims = PriorClaims::of_start(&start[..read], size).ok_or(unknown)?;
        out.write(&estimate_of(&claims, camera));
        Ok(NVSP_OK)
    })
}

fn estimate_of(claims: &PriorClaims, camera: Option<Camera>) -> nvsp_memory_estimate {
    let of = |bytes: fn(u32, u32) -> u64| camera.map_or(0, |c| bytes(c.width, c.height));
    let splats = camera.map_or(0, |_| claims.splats * limits::WORKSPACE);
    nvsp_memory_estimate {
        splats: claims.splats,
        prior_host: limits::prior(claims) + claims.bytes,
        prior_device: claims.device_bytes(),
        encoder_host: of(limits::encoder),
        encoder_device: of(limits::encoder_device) + splats,
        decoder_host: of(limits::decoder),
        decoder_device: of(limits::decoder_device) + splats,
        ..zeroed()
    }
}

/// Describes a prior. Call it between frames of a prior in blocks: it waits for the frame under way.
///
/// # Parameters
/// - `info`: receives the description.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_prior_get_info(
    prior: Option<&nvsp_prior>,
    info: Out<nvsp_prior_info>,
) -> nvsp_status {
    nvsp_prior::share(prior, |_, content| {
        let out = info.required()?;
        let mut info = content.info;
        if let Some(residency) = content.scene.residency() {
            info.loaded_blocks = number(residency.blocks);
            info.loaded_splats = number(residency.splats);
            info.splat_room = number(residency.room);
            info.host_bytes = residency.host_bytes;
            info.block_changes = residency.changes;
            info.block_waits = residency.waits;
            info.repeated_searches = residency.repeated;
            info.incomplete_searches = residency.incomplete;
        }
        out.write(&info);
        Ok(NVSP_OK)
    })
}
