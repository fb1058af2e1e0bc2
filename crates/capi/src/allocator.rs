//! The caller's functions for host memory.

use std::ffi::c_void;

/// Gives `size` bytes at an address that is a multiple of `alignment`, a power of two; NULL: there are none. Called on
/// any thread, on several at once. It must not call the library, and must not unwind.
pub type nvsp_allocate_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, size: usize, alignment: usize) -> *mut c_void>;

/// Takes a block back that nvsp_allocate_callback gave, with the size and alignment that it was asked for.
pub type nvsp_release_callback = Option<
    unsafe extern "C" fn(user: *mut c_void, block: *mut c_void, size: usize, alignment: usize),
>;
