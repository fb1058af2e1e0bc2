//! The fence between C and the library.

use std::cell::RefCell;
use std::ffi::{c_char, c_void};
use std::fmt::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

use nvsprior::QueueError;
use nvsprior::parts::FloatEnvironment;

use super::log::{Log, NVSP_LOG_ERROR};
use super::stack::with_room;
use super::status::*;

/// What an opaque handle points to: its content for one thread at a time, and its failures. The types of the header are
/// names of it. C has handles from [`Handle::boxed`] alone, so that a function that takes a reference need not check
/// more than NULL.
#[repr(C)]
pub struct Handle<T> {
    /// First, where functions find it that take any handle.
    head: Head,
    content: Mutex<T>,
}

/// What handles of all kinds begin with.
struct Head {
    failures: Failures,
    /// A pointer to this handle as what it is.
    known: fn(*mut c_void) -> *mut dyn AnyHandle,
    /// Another handle owns it.
    is_lent: bool,
}

/// What can be done with a handle of any kind.
trait AnyHandle {
    fn failures(&self) -> &Failures;
    fn is_lent(&self) -> bool;
    fn wait(&self, timeout: Duration) -> nvsp_status;
    fn cancel(&self) -> nvsp_status;
    fn end(self: Box<Self>);
}

/// What a handle may hold.
pub(super) trait Content: Sized + 'static {
    /// See [`nvsp_wait`].
    fn wait(&mut self, _: Duration) -> Result<nvsp_status, Failure> {
        Err(Failure::argument("handle: none that works beside its caller"))
    }

    /// See [`nvsp_cancel`].
    fn cancel(&mut self) -> Result<nvsp_status, Failure> {
        Err(Failure::argument("handle: none that works beside its caller"))
    }

    /// Called before the handle ends.
    fn ends(_: &Handle<Self>) {}
}

impl<T: Content> AnyHandle for Handle<T> {
    fn failures(&self) -> &Failures {
        &self.head.failures
    }

    fn is_lent(&self) -> bool {
        self.head.is_lent
    }

    fn wait(&self, timeout: Duration) -> nvsp_status {
        Handle::call(Some(self), |content| content.wait(timeout))
    }

    fn cancel(&self) -> nvsp_status {
        Handle::call(Some(self), Content::cancel)
    }

    fn end(self: Box<Self>) {
        T::ends(&self);
    }
}

/// The handle at a pointer; NULL is none.
///
/// # Safety
/// `handle` is NULL or a live one.
unsafe fn any(handle: *mut c_void) -> Option<*mut dyn AnyHandle> {
    // SAFETY: a live handle of any kind begins with its head.
    let head = unsafe { handle.cast::<Head>().as_ref()? };
    Some((head.known)(handle))
}

/// The last failure on a handle, and where failures are logged.
pub(super) struct Failures {
    last: Mutex<LastFailure>,
    log: Log,
}

/// The text of the last failure, and how often it came in a row.
struct LastFailure {
    text: Text,
    times: u64,
}

/// Bytes of a failure's text that are kept.
const TEXT: usize = 512;

/// A text of bounded length: a failure costs no memory.
#[derive(Clone, Copy)]
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
    const EMPTY: Text = Text { bytes: [0; TEXT], len: 0 };

    fn of(text: fmt::Arguments) -> Text {
        let mut made = Text::EMPTY;
        // Writing to a Text never fails.
        let _ = made.write_fmt(text);
        made
    }

    fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..self.len]).unwrap_or_default()
    }
}

impl<T: Content> Handle<T> {
    fn new(content: T, log: Log, is_lent: bool) -> Handle<T> {
        let last = Mutex::new(LastFailure { text: Text::EMPTY, times: 0 });
        let head = Head {
            failures: Failures { last, log },
            known: |handle| handle.cast::<Handle<T>>() as *mut dyn AnyHandle,
            is_lent,
        };
        Handle { head, content: Mutex::new(content) }
    }

    /// Makes a handle for C to hold; [`nvsp_destroy`] takes it back.
    pub(super) fn boxed(content: T, log: Log) -> Box<Handle<T>> {
        Box::new(Handle::new(content, log, false))
    }

    /// Makes a handle that another one owns: C may use it, and not end it.
    pub(super) fn lent(content: T, log: Log) -> Arc<Handle<T>> {
        Arc::new(Handle::new(content, log, true))
    }
}

