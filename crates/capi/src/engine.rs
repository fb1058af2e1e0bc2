//! The engine's handle.

use std::ffi::{c_char, c_void};
use std::time::Duration;

use nvsprior::Engine;
use nvsprior::vulkan::DeviceOptions;

use super::handle::{Content, Handle};
use super::limits::{Limits, engine_bytes};
use super::log::{Log, NVSP_LOG_INFO, NVSP_LOG_WARNING, nvsp_log_callback};
use super::memory::Grant;
use super::slices::{Room, optional_slice, text};
use super::status::*;
use super::structs::{In, Out, Place, User, versioned, zeroed};
use super::thread::{ThreadStart, nvsp_thread_callback};
use super::vulkan::{given, nvsp_vulkan};

/// An opened Vulkan device with all pipelines built. Example:
///
/// ```c
/// nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
/// nvsp_engine *engine = NULL;
/// options.log = print_to_stderr;
/// options.watchdog_milliseconds = 5000;
/// if (nvsp_engine_create(&options, &engine) != NVSP_OK) return 1;
/// ```
pub type nvsp_engine = Handle<EngineContent>;

/// What an engine's handle holds.
#[derive(Clone)]
pub(super) struct EngineContent {
    pub engine: Engine,
    /// How it was opened.
    pub how: OpenOptions,
}

/// An engine's options, read.
#[derive(Clone)]
pub(super) struct OpenOptions {
    pub limits: Limits,
    pub threads: ThreadStart,
    options: DeviceOptions,
}

impl OpenOptions {
    /// Opens the device.
    fn open(self) -> Result<EngineContent, Failure> {
        Ok(EngineContent { engine: Engine::new(&self.options)?, how: self })
    }
}

/// Run under the Khronos validation layer, which must be installed. Its messages are logged as
/// warnings when the engine is destroyed or reopened. For tests; slow.
pub const NVSP_ENGINE_VALIDATION: u32 = 1;

/// For nvsp_engine_options.watchdog_milliseconds: wait as long as the device takes.
pub const NVSP_WATCHDOG_NONE: u32 = u32::MAX;

/// The watchdog's time by default, milliseconds. A CPU driver may take seconds to compile what a frame needs first.
const WATCHDOG: u64 = 60_000;

/// What keeps the log of an engine that is not there yet.
impl Content for () {}

/// How to open an engine; all zero: the best device, nothing logged.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_engine_options {
    pub struct_size: u32,
    pub abi_version: u32,
    /// The device's number as text, or a part of its name or its driver's name. NULL: the best device, first a discrete
    /// GPU, then an integrated one, then a CPU.
    pub device: *const c_char,
    /// Receives messages. NULL: nothing is logged.
    pub log: nvsp_log_callback,
    /// Passed to `log` as it is. What it points to must outlive every handle made with the engine, not the engine's own
    /// alone: priors, encoders and decoders log, too, and their threads.
    pub log_user: *mut c_void,
    /// NVSP_ENGINE_* bits.
    pub flags: u32,
    /// Most pixels of a picture, width times height. Encoders and decoders refuse larger ones with NVSP_ERR_MEMORY, and
    /// take none for them. 0: 16,777,216, which is 4096 by 4096.
    pub frame_size_limit: u32,
    /// Most bytes of host memory that opening a prior, an encoder or a decoder may take. A call that may need more
    /// fails with NVSP_ERR_MEMORY before it takes any. 0: no limit.
    pub host_memory_limit: u64,
    /// Most bytes of device memory that everything made with the engine may take from the driver together. A call that
    /// needs more fails with NVSP_ERR_MEMORY. 0: no limit; then memory is taken in blocks of 64 MiB and more.
    pub device_memory_limit: u64,
    /// Called on each thread that the library starts: one per encoder and one per decoder, by its first
    /// nvsp_encode_begin or nvsp_decode_begin. NULL: nothing is called.
    pub thread_start: nvsp_thread_callback,
    /// Passed to `thread_start` as it is. What it points to must outlive every handle made with the engine.
    pub thread_start_user: *mut c_void,
    /// Longest that the library waits for one piece of work on the device, milliseconds: a frame is one to a few
    /// pieces. If it takes longer, the call fails with NVSP_ERR_DEVICE_LOST, and so does every later call on what was
    /// made with the engine. All handles can then be destroyed as usual; the memory that the device may still use is
    /// never given back. 0: 60,000. NVSP_WATCHDOG_NONE: no bound.
    pub watchdog_milliseconds: u32,
    /// Zero.
    pub reserved: u32,
    /// What nvsp_engine_get_pipeline_cache gave on an earlier start, so that the driver need not compile again. Read
    /// during nvsp_engine_create. Bytes that are damaged, or of another device or driver, are left aside. NULL: none.
    pub pipeline_cache: *const u8,
    /// Bytes of it.
    pub pipeline_cache_size: usize,
    /// A Vulkan device of yours to work on. Read during nvsp_engine_create. `device` is then NULL, and
    /// NVSP_ENGINE_VALIDATION not set: validation is your instance's. NULL: the library opens a device of its own.
    pub vulkan: In<nvsp_vulkan>,
}
versioned!(nvsp_engine_options, 104);

