//! Bytes at a caller's pointers.

use super::status::Failure;

/// The bytes at a pointer; an empty slice if `size` is 0.
///
/// # Safety
/// `bytes` is null or has `size` bytes that nobody changes for as long as the slice is in use.
pub(super) unsafe fn slice<'a>(
    bytes: *const u8,
    size: usize,
    name: &'static str,
) -> Result<&'a [u8], Failure> {
    match (bytes.is_null(), size) {
        (_, 0) => Ok(&[]),
        (true, _) => Err(Failure::null(name)),
        (false, size) if size > isize::MAX as usize => Err(Failure::argument(name)),
        // SAFETY: as the caller promises.
        (false, size) => Ok(unsafe { std::slice::from_raw_parts(bytes, size) }),
    }
}

/// As [`slice()`], to write.
///
/// # Safety
/// As for [`slice()`], and nobody reads the bytes either.
pub(super) unsafe fn slice_mut<'a>(
    bytes: *mut u8,
    size: usize,
    name: &'static str,
) -> Result<&'a mut [u8], Failure> {
    match (bytes.is_null(), size) {
        (_, 0) => Ok(&mut []),
        (true, _) => Err(Failure::null(name)),
        (false, size) if size > isize::MAX as usize => Err(Failure::argument(name)),
        // SAFETY: as the caller promises.
        (false, size) => Ok(unsafe { std::slice::from_raw_parts_mut(bytes, size) }),
    }
}
