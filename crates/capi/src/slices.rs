//! Bytes at a caller's pointers.

use std::ffi::{CStr, c_char};

use super::status::Failure;
use super::structs::Place;

/// Refuses NULL, and more bytes than a slice may have.
fn check(bytes: *const u8, size: usize, name: &'static str) -> Result<(), Failure> {
    match bytes.is_null() {
        true => Err(Failure::null(name)),
        false if size > isize::MAX as usize => Err(Failure::argument(name)),
        false => Ok(()),
    }
}

/// The bytes at a pointer, which is not NULL.
///
/// # Safety
/// `bytes` is NULL or has `size` bytes that nobody changes for as long as the slice is in use.
pub(super) unsafe fn slice<'a>(
    bytes: *const u8,
    size: usize,
    name: &'static str,
) -> Result<&'a [u8], Failure> {
    check(bytes, size, name)?;
    // SAFETY: `size` bytes stand at `bytes`, which is not NULL, and nobody changes them, see `# Safety`.
    Ok(unsafe { std::slice::from_raw_parts(bytes, size) })
}

/// As [`slice()`]; NULL is none if `size` is 0.
///
/// # Safety
/// As for [`slice()`].
pub(super) unsafe fn optional_slice<'a>(
    bytes: *const u8,
    size: usize,
    name: &'static str,
) -> Result<Option<&'a [u8]>, Failure> {
    if bytes.is_null() && size == 0 {
        return Ok(None);
    }
    // SAFETY: as for `slice`.
    unsafe { slice(bytes, size, name) }.map(Some)
}

/// As [`slice()`], to write; NULL is an empty one if `size` is 0.
///
/// # Safety
/// As for [`slice()`], and nobody reads the bytes either.
pub(super) unsafe fn slice_mut<'a>(
    bytes: *mut u8,
    size: usize,
    name: &'static str,
) -> Result<&'a mut [u8], Failure> {
    if bytes.is_null() && size == 0 {
        return Ok(&mut []);
    }
    check(bytes, size, name)?;
    // SAFETY: `size` bytes stand at `bytes`, which is not NULL, and nobody else uses them, see `# Safety`.
    Ok(unsafe { std::slice::from_raw_parts_mut(bytes, size) })
}

/// A text that ends in NUL; NULL is none.
///
/// # Safety
/// `text` is NULL, or ends in NUL and is not changed for as long as the result is in use.
pub(super) unsafe fn text<'a>(text: *const c_char) -> Option<&'a CStr> {
    // SAFETY: not null, and it ends in NUL, see `# Safety`.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) })
}

/// Where a caller wants bytes, and their number.
pub(super) struct Room<'a> {
    bytes: &'a mut [u8],
    written: Place<usize>,
}

impl Room<'_> {
    /// Checks both.
    ///
    /// # Safety
    /// `bytes` is NULL or has `size` bytes, which nobody else uses for as long as the room is in use.
    pub(super) unsafe fn new<'a>(
        bytes: *mut u8,
        size: usize,
        written: Place<usize>,
        name: &'static str,
    ) -> Result<Room<'a>, Failure> {
        if bytes.is_null() {
            return Err(Failure::null(name));
        }
        // SAFETY: as for `Room::new`.
        unsafe { Room::or_none(bytes, size, written, name) }
    }

    /// As [`Room::new`]; NULL is no room if `size` is 0.
    ///
    /// # Safety
    /// As for [`Room::new`].
    pub(super) unsafe fn or_none<'a>(
        bytes: *mut u8,
        size: usize,
        written: Place<usize>,
        name: &'static str,
    ) -> Result<Room<'a>, Failure> {
        let written = written.required("written")?;
        // SAFETY: `size` bytes stand at `bytes` if it is not NULL, see `# Safety`.
        Ok(Room { bytes: unsafe { slice_mut(bytes, size, name)? }, written })
    }

    /// Fails if so many bytes do not fit, and writes how many they are.
    pub(super) fn check(&self, needed: usize) -> Result<(), Failure> {
        let found = self.bytes.len();
        if needed > found {
            self.written.write(needed);
            return Err(Failure::Room { needed, found });
        }
        Ok(())
    }

    /// Has so many bytes written, and writes how many they are; if they do not fit, only how many.
    pub(super) fn fill(
        &mut self,
        len: usize,
        write: impl FnOnce(&mut [u8]),
    ) -> Result<(), Failure> {
        self.check(len)?;
        write(&mut self.bytes[..len]);
        self.written.write(len);
        Ok(())
    }

    /// Writes the bytes and how many they are; if they do not fit, only how many.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.fill(bytes.len(), |into| into.copy_from_slice(bytes))
    }
}
