//! Host memory that never ends the process.
//!
//! Rust code, ours and that of the libraries we use, ends the process if an allocation fails. So a call that takes
//! memory first sets aside as much as it can need at most, which may fail, and gives it back at its end: [`Grant`].
//! In between, the library's allocator serves from the grant what the system refuses. What outlives the call stays in
//! the grant, which is freed with the last of it. Small needs outside of such calls (the text of an error, a thread)
//! come from a fixed reserve.
//!
//! The allocator stands only in the C library, which cargo-c builds with `cfg(cargo_c)`. Rust programs choose their
//! own.

use std::ffi::c_void;

use super::allocator::{nvsp_allocate_callback, nvsp_release_callback};
use super::handle::fence;
use super::status::*;

/// Sets the functions that the library takes host memory from, for the whole process. Call it before all other
/// functions. You may call it again once all handles are destroyed. The Vulkan loader and driver take theirs as they
/// do, and threads their stacks.
///
/// Fails with NVSP_ERR_ARGUMENT (one callback without the other), or NVSP_ERR_STATE if the library holds memory.
///
/// # Parameters
/// - `allocate`: gives memory. NULL: both callbacks are NULL, and the C library's functions are used.
/// - `release`: takes it back.
/// - `user`: passed to both as it is. What it points to must stay as long as the library is loaded.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_set_allocator(
    allocate: nvsp_allocate_callback,
    release: nvsp_release_callback,
    user: *mut c_void,
) -> nvsp_status {
    fence(|| {
        if allocate.is_some() != release.is_some() {
            return Err(Failure::argument("allocate, release: one without the other"));
        }
        #[cfg(cargo_c)]
        if arena::source::set(allocate, release, user) {
            return Ok(NVSP_OK);
        }
        #[cfg(not(cargo_c))]
        let _ = user;
        Err(Failure::at(NVSP_ERR_STATE, "the library holds memory"))
    })
}

/// Memory set aside for a call on this thread.
pub(super) struct Grant {
    #[cfg(cargo_c)]
    _arena: arena::Open,
}

impl Grant {
    /// Sets `bytes` aside for `what`. Fails if they are above `limit`, or if the system does not have them.
    pub(super) fn take(what: &'static str, bytes: u64, limit: u64) -> Result<Grant, Failure> {
        let failed = || Failure::Memory { what, bytes, limit };
        if bytes > limit {
            return Err(failed());
        }
        let size = usize::try_from(bytes).map_err(|_| failed())?;
        #[cfg(cargo_c)]
        return arena::Open::new(size).map(|_arena| Grant { _arena }).ok_or_else(failed);
        #[cfg(not(cargo_c))]
        Vec::<u8>::new().try_reserve_exact(size).map(|()| Grant {}).map_err(|_| failed())
    }
}

#[cfg(any(cargo_c, test))]
mod arena {
    use std::alloc::{GlobalAlloc, Layout};
    use std::ptr::{NonNull, null_mut};
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::{Mutex, MutexGuard, PoisonError};

    use linked_list_allocator::Heap;

    use source::Source;

    pub(super) mod source;

    #[cfg(cargo_c)]
    #[global_allocator]
    static ALLOCATOR: Allocator = Allocator;

    /// The caller's allocator, or the system's. If it has nothing left, the arenas of this thread, then the reserve.
    pub(super) struct Allocator;

    /// Grants that may be held at once. A call has one; one more stays for each call that found the system without
    /// memory, as long as what it made lives.
    const ARENAS: usize = 64;
    /// Bytes of the reserve.
    const RESERVE: usize = 256 << 10;
    /// Largest block that the reserve gives: it is for many small needs.
    const RESERVE_BLOCK: usize = 16 << 10;
    /// Bytes that an arena takes for its own lists, and loses between blocks.
    const OVERHEAD: usize = 4096;
    const ALIGN: usize = 4096;

    static TABLE: [Arena; ARENAS] = [const { Arena::new() }; ARENAS];
    static RESERVE_ARENA: Arena = Arena::new();
    static RESERVE_BYTES: ReserveBytes = ReserveBytes(std::cell::UnsafeCell::new([0; RESERVE]));

    #[repr(align(4096))]
    struct ReserveBytes(std::cell::UnsafeCell<[u8; RESERVE]>);

    // SAFETY: only RESERVE_ARENA's heap, which a lock guards, gives parts of it away.
    unsafe impl Sync for ReserveBytes {}