/// A device in words, and the memory it gave.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_engine_info {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Name, kind, driver and Vulkan version of the device, ending in NUL.
    pub device: [c_char; 256],
    /// Bytes of device memory that everything made with the engine uses.
    pub memory_used: u64,
    /// Bytes of device memory taken from the driver for that.
    pub memory_reserved: u64,
    /// Vulkan buffers in use.
    pub buffers: u64,
}
versioned!(nvsp_engine_info, 288);

/// Opens a device and builds the pipelines. Takes tens of milliseconds to seconds. The text of a failure goes to the
/// options' `log`, as there is no handle to ask yet.
///
/// Fails with NVSP_ERR_ARGUMENT (unknown flags, a name that is no UTF-8, or fields that exclude each other),
/// NVSP_ERR_NO_DEVICE, NVSP_ERR_MEMORY or NVSP_ERR_VULKAN.
///
/// # Parameters
/// - `options`: `log` and `log_user` are used as long as anything made with the engine lives. NULL: all defaults.
/// - `engine`: receives the engine, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_engine_create(
    options: In<nvsp_engine_options>,
    engine: Place<Box<nvsp_engine>>,
) -> nvsp_status {
    let (options, engine) = match (options.read(), engine.required("engine")) {
        (Ok(options), Ok(engine)) => (options, engine),
        (Err(failure), _) | (_, Err(failure)) => return failure.status(),
    };
    let log = Log::new(options.log, options.log_user);
    // A handle without content: a failure goes through the same fence as that of every other call.
    Handle::call(Some(&Handle::boxed((), log)), |()| {
        let made = open_options(&options)?;
        let _memory = Grant::take("an engine", engine_bytes(), u64::MAX)?;
        let content = made.open()?;
        log.write(NVSP_LOG_INFO, &content.engine.device().to_string());
        engine.write(Handle::boxed(content, log));
        Ok(NVSP_OK)
    })
}

/// Reads the options.
fn open_options(options: &nvsp_engine_options) -> Result<OpenOptions, Failure> {
    if options.flags & !NVSP_ENGINE_VALIDATION != 0 {
        return Err(Failure::argument("nvsp_engine_options.flags: unknown bits"));
    }
    // SAFETY: a text, as the header asks of this field.
    let device = unsafe { text(options.device) };
    let device = device.map(|name| name.to_str().map(str::to_owned)).transpose();
    let device = device.map_err(|_| Failure::argument("nvsp_engine_options.device is no UTF-8"))?;
    let or_none = |limit: u64| if limit == 0 { u64::MAX } else { limit };
    let limits = Limits {
        frame_pixels: match options.frame_size_limit {
            0 => u32::MAX,
            pixels => pixels,
        },
        host_bytes: or_none(options.host_memory_limit),
        stream: false,
        key_frames: 0,
    };
    let validation = options.flags & NVSP_ENGINE_VALIDATION != 0;
    let memory_limit = options.device_memory_limit;
    let threads =
        ThreadStart { callback: options.thread_start, user: User(options.thread_start_user) };
    let watchdog = match options.watchdog_milliseconds {
        0 => Some(Duration::from_millis(WATCHDOG)),
        NVSP_WATCHDOG_NONE => None,
        milliseconds => Some(Duration::from_millis(milliseconds.into())),
    };
    if options.reserved != 0 {
        return Err(Failure::argument("nvsp_engine_options.reserved: not zero"));
    }
    let (cache, size) = (options.pipeline_cache, options.pipeline_cache_size);
    // SAFETY: so many bytes stand there, as the header asks of these fields.
    let cache = unsafe { optional_slice(cache, size, "nvsp_engine_options.pipeline_cache")? };
    let cache = cache.unwrap_or_default();
    let mut pipeline_cache = Vec::new();
    let refused = |_| Failure::at(NVSP_ERR_MEMORY, "a copy of the pipeline cache");
    pipeline_cache.try_reserve_exact(cache.len()).map_err(refused)?;
    pipeline_cache.extend_from_slice(cache);
    let given = given(options.vulkan)?;
    if given.is_some() && (validation || device.is_some()) {
        return Err(Failure::argument(
            "nvsp_engine_options.vulkan with device or NVSP_ENGINE_VALIDATION",
        ));
    }
    let options =
        DeviceOptions { device, validation, memory_limit, watchdog, pipeline_cache, given };
    Ok(OpenOptions { limits, threads, options })
}

