//! Versions.

use std::ffi::c_char;

use super::structs::NVSP_ABI_VERSION;

/// The library's version, as in "0.1.0"; static.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_version() -> *const c_char {
    const TEXT: &std::ffi::CStr = match std::ffi::CStr::from_bytes_with_nul(
        concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes(),
    ) {
        Ok(text) => text,
        Err(_) => panic!("a version without NUL"),
    };
    TEXT.as_ptr()
}

/// The ABI version that the library speaks. A program made for another NVSP_ABI_VERSION is refused by
/// NVSP_INIT and by every call that takes a structure.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_abi_version() -> u32 {
    NVSP_ABI_VERSION
}
