//! Status codes, and how failures become one.

use std::ffi::{CStr, c_char};

use crate::image::PixelError;
use crate::keys::{KeyError, Refusal};
use crate::modem::ModemError;
use crate::queue::QueueError;
use crate::{ErrorKind, vulkan};

use super::modifier::Modifier;

/// What a call came to: `NVSP_OK`, `NVSP_PENDING`, or an error below zero.
pub type nvsp_status = i32;

/// Done.
pub const NVSP_OK: nvsp_status = 0;
/// Not done yet: ask again later.
pub const NVSP_PENDING: nvsp_status = 1;
/// A pointer that must not be NULL is NULL.
pub const NVSP_ERR_NULL: nvsp_status = -1;
/// An argument or a field is out of its range; the text names it.
pub const NVSP_ERR_ARGUMENT: nvsp_status = -2;
/// This library does not know a structure's struct_size; see NVSP_INIT.
pub const NVSP_ERR_STRUCT_SIZE: nvsp_status = -3;
/// A structure was made for an ABI version that this library does not speak.
pub const NVSP_ERR_ABI_VERSION: nvsp_status = -4;
/// The destination is too small. What else the call writes tells how many bytes are needed: `written`, or
/// nvsp_picture.needed.
pub const NVSP_ERR_BUFFER_TOO_SMALL: nvsp_status = -5;
/// Another thread is inside a call on this handle.
pub const NVSP_ERR_BUSY: nvsp_status = -6;
/// There is nothing to finish or to fetch.
pub const NVSP_ERR_STATE: nvsp_status = -7;
/// An earlier call on this handle failed with NVSP_ERR_INTERNAL; destroy it.
pub const NVSP_ERR_POISONED: nvsp_status = -8;
/// No Vulkan loader, or no device that fits; the text says what was found and what to install.
pub const NVSP_ERR_NO_DEVICE: nvsp_status = -9;
/// The device was lost, or did not end its work within nvsp_engine_options.watchdog_milliseconds. See
/// nvsp_engine_reopen.
pub const NVSP_ERR_DEVICE_LOST: nvsp_status = -10;
/// Host or device memory could not be allocated. The text names the buffer and its size.
pub const NVSP_ERR_MEMORY: nvsp_status = -11;
/// A Vulkan call failed; the text names it.
pub const NVSP_ERR_VULKAN: nvsp_status = -12;
/// A file cannot be read or written.
pub const NVSP_ERR_FILE: nvsp_status = -13;
/// The content of a prior is not valid. The text names the splat or the byte.
pub const NVSP_ERR_PRIOR: nvsp_status = -14;
/// No picture can be rendered with this camera.
pub const NVSP_ERR_CAMERA: nvsp_status = -15;
/// An image's size, shape, strides or planes do not fit, or its DMA-BUF is still being written.
pub const NVSP_ERR_IMAGE: nvsp_status = -16;
/// The first frame came without a pose to start from, and the prior has no key frames.
pub const NVSP_ERR_NO_START: nvsp_status = -17;
/// The byte budget does not even hold the pose, or a packet's shares do not.
pub const NVSP_ERR_BUDGET: nvsp_status = -18;
/// The bytes are no packet, or its latent part is damaged.
pub const NVSP_ERR_PACKET: nvsp_status = -19;
/// The packet is about another prior than the one at hand. Or one before was, or its render was another, and this one
/// does not state its prior: wait for one that does.
pub const NVSP_ERR_OTHER_PRIOR: nvsp_status = -20;
/// The packet's tag is not that of the prior at hand with any camera known: the packet that states prior and camera is
/// missing, or it is about another prior.
pub const NVSP_ERR_CAMERA_UNKNOWN: nvsp_status = -21;
/// The difference picture is damaged or cut short.
pub const NVSP_ERR_RESIDUAL: nvsp_status = -22;
/// The bytes are no modem frame of a packet, or the packet does not fit the modem.
pub const NVSP_ERR_MODEM: nvsp_status = -23;
/// A fault of the library itself. The handle cannot be used any more.
pub const NVSP_ERR_INTERNAL: nvsp_status = -24;
/// A picture has more pixels than nvsp_engine_options.frame_size_limit allows.
pub const NVSP_ERR_LIMIT: nvsp_status = -25;
/// A frame or a packet that was begun on this handle is not finished: finish it, or cancel it. Of a sender: too many
/// shares wait.
pub const NVSP_ERR_UNFINISHED: nvsp_status = -26;
/// A packet, a modem frame, a difference picture or a prior's file is of a newer format than this library knows, or
/// looks like one by chance. Update this side.
pub const NVSP_ERR_NEWER: nvsp_status = -27;
/// The system, a driver or an engine cannot do this; the text says what is missing.
pub const NVSP_ERR_UNSUPPORTED: nvsp_status = -28;
/// The reference frame of a difference picture is missing, came in part, or is of another stream. Only
/// nvsp_decoded.damage has it.
pub const NVSP_ERR_REFERENCE: nvsp_status = -29;
/// No key that is held has made the tag: of a stranger or of another epoch, or damaged.
pub const NVSP_ERR_FOREIGN: nvsp_status = -30;
/// It has the right tag, and comes a second time.
pub const NVSP_ERR_REPLAYED: nvsp_status = -31;

