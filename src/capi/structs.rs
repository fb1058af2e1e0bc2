//! Structures that grow: those that begin with their size and the ABI version.
//!
//! Fields are only ever appended, and zero means "default" or "not there". So a structure of an older header is a
//! prefix of ours. A structure of a newer header is sound if all that we do not know in it is zero.

use std::ffi::c_void;

use super::status::*;

/// Version of the ABI that this header describes.
pub const NVSP_ABI_VERSION: u32 = 1;
/// Version of the library that this header came with; nvsp_version gives that of the library in use. First number.
#[allow(dead_code)] // For C alone.
pub const NVSP_VERSION_MAJOR: u32 = 0;
/// Second number.
#[allow(dead_code)] // For C alone.
pub const NVSP_VERSION_MINOR: u32 = 1;
/// Third number.
#[allow(dead_code)] // For C alone.
pub const NVSP_VERSION_PATCH: u32 = 0;
/// The three in one number, for comparisons: 1,000,000 major + 1,000 minor + patch.
#[allow(dead_code)] // For C alone.
pub const NVSP_VERSION_NUMBER: u32 = 1000;

/// Bytes of the two fields that all these structures begin with.
const HEAD: usize = 8;
/// No header, however new, has a larger structure.
const MAX_SIZE: usize = 4096;

/// A structure with `struct_size` and `abi_version` in front.
///
/// # Safety
/// It is `#[repr(C)]` and begins with these two `u32`. It holds only numbers, pointers and arrays
/// of them, for which zero is a value.
pub(super) unsafe trait Versioned: Copy {
    /// Bytes that its first version had.
    const FIRST_SIZE: usize;
    /// Its name in C.
    const NAME: &'static str;
}

/// A count for C, which has 32 bits for it.
pub(super) fn number(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}

/// Zeroes a structure of `size` bytes, then writes its size and the caller's ABI version into it.
/// The structure then means all defaults. The macro NVSP_INIT calls this.
///
/// Fails with NVSP_ERR_NULL, NVSP_ERR_STRUCT_SIZE (size below 8 or above 4096) or
/// NVSP_ERR_ABI_VERSION.
///
/// # Safety
/// - `structure`: is zeroed. Yours, of `size` bytes. Not NULL.
/// - `size`: bytes of the structure, 8 to 4096.
/// - `abi_version`: NVSP_ABI_VERSION of your header.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_struct_init(
    structure: *mut c_void,
    size: usize,
    abi_version: u32,
) -> nvsp_status {
    if structure.is_null() {
        return NVSP_ERR_NULL;
    }
    if !(HEAD..=MAX_SIZE).contains(&size) {
        return NVSP_ERR_STRUCT_SIZE;
    }
    if abi_version != NVSP_ABI_VERSION {
        return NVSP_ERR_ABI_VERSION;
    }
    // SAFETY: the caller promises `size` bytes, of which there are at least eight; unaligned writes
    // need no alignment.
    unsafe {
        structure.cast::<u8>().write_bytes(0, size);
        structure.cast::<u32>().write_unaligned(size as u32);
        structure.cast::<u32>().add(1).write_unaligned(abi_version);
    }
    NVSP_OK
}

/// Checks a structure's head; its size.
///
/// # Safety
/// `structure` is null, or as large as its first field says.
unsafe fn check_head<T: Versioned>(structure: *const T) -> Result<usize, Failure> {
    // SAFETY: a structure has at least its head.
    let [size, abi_version] = unsafe { structure.cast::<[u32; 2]>().read_unaligned() };
    let size = size as usize;
    if !(T::FIRST_SIZE..=MAX_SIZE).contains(&size) {
        return Err(Failure::at(NVSP_ERR_STRUCT_SIZE, T::NAME));
    }
    if abi_version != NVSP_ABI_VERSION {
        return Err(Failure::at(NVSP_ERR_ABI_VERSION, T::NAME));
    }
    Ok(size)
}

/// Reads a structure of any version; NULL gives all defaults.
///
/// # Safety
/// As for [`check_head`].
pub(super) unsafe fn read<T: Versioned>(structure: *const T) -> Result<T, Failure> {
    // SAFETY: zero is a value of every field.
    let mut value: T = unsafe { std::mem::zeroed() };
    if structure.is_null() {
        return Ok(value);
    }
    // SAFETY: the caller promises `size` bytes. The known ones fit into `value`, whose fields take
    // any bytes.
    let unknown = unsafe {
        let size = check_head(structure)?;
        let known = size.min(size_of::<T>());
        let bytes = structure.cast::<u8>();
        (&raw mut value).cast::<u8>().copy_from_nonoverlapping(bytes, known);
        std::slice::from_raw_parts(bytes.add(known), size - known)
    };
    if unknown.iter().any(|b| *b != 0) {
        // The caller set a field that this version does not know. It must not be ignored.
        return Err(Failure::at(NVSP_ERR_STRUCT_SIZE, T::NAME));
    }
    Ok(value)
}

/// A checked place for a result.
pub(super) struct Out<T> {
    /// Null if the caller wants no result.
    place: *mut T,
    size: usize,
}

impl<T: Versioned> Out<T> {
    /// Checks a structure to write, before any work is done for it.
    ///
    /// # Safety
    /// As for [`check_head`], through the last use of the place.
    pub(super) unsafe fn new(place: *mut T) -> Result<Out<T>, Failure> {
        // SAFETY: as the caller promises.
        let size = if place.is_null() { 0 } else { unsafe { check_head(place)? } };
        Ok(Out { place, size })
    }

