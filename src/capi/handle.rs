//! The fence between C and the library.

use std::ffi::c_char;
use std::fmt::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError, TryLockError};

use super::log::{Log, NVSP_LOG_ERROR};
use super::status::*;

/// What an opaque handle points to: its content for one thread at a time, and the text of its last
/// failure.
pub(super) struct Handle<T> {
    content: Mutex<T>,
    failure: Mutex<LastFailure>,
    log: Log,
}

/// The text of the last failure, and how often it came in a row.
struct LastFailure {
    text: Text,
    times: u64,
}

/// A type of the header that C knows by address alone. It is tied to what its handle holds, so that a cast to another
/// handle does not compile.
pub(super) trait Opaque: Sized {
    /// What the handle holds.
    type Content;

    /// The handle at an address that C holds.
    fn handle(address: *const Self) -> *const Handle<Self::Content> {
        address.cast()
    }

    /// The address of a handle, for C to hold.
    fn address(handle: *mut Handle<Self::Content>) -> *mut Self {
        handle.cast()
    }
}

/// Bytes of a failure's text that are kept.
const TEXT: usize = 512;

/// A text of bounded length: a failure costs no memory.
struct Text {
    bytes: [u8; TEXT],
    len: usize,
}

impl Write for Text {
    /// Takes what there is room for, in whole characters.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = TEXT - self.len;
        let end = (0..=room.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0);
        self.bytes[self.len..self.len + end].copy_from_slice(&text.as_bytes()[..end]);
        self.len += end;
        Ok(())
    }
}

impl Text {
    fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..self.len]).unwrap_or_default()
    }
}

impl<T> Handle<T> {
    /// Makes a handle for C to hold; [`Handle::destroy`] takes it back.
    pub(super) fn boxed(content: T, log: Log) -> *mut Handle<T> {
        let text = Text { bytes: [0; TEXT], len: 0 };
        let failure = Mutex::new(LastFailure { text, times: 0 });
        Box::into_raw(Box::new(Handle { content: Mutex::new(content), failure, log }))
    }

    pub(super) fn log(&self) -> Log {
        self.log
    }

    /// Runs a call that needs the handle for itself. Fails with `NVSP_ERR_BUSY` if another thread
    /// is inside such a call. After a panic, every later call fails with `NVSP_ERR_POISONED`.
    ///
    /// # Safety
    /// `handle` is null or came from [`Handle::boxed`] and was not destroyed.
    pub(super) unsafe fn call(
        handle: *const Handle<T>,
        body: impl FnOnce(&mut T) -> Result<nvsp_status, Failure>,
    ) -> nvsp_status {
        // SAFETY: as the caller promises.
        let Some(handle) = (unsafe { handle.as_ref() }) else { return NVSP_ERR_NULL };
        handle.fence(|| match handle.content.try_lock() {
            Ok(mut content) => body(&mut content),
            Err(TryLockError::WouldBlock) => {
                Err(Failure::at(NVSP_ERR_BUSY, "another thread is inside a call on it"))
            }
            Err(TryLockError::Poisoned(_)) => {
                Err(Failure::at(NVSP_ERR_POISONED, "only destroying it is left"))
            }
        })
    }

    /// Runs a call that several threads may make at once: `body` gets the content as it stands.
    ///
    /// # Safety
    /// As for [`Handle::call`].
    pub(super) unsafe fn share(
        handle: *const Handle<T>,
        body: impl FnOnce(&Handle<T>, T) -> Result<nvsp_status, Failure>,
    ) -> nvsp_status
    where
        T: Clone,
    {
        // SAFETY: as the caller promises.
        let Some(handle) = (unsafe { handle.as_ref() }) else { return NVSP_ERR_NULL };
        handle.fence(|| body(handle, handle.get()))
    }

