//! The caller's functions for host memory.

use std::ffi::c_void;

use super::structs::versioned;

/// Gives `size` bytes at an address that is a multiple of `alignment`, a power of two; NULL: there are none. Called on
/// any thread, on several at once. It must not call the library, and must not unwind.
pub type nvsp_allocate_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, size: usize, alignment: usize) -> *mut c_void>;

/// Takes a block back that nvsp_allocate_callback gave, with the size and alignment that it was asked for.
pub type nvsp_release_callback = Option<
    unsafe extern "C" fn(user: *mut c_void, block: *mut c_void, size: usize, alignment: usize),
>;

/// Where the library takes host memory from.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_allocator {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Gives memory. NULL: both callbacks are NULL, and the C library's functions are used.
    pub allocate: nvsp_allocate_callback,
    /// Takes it back.
    pub release: nvsp_release_callback,
    /// Passed to both as it is. What it points to must stay as long as the library is loaded.
    pub user: *mut c_void,
}
versioned!(nvsp_allocator, 32);
