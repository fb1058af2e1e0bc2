//! Status codes, and how failures become one.

use std::ffi::{CStr, c_char};

use nvsprior::QueueError;
use nvsprior::image::PixelError;
use nvsprior::{ErrorKind, vulkan};
use nvsprior_link::LinkError;
use nvsprior_link::keys::{KeyError, Refusal};
use nvsprior_link::modem::ModemError;

use super::modifier::Modifier;

/// What a call came to: `NVSP_OK`, `NVSP_PENDING`, or an error below zero.
pub type nvsp_status = i32;

/// Done.
pub const NVSP_OK: nvsp_status = 0;
/// Not done yet: ask again later.
pub const NVSP_PENDING: nvsp_status = 1;
/// An argument or a field is out of its range, or NULL where it must not be; the text names it. Correct the program.
pub const NVSP_ERR_ARGUMENT: nvsp_status = -1;
/// A structure that was not set up by NVSP_INIT, or of a header that this library does not know. Build the program with
/// the header of this library.
pub const NVSP_ERR_STRUCTURE: nvsp_status = -2;
/// The destination is too small. What else the call writes tells how many bytes are needed: `written`, or
/// nvsp_picture.needed. Call again with as many.
pub const NVSP_ERR_BUFFER_TOO_SMALL: nvsp_status = -3;
/// Another thread is inside a call on this handle. Call again.
pub const NVSP_ERR_BUSY: nvsp_status = -4;
/// There is nothing to finish or to fetch.
pub const NVSP_ERR_STATE: nvsp_status = -5;
/// A frame or a packet that was begun on this handle is not finished: finish it, or cancel it. Of a vehicle: too many
/// modem frames wait.
pub const NVSP_ERR_UNFINISHED: nvsp_status = -6;
/// A fault of the library itself, in this call or an earlier one. Destroy the handle, and report the fault.
pub const NVSP_ERR_INTERNAL: nvsp_status = -7;
/// No Vulkan loader, or no device that fits; the text says what was found and what to install.
pub const NVSP_ERR_NO_DEVICE: nvsp_status = -8;
/// The device was lost, or did not end its work within nvsp_engine_options.watchdog_milliseconds. See
/// nvsp_engine_reopen.
pub const NVSP_ERR_DEVICE_LOST: nvsp_status = -9;
/// Host or device memory could not be allocated, or the engine's limits do not allow it or so large a picture. The text
/// names what is too large, and the limit. Leave the frame out, or make room.
pub const NVSP_ERR_MEMORY: nvsp_status = -10;
/// A Vulkan call failed; the text names it. Use another device or driver.
pub const NVSP_ERR_VULKAN: nvsp_status = -11;
/// The system, a driver or an engine cannot do this; the text says what is missing. Do without.
pub const NVSP_ERR_UNSUPPORTED: nvsp_status = -12;
/// A file cannot be read. Look at its path and its rights.
pub const NVSP_ERR_FILE: nvsp_status = -13;
/// The content of a prior is not valid. The text names the splat or the byte. Get the file anew.
pub const NVSP_ERR_PRIOR: nvsp_status = -14;
/// An image's size, shape, strides or planes do not fit, or its DMA-BUF is still being written. Leave the frame out.
pub const NVSP_ERR_IMAGE: nvsp_status = -15;
/// The first frame came without a pose to start from, and the prior has no key frames. Give a hint.
pub const NVSP_ERR_NO_START: nvsp_status = -16;
/// The byte budget does not even hold the pose, or a packet's modem frames do not. Give more bytes, or leave the frame
/// out.
pub const NVSP_ERR_BUDGET: nvsp_status = -17;
/// The bytes are no packet, no modem frame of the vehicle and no report for it, or they are damaged or too late, or
/// longer than the modem frames hold. Drop them.
pub const NVSP_ERR_PACKET: nvsp_status = -18;
/// The packet is about another prior than the one at hand: open that one. Or one before was, or its render was another,
/// and this one does not state its prior: wait for one that does.
pub const NVSP_ERR_OTHER_PRIOR: nvsp_status = -19;
/// The packet's tag is not that of the prior at hand with any camera known: the packet that states prior and camera is
/// missing, or it is about another prior. Wait for one that states them, or have the vehicle call
/// nvsp_encoder_announce.
pub const NVSP_ERR_CAMERA_UNKNOWN: nvsp_status = -20;
/// A packet, a modem frame, a difference picture or a prior's file is of a newer format than this library knows, or
/// looks like one by chance. Update this side.
pub const NVSP_ERR_NEWER: nvsp_status = -21;
/// No key that is held has made the tag: of a stranger or of another epoch, or damaged. Drop it.
pub const NVSP_ERR_FOREIGN: nvsp_status = -22;
/// It has the right tag, and comes a second time. Drop it; many tell of a stranger.
pub const NVSP_ERR_REPLAYED: nvsp_status = -23;
/// The difference picture is damaged or cut short. Only nvsp_decoded.damage has it.
pub const NVSP_ERR_RESIDUAL: nvsp_status = -24;
/// The reference frame of a difference picture is missing, came in part, or is of another stream. Only
/// nvsp_decoded.damage has it.
pub const NVSP_ERR_REFERENCE: nvsp_status = -25;

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
        NVSP_ERR_ARGUMENT => c"an argument is NULL or out of its range",
        NVSP_ERR_STRUCTURE => c"a structure that this library does not know",
        NVSP_ERR_BUFFER_TOO_SMALL => c"the destination is too small",
        NVSP_ERR_BUSY => c"the handle is in use",
        NVSP_ERR_STATE => c"there is nothing to finish or to fetch",
        NVSP_ERR_UNFINISHED => c"what was begun is not finished",
        NVSP_ERR_INTERNAL => c"a fault inside the library",
        NVSP_ERR_NO_DEVICE => c"no Vulkan device fits",
        NVSP_ERR_DEVICE_LOST => c"the device was lost",
        NVSP_ERR_MEMORY => c"out of memory, or above a limit",
        NVSP_ERR_VULKAN => c"a Vulkan call failed",
        NVSP_ERR_UNSUPPORTED => c"not supported here",
        NVSP_ERR_FILE => c"a file cannot be read",
        NVSP_ERR_PRIOR => c"the prior is not valid",
        NVSP_ERR_IMAGE => c"the image does not fit",
        NVSP_ERR_NO_START => c"no pose to start from",
        NVSP_ERR_BUDGET => c"the byte budget does not hold the pose",
        NVSP_ERR_PACKET => c"no packet, or damaged",
        NVSP_ERR_OTHER_PRIOR => c"the packet is about another prior",
        NVSP_ERR_CAMERA_UNKNOWN => c"the packet's prior and camera are not known",
        NVSP_ERR_NEWER => c"of a newer format than this library knows",
        NVSP_ERR_FOREIGN => c"no key that is held has made it",
        NVSP_ERR_REPLAYED => c"it comes a second time",
        NVSP_ERR_RESIDUAL => c"the difference picture is damaged",
        NVSP_ERR_REFERENCE => c"the reference frame of a difference picture is missing",
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
    /// A pointer that must not be NULL.
    #[error("{0} is NULL")]
    Null(&'static str),
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
    Library(#[from] nvsprior::Error),
    /// An end of a link refuses what it is given.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// An end of a link cannot be made.
    #[error(transparent)]
    Options(LinkError),
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
        Failure::Null(about)
    }

    pub(super) fn argument(about: &'static str) -> Failure {
        Failure::at(NVSP_ERR_ARGUMENT, about)
    }

    pub(super) fn status(&self) -> nvsp_status {
        match self {
            Failure::Boundary { status, .. } => *status,
            Failure::Null(_) => NVSP_ERR_ARGUMENT,
            Failure::Room { .. } => NVSP_ERR_BUFFER_TOO_SMALL,
            Failure::Memory { .. } => NVSP_ERR_MEMORY,
            Failure::Modifier(_) => NVSP_ERR_UNSUPPORTED,
            Failure::Library(error) => of_library(error),
            Failure::Link(error) => of_kind(error.kind()),
            Failure::Options(error) => match error.kind() {
                // Modem and keys are what they are: the option is wrong.
                ErrorKind::Modem | ErrorKind::State | ErrorKind::Budget => NVSP_ERR_ARGUMENT,
                kind => of_kind(kind),
            },
            Failure::Keys(error) => of_kind(error.kind()),
            Failure::Refused(refusal) => of_kind(refusal.kind()),
        }
    }
}