    /// Clones the content. The lock is held for the clone alone, so that nothing can panic under it.
    pub(super) fn get(&self) -> T
    where
        T: Clone,
    {
        self.content.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Replaces the content.
    pub(super) fn replace(&self, content: T) {
        let mut place = self.content.lock().unwrap_or_else(PoisonError::into_inner);
        // The old content is dropped when the lock is free again.
        let _old = std::mem::replace(&mut *place, content);
        drop(place);
    }

    /// Turns failures and panics into statuses with a text.
    fn fence(&self, body: impl FnOnce() -> Result<nvsp_status, Failure>) -> nvsp_status {
        let failure = match catch_unwind(AssertUnwindSafe(body)) {
            Ok(Ok(status)) => return status,
            Ok(Err(failure)) => failure,
            Err(_) => Failure::at(NVSP_ERR_INTERNAL, "please report it"),
        };
        self.note(&failure);
        failure.status()
    }

    /// Keeps a failure's text and logs it. If it is the same as the last one, it is only counted: the log gets a line
    /// when the count reaches 10, 100 and so on, and a last one before another text.
    pub(super) fn note(&self, failure: &Failure) {
        let mut text = Text { bytes: [0; TEXT], len: 0 };
        // Writing to a Text never fails.
        let _ = write!(text, "{failure}");
        let mut last = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        if last.times > 0 && last.text.as_str() == text.as_str() {
            last.times += 1;
            let times = last.times;
            drop(last);
            if times >= 10 && 10_u64.pow(times.ilog10()) == times {
                self.log_count(text.as_str(), times);
            }
            return;
        }
        let LastFailure { text: before, times } =
            std::mem::replace(&mut *last, LastFailure { text, times: 1 });
        let mut text = Text { bytes: [0; TEXT], len: 0 };
        let _ = write!(text, "{}", last.text.as_str());
        drop(last);
        if times > 1 && 10_u64.pow(times.ilog10()) != times {
            self.log_count(before.as_str(), times);
        }
        self.log.write(NVSP_LOG_ERROR, text.as_str());
    }

    /// Logs how often a failure came in a row.
    fn log_count(&self, text: &str, times: u64) {
        // Not on the heap: a link may damage a frame at any time.
        let mut line = Text { bytes: [0; TEXT], len: 0 };
        let _ = write!(line, "{times} times in a row: {text}");
        self.log.write(NVSP_LOG_ERROR, line.as_str());
    }

    /// Copies the text of the last failure, ending in NUL, and cut if it is too long.
    ///
    /// # Safety
    /// `handle` as for [`Handle::call`]; `text` is null or has room for `size` bytes.
    pub(super) unsafe fn last_error(
        handle: *const Handle<T>,
        text: *mut c_char,
        size: usize,
    ) -> nvsp_status {
        // SAFETY: as the caller promises.
        let Some(handle) = (unsafe { handle.as_ref() }) else { return NVSP_ERR_NULL };
        if text.is_null() {
            return NVSP_ERR_NULL;
        }
        if size == 0 {
            return NVSP_ERR_BUFFER_TOO_SMALL;
        }
        let failure = handle.failure.lock().unwrap_or_else(PoisonError::into_inner);
        let failure = &failure.text;
        let mut end = failure.len.min(size - 1);
        while !failure.as_str().is_char_boundary(end) {
            end -= 1;
        }
        // SAFETY: `end` bytes and the NUL fit into `size`, which the caller promises.
        unsafe {
            text.copy_from_nonoverlapping(failure.bytes.as_ptr().cast(), end);
            *text.add(end) = 0;
        }
        NVSP_OK
    }

    /// Ends a handle; null is none.
    ///
    /// # Safety
    /// `handle` is null, or came from [`Handle::boxed`], was not destroyed, and no call is on it.
    pub(super) unsafe fn destroy(handle: *mut Handle<T>) {
        if !handle.is_null() {
            // SAFETY: as the caller promises.
            let handle = unsafe { Box::from_raw(handle) };
            // There is nobody left to report a panic while dropping.
            let _ = catch_unwind(AssertUnwindSafe(|| drop(handle)));
        }
    }
}

/// Runs a call that has no handle to keep a text in.
pub(super) fn fence(body: impl FnOnce() -> Result<nvsp_status, Failure>) -> nvsp_status {
    let caught = catch_unwind(AssertUnwindSafe(body));
    caught.map_or(NVSP_ERR_INTERNAL, |done| done.unwrap_or_else(|failure| failure.status()))
}

#[cfg(test)]
mod tests {
    use std::ptr::{null, null_mut};

