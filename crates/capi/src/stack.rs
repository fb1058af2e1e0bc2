//! Calls from threads whose stack is small.
//!
//! A driver compiles shaders on the stack of the thread that asks for it, and takes hundreds of kilobytes. A thread of
//! musl has 128 kB, one of a real-time system or a coroutine less.

use std::cell::Cell;
use std::mem::{MaybeUninit, transmute};
use std::ops::Range;
use std::ptr::{null_mut, without_provenance_mut};

use super::status::*;
use super::structs::User;
use super::thread::{Thread, ThreadStart};

/// What a call may need of its stack, bytes.
const NEEDED: usize = 1 << 20;

thread_local! {
    /// Where this thread's stack lies; empty: not known yet.
    static STACK: Cell<(usize, usize)> = const { Cell::new((0, 0)) };
}

/// A call of another thread, which waits for its end.
struct Lent(*mut (dyn FnMut() + 'static));

// SAFETY: the thread that lent it does nothing until it is done.
unsafe impl Send for Lent {}

impl Lent {
    /// # Safety
    /// What was lent is still there, and nobody else uses it.
    unsafe fn run(self) {
        // SAFETY: see `# Safety`.
        unsafe { (*self.0)() }
    }
}

/// Runs a call: on this thread or, if too little of its stack is left, on one of the library while this one waits. The
/// call must not unwind.
///
/// Fails with NVSP_ERR_MEMORY if no thread can be started.
// Not inlined, so that what calls take of the stack is not taken here.
#[inline(never)]
pub(super) fn with_room(call: &mut dyn FnMut()) -> Result<(), Failure> {
    if left() >= NEEDED {
        call();
        return Ok(());
    }
    // SAFETY: the same type but for the lifetime. The thread is joined below, before that ends.
    let lent =
        Lent(unsafe { transmute::<*mut (dyn FnMut() + '_), *mut (dyn FnMut() + 'static)>(call) });
    let start = ThreadStart { callback: None, user: User(null_mut()) };
    // SAFETY: `call` is there until the thread has ended, and this thread only waits.
    drop(Thread::spawn(c"nvsp-call", start, move || unsafe { lent.run() })?);
    Ok(())
}

/// Bytes of the stack that are left. None if this is not the stack that the system gave the thread.
fn left() -> usize {
    let here = MaybeUninit::<u8>::uninit();
    let here = here.as_ptr().addr();
    let (mut low, mut high) = STACK.get();
    if low == high {
        // Unknown: it counts as large.
        Range { start: low, end: high } = bounds().unwrap_or(1..usize::MAX);
        STACK.set((low, high));
    }
    if (low..high).contains(&here) { here - low } else { 0 }
}

/// Where the system put this thread's stack.
fn bounds() -> Option<Range<usize>> {
    let mut attributes = MaybeUninit::uninit();
    let (mut start, mut size) = (without_provenance_mut(0), 0);
    // SAFETY: places of the right types; `attributes` is destroyed once it was filled.
    let found = unsafe {
        if libc::pthread_getattr_np(libc::pthread_self(), attributes.as_mut_ptr()) != 0 {
            return None;
        }
        let found = libc::pthread_attr_getstack(attributes.as_ptr(), &raw mut start, &raw mut size);
        libc::pthread_attr_destroy(attributes.as_mut_ptr());
        found == 0
    };
    let start = start.addr();
    found.then_some(start..start + size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thread_of_a_call(stack: usize) -> bool {
        let thread = std::thread::Builder::new().stack_size(stack);
        let moved = thread.spawn(|| {
            let (own, mut ran) = (std::thread::current().id(), None);
            with_room(&mut || ran = Some(std::thread::current().id())).unwrap();
            ran.expect("a call that ran") != own
        });
        moved.unwrap().join().unwrap()
    }

    #[test]
    fn small_stacks_are_left() {
        assert!(thread_of_a_call(64 << 10));
        assert!(!thread_of_a_call(2 << 20));
    }
}