    /// As [`Out::new`], refusing NULL.
    ///
    /// # Safety
    /// As for [`Out::new`].
    pub(super) unsafe fn required(place: *mut T) -> Result<Out<T>, Failure> {
        if place.is_null() {
            return Err(Failure::null(T::NAME));
        }
        // SAFETY: as the caller promises.
        unsafe { Out::new(place) }
    }

    /// Writes the fields that the caller's version has. Fields that only the caller's version knows become zero.
    pub(super) fn write(&self, value: &T) {
        if self.place.is_null() {
            return;
        }
        let known = self.size.min(size_of::<T>());
        // SAFETY: `place` has `size` bytes, as the maker of this promised; the head stays.
        unsafe {
            let (from, to) = ((&raw const *value).cast::<u8>(), self.place.cast::<u8>());
            to.add(HEAD).copy_from_nonoverlapping(from.add(HEAD), known - HEAD);
            to.add(known).write_bytes(0, self.size - known);
        }
    }
}

/// Implements [`Versioned`] for a structure that has had `$first_size` bytes since its first version.
macro_rules! versioned {
    ($name:ident, $first_size:expr) => {
        // SAFETY: its definition stands above, with numbers and pointers only.
        unsafe impl crate::capi::structs::Versioned for $name {
            const FIRST_SIZE: usize = $first_size;
            const NAME: &'static str = stringify!($name);
        }
        #[cfg(target_pointer_width = "64")]
        const _: () = assert!(size_of::<$name>() == $first_size, "the size in this version");
    };
}
pub(super) use versioned;

#[cfg(test)]
mod tests {
    use super::*;

    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Sample {
        struct_size: u32,
        abi_version: u32,
        first: u32,
        later: u32,
    }

    // SAFETY: numbers only.
    unsafe impl Versioned for Sample {
        const FIRST_SIZE: usize = 12;
        const NAME: &'static str = "sample";
    }

    fn status<R>(result: Result<R, Failure>) -> Option<nvsp_status> {
        result.err().map(|failure| failure.status())
    }

    /// The words of a structure of a header.
    fn words<const N: usize>(fields: [u32; N]) -> [u32; N] {
        let mut words = fields;
        (words[0], words[1]) = (4 * N as u32, NVSP_ABI_VERSION);
        words
    }

    #[test]
    fn older_and_newer_headers_are_understood() {
        // SAFETY: every array is as large as its first word says.
        unsafe {
            let read = |words: *const u32| read(words.cast::<Sample>());
            assert_eq!(read(std::ptr::null()).unwrap().first, 0);
            let older = read(words([0, 0, 7]).as_ptr()).unwrap();
            assert_eq!((older.first, older.later), (7, 0));
            let newer = read(words([0, 0, 7, 8, 0]).as_ptr()).unwrap();
            assert_eq!((newer.first, newer.later), (7, 8));
            let unknown = read(words([0, 0, 7, 8, 1]).as_ptr());
            assert_eq!(status(unknown), Some(NVSP_ERR_STRUCT_SIZE));
            assert_eq!(status(read(words([0, 0]).as_ptr())), Some(NVSP_ERR_STRUCT_SIZE));
            let absurd = [u32::MAX, NVSP_ABI_VERSION];
            assert_eq!(status(read(absurd.as_ptr())), Some(NVSP_ERR_STRUCT_SIZE));
            let foreign = [16, NVSP_ABI_VERSION + 1, 7, 8];
            assert_eq!(status(read(foreign.as_ptr())), Some(NVSP_ERR_ABI_VERSION));
        }
    }

    #[test]
    fn results_stay_within_the_callers_structure() {
        let value = Sample { struct_size: 99, abi_version: 99, first: 5, later: 6 };
        let mut older = words([0, 0, 1]).to_vec();
        older.push(77);
        let mut newer = words([0, 0, 1, 2, 3, 4]);
        // SAFETY: both arrays are at least as large as their first word says.
        unsafe {
            Out::new(older.as_mut_ptr().cast::<Sample>()).unwrap().write(&value);
            Out::required(newer.as_mut_ptr().cast::<Sample>()).unwrap().write(&value);
            Out::<Sample>::new(std::ptr::null_mut()).unwrap().write(&value);
            let none = Out::<Sample>::required(std::ptr::null_mut());
            assert_eq!(status(none), Some(NVSP_ERR_NULL));
        }
        assert_eq!(older, [12, NVSP_ABI_VERSION, 5, 77]);
        assert_eq!(newer, [24, NVSP_ABI_VERSION, 5, 6, 0, 0]);
    }

    #[test]
    fn initialising_writes_the_size_it_was_given() {
        let mut words = [9u32; 4];
        let place = words.as_mut_ptr().cast();
        // SAFETY: room for sixteen bytes.
        unsafe {
            assert_eq!(nvsp_struct_init(place, 12, NVSP_ABI_VERSION), NVSP_OK);
            assert_eq!(words, [12, NVSP_ABI_VERSION, 0, 9]);
            assert_eq!(nvsp_struct_init(place, 7, NVSP_ABI_VERSION), NVSP_ERR_STRUCT_SIZE);
            assert_eq!(nvsp_struct_init(place, 12, 0), NVSP_ERR_ABI_VERSION);
            let null = std::ptr::null_mut();
            assert_eq!(nvsp_struct_init(null, 12, NVSP_ABI_VERSION), NVSP_ERR_NULL);
        }
    }
}