    use super::*;

    fn handle() -> *mut Handle<u32> {
        Handle::boxed(5, Log::new(None, null_mut()))
    }

    fn last_error(handle: *const Handle<u32>) -> String {
        let mut text = [1u8; 600];
        // SAFETY: a live handle, and the buffer's own size.
        let status = unsafe { Handle::last_error(handle, text.as_mut_ptr().cast(), 600) };
        assert_eq!(status, NVSP_OK);
        let end = text.iter().position(|b| *b == 0).unwrap();
        String::from_utf8(text[..end].to_vec()).unwrap()
    }

    #[test]
    fn a_panic_poisons_the_handle_and_nothing_else() {
        let (one, other) = (handle(), handle());
        // SAFETY: both handles live until destroyed.
        unsafe {
            assert_eq!(Handle::call(one, |_| panic!("on purpose")), NVSP_ERR_INTERNAL);
            assert!(last_error(one).contains("report"));
            assert_eq!(Handle::call(one, |_| Ok(NVSP_OK)), NVSP_ERR_POISONED);
            assert_eq!(Handle::call(other, |v| Ok(*v as i32)), 5);
            Handle::destroy(one);
            Handle::destroy(other);
            Handle::<u32>::destroy(null_mut());
            assert_eq!(Handle::<u32>::call(null(), |_| Ok(NVSP_OK)), NVSP_ERR_NULL);
        }
    }

    #[test]
    fn two_threads_do_not_enter_at_once() {
        let shared = handle() as usize;
        let (entered, wait) = std::sync::mpsc::channel();
        let (go_on, released) = std::sync::mpsc::channel();
        let inside = std::thread::spawn(move || {
            // SAFETY: destroyed after this thread has ended.
            unsafe {
                Handle::call(shared as *mut Handle<u32>, |_| {
                    entered.send(()).unwrap();
                    released.recv().unwrap();
                    Ok(NVSP_OK)
                })
            }
        });
        wait.recv().unwrap();
        // SAFETY: a live handle.
        unsafe {
            assert_eq!(Handle::call(shared as *mut Handle<u32>, |_| Ok(NVSP_OK)), NVSP_ERR_BUSY);
            go_on.send(()).unwrap();
            assert_eq!(inside.join().unwrap(), NVSP_OK);
            assert_eq!(Handle::call(shared as *mut Handle<u32>, |_| Ok(NVSP_OK)), NVSP_OK);
            Handle::destroy(shared as *mut Handle<u32>);
        }
    }

    #[test]
    fn texts_are_cut_at_whole_characters() {
        let mut text = Text { bytes: [0; TEXT], len: 0 };
        write!(text, "{}é{}", "a".repeat(TEXT - 1), "b".repeat(9)).unwrap();
        assert_eq!(text.len, TEXT);
        assert!(text.as_str().ends_with("ab"), "the é did not fit, what came after did");
        let handle = handle();
        // SAFETY: a live handle and buffers of the sizes given.
        unsafe {
            Handle::call(handle, |_| Err(Failure::argument("é")));
            let mut short = [9u8; 4];
            assert_eq!(Handle::last_error(handle, short.as_mut_ptr().cast(), 4), NVSP_OK);
            assert_eq!(&short, b"an \0");
            let none = short.as_mut_ptr().cast();
            assert_eq!(Handle::last_error(handle, none, 0), NVSP_ERR_BUFFER_TOO_SMALL);
            assert_eq!(Handle::last_error(handle, null_mut(), 9), NVSP_ERR_NULL);
            Handle::destroy(handle);
        }
    }
}
