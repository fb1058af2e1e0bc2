//! Structures that grow: those that begin with their size and the ABI version.
//!
//! Fields are only ever appended, and zero means "default" or "not there". So a structure of an older header is a
//! prefix of ours. A structure of a newer header is valid if all that we do not know in it is zero.

use std::ffi::c_void;

use super::status::*;

/// Version of the ABI that this header describes.
pub const NVSP_ABI_VERSION: u32 = 1;
/// Version of the library that this header came with; nvsp_version tells that of the library in use. First number.
#[allow(dead_code)] // For C alone.
pub const NVSP_VERSION_MAJOR: u32 = 1;
/// Second number.
#[allow(dead_code)] // For C alone.
pub const NVSP_VERSION_MINOR: u32 = 0;
/// Third number.
#[allow(dead_code)] // For C alone.
pub const NVSP_VERSION_PATCH: u32 = 0;
/// The three in one number, for comparisons: 1,000,000 major + 1,000 minor + patch.
pub const NVSP_VERSION_NUMBER: u32 = 1_000_000;

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

/// What a caller's callbacks are called with.
#[derive(Clone, Copy, Debug)]
pub(super) struct User(pub *mut c_void);

// SAFETY: passed on as it is. The header asks for callbacks that may be called, with their pointer, on any thread and
// on several at once.
unsafe impl Send for User {}
// SAFETY: as for `Send`.
unsafe impl Sync for User {}

/// A count for C, which has 32 bits for it.
pub(super) fn number(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}

/// Zeroes a structure of `size` bytes, then writes its size and the caller's ABI version into it.
/// The structure then means all defaults. The macro NVSP_INIT calls this.
///
/// Fails with NVSP_ERR_STRUCTURE (size below 8 or above 4096, or another ABI version).
///
/// # Safety
/// - `structure`: is zeroed.
/// - `size`: bytes of the structure, 8 to 4096.
/// - `abi_version`: NVSP_ABI_VERSION of your header.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nvsp_struct_init(
    structure: *mut c_void,
    size: usize,
    abi_version: u32,
) -> nvsp_status {
    if structure.is_null() {
        return NVSP_ERR_ARGUMENT;
    }
    if !(HEAD..=MAX_SIZE).contains(&size) || abi_version != NVSP_ABI_VERSION {
        return NVSP_ERR_STRUCTURE;
    }
    // SAFETY: `size` bytes stand at `structure`, see `# Safety`: eight or more. Unaligned writes need no alignment.
    unsafe {
        structure.cast::<u8>().write_bytes(0, size);
        structure.cast::<u32>().write_unaligned(size as u32);
        structure.cast::<u32>().add(1).write_unaligned(abi_version);
    }
    NVSP_OK
}

/// All defaults.
pub(super) fn zeroed<T: Versioned>() -> T {
    // SAFETY: zero is a value of every field, as `Versioned` says.
    unsafe { std::mem::zeroed() }
}

/// A structure to read: NULL, or as large as its first field says, which the header asks of every caller. Only C makes
/// one.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct In<T>(*const T);

impl<T: Versioned> In<T> {
    /// No structure.
    pub(super) fn none() -> In<T> {
        In(std::ptr::null())
    }

    pub(super) fn is_null(self) -> bool {
        self.0.is_null()
    }

    /// Checks the structure's head; its size.
    fn check_head(self) -> Result<usize, Failure> {
        // SAFETY: not null, as `optional` and `Out::optional` check; a structure has at least its head.
        let [size, abi_version] = unsafe { self.0.cast::<[u32; 2]>().read_unaligned() };
        let size = size as usize;
        if !(T::FIRST_SIZE..=MAX_SIZE).contains(&size) || abi_version != NVSP_ABI_VERSION {
            return Err(Failure::at(NVSP_ERR_STRUCTURE, T::NAME));
        }
        Ok(size)
    }

    /// Reads a structure of any version; NULL gives all defaults.
    pub(super) fn read(self) -> Result<T, Failure> {
        Ok(self.optional()?.unwrap_or_else(zeroed))
    }

    /// As [`In::read`], refusing NULL.
    pub(super) fn required(self) -> Result<T, Failure> {
        self.optional()?.ok_or(Failure::null(T::NAME))
    }

    /// As [`In::read`]; NULL gives nothing.
    pub(super) fn optional(self) -> Result<Option<T>, Failure> {
        if self.is_null() {
            return Ok(None);
        }
        let (size, mut value) = (self.check_head()?, zeroed::<T>());
        // SAFETY: the structure has `size` bytes. The known ones fit into `value`, whose fields take any bytes.
        let unknown = unsafe {
            let known = size.min(size_of::<T>());
            let bytes = self.0.cast::<u8>();
            (&raw mut value).cast::<u8>().copy_from_nonoverlapping(bytes, known);
            std::slice::from_raw_parts(bytes.add(known), size - known)
        };
        if unknown.iter().any(|b| *b != 0) {
            // The caller set a field that this version does not know. It must not be ignored.
            return Err(Failure::at(NVSP_ERR_STRUCTURE, T::NAME));
        }
        Ok(Some(value))
    }
}

/// A structure to write, as [`In`] is one to read.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct Out<T>(*mut T);

