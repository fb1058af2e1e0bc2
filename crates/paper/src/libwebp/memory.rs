//! The memory that libwebp works in.
//!
//! Libwebp takes and returns memory only through the few functions of its `src/utils/utils.c`. This
//! file defines them instead. A linker takes an archive's member only for a symbol that is still
//! missing, and no symbol of that file is missing. (If one were, both definitions would be linked
//! and clash: the build would fail, and not allocate unseen.)

use std::cell::Cell;
use std::ffi::{c_int, c_void};
use std::mem::MaybeUninit;
use std::ptr::null_mut;

// Visible in this library only. If they were exported, they would replace those of the process's own libwebp.
#[cfg(target_os = "linux")]
std::arch::global_asm!(
    ".hidden WebPSafeMalloc",
    ".hidden WebPSafeCalloc",
    ".hidden WebPSafeFree",
    ".hidden WebPMalloc",
    ".hidden WebPFree",
    ".hidden WebPCopyPlane",
    ".hidden WebPCopyPixels",
);

/// Alignment of every block, bytes: that of a SIMD register of libwebp's kernels.
const ALIGN: usize = 32;

/// What an arena is made of.
#[repr(C, align(32))]
#[derive(Clone, Copy)]
struct Unit(MaybeUninit<[u8; ALIGN]>);

/// Memory for one call of libwebp at a time. Blocks follow one another, and all are freed at the end of the call.
pub struct Arena {
    units: Vec<Unit>,
    /// Units in use.
    used: usize,
    /// Most units ever in use.
    #[cfg(test)]
    peak: usize,
    /// Blocks that did not fit and came from the heap, over all calls.
    #[cfg(test)]
    spilled: usize,
}

thread_local! {
    /// The arena lent to libwebp on this thread; null outside of [`Arena::lend`].
    static LENT: Cell<*mut Arena> = const { Cell::new(null_mut()) };
}

impl Arena {
    /// The system gives memory when it is first touched, so a large capacity costs nothing.
    pub fn with_capacity(bytes: usize) -> Arena {
        let count = bytes.div_ceil(ALIGN);
        let mut units = Vec::with_capacity(count);
        // SAFETY: the capacity is there, and a unit needs no initialisation.
        unsafe { units.set_len(count) };
        Arena {
            units,
            used: 0,
            #[cfg(test)]
            peak: 0,
            #[cfg(test)]
            spilled: 0,
        }
    }

    /// Calls libwebp through `work`, with all of its blocks in this arena. The blocks end with the
    /// call: `work` must free or forget them all.
    pub fn lend<R>(&mut self, work: impl FnOnce() -> R) -> R {
        struct Return(*mut Arena);
        impl Drop for Return {
            fn drop(&mut self) {
                LENT.set(self.0);
            }
        }
        self.used = 0;
        let _before = Return(LENT.replace(self));
        work()
    }

    /// Most bytes that a call took.
    #[cfg(test)]
    pub fn peak(&self) -> usize {
        self.peak * ALIGN
    }

    /// Blocks that did not fit and came from the heap.
    #[cfg(test)]
    pub fn spilled(&self) -> usize {
        self.spilled
    }

    fn take(&mut self, bytes: usize) -> *mut c_void {
        let count = bytes.div_ceil(ALIGN);
        // Fuzzers see an overrun of a block of the heap, but not of a block in the arena.
        if cfg!(fuzzing) || count > self.units.len() - self.used {
            #[cfg(test)]
            {
                self.spilled += 1;
            }
            return null_mut();
        }
        let block = &mut self.units[self.used..];
        self.used += count;
        #[cfg(test)]
        {
            self.peak = self.peak.max(self.used);
        }
        block.as_mut_ptr().cast()
    }

    fn holds(&self, block: *const c_void) -> bool {
        self.units.as_ptr_range().contains(&block.cast::<Unit>())
    }
}

/// Runs `with` on the arena lent on this thread, if one is.
fn lent<R>(with: impl FnOnce(&mut Arena) -> R) -> Option<R> {
    // SAFETY: `lend` holds the arena borrowed for as long as the pointer stands here, and its
    // thread is inside libwebp, so nothing else uses it.
    unsafe { LENT.get().as_mut() }.map(with)
}

/// Size of an array; `None` if it is absurd.
fn size_of_array(count: u64, size: usize) -> Option<usize> {
    let bytes = usize::try_from(count).ok()?.checked_mul(size)?;
    (bytes <= isize::MAX as usize / 2).then_some(bytes)
}

/// Takes a block for libwebp.
///
/// # Safety
/// Any arguments do; the block is returned by [`WebPSafeFree`].
#[unsafe(no_mangle)]
unsafe extern "C" fn WebPSafeMalloc(count: u64, size: usize) -> *mut c_void {
    let Some(bytes) = size_of_array(count, size) else { return null_mut() };
    match lent(|arena| arena.take(bytes)) {
        Some(block) if !block.is_null() => block,
        // SAFETY: any size does.
        _ => unsafe { libc::malloc(bytes) },
    }
}