impl<T> Handle<T> {
    pub(super) fn log(&self) -> Log {
        self.head.failures.log
    }

    /// Runs a call that needs the handle for itself. Fails with `NVSP_ERR_BUSY` if another thread
    /// is inside such a call. After a panic, every later call fails with `NVSP_ERR_INTERNAL`.
    pub(super) fn call(
        handle: Option<&Handle<T>>,
        body: impl FnOnce(&mut T) -> Result<nvsp_status, Failure>,
    ) -> nvsp_status {
        let Some(handle) = handle else { return NVSP_ERR_ARGUMENT };
        handle.head.failures.fence(|| body(&mut *handle.enter()?))
    }

    /// The content, for this thread alone.
    pub(super) fn enter(&self) -> Result<MutexGuard<'_, T>, Failure> {
        self.content.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => {
                Failure::at(NVSP_ERR_BUSY, "another thread is inside a call on it")
            }
            TryLockError::Poisoned(_) => {
                Failure::at(NVSP_ERR_INTERNAL, "in an earlier call: destroy the handle")
            }
        })
    }

    /// Keeps and logs a failure that no call returns.
    pub(super) fn note(&self, failure: &Failure) {
        self.head.failures.note(failure);
    }

    /// Runs a call that several threads may make at once: `body` gets the content as it stands.
    pub(super) fn share(
        handle: Option<&Handle<T>>,
        body: impl FnOnce(&Handle<T>, T) -> Result<nvsp_status, Failure>,
    ) -> nvsp_status
    where
        T: Clone,
    {
        let Some(handle) = handle else { return NVSP_ERR_ARGUMENT };
        handle.head.failures.fence(|| body(handle, handle.get()))
    }

    /// The content as it stands of a handle that another call needs besides its own.
    pub(super) fn of(handle: Option<&Handle<T>>, name: &'static str) -> Result<T, Failure>
    where
        T: Clone,
    {
        handle.map(Handle::get).ok_or(Failure::null(name))
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
}

impl Failures {
    /// Turns failures and panics into statuses with a text.
    fn fence(&self, body: impl FnOnce() -> Result<nvsp_status, Failure>) -> nvsp_status {
        caught(body).unwrap_or_else(|failure| {
            self.note(&failure);
            keep(&failure);
            failure.status()
        })
    }

    /// Keeps a failure's text and logs it. If it is the same as the last one, it is only counted: the log gets a line
    /// when the count reaches 10, 100 and so on, and a last one before another text.
    fn note(&self, failure: &Failure) {
        let text = Text::of(format_args!("{failure}"));
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
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
        let text = Text::of(format_args!("{}", last.text.as_str()));
        drop(last);
        if times > 1 && 10_u64.pow(times.ilog10()) != times {
            self.log_count(before.as_str(), times);
        }
        self.log.write(NVSP_LOG_ERROR, text.as_str());
    }

    /// Logs how often a failure came in a row.
    fn log_count(&self, text: &str, times: u64) {
        // Not on the heap: a link may damage a frame at any time.
        let line = Text::of(format_args!("{times} times in a row: {text}"));
        self.log.write(NVSP_LOG_ERROR, line.as_str());
    }
}

/// Copies the text of the last failed call on a handle into `text`. An engine's is also that of the last failure to
/// make something with it; that of the encoder of a vehicle tells of its last frame that failed. Writes at most `size`
/// bytes, with the NUL at the end. The text is empty if nothing failed.
///
/// Fails with NVSP_ERR_BUFFER_TOO_SMALL if `size` is 0.
///
/// # Safety
/// - `handle`: a live handle of any kind. NULL: the last call that failed on this thread, of any handle or of none.
/// - `text`: receives the text, ending in NUL.
/// - `size`: bytes of `text`, 1 or more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_last_error(
    handle: *const c_void,
    text: *mut c_char,
    size: usize,
) -> nvsp_status {
    // SAFETY: a live handle, see `# Safety`.
    let handle = unsafe { any(handle.cast_mut()).map(|handle| &*handle) };
    if text.is_null() {
        return NVSP_ERR_ARGUMENT;
    }
    if size == 0 {
        return NVSP_ERR_BUFFER_TOO_SMALL;
    }
    let last = match handle {
        Some(handle) => handle.failures().last.lock().unwrap_or_else(PoisonError::into_inner).text,
        None => LAST.with_borrow(|text| *text),
    };
    let from = &last.as_str()[..last.as_str().floor_char_boundary(size - 1)];
    // SAFETY: `size` bytes stand at `text`, see `# Safety`; the bytes copied and the NUL are at most as many.
    unsafe {
        text.copy_from_nonoverlapping(from.as_ptr().cast(), from.len());
        *text.add(from.len()) = 0;
    }
    NVSP_OK
}