/// Opens the device again, with the options that the engine was made with. Call it after NVSP_ERR_DEVICE_LOST. What was
/// made with the engine before stays on the lost device: every call on it fails with NVSP_ERR_DEVICE_LOST. So open the
/// prior again next. Then move encoders and decoders to it with nvsp_encoder_reopen and nvsp_decoder_reopen, which keep
/// their state. Then destroy the old prior. If the device cannot be opened, the engine does not change; try again
/// later.
///
/// Fails as nvsp_engine_create does, or with NVSP_ERR_UNSUPPORTED if the device is one that you gave: make a new one,
/// and a new engine with it.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_engine_reopen(engine: Option<&nvsp_engine>) -> nvsp_status {
    nvsp_engine::share(engine, |handle, content| {
        if content.how.options.given.is_some() {
            return Err(Failure::at(
                NVSP_ERR_UNSUPPORTED,
                "the device is yours: make a new one, and an engine with it",
            ));
        }
        log_validation(handle, &content.engine);
        let _memory = Grant::take("an engine", engine_bytes(), u64::MAX)?;
        let opened = content.how.open()?;
        handle.log().write(NVSP_LOG_INFO, &opened.engine.device().to_string());
        handle.replace(opened);
        Ok(NVSP_OK)
    })
}

/// Describes the engine's device and its memory. Allocates.
///
/// # Parameters
/// - `info`: receives the description.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_engine_get_info(
    engine: Option<&nvsp_engine>,
    info: Out<nvsp_engine_info>,
) -> nvsp_status {
    nvsp_engine::share(engine, |_, content| {
        let out = info.required()?;
        let memory = content.engine.memory();
        let mut device = [0; 256];
        write_text(&content.engine.device().to_string(), &mut device);
        out.write(&nvsp_engine_info {
            device,
            memory_used: memory.used,
            memory_reserved: memory.reserved,
            buffers: memory.buffers,
            ..zeroed()
        });
        Ok(NVSP_OK)
    })
}

/// Copies what the driver has compiled so far, to keep in a file for nvsp_engine_options.pipeline_cache of the next
/// start. Call it after a first frame was encoded or decoded, as drivers compile late. Waits for no work. Allocates.
///
/// Fails with NVSP_ERR_BUFFER_TOO_SMALL, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
///
/// # Safety
/// - `bytes`: receives the data. NULL only if `size` is 0.
/// - `size`: bytes of `bytes`.
/// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_engine_get_pipeline_cache(
    engine: Option<&nvsp_engine>,
    bytes: *mut u8,
    size: usize,
    written: Place<usize>,
) -> nvsp_status {
    nvsp_engine::share(engine, |_, content| {
        // SAFETY: `size` bytes stand at `bytes`, see `# Safety`.
        let mut room = unsafe { Room::or_none(bytes, size, written, "bytes")? };
        let _memory = Grant::take("the pipeline cache", CACHE, content.how.limits.host_bytes)?;
        room.write(&content.engine.vulkan().pipeline_cache()?)?;
        Ok(NVSP_OK)
    })
}

/// Bytes that a copy of the pipeline cache may take.
const CACHE: u64 = 32 << 20;

impl Content for EngineContent {
    fn ends(handle: &nvsp_engine) {
        log_validation(handle, &handle.get().engine);
    }
}

fn log_validation(handle: &Handle<EngineContent>, engine: &Engine) {
    for message in engine.validation_messages() {
        handle.log().write(NVSP_LOG_WARNING, &message);
    }
}

/// Writes a text that ends in NUL. If it is too long, cuts it after a whole character.
pub(super) fn write_text(text: &str, to: &mut [c_char]) {
    let end = text.floor_char_boundary(to.len() - 1);
    for (to, byte) in to.iter_mut().zip(text[..end].bytes().chain([0])) {
        *to = byte as c_char;
    }
}