/// As [`WebPSafeMalloc`], zeroed.
///
/// # Safety
/// As for [`WebPSafeMalloc`].
#[unsafe(no_mangle)]
unsafe extern "C" fn WebPSafeCalloc(count: u64, size: usize) -> *mut c_void {
    // SAFETY: any arguments do, and the block has as many bytes as are zeroed.
    unsafe {
        let block = WebPSafeMalloc(count, size);
        if !block.is_null() {
            block.cast::<u8>().write_bytes(0, count as usize * size);
        }
        block
    }
}

/// Returns a block. A block of the arena stays there until the call ends.
///
/// # Safety
/// `block` is null or came from [`WebPSafeMalloc`] and was not freed since.
#[unsafe(no_mangle)]
unsafe extern "C" fn WebPSafeFree(block: *mut c_void) {
    if lent(|arena| arena.holds(block)) != Some(true) {
        // SAFETY: not of the arena, so of `malloc`.
        unsafe { libc::free(block) }
    }
}

/// The public name of [`WebPSafeMalloc`].
///
/// # Safety
/// As for [`WebPSafeMalloc`].
#[unsafe(no_mangle)]
unsafe extern "C" fn WebPMalloc(size: usize) -> *mut c_void {
    // SAFETY: as the caller promises.
    unsafe { WebPSafeMalloc(1, size) }
}

/// The public name of [`WebPSafeFree`].
///
/// # Safety
/// As for [`WebPSafeFree`].
#[unsafe(no_mangle)]
unsafe extern "C" fn WebPFree(block: *mut c_void) {
    // SAFETY: as the caller promises.
    unsafe { WebPSafeFree(block) }
}

/// Copies a plane. It is here because libwebp's file of the memory functions has it too.
///
/// # Safety
/// Both planes hold `height` rows of `width` bytes, a stride apart, and do not overlap.
#[unsafe(no_mangle)]
unsafe extern "C" fn WebPCopyPlane(
    mut from: *const u8,
    from_stride: c_int,
    mut to: *mut u8,
    to_stride: c_int,
    width: c_int,
    height: c_int,
) {
    for _ in 0..height {
        // SAFETY: as the caller promises; past the last row nothing is read.
        unsafe {
            to.copy_from_nonoverlapping(from, width as usize);
            from = from.wrapping_offset(from_stride as isize);
            to = to.wrapping_offset(to_stride as isize);
        }
    }
}

/// Copies the pixels of a picture of 32-bit pixels; as [`WebPCopyPlane`].
///
/// # Safety
/// Both pictures have their pixels in `argb` and the same size.
#[unsafe(no_mangle)]
unsafe extern "C" fn WebPCopyPixels(
    from: *const libwebp_sys::WebPPicture,
    to: *mut libwebp_sys::WebPPicture,
) {
    // SAFETY: as the caller promises.
    unsafe {
        let (from, to) = (&*from, &*to);
        let (source, target) = (from.argb.cast(), to.argb.cast());
        let (width, height) = (4 * from.width, from.height);
        WebPCopyPlane(source, 4 * from.argb_stride, target, 4 * to.argb_stride, width, height);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_aligned_apart_and_end_with_the_call() {
        let mut arena = Arena::with_capacity(1000);
        for _ in 0..3 {
            arena.lend(|| {
                // SAFETY: plain use of an allocator; every block is written within its size.
                unsafe {
                    let a = WebPSafeMalloc(3, 33).cast::<u8>();
                    let b = WebPSafeCalloc(1, 64).cast::<u8>();
                    assert_eq!((a as usize % ALIGN, b as usize % ALIGN), (0, 0));
                    assert_eq!(b as usize - a as usize, 128);
                    a.write_bytes(7, 99);
                    assert!((0..64).all(|i| *b.add(i) == 0));
                    b.write_bytes(7, 64);
                    WebPSafeFree(a.cast());
                    WebPSafeFree(b.cast());
                }
            });
        }
        assert_eq!((arena.peak(), arena.spilled()), (192, 0));
    }

    #[test]
    fn what_does_not_fit_comes_from_the_heap() {
        let mut arena = Arena::with_capacity(64);
        // SAFETY: every block is freed once, and written within its size.
        unsafe {
            let outside = WebPMalloc(10);
            arena.lend(|| {
                let large = WebPMalloc(1 << 20);
                large.cast::<u8>().write_bytes(1, 1 << 20);
                WebPFree(large);
                WebPFree(null_mut());
                WebPFree(outside);
                assert!(WebPSafeMalloc(u64::MAX, 2).is_null());
                assert!(WebPSafeCalloc(u64::MAX / 2, 2).is_null());
            });
        }
        assert_eq!((arena.peak(), arena.spilled()), (0, 1));
    }
}
