//! Frames in DMA-BUFs: buffers of cameras, decoders and GPUs, shared by file descriptor.
//!
//! The conversion to RGB runs on the CPU. So a buffer is mapped, once, and each frame is read in place between the two
//! ioctls that keep the CPU's caches true. That works with every exporter whose buffers can be mapped, and asks nothing
//! of the Vulkan device.

use std::os::fd::{AsRawFd, FromRawFd, OwnedFd, RawFd};
use std::ptr::null_mut;
use std::sync::Arc;

use super::engine::nvsp_engine;
use super::handle::{Content, Handle};
use super::modifier::Modifier;
use super::status::*;
use super::structs::Place;

/// A DMA-BUF that frames are read from; import each buffer of a camera's ring once. Example, for a frame of V4L2 in
/// NV12, whose buffer VIDIOC_EXPBUF exported:
///
/// ```c
/// nvsp_dmabuf *buffer = NULL;
/// if (nvsp_dmabuf_import(engine, fd, 0, &buffer) != NVSP_OK) return 1;
/// nvsp_image image = NVSP_INITIALIZER(nvsp_image);
/// image.format = NVSP_FORMAT_NV12;
/// image.width = 1920;
/// image.height = 1080;
/// image.dmabufs[0] = buffer;
/// image.offsets[1] = 1080 * stride;
/// image.strides[0] = image.strides[1] = stride;
/// ```
pub type nvsp_dmabuf = Handle<Arc<Mapping>>;

impl Content for Arc<Mapping> {}

/// A buffer in this process.
pub(super) struct Mapping {
    fd: OwnedFd,
    start: *mut libc::c_void,
    size: usize,
}

// SAFETY: only read, by any thread.
unsafe impl Send for Mapping {}
// SAFETY: only read, by any thread.
unsafe impl Sync for Mapping {}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: what `map` mapped, and no view is left: each holds this.
        unsafe { libc::munmap(self.start, self.size) };
    }
}

/// `DMA_BUF_IOCTL_SYNC`, of linux/dma-buf.h.
const SYNC: u64 = 0x4008_6200;
const SYNC_READ: u64 = 1;
const SYNC_END: u64 = 4;
/// The kernel asks to try again if a signal came; no more often than this.
const TRIES: usize = 1000;

/// Begins or ends reading by the CPU. On failure the system's error.
fn sync(fd: RawFd, flags: u64) -> Result<(), i32> {
    let mut error = 0;
    for _ in 0..TRIES {
        // SAFETY: a descriptor that is open, and the structure that the call asks for: one u64.
        if unsafe { libc::ioctl(fd, SYNC as _, &raw const flags) } == 0 {
            return Ok(());
        }
        error = system_error();
        if error != libc::EINTR && error != libc::EAGAIN {
            break;
        }
    }
    Err(error)
}

fn system_error() -> i32 {
    std::io::Error::last_os_error().raw_os_error().unwrap_or(0)
}

impl Mapping {
    fn new(fd: RawFd) -> Result<Mapping, Failure> {
        // SAFETY: any number may be asked for.
        let copy = unsafe { libc::fcntl(fd, libc::F_DUPFD_CLOEXEC, 0) };
        if copy < 0 {
            return Err(match system_error() {
                libc::EBADF => Failure::argument("fd: not open"),
                _ => Failure::at(NVSP_ERR_MEMORY, "no file descriptor is left"),
            });
        }
        // SAFETY: just made, for this alone.
        let fd = unsafe { OwnedFd::from_raw_fd(copy) };
        sync(copy, SYNC_READ).and_then(|()| sync(copy, SYNC_READ | SYNC_END)).map_err(|error| {
            match error {
                libc::ENOTTY | libc::EINVAL | libc::ENOSYS => Failure::argument("fd: no DMA-BUF"),
                _ => Failure::at(NVSP_ERR_UNSUPPORTED, "fd: the CPU may not read this DMA-BUF"),
            }
        })?;
        // SAFETY: an open descriptor. Nobody reads a DMA-BUF from a place.
        let size = unsafe { libc::lseek(copy, 0, libc::SEEK_END) };
        let size = usize::try_from(size).ok().filter(|size| *size > 0);
        let size = size.ok_or(Failure::at(NVSP_ERR_UNSUPPORTED, "fd: a DMA-BUF without a size"))?;
        let (read, shared) = (libc::PROT_READ, libc::MAP_SHARED);
        // SAFETY: at an address that the system chooses.
        let start = unsafe { libc::mmap(null_mut(), size, read, shared, copy, 0) };
        if start == libc::MAP_FAILED {
            return Err(match system_error() {
                libc::ENOMEM => Failure::at(NVSP_ERR_MEMORY, "no address space for a DMA-BUF"),
                _ => Failure::at(NVSP_ERR_UNSUPPORTED, "fd: this DMA-BUF cannot be mapped"),
            });
        }
        Ok(Mapping { fd, start, size })
    }
}

/// A buffer while the CPU reads it.
pub(super) struct Reading(Arc<Mapping>);