    struct Arena {
        /// Where it lies; 0 if there is none. Read without the lock: a block's owner knows that its arena stays.
        start: AtomicUsize,
        end: AtomicUsize,
        state: Mutex<State>,
    }

    struct State {
        heap: Heap,
        /// Bytes taken from the system; 0: none.
        size: usize,
        /// The thread that it serves; `None` once its call has ended.
        owner: Option<libc::pthread_t>,
    }

    impl Arena {
        const fn new() -> Arena {
            let state = State { heap: Heap::empty(), size: 0, owner: None };
            let (start, end) = (AtomicUsize::new(0), AtomicUsize::new(0));
            Arena { start, end, state: Mutex::new(state) }
        }

        fn lock(&self) -> MutexGuard<'_, State> {
            self.state.lock().unwrap_or_else(PoisonError::into_inner)
        }

        fn holds(&self, block: *mut u8) -> bool {
            let address = block as usize;
            address >= self.start.load(Ordering::Acquire)
                && address < self.end.load(Ordering::Acquire)
        }

        /// # Safety
        /// The bytes are nobody else's until [`Arena::close`].
        unsafe fn open(&self, state: &mut State, start: *mut u8, size: usize) {
            // SAFETY: `size` bytes at `start` are nobody else's, see `# Safety`; the heap was empty.
            unsafe { state.heap.init(start, size) };
            state.size = size;
            self.start.store(start as usize, Ordering::Release);
            self.end.store(start as usize + size, Ordering::Release);
        }

