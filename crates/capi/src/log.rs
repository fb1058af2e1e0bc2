//! The engine's log callback.

use std::ffi::{CString, c_char, c_void};

use super::structs::User;

/// A call failed.
pub const NVSP_LOG_ERROR: i32 = 1;
/// Something is not as it should be, but work goes on.
pub const NVSP_LOG_WARNING: i32 = 2;
/// What was chosen and loaded.
pub const NVSP_LOG_INFO: i32 = 3;

/// Receives messages of an engine and of everything made with it: a level, NVSP_LOG_ERROR, NVSP_LOG_WARNING or
/// NVSP_LOG_INFO, and a text that is valid during the call. It is called on the thread that is inside the library, or
/// on an encoder's own thread (see nvsp_encode_begin), and perhaps on several threads at once. It must not call the
/// library, and must not unwind. A frame that succeeds makes no call.
#[allow(non_camel_case_types)]
pub type nvsp_log_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, level: i32, message: *const c_char)>;

/// The callback with its user pointer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Log {
    callback: nvsp_log_callback,
    user: User,
}

impl Log {
    pub(super) fn new(callback: nvsp_log_callback, user: *mut c_void) -> Log {
        Log { callback, user: User(user) }
    }

    /// Passes a message on.
    pub(super) fn write(&self, level: i32, message: &str) {
        let Some(callback) = self.callback else { return };
        let text = CString::new(message.replace('\0', "?")).unwrap_or_default();
        // SAFETY: the header asks for a callback that takes any text, with the pointer it came with.
        unsafe { callback(self.user.0, level, text.as_ptr()) }
    }
}