/// Tells whether the frame or the packet that was begun has ended, with success or not: NVSP_OK if it has, else
/// NVSP_PENDING. Waits for that at most as long as you say.
///
/// Fails with NVSP_ERR_STATE if none was begun, or NVSP_ERR_ARGUMENT (another handle).
///
/// # Safety
/// - `handle`: an encoder or a decoder; a vehicle: its first frame that is coded; a topside: what it decodes.
/// - `milliseconds`: the longest to wait; 0 does not wait.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_wait(handle: *mut c_void, milliseconds: u32) -> nvsp_status {
    // SAFETY: a live handle, see `# Safety`.
    let handle = unsafe { any(handle).map(|handle| &*handle) };
    let timeout = Duration::from_millis(milliseconds.into());
    handle.map_or(NVSP_ERR_ARGUMENT, |handle| handle.wait(timeout))
}

/// Drops what was begun, and a packet or a picture that was not fetched; both frames, if two are under way. Never
/// waits: returns NVSP_OK if the handle is free again, or nothing was begun, else NVSP_PENDING. What was begun then
/// ends with what the device is at, a few renders, at most as long as the watchdog allows; a coding that has begun goes
/// on to its end. Until then, other calls fail with NVSP_ERR_UNFINISHED. Call this again, or nvsp_wait, which then
/// returns NVSP_ERR_STATE.
///
/// A frame that is dropped counts as one whose packet was lost. Its number is used up. The next search may start at its
/// pose. The next packet names prior and camera in full. A camera that a dropped packet told is known afterwards.
///
/// Fails with NVSP_ERR_ARGUMENT (another handle).
///
/// # Safety
/// - `handle`: an encoder or a decoder; those of a vehicle and a topside are these handles' own.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_cancel(handle: *mut c_void) -> nvsp_status {
    // SAFETY: a live handle, see `# Safety`.
    let handle = unsafe { any(handle).map(|handle| &*handle) };
    handle.map_or(NVSP_ERR_ARGUMENT, |handle| handle.cancel())
}

/// Ends a handle of any kind. What was made with it goes on to work: the last such handle frees what they share, and
/// closes the device, unless you gave it. Waits for a frame or a packet that was begun, at most as long as the watchdog
/// allows. Modem frames that wait in a vehicle are lost. Encoder and decoder that a vehicle or a topside has handed out
/// end with these: on them the call does nothing.
///
/// # Safety
/// - `handle`: a live handle, which no thread uses. NULL: nothing is done.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_destroy(handle: *mut c_void) {
    // There is nobody left to report a panic while dropping.
    let _ = caught(|| {
        // SAFETY: a live handle, see `# Safety`.
        let Some(handle) = (unsafe { any(handle) }) else { return Ok(()) };
        // SAFETY: as before.
        if unsafe { (*handle).is_lent() } {
            return Ok(());
        }
        // SAFETY: `Handle::boxed` made the box, as it is not lent, and nobody uses it afterwards, see `# Safety`.
        unsafe { Box::from_raw(handle) }.end();
        Ok(())
    });
}

/// Locks what calls and the library's threads share. Fails if a thread panicked while it had the lock.
pub(super) fn locked<T>(content: &Mutex<T>) -> Result<MutexGuard<'_, T>, Failure> {
    content.lock().map_err(|_| QueueError::Poisoned.into())
}

thread_local! {
    /// The text of the last failure on this thread.
    static LAST: RefCell<Text> = const { RefCell::new(Text::EMPTY) };
}

/// Keeps a failure's text for this thread.
fn keep(failure: &Failure) {
    let text = Text::of(format_args!("{failure}"));
    LAST.with_borrow_mut(|last| *last = text);
}

/// Runs a call that has no handle to keep a text in.
pub(super) fn fence(body: impl FnOnce() -> Result<nvsp_status, Failure>) -> nvsp_status {
    caught(body).unwrap_or_else(|failure| {
        keep(&failure);
        failure.status()
    })
}