impl Reading {
    /// Begins to read. Does not wait for what is still being written.
    fn new(mapping: Arc<Mapping>) -> Result<Reading, Failure> {
        let fd = mapping.fd.as_raw_fd();
        let mut events = libc::pollfd { fd, events: libc::POLLIN, revents: 0 };
        // SAFETY: one descriptor.
        if unsafe { libc::poll(&raw mut events, 1, 0) } == 0 {
            return Err(Failure::at(NVSP_ERR_IMAGE, "nvsp_image.dmabufs: still being written"));
        }
        sync(fd, SYNC_READ).map_err(|_| {
            Failure::at(NVSP_ERR_UNSUPPORTED, "nvsp_image.dmabufs: the CPU may not read it now")
        })?;
        Ok(Reading(mapping))
    }

    /// The bytes from `offset` on, at most `size`; 0: to the end.
    ///
    /// # Safety
    /// The slice is not used after this, and nobody writes the buffer meanwhile.
    unsafe fn bytes<'a>(&self, offset: usize, size: usize) -> Result<&'a [u8], Failure> {
        let Mapping { start, size: all, .. } = *self.0;
        let Some(rest) = all.checked_sub(offset) else {
            return Err(Failure::at(NVSP_ERR_IMAGE, "nvsp_image.offsets: beyond the DMA-BUF"));
        };
        if size > rest {
            return Err(Failure::at(NVSP_ERR_IMAGE, "nvsp_image.sizes: beyond the DMA-BUF"));
        }
        let size = if size == 0 { rest } else { size };
        // SAFETY: within the mapping, which stays as long as this does.
        Ok(unsafe { std::slice::from_raw_parts(start.cast::<u8>().add(offset), size) })
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        // The bytes were read; there is nobody to tell.
        let _ = sync(self.0.fd.as_raw_fd(), SYNC_READ | SYNC_END);
    }
}

/// What keeps planes readable.
pub(super) type Readings = [Option<Reading>; 3];
/// The planes' bytes, and what keeps them readable.
pub(super) type Planes<'a> = ([&'a [u8]; 3], Readings);

/// Begins to read the first `count` planes of an image.
///
/// # Safety
/// The handles are NULL or live. The bytes are not used after the second result is dropped, and nobody writes the
/// buffers before.
pub(super) unsafe fn planes<'a>(
    dmabufs: [*const nvsp_dmabuf; 3],
    offsets: [usize; 3],
    sizes: [usize; 3],
    count: usize,
) -> Result<Planes<'a>, Failure> {
    let (mut planes, mut readings): Planes = ([&[]; 3], [None, None, None]);
    for i in 0..count {
        // Planes without a buffer of their own lie in the first one's.
        let of = |i: usize| if dmabufs[i].is_null() { dmabufs[0] } else { dmabufs[i] };
        let first = (0..i).find(|&earlier| of(earlier) == of(i)).unwrap_or(i);
        if first == i {
            // SAFETY: NULL or live, see `# Safety`.
            let buffer = nvsp_dmabuf::of(unsafe { of(i).as_ref() }, "nvsp_image.dmabufs")?;
            readings[i] = Some(Reading::new(buffer)?);
        }
        if let Some(reading) = &readings[first] {
            // SAFETY: the reading comes along, and nobody writes the buffer, see `# Safety`.
            planes[i] = unsafe { reading.bytes(offsets[i], sizes[i])? };
        }
    }
    Ok((planes, readings))
}

/// Imports a DMA-BUF, to read frames from it without a copy. The rows of its pixels lie one after the other
/// (DRM_FORMAT_MOD_LINEAR, "pitch linear"). Surfaces in a layout of the hardware's own, such as NVIDIA's block-linear
/// NVMM surfaces, must be converted first: on a Jetson nvvidconv or NvBufSurfTransform does it. The library maps the
/// buffer for reading and keeps a copy of the descriptor. Needs no extension of the Vulkan device. Allocates.
///
/// Fails with NVSP_ERR_ARGUMENT (the descriptor is not open, or of no DMA-BUF: memfd and files are none),
/// NVSP_ERR_UNSUPPORTED (another modifier, or a buffer that the CPU may not read or map), or NVSP_ERR_MEMORY; the text
/// is the engine's.
///
/// # Parameters
/// - `engine`: a live engine, whose log and last error tell of failures.
/// - `fd`: a file descriptor of the DMA-BUF. You may close it after the call.
/// - `modifier`: the DRM format modifier of its pixels: 0, which is DRM_FORMAT_MOD_LINEAR. V4L2 has no modifiers: its
///   formats without a name of their own for a layout are linear.
/// - `dmabuf`: receives the buffer, which nvsp_destroy ends.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_dmabuf_import(
    engine: Option<&nvsp_engine>,
    fd: i32,
    modifier: u64,
    dmabuf: Place<Box<nvsp_dmabuf>>,
) -> nvsp_status {
    nvsp_engine::share(engine, |handle, _| {
        let dmabuf = dmabuf.required("dmabuf")?;
        if modifier != 0 {
            return Err(Failure::Modifier(Modifier(modifier)));
        }
        let content = Arc::new(Mapping::new(fd)?);
        dmabuf.write(Handle::boxed(content, handle.log()));
        Ok(NVSP_OK)
    })
}