        /// Gives the bytes back to the system, if nobody uses any.
        fn close_if_unused(&self, state: &mut State) {
            if state.owner.is_some() || state.size == 0 || state.heap.used() > 0 {
                return;
            }
            let start = self.start.swap(0, Ordering::AcqRel);
            self.end.store(0, Ordering::Release);
            state.heap = Heap::empty();
            let size = std::mem::take(&mut state.size);
            // SAFETY: `Open::new` got them from the system in this layout, and no block of them is left.
            unsafe { Source.dealloc(start as *mut u8, layout_of(size)) };
        }
    }

    fn layout_of(size: usize) -> Layout {
        // A constant alignment, and a size that `Open::new` has tried.
        Layout::from_size_align(size, ALIGN).unwrap_or(Layout::new::<u8>())
    }

    fn this_thread() -> libc::pthread_t {
        // SAFETY: no preconditions.
        unsafe { libc::pthread_self() }
    }

    /// An arena that serves this thread.
    pub(super) struct Open(usize);

    impl Open {
        /// `None` if the system does not have the bytes, or the table is full.
        pub(super) fn new(size: usize) -> Option<Open> {
            let size = size.checked_add(size / 16 + OVERHEAD)?.next_multiple_of(ALIGN);
            let layout = Layout::from_size_align(size, ALIGN).ok()?;
            for (index, arena) in TABLE.iter().enumerate() {
                let Ok(mut state) = arena.state.try_lock() else { continue };
                if state.size > 0 {
                    continue;
                }
                // SAFETY: the layout has a size.
                let start = NonNull::new(unsafe { Source.alloc(layout) })?;
                state.owner = Some(this_thread());
                // SAFETY: just taken, for this arena alone.
                unsafe { arena.open(&mut state, start.as_ptr(), size) };
                return Some(Open(index));
            }
            None
        }
    }

    impl Drop for Open {
        fn drop(&mut self) {
            let mut state = TABLE[self.0].lock();
            state.owner = None;
            TABLE[self.0].close_if_unused(&mut state);
        }
    }

    /// What to give if the system has nothing.
    fn rescue(layout: Layout) -> *mut u8 {
        let me = this_thread();
        for arena in TABLE.iter().filter(|arena| arena.end.load(Ordering::Acquire) > 0) {
            let mut state = arena.lock();
            if state.owner == Some(me)
                && let Ok(block) = state.heap.allocate_first_fit(layout)
            {
                return block.as_ptr();
            }
        }
        if layout.size() > RESERVE_BLOCK {
            return null_mut();
        }
        let mut state = RESERVE_ARENA.lock();
        if state.size == 0 {
            // SAFETY: opened once; nobody else uses the bytes.
            unsafe { RESERVE_ARENA.open(&mut state, RESERVE_BYTES.0.get().cast(), RESERVE) };
        }
        state.heap.allocate_first_fit(layout).map_or(null_mut(), NonNull::as_ptr)
    }

    /// The arena that a block lies in.
    fn arena_of(block: *mut u8) -> Option<&'static Arena> {
        TABLE.iter().chain([&RESERVE_ARENA]).find(|arena| arena.holds(block))
    }

    // SAFETY: blocks come from Source or from a heap, of the layout asked for, and go back to where they came from.
    // Nothing here allocates or unwinds: the heaps panic on no request.
    unsafe impl GlobalAlloc for Allocator {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            // SAFETY: the layout has a size, as `GlobalAlloc::alloc` asks.
            let block = unsafe { Source.alloc(layout) };
            if block.is_null() { rescue(layout) } else { block }
        }

        unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
            // SAFETY: the layout has a size, as `GlobalAlloc::alloc` asks.
            let block = unsafe { Source.alloc_zeroed(layout) };
            if !block.is_null() {
                return block;
            }
            let block = rescue(layout);
            if !block.is_null() {
                // SAFETY: a block of the layout's size.
                unsafe { block.write_bytes(0, layout.size()) };
            }
            block
        }

        unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
            match (arena_of(block), NonNull::new(block)) {
                (Some(arena), Some(block)) => {
                    let mut state = arena.lock();
                    // SAFETY: the block is of this heap, in this layout.
                    unsafe { state.heap.deallocate(block, layout) };
                    if !std::ptr::eq(arena, &RESERVE_ARENA) {
                        arena.close_if_unused(&mut state);
                    }
                }
                // SAFETY: the block is of no heap, so it is the source's, of this layout.
                _ => unsafe { Source.dealloc(block, layout) },
            }
        }

        unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
            if arena_of(block).is_none() {
                // SAFETY: the block is of no heap, so it is the source's, of this layout.
                let moved = unsafe { Source.realloc(block, layout, size) };
                if !moved.is_null() {
                    return moved;
                }
            }
            // SAFETY: the block is this allocator's, of this layout, as `GlobalAlloc::realloc` asks.
            unsafe { source::move_block(self, block, layout, size) }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn blocks_outlive_the_call_and_the_last_one_closes_the_arena() {
            let open = Open::new(1 << 20).unwrap();
            let index = open.0;
            let layout = Layout::from_size_align(100_000, 64).unwrap();
            let block = || Some(rescue(layout)).filter(|block| !block.is_null());
            // The reserve is for small blocks: it gives none of these.
            let blocks: Vec<_> = std::iter::from_fn(block).collect();
            assert!((10..=12).contains(&blocks.len()), "{} blocks", blocks.len());
            assert!(blocks.iter().all(|b| !b.is_null() && TABLE[index].holds(*b)));
            assert!(blocks.iter().all(|b| (*b as usize).is_multiple_of(64)));
            drop(open);
            assert!(TABLE[index].end.load(Ordering::Acquire) > 0, "blocks are left");
            // SAFETY: each block is given back once, in its layout.
            unsafe { blocks.iter().for_each(|b| Allocator.dealloc(*b, layout)) };
            assert_eq!(TABLE[index].lock().size, 0);
        }

        #[test]
        fn a_grant_serves_its_own_thread_alone() {
            let open = Open::new(1 << 20).unwrap();
            let (index, layout) = (open.0, Layout::from_size_align(1000, 8).unwrap());
            let other = std::thread::spawn(move || {
                let block = rescue(layout);
                let from_reserve = RESERVE_ARENA.holds(block);
                // SAFETY: given back once, in its layout.
                unsafe { Allocator.dealloc(block, layout) };
                from_reserve
            });
            assert!(other.join().unwrap());
            let block = rescue(layout);
            assert!(TABLE[index].holds(block));
            // SAFETY: a block of 1000 bytes; realloc gives it back.
            unsafe {
                block.write_bytes(7, 1000);
                let moved = Allocator.realloc(block, layout, 50_000);
                assert_eq!(std::slice::from_raw_parts(moved, 1000), [7; 1000]);
                Allocator.dealloc(moved, Layout::from_size_align(50_000, 8).unwrap());
            }
            assert_eq!(TABLE[index].lock().heap.used(), 0);
        }

        #[test]
        fn what_no_system_has_is_refused() {
            assert!(Open::new(usize::MAX).is_none());
            assert!(Open::new(usize::MAX / 4).is_none());
        }
    }
}