/// Says in a few English words what a status means. The text is static and never NULL, even if the number is no status.
///
/// # Parameters
/// - `status`: any number.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_status_text(status: nvsp_status) -> *const c_char {
    text(status).as_ptr()
}

fn text(status: nvsp_status) -> &'static CStr {
    match status {
        NVSP_OK => c"done",
        NVSP_PENDING => c"not done yet",
        NVSP_ERR_NULL => c"a required pointer is NULL",
        NVSP_ERR_ARGUMENT => c"an argument is out of its range",
        NVSP_ERR_STRUCT_SIZE => c"unknown structure size",
        NVSP_ERR_ABI_VERSION => c"unknown ABI version",
        NVSP_ERR_BUFFER_TOO_SMALL => c"the destination is too small",
        NVSP_ERR_BUSY => c"the handle is in use",
        NVSP_ERR_STATE => c"there is nothing to finish or to fetch",
        NVSP_ERR_POISONED => c"an earlier call failed inside the library",
        NVSP_ERR_NO_DEVICE => c"no Vulkan device fits",
        NVSP_ERR_DEVICE_LOST => c"the device was lost",
        NVSP_ERR_MEMORY => c"out of memory",
        NVSP_ERR_VULKAN => c"a Vulkan call failed",
        NVSP_ERR_FILE => c"a file cannot be read or written",
        NVSP_ERR_PRIOR => c"the prior is not valid",
        NVSP_ERR_CAMERA => c"no picture can be rendered with this camera",
        NVSP_ERR_IMAGE => c"the image does not fit",
        NVSP_ERR_NO_START => c"no pose to start from",
        NVSP_ERR_BUDGET => c"the byte budget does not hold the pose",
        NVSP_ERR_PACKET => c"no packet, or damaged",
        NVSP_ERR_OTHER_PRIOR => c"the packet is about another prior",
        NVSP_ERR_CAMERA_UNKNOWN => c"the packet's prior and camera are not known",
        NVSP_ERR_RESIDUAL => c"the difference picture is damaged",
        NVSP_ERR_MODEM => c"no modem frame of a packet",
        NVSP_ERR_INTERNAL => c"a fault inside the library",
        NVSP_ERR_LIMIT => c"above the limit that you set",
        NVSP_ERR_UNFINISHED => c"what was begun is not finished",
        NVSP_ERR_NEWER => c"of a newer format than this library knows",
        NVSP_ERR_UNSUPPORTED => c"not supported here",
        NVSP_ERR_REFERENCE => c"the reference frame of a difference picture is missing",
        NVSP_ERR_FOREIGN => c"no key that is held has made it",
        NVSP_ERR_REPLAYED => c"it comes a second time",
        _ => c"no status of this library",
    }
}

/// `NVSP_OK` if the work is done, else `NVSP_PENDING`.
pub(super) fn done_or_pending(done: bool) -> nvsp_status {
    if done { NVSP_OK } else { NVSP_PENDING }
}

