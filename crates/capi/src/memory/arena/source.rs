//! Where memory comes from: the caller's functions, or the system's.

use std::alloc::{GlobalAlloc, Layout, System};
use std::ffi::c_void;
use std::mem::transmute;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};

use crate::allocator::{nvsp_allocate_callback, nvsp_release_callback};

type Allocate = unsafe extern "C" fn(*mut c_void, usize, usize) -> *mut c_void;
type Release = unsafe extern "C" fn(*mut c_void, *mut c_void, usize, usize);

static ALLOCATE: AtomicPtr<c_void> = AtomicPtr::new(null_mut());
static RELEASE: AtomicPtr<c_void> = AtomicPtr::new(null_mut());
static USER: AtomicPtr<c_void> = AtomicPtr::new(null_mut());
/// Blocks that are out.
static BLOCKS: AtomicUsize = AtomicUsize::new(0);

/// Takes the caller's functions, unless blocks are out: each must go back to where it came from.
#[cfg_attr(not(cargo_c), allow(dead_code))] // Only the C library has this allocator.
pub(in crate::memory) fn set(
    allocate: nvsp_allocate_callback,
    release: nvsp_release_callback,
    user: *mut c_void,
) -> bool {
    if BLOCKS.load(Ordering::Acquire) > 0 {
        return false;
    }
    let pointer = |function: Option<*mut c_void>| function.unwrap_or(null_mut());
    RELEASE.store(pointer(release.map(|f| f as *mut c_void)), Ordering::Release);
    USER.store(user, Ordering::Release);
    ALLOCATE.store(pointer(allocate.map(|f| f as *mut c_void)), Ordering::Release);
    true
}

/// Gives a block's content a block of another size. The old one goes back only if there is a new one.
///
/// # Safety
/// As for [`GlobalAlloc::realloc`] of this allocator.
pub(super) unsafe fn move_block(
    allocator: &impl GlobalAlloc,
    block: *mut u8,
    layout: Layout,
    size: usize,
) -> *mut u8 {
    // SAFETY: a size that is no more than a layout takes, see `# Safety`. Both blocks have the bytes that are copied.
    unsafe {
        let moved = allocator.alloc(Layout::from_size_align_unchecked(size, layout.align()));
        if !moved.is_null() {
            moved.copy_from_nonoverlapping(block, layout.size().min(size));
            allocator.dealloc(block, layout);
        }
        moved
    }
}

pub(super) struct Source;

// SAFETY: the system's allocator, or functions that the header asks to be one. Nothing here allocates or unwinds.
unsafe impl GlobalAlloc for Source {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let function = ALLOCATE.load(Ordering::Acquire);
        let block = if function.is_null() {
            // SAFETY: the layout has a size, as `GlobalAlloc::alloc` asks.
            unsafe { System.alloc(layout) }
        } else {
            // SAFETY: `set` stored a function of this type.
            let allocate = unsafe { transmute::<*mut c_void, Allocate>(function) };
            let user = USER.load(Ordering::Acquire);
            // SAFETY: the header asks for a function that takes any size and power of two.
            unsafe { allocate(user, layout.size(), layout.align()).cast() }
        };
        if !block.is_null() {
            BLOCKS.fetch_add(1, Ordering::Relaxed);
        }
        block
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if ALLOCATE.load(Ordering::Acquire).is_null() {
            // SAFETY: the layout has a size, as `GlobalAlloc::alloc` asks.
            let block = unsafe { System.alloc_zeroed(layout) };
            if !block.is_null() {
                BLOCKS.fetch_add(1, Ordering::Relaxed);
            }
            return block;
        }
        // SAFETY: the layout has a size, which is the block's, too.
        unsafe {
            let block = self.alloc(layout);
            if !block.is_null() {
                block.write_bytes(0, layout.size());
            }
            block
        }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        let function = RELEASE.load(Ordering::Acquire);
        if function.is_null() {
            // SAFETY: the block is the system's, of this layout: `set` changes nothing while blocks are out.
            unsafe { System.dealloc(block, layout) };
        } else {
            // SAFETY: `set` stored a function of this type, and gave the block by its counterpart.
            unsafe {
                let release = transmute::<*mut c_void, Release>(function);
                release(USER.load(Ordering::Acquire), block.cast(), layout.size(), layout.align());
            }
        }
        BLOCKS.fetch_sub(1, Ordering::Release);
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if ALLOCATE.load(Ordering::Acquire).is_null() {
            // SAFETY: the block is the system's, of this layout: `set` changes nothing while blocks are out.
            return unsafe { System.realloc(block, layout, size) };
        }
        // SAFETY: the block is this allocator's, of this layout, as `GlobalAlloc::realloc` asks.
        unsafe { move_block(self, block, layout, size) }
    }
}
