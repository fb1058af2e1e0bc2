//! The threads that the library starts.
//!
//! They are made with the system's own calls, as std takes memory for a thread that it cannot do without.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::mem::MaybeUninit;
use std::ptr::null_mut;

use super::status::*;
use super::structs::User;
use nvsprior::parts::{FloatEnvironment, Spawn};

/// Called once on each thread that the library starts, before it does any work: set its scheduling, its affinity or
/// another name here. `name` is the name that the thread has, valid during the call. It must not call the library, and
/// must not unwind.
#[allow(non_camel_case_types)]
pub type nvsp_thread_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, name: *const c_char)>;

/// The callback with its user pointer.
#[derive(Clone, Copy)]
pub(super) struct ThreadStart {
    pub callback: nvsp_thread_callback,
    pub user: User,
}

/// A thread that was started. Waits for its end when dropped.
pub(super) struct Thread(libc::pthread_t);

/// Starts the threads of a queue's workers, by the names of the workers.
pub(super) fn spawner<const N: usize>(
    names: [&'static CStr; N],
    start: ThreadStart,
) -> Spawn<Failure> {
    Box::new(move |worker, body| {
        Ok(Box::new(Thread::spawn(names[worker.min(N - 1)], start, body)?))
    })
}

/// What a thread gets.
struct Start {
    name: &'static CStr,
    callback: ThreadStart,
    body: Box<dyn FnOnce() + Send>,
}

/// Stack of a thread, bytes.
const STACK: usize = 2 << 20;

/// Signals that a fault of the thread itself raises. They cannot be left for later.
const FAULTS: [c_int; 6] =
    [libc::SIGSEGV, libc::SIGBUS, libc::SIGILL, libc::SIGFPE, libc::SIGTRAP, libc::SIGSYS];

impl Thread {
    /// Starts a thread that blocks all signals, but for those of its own faults. `name` has at most 15 bytes. `body`
    /// must not unwind.
    pub(super) fn spawn(
        name: &'static CStr,
        callback: ThreadStart,
        body: impl FnOnce() + Send + 'static,
    ) -> Result<Thread, Failure> {
        let start = Box::into_raw(Box::new(Start { name, callback, body: Box::new(body) }));
        // The mask is inherited, so that no signal reaches the thread before it could block it.
        let old = block_signals();
        // SAFETY: `start` is the thread's from here on.
        let made = unsafe { create(start.cast()) };
        // SAFETY: a mask that the system gave.
        unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, &old, null_mut()) };
        made.map(Thread).ok_or_else(|| {
            // SAFETY: no thread has taken it.
            drop(unsafe { Box::from_raw(start) });
            Failure::at(NVSP_ERR_MEMORY, "a thread cannot be started")
        })
    }
}

impl Drop for Thread {
    fn drop(&mut self) {
        // SAFETY: started by `spawn`, and joined once.
        unsafe { libc::pthread_join(self.0, null_mut()) };
    }
}

/// # Safety
/// `start` is a `Start` that nobody else uses.
unsafe fn create(start: *mut c_void) -> Option<libc::pthread_t> {
    let (mut thread, mut attributes) = (MaybeUninit::uninit(), MaybeUninit::uninit());
    // SAFETY: places of the right types; `run` takes what `start` is.
    unsafe {
        if libc::pthread_attr_init(attributes.as_mut_ptr()) != 0 {
            return None;
        }
        libc::pthread_attr_setstacksize(attributes.as_mut_ptr(), STACK);
        let made = libc::pthread_create(thread.as_mut_ptr(), attributes.as_ptr(), run, start);
        libc::pthread_attr_destroy(attributes.as_mut_ptr());
        (made == 0).then(|| thread.assume_init())
    }
}

/// Blocks what a thread of the library should not see, on this thread. Returns the mask before.
fn block_signals() -> libc::sigset_t {
    let (mut all, mut old) = (MaybeUninit::uninit(), MaybeUninit::uninit());
    // SAFETY: places of the right type, which the first call fills.
    unsafe {
        libc::sigfillset(all.as_mut_ptr());
        for fault in FAULTS {
            libc::sigdelset(all.as_mut_ptr(), fault);
        }
        libc::pthread_sigmask(libc::SIG_SETMASK, all.as_ptr(), old.as_mut_ptr());
        old.assume_init()
    }
}

extern "C" fn run(start: *mut c_void) -> *mut c_void {
    // SAFETY: what `spawn` made for this thread alone.
    let Start { name, callback, body } = *unsafe { Box::from_raw(start.cast::<Start>()) };
    // SAFETY: this thread, and a text that ends in NUL.
    unsafe { libc::pthread_setname_np(libc::pthread_self(), name.as_ptr()) };
    if let Some(function) = callback.callback {
        // SAFETY: the header asks for a callback that takes any text, with the pointer it came with.
        unsafe { function(callback.user.0, name.as_ptr()) };
    }
    // Whatever the callback has set.
    let _environment = FloatEnvironment::enter();
    body();
    null_mut()
}