impl From<ModemError> for Failure {
    fn from(error: ModemError) -> Failure {
        Failure::Link(error.into())
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
pub(super) fn of_library(error: &nvsprior::Error) -> nvsp_status {
    of_kind(error.kind())
}

fn of_kind(kind: ErrorKind) -> nvsp_status {
    match kind {
        ErrorKind::Argument | ErrorKind::Camera => NVSP_ERR_ARGUMENT,
        ErrorKind::Image => NVSP_ERR_IMAGE,
        ErrorKind::NoDevice => NVSP_ERR_NO_DEVICE,
        ErrorKind::DeviceLost => NVSP_ERR_DEVICE_LOST,
        ErrorKind::Memory | ErrorKind::Limit => NVSP_ERR_MEMORY,
        ErrorKind::Vulkan => NVSP_ERR_VULKAN,
        ErrorKind::File => NVSP_ERR_FILE,
        ErrorKind::Prior => NVSP_ERR_PRIOR,
        ErrorKind::NoStart => NVSP_ERR_NO_START,
        ErrorKind::Budget => NVSP_ERR_BUDGET,
        ErrorKind::Packet | ErrorKind::Modem => NVSP_ERR_PACKET,
        ErrorKind::OtherPrior => NVSP_ERR_OTHER_PRIOR,
        ErrorKind::SessionUnknown => NVSP_ERR_CAMERA_UNKNOWN,
        ErrorKind::Residual => NVSP_ERR_RESIDUAL,
        ErrorKind::Reference => NVSP_ERR_REFERENCE,
        ErrorKind::Newer => NVSP_ERR_NEWER,
        ErrorKind::Unsupported => NVSP_ERR_UNSUPPORTED,
        ErrorKind::Foreign => NVSP_ERR_FOREIGN,
        ErrorKind::Replayed => NVSP_ERR_REPLAYED,
        ErrorKind::State => NVSP_ERR_STATE,
        ErrorKind::Unfinished => NVSP_ERR_UNFINISHED,
        // `Poisoned`, `Internal`, and what this library does not know.
        _ => NVSP_ERR_INTERNAL,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    /// The last one there is.
    const LAST: nvsp_status = NVSP_ERR_REFERENCE;

    #[test]
    fn every_status_has_a_text_of_its_own() {
        let texts: HashSet<_> = (LAST..=NVSP_PENDING).map(text).collect();
        assert_eq!(texts.len() as i32, NVSP_PENDING - LAST + 1);
        for other in [LAST - 1, NVSP_PENDING + 1, i32::MIN, i32::MAX] {
            assert!(!texts.contains(text(other)));
        }
    }
}