/// Why a call fails.
#[derive(Debug, thiserror::Error)]
pub(super) enum Failure {
    /// Found by the C functions themselves: a status, and what it is about.
    #[error("{}: {about}", text(*status).to_string_lossy())]
    Boundary { status: nvsp_status, about: &'static str },
    /// The destination is too small.
    #[error("the destination has {found} bytes, but {needed} are needed")]
    Room { needed: usize, found: usize },
    /// A call's host memory is above the limit, or the system does not have it.
    #[error("no memory for {what}: it may take {bytes} bytes of host memory{}", limit_text(*limit))]
    Memory { what: &'static str, bytes: u64, limit: u64 },
    /// Pixels in a layout that cannot be read.
    #[error("{0}; only DRM_FORMAT_MOD_LINEAR, 0, can be read: convert the frame to it first")]
    Modifier(Modifier),
    /// An error of the library.
    #[error(transparent)]
    Library(#[from] crate::Error),
    /// An error of sending or collecting.
    #[error(transparent)]
    Modem(#[from] ModemError),
    /// Keys that cannot be used.
    #[error(transparent)]
    Keys(#[from] KeyError),
    /// Not the other side's.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

impl Failure {
    pub(super) fn at(status: nvsp_status, about: &'static str) -> Failure {
        Failure::Boundary { status, about }
    }

    pub(super) fn null(about: &'static str) -> Failure {
        Failure::at(NVSP_ERR_NULL, about)
    }

    pub(super) fn argument(about: &'static str) -> Failure {
        Failure::at(NVSP_ERR_ARGUMENT, about)
    }

    pub(super) fn status(&self) -> nvsp_status {
        match self {
            Failure::Boundary { status, .. } => *status,
            Failure::Room { .. } => NVSP_ERR_BUFFER_TOO_SMALL,
            Failure::Memory { .. } => NVSP_ERR_MEMORY,
            Failure::Modifier(_) => NVSP_ERR_UNSUPPORTED,
            Failure::Library(error) => of_library(error),
            Failure::Modem(error) => of_kind(error.kind()),
            Failure::Keys(error) => of_kind(error.kind()),
            Failure::Refused(refusal) => of_kind(refusal.kind()),
        }
    }
}

impl From<vulkan::Error> for Failure {
    fn from(error: vulkan::Error) -> Failure {
        Failure::Library(error.into())
    }
}

impl From<QueueError> for Failure {
    fn from(error: QueueError) -> Failure {
        Failure::Library(error.into())
    }
}

impl From<PixelError> for Failure {
    fn from(error: PixelError) -> Failure {
        Failure::Library(error.into())
    }
}

fn limit_text(limit: u64) -> String {
    if limit == u64::MAX { String::new() } else { format!("; the limit is {limit}") }
}

/// The status of a library's error.
pub(super) fn of_library(error: &crate::Error) -> nvsp_status {
    of_kind(error.kind())
}

fn of_kind(kind: ErrorKind) -> nvsp_status {
    match kind {
        ErrorKind::Argument => NVSP_ERR_ARGUMENT,
        ErrorKind::Image => NVSP_ERR_IMAGE,
        ErrorKind::NoDevice => NVSP_ERR_NO_DEVICE,
        ErrorKind::DeviceLost => NVSP_ERR_DEVICE_LOST,
        ErrorKind::Memory => NVSP_ERR_MEMORY,
        ErrorKind::Vulkan => NVSP_ERR_VULKAN,
        ErrorKind::File => NVSP_ERR_FILE,
        ErrorKind::Prior => NVSP_ERR_PRIOR,
        ErrorKind::Camera => NVSP_ERR_CAMERA,
        ErrorKind::NoStart => NVSP_ERR_NO_START,
        ErrorKind::Budget => NVSP_ERR_BUDGET,
        ErrorKind::Limit => NVSP_ERR_LIMIT,
        ErrorKind::Packet => NVSP_ERR_PACKET,
        ErrorKind::OtherPrior => NVSP_ERR_OTHER_PRIOR,
        ErrorKind::SessionUnknown => NVSP_ERR_CAMERA_UNKNOWN,
        ErrorKind::Residual => NVSP_ERR_RESIDUAL,
        ErrorKind::Reference => NVSP_ERR_REFERENCE,
        ErrorKind::Newer => NVSP_ERR_NEWER,
        ErrorKind::Unsupported => NVSP_ERR_UNSUPPORTED,
        ErrorKind::Modem => NVSP_ERR_MODEM,
        ErrorKind::Foreign => NVSP_ERR_FOREIGN,
        ErrorKind::Replayed => NVSP_ERR_REPLAYED,
        ErrorKind::State => NVSP_ERR_STATE,
        ErrorKind::Unfinished => NVSP_ERR_UNFINISHED,
        ErrorKind::Poisoned => NVSP_ERR_POISONED,
        ErrorKind::Internal => NVSP_ERR_INTERNAL,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    /// The last one there is.
    const LAST: nvsp_status = NVSP_ERR_REPLAYED;

    #[test]
    fn every_status_has_a_text_of_its_own() {
        let texts: HashSet<_> = (LAST..=NVSP_PENDING).map(text).collect();
        assert_eq!(texts.len() as i32, NVSP_PENDING - LAST + 1);
        for other in [LAST - 1, NVSP_PENDING + 1, i32::MIN, i32::MAX] {
            assert!(!texts.contains(text(other)));
        }
    }
}
