//! Versions.

use std::ffi::c_char;

use super::structs::NVSP_ABI_VERSION;

/// Returns the library's version, such as "0.1.0". The text is static.
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

/// Returns the ABI version that the library speaks. NVSP_INIT and every call that takes a structure refuse a program
/// made for another NVSP_ABI_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_abi_version() -> u32 {
    NVSP_ABI_VERSION
}