fn caught<T>(body: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    let _environment = FloatEnvironment::enter();
    let (mut body, mut done) = (Some(body), None);
    with_room(&mut || {
        let body = AssertUnwindSafe(|| body.take().map(|body| body()));
        done = catch_unwind(body).unwrap_or(None);
    })?;
    done.unwrap_or_else(|| {
        Err(Failure::at(NVSP_ERR_INTERNAL, "please report it, and destroy the handle"))
    })
}

#[cfg(test)]
mod tests {
    use std::ptr::{null, null_mut};

    use super::*;

    impl Content for u32 {}

    fn handle() -> Box<Handle<u32>> {
        Handle::boxed(5, Log::new(None, null_mut()))
    }

    /// [`nvsp_last_error`] into a buffer, all of whose bytes were 1.
    fn last_error<const SIZE: usize>(handle: &Handle<u32>) -> (nvsp_status, [u8; SIZE]) {
        let mut text = [1u8; SIZE];
        // SAFETY: a live handle, and the buffer's own size.
        let status =
            unsafe { nvsp_last_error((&raw const *handle).cast(), text.as_mut_ptr().cast(), SIZE) };
        (status, text)
    }

    #[test]
    fn a_panic_poisons_the_handle_and_nothing_else() {
        let (one, other) = (handle(), handle());
        assert_eq!(Handle::call(Some(&one), |_| panic!("on purpose")), NVSP_ERR_INTERNAL);
        let (status, text) = last_error::<600>(&one);
        let end = text.iter().position(|b| *b == 0).unwrap();
        assert!(status == NVSP_OK && str::from_utf8(&text[..end]).unwrap().contains("report"));
        assert_eq!(Handle::call(Some(&one), |_| Ok(NVSP_OK)), NVSP_ERR_INTERNAL);
        assert_eq!(Handle::call(Some(&other), |v| Ok(*v as i32)), 5);
        // SAFETY: a live handle and none.
        unsafe {
            assert_eq!(nvsp_wait((&raw const *other).cast_mut().cast(), 0), NVSP_ERR_ARGUMENT);
            assert_eq!(nvsp_cancel(null_mut()), NVSP_ERR_ARGUMENT);
            nvsp_destroy(Box::into_raw(one).cast());
            nvsp_destroy(null_mut());
        }
        assert_eq!(Handle::<u32>::call(None, |_| Ok(NVSP_OK)), NVSP_ERR_ARGUMENT);
    }

    #[test]
    fn two_threads_do_not_enter_at_once() {
        let shared = handle();
        let (entered, wait) = std::sync::mpsc::channel();
        let (go_on, released) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let shared = &shared;
            let inside = scope.spawn(move || {
                Handle::call(Some(shared), |_| {
                    entered.send(()).unwrap();
                    released.recv().unwrap();
                    Ok(NVSP_OK)
                })
            });
            wait.recv().unwrap();
            assert_eq!(Handle::call(Some(shared), |_| Ok(NVSP_OK)), NVSP_ERR_BUSY);
            go_on.send(()).unwrap();
            assert_eq!(inside.join().unwrap(), NVSP_OK);
            assert_eq!(Handle::call(Some(shared), |_| Ok(NVSP_OK)), NVSP_OK);
        });
    }

    #[test]
    fn texts_are_cut_at_whole_characters() {
        let text = Text::of(format_args!("{}é{}", "a".repeat(TEXT - 1), "b".repeat(9)));
        assert_eq!(text.len, TEXT);
        assert!(text.as_str().ends_with("ab"), "the é did not fit, what came after did");
        let handle = handle();
        Handle::call(Some(&handle), |_| Err(Failure::argument("é")));
        assert_eq!(last_error(&handle), (NVSP_OK, *b"an \0"));
        assert_eq!(last_error(&handle), (NVSP_ERR_BUFFER_TOO_SMALL, []));
        // SAFETY: a live handle or none, and no text.
        unsafe {
            let this = (&raw const *handle).cast();
            assert_eq!(nvsp_last_error(this, null_mut(), 9), NVSP_ERR_ARGUMENT);
            assert_eq!(nvsp_last_error(null(), null_mut(), 9), NVSP_ERR_ARGUMENT);
            let mut text = [1u8; 9];
            assert_eq!(nvsp_last_error(null(), text.as_mut_ptr().cast(), 9), NVSP_OK);
            assert_eq!(&text, b"an argum\0", "of this thread's last failure");
        }
    }
}