impl<T: Versioned> Out<T> {
    pub(super) fn is_null(self) -> bool {
        self.0.is_null()
    }

    /// What the caller has set in it.
    pub(super) fn given(self) -> In<T> {
        In(self.0)
    }

    /// Checks the structure before any work is done for it. NULL: the caller wants no result.
    pub(super) fn optional(self) -> Result<Checked<T>, Failure> {
        let size = if self.is_null() { 0 } else { self.given().check_head()? };
        Ok(Checked { place: self.0, size })
    }

    /// As [`Out::optional`], refusing NULL.
    pub(super) fn required(self) -> Result<Checked<T>, Failure> {
        if self.is_null() {
            return Err(Failure::null(T::NAME));
        }
        self.optional()
    }
}

/// A checked structure for a result.
pub(super) struct Checked<T> {
    /// Null if the caller wants no result.
    place: *mut T,
    size: usize,
}

impl<T: Versioned> Checked<T> {
    /// Writes the fields that the caller's version has. Fields that only the caller's version knows become zero.
    pub(super) fn write(&self, value: &T) {
        if self.place.is_null() {
            return;
        }
        let known = self.size.min(size_of::<T>());
        // SAFETY: `place` has `size` bytes, as `Out` says; the head stays.
        unsafe {
            let (from, to) = ((&raw const *value).cast::<u8>(), self.place.cast::<u8>());
            to.add(HEAD).copy_from_nonoverlapping(from.add(HEAD), known - HEAD);
            to.add(known).write_bytes(0, self.size - known);
        }
    }
}

/// A place for a number or a handle: NULL, or room for one, which the header asks of every caller. Only C makes one.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct Place<T>(*mut T);

impl<T> Place<T> {
    /// Refuses NULL.
    pub(super) fn required(self, name: &'static str) -> Result<Place<T>, Failure> {
        if self.0.is_null() { Err(Failure::null(name)) } else { Ok(self) }
    }

    /// Writes the value, unless the place is NULL.
    pub(super) fn write(self, value: T) {
        if !self.0.is_null() {
            // SAFETY: not null, so there is room, as the type says. What the place held is no value of ours.
            unsafe { self.0.write(value) };
        }
    }
}

/// Implements [`Versioned`] for a structure that had `$first_size` bytes in its first version, and has `$size` now.
macro_rules! versioned {
    ($name:ident, $size:expr) => {
        // SAFETY: its definition stands above, with numbers and pointers only.
        unsafe impl crate::structs::Versioned for $name {
            const FIRST_SIZE: usize = $size;
            const NAME: &'static str = stringify!($name);
        }
        #[cfg(target_pointer_width = "64")]
        const _: () = assert!(size_of::<$name>() == $size, "the size in this version");
    };
}
pub(super) use versioned;

/// A bit of a structure's flags, if it is set.
pub(super) fn flag(set: bool, bit: u32) -> u32 {
    if set { bit } else { 0 }
}

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
        let read = |words: *const u32| In(words.cast::<Sample>()).read();
        assert_eq!(read(std::ptr::null()).unwrap().first, 0);
        let older = read(words([0, 0, 7]).as_ptr()).unwrap();
        assert_eq!((older.first, older.later), (7, 0));
        let newer = read(words([0, 0, 7, 8, 0]).as_ptr()).unwrap();
        assert_eq!((newer.first, newer.later), (7, 8));
        let unknown = read(words([0, 0, 7, 8, 1]).as_ptr());
        assert_eq!(status(unknown), Some(NVSP_ERR_STRUCTURE));
        assert_eq!(status(read(words([0, 0]).as_ptr())), Some(NVSP_ERR_STRUCTURE));
        let absurd = [u32::MAX, NVSP_ABI_VERSION];
        assert_eq!(status(read(absurd.as_ptr())), Some(NVSP_ERR_STRUCTURE));
        let foreign = [16, NVSP_ABI_VERSION + 1, 7, 8];
        assert_eq!(status(read(foreign.as_ptr())), Some(NVSP_ERR_STRUCTURE));
        assert_eq!(status(In::<Sample>(std::ptr::null()).required()), Some(NVSP_ERR_ARGUMENT));
    }

    #[test]
    fn results_stay_within_the_callers_structure() {
        let value = Sample { struct_size: 99, abi_version: 99, first: 5, later: 6 };
        let mut older = words([0, 0, 1]).to_vec();
        older.push(77);
        let mut newer = words([0, 0, 1, 2, 3, 4]);
        Out(older.as_mut_ptr().cast::<Sample>()).optional().unwrap().write(&value);
        Out(newer.as_mut_ptr().cast::<Sample>()).required().unwrap().write(&value);
        let none = Out::<Sample>(std::ptr::null_mut());
        none.optional().unwrap().write(&value);
        assert_eq!(status(none.required()), Some(NVSP_ERR_ARGUMENT));
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
            assert_eq!(nvsp_struct_init(place, 7, NVSP_ABI_VERSION), NVSP_ERR_STRUCTURE);
            assert_eq!(nvsp_struct_init(place, 12, 0), NVSP_ERR_STRUCTURE);
            let null = std::ptr::null_mut();
            assert_eq!(nvsp_struct_init(null, 12, NVSP_ABI_VERSION), NVSP_ERR_ARGUMENT);
        }
    }
}
